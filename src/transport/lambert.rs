//! Lambert's closed form: the form factor from a point to a polygon of constant radiosity.
//!
//! `F(x) = |1/(2π) Σ_i Θ_i n·Γ_i|` over the edges, `Γ_i = (v_i × v_{i+1})/|v_i × v_{i+1}|`, `Θ_i` the angle between `v_i` and
//! `v_{i+1}` as seen from x, after clipping at the horizon of x.

use std::f64::consts::PI;

use glam::DVec3;
use wide::f64x4;

use crate::math::lanes::{DVec3x4, LANES};

/// The unoccluded form factor from point `x` with unit normal `n` to `polygon`, counter-clockwise seen from its front; 0 when x lies behind
/// the polygon. Concave polygons and bridge edges are fine: the sum is a contour integral.
pub fn form_factor(x: DVec3, n: DVec3, polygon: impl Iterator<Item = DVec3> + Clone) -> f64 {
    let corners = polygon.map(|p| p - x);
    if let Some(sum) = quadrilateral_above(n, corners.clone()) {
        return share(sum);
    }
    let mut contour = Contour::new(n);
    let mut previous: Option<(DVec3, f64)> = None;
    let close = corners.clone().next();
    for v in corners.chain(close) {
        let height = n.dot(v);
        if let Some((a, height_a)) = previous {
            if height_a >= 0.0 {
                contour.push(a);
            }
            if (height_a > 0.0 && height < 0.0) || (height_a < 0.0 && height > 0.0) {
                contour.push(a + (v - a) * (height_a / (height_a - height)));
            }
        }
        previous = Some((v, height));
    }
    share(contour.close())
}

/// Seen from its front, a counter-clockwise polygon runs clockwise around the upward normal of x.
fn share(sum: f64) -> f64 {
    (-sum / (2.0 * PI)).clamp(0.0, 1.0)
}

/// The sum over the edges of a polygon of four corners above the horizon, which most are; `None` for others.
fn quadrilateral_above(n: DVec3, mut corners: impl Iterator<Item = DVec3>) -> Option<f64> {
    let [p, q, r, s] = [corners.next()?, corners.next()?, corners.next()?, corners.next()?];
    let ends = DVec3x4::new(&[p, q, r, s]);
    let is_above = DVec3x4::splat(n).dot(&ends).simd_ge(f64x4::ZERO).all();
    (is_above && corners.next().is_none()).then(|| terms(n, &ends, &DVec3x4::new(&[q, r, s, p])).iter().sum())
}

/// The terms of four edges; 0 for those that have no angle.
#[inline]
fn terms(n: DVec3, a: &DVec3x4, b: &DVec3x4) -> [f64; LANES] {
    let cross = a.cross(b);
    let length = cross.length_squared().sqrt();
    let angle = length.atan2(a.dot(b));
    ((angle * DVec3x4::splat(n).dot(&cross) / length) & length.simd_gt(f64x4::ZERO)).to_array()
}

/// The sum over a contour's edges, found for four edges side by side.
struct Contour {
    n: DVec3,
    first: Option<DVec3>,
    last: DVec3,
    /// Ends of the edges that are still to be added.
    edges: [[DVec3; LANES]; 2],
    count: usize,
    sum: f64,
}

impl Contour {
    fn new(n: DVec3) -> Self {
        Self { n, first: None, last: DVec3::ZERO, edges: [[DVec3::ZERO; LANES]; 2], count: 0, sum: 0.0 }
    }

    #[inline]
    fn push(&mut self, v: DVec3) {
        if self.first.is_none() {
            self.first = Some(v);
        } else {
            self.edge(self.last, v);
        }
        self.last = v;
    }

    #[inline]
    fn edge(&mut self, a: DVec3, b: DVec3) {
        (self.edges[0][self.count], self.edges[1][self.count]) = (a, b);
        self.count += 1;
        if self.count == LANES {
            self.add();
        }
    }

    /// Adds the edges that are there.
    fn add(&mut self) {
        let (a, b) = (DVec3x4::new(&self.edges[0]), DVec3x4::new(&self.edges[1]));
        self.sum += terms(self.n, &a, &b)[..self.count].iter().sum::<f64>();
        self.count = 0;
    }

    fn close(&mut self) -> f64 {
        if let Some(first) = self.first {
            self.edge(self.last, first);
        }
        if self.count > 0 {
            self.add();
        }
        self.sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(corners: &[(f64, f64, f64)]) -> Vec<DVec3> {
        corners.iter().map(|(x, y, z)| DVec3::new(*x, *y, *z)).collect()
    }

    /// Closed form of a parallel rectangle above a corner, a = w/h, b = d/h.
    fn parallel(a: f64, b: f64) -> f64 {
        let (ra, rb) = ((1.0 + a * a).sqrt(), (1.0 + b * b).sqrt());
        (a / ra * (b / ra).atan() + b / rb * (a / rb).atan()) / (2.0 * PI)
    }

    proptest! {
        #[test]
        fn parallel_rectangle_above_its_corner(w in 0.01..20.0f64, d in 0.01..20.0f64, h in 0.01..20.0f64) {
            // Its front looks down at the origin: counter-clockwise from below.
            let polygon = at(&[(0.0, 0.0, h), (0.0, d, h), (w, d, h), (w, 0.0, h)]);
            let f = form_factor(DVec3::ZERO, DVec3::Z, polygon.iter().copied());
            prop_assert!((f - parallel(w / h, d / h)).abs() < 1e-14);
        }

        #[test]
        fn perpendicular_rectangle_opposite_its_foot(l in 0.01..20.0f64, h in 0.01..20.0f64, c in 0.01..20.0f64) {
            // It stands at x = c and looks towards −x.
            let polygon = at(&[(c, 0.0, 0.0), (c, 0.0, h), (c, l, h), (c, l, 0.0)]);
            let f = form_factor(DVec3::ZERO, DVec3::Z, polygon.iter().copied());
            let root = (h * h + c * c).sqrt();
            let exact = ((l / c).atan() - c / root * (l / root).atan()) / (2.0 * PI);
            prop_assert!((f - exact).abs() < 1e-14);
        }

        #[test]
        fn a_polygon_below_the_horizon_counts_as_its_upper_part(z in 0.05..0.95f64, h in 0.1..3.0f64) {
            let whole = at(&[(1.0, -1.0, -z), (1.0, -1.0, h), (1.0, 1.0, h), (1.0, 1.0, -z)]);
            let upper = at(&[(1.0, -1.0, 0.0), (1.0, -1.0, h), (1.0, 1.0, h), (1.0, 1.0, 0.0)]);
            let f = |p: &[DVec3]| form_factor(DVec3::ZERO, DVec3::Z, p.iter().copied());
            prop_assert!((f(&whole) - f(&upper)).abs() < 1e-14);
        }
    }

    #[test]
    fn concave_polygon_cut_by_the_horizon_is_the_sum_of_its_parts() {
        // A U lying on its side: the horizon cuts it into two pieces.
        let u = at(&[
            (1.0, 3.0, 1.0),
            (1.0, 3.0, -1.0),
            (1.0, -3.0, -1.0),
            (1.0, -3.0, 1.0),
            (1.0, -1.0, 1.0),
            (1.0, -1.0, -0.5),
            (1.0, 1.0, -0.5),
            (1.0, 1.0, 1.0),
        ]);
        let left = at(&[(1.0, 3.0, 1.0), (1.0, 3.0, 0.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0)]);
        let right = at(&[(1.0, -1.0, 1.0), (1.0, -1.0, 0.0), (1.0, -3.0, 0.0), (1.0, -3.0, 1.0)]);
        let f = |p: &[DVec3]| form_factor(DVec3::ZERO, DVec3::Z, p.iter().copied());
        assert!(f(&left) > 0.01);
        assert!((f(&u) - f(&left) - f(&right)).abs() < 1e-15);
    }

    #[test]
    fn seen_from_behind_it_is_nothing() {
        let polygon = at(&[(0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, 1.0), (0.0, 1.0, 1.0)]);
        assert_eq!(form_factor(DVec3::ZERO, DVec3::Z, polygon.iter().copied()), 0.0);
    }
}
