//! Planar polygons in two dimensions: area, clipping to a cell, point tests, moments.
//!
//! Polygons may be concave and may reach holes by bridge edges. Clipping is Sutherland–Hodgman's; where it cuts a concave
//! polygon in pieces it leaves them joined by edges that run there and back along the clip line, which cancel in every contour
//! integral taken here and in Lambert's formula.

use std::borrow::Cow;

use glam::DVec2;
use wide::f64x4;

use super::basis::{Basis, MAX_FUNCTIONS, legendre};
use super::cell::Cell;
use super::quadrature::gauss;

/// How far points keep off a polygon's corners and off its edges, as shares of the edge: inside of all but the sharpest corners.
const OFF_CORNERS: f64 = 1e-3;
const OFF_EDGES: f64 = 0.2 * OFF_CORNERS;

/// Parameters this near to a line lie on it but for rounding.
const ON_LINE: f64 = 1e-12;

/// Signed area, positive when counter-clockwise.
pub fn area(polygon: &[DVec2]) -> f64 {
    edges(polygon).map(|(a, b)| a.perp_dot(b)).sum::<f64>() * 0.5
}

/// The centre of its area, from its signed `area`, which must not be 0. Corners that rounding repeats do not move it.
pub fn centroid(polygon: &[DVec2], area: f64) -> DVec2 {
    let origin = polygon[0];
    let moment = edges(polygon).map(|(a, b)| {
        let (a, b) = (a - origin, b - origin);
        a.perp_dot(b) * (a + b)
    });
    origin + moment.sum::<DVec2>() / (6.0 * area)
}

/// The edges, closing one last.
pub fn edges(polygon: &[DVec2]) -> impl Iterator<Item = (DVec2, DVec2)> + '_ {
    let n = polygon.len();
    (0..n).map(move |i| (polygon[i], polygon[(i + 1) % n]))
}

/// The part of `polygon` with `side(p) ≥ 0`, for an affine `side`. Corners on the line but for rounding count as on it.
pub fn clip_half_plane(polygon: &[DVec2], side: impl Fn(DVec2) -> f64) -> Vec<DVec2> {
    let mut out = Vec::with_capacity(polygon.len() + 4);
    let side = |p: DVec2| {
        let side = side(p);
        if side.abs() <= ON_LINE { 0.0 } else { side }
    };
    for (a, b) in edges(polygon) {
        let (da, db) = (side(a), side(b));
        if da >= 0.0 {
            out.push(a);
        }
        if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
            out.push(a + (b - a) * (da / (da - db)));
        }
    }
    out
}

/// The part of `polygon` inside `cell`, in the same coordinates; empty where they do not overlap.
pub fn clip_to_cell(polygon: &[DVec2], cell: &Cell) -> Vec<DVec2> {
    let (low, high) = (cell.low, cell.low + cell.size);
    let mut part = Cow::Borrowed(polygon);
    let mut clip = |side: &dyn Fn(DVec2) -> f64| {
        // Most polygons lie on one side of most lines.
        if part.iter().any(|p| side(*p) < 0.0) {
            part = Cow::Owned(clip_half_plane(&part, side));
        }
    };
    clip(&|p| p.x - low.x);
    clip(&|p| high.x - p.x);
    clip(&|p| p.y - low.y);
    clip(&|p| high.y - p.y);
    part.into_owned()
}

/// Whether `point` lies inside, by the even–odd rule.
pub fn contains(polygon: &[DVec2], point: DVec2) -> bool {
    let mut inside = false;
    for (a, b) in edges(polygon) {
        if (a.y > point.y) != (b.y > point.y) {
            let x = a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x);
            inside ^= point.x < x;
        }
    }
    inside
}

/// The point of the boundary nearest to `point`, distances measured after mapping by `metric` (parameters → metres, linear).
pub fn nearest_on_boundary(polygon: &[DVec2], point: DVec2, metric: impl Fn(DVec2) -> f64) -> DVec2 {
    let mut best = (f64::INFINITY, point);
    for (a, b) in edges(polygon) {
        let candidate = a + (b - a) * nearest_on_edge((a, b), point, &metric);
        let distance = metric(candidate - point);
        if distance < best.0 {
            best = (distance, candidate);
        }
    }
    best.1
}

/// How far along an edge the point nearest to `point` lies, from 0 to 1.
fn nearest_on_edge((a, b): (DVec2, DVec2), point: DVec2, metric: impl Fn(DVec2) -> f64) -> f64 {
    // Squared length is a quadratic along the edge: its minimum from three values, exact for a linear metric.
    let (d0, d1, dm) = (metric(a - point), metric(b - point), metric((a + b) * 0.5 - point));
    let curvature = 2.0 * (d0 - 2.0 * dm + d1);
    if curvature > 0.0 { ((d0 - d1) / (2.0 * curvature) + 0.5).clamp(0.0, 1.0) } else { 0.0 }
}

/// A point inside a counter-clockwise polygon that is about as near as any to `point` outside of it. It keeps off edges and corners, so that
/// rounding does not decide on which side of other edges, and of planes through them, it lies; edges that run there and back have no inside.
/// On the boundary where the polygon is too narrow for that.
pub fn nearest_inside(polygon: &[DVec2], point: DVec2, metric: impl Fn(DVec2) -> f64) -> DVec2 {
    let mut best = (f64::INFINITY, None);
    for (a, b) in edges(polygon) {
        let along = nearest_on_edge((a, b), point, &metric).clamp(OFF_CORNERS, 1.0 - OFF_CORNERS);
        let foot = a + (b - a) * along;
        let distance = metric(foot - point);
        let inside = foot + (b - a).perp() * OFF_EDGES;
        if distance < best.0 && contains(polygon, inside) {
            best = (distance, Some(inside));
        }
    }
    best.1.unwrap_or_else(|| nearest_on_boundary(polygon, point, metric))
}

/// `∫ φ_a` over the polygon given in a cell's own unit square, for every function of `basis`; `[0]` is its signed area.
///
/// By Green's theorem on the triangles spanned by the first corner and each edge, each integrated exactly by a collapsed Gauss rule: functions
/// of `k` by `k` reach degree `2k − 2`, with the Jacobian `2k − 1`.
pub fn moments(polygon: &[DVec2], basis: Basis) -> [f64; MAX_FUNCTIONS] {
    let k = basis.order();
    let (nodes, weights) = gauss(k);
    let anchor = polygon.first().copied().unwrap_or_default();
    // Of the functions that have the same factor in x, those of each factor in y side by side.
    let mut sums = [f64x4::ZERO; 3];
    for (a, b) in edges(polygon) {
        let jacobian = (a - anchor).perp_dot(b - anchor);
        if jacobian == 0.0 {
            continue;
        }
        for (s, ws) in nodes.iter().zip(weights) {
            for (t, wt) in nodes.iter().zip(weights) {
                // Collapsed square: the point anchor + s((1 − t)a + t b), Jacobian s.
                let point = anchor + *s * (a - anchor + *t * (b - a));
                let (x, y) = (legendre(point.x), f64x4::from(legendre(point.y)));
                let weight = f64x4::splat(jacobian * s * ws * wt);
                for (sum, x) in sums[..k].iter_mut().zip(x) {
                    *sum += weight * (f64x4::splat(x) * y);
                }
            }
        }
    }
    let mut moments = [0.0; MAX_FUNCTIONS];
    for i in 0..k {
        moments[i * k..][..k].copy_from_slice(&sums[i].to_array()[..k]);
    }
    moments
}

#[cfg(test)]
mod tests {
    use super::*;

    fn concave() -> Vec<DVec2> {
        [(0.0, 0.0), (1.0, 0.0), (1.0, 0.4), (0.4, 0.4), (0.4, 1.0), (0.0, 1.0)]
            .map(|(x, y)| DVec2::new(x, y))
            .to_vec()
    }

    #[test]
    fn clipped_parts_add_up_to_the_whole() {
        let polygon = concave();
        let mut total = 0.0;
        for i in 0..8 {
            for j in 0..8 {
                let cell = Cell { low: DVec2::new(i as f64, j as f64) / 8.0, size: DVec2::splat(0.125) };
                total += area(&clip_to_cell(&polygon, &cell));
            }
        }
        assert!((total - area(&polygon)).abs() < 1e-14);
    }

    #[test]
    fn the_centroid_stays_where_corners_repeat() {
        let polygon = concave();
        // Of the lower bar, 1 by 0.4, and of what stands on it, 0.4 by 0.6.
        let expected = (0.4 * DVec2::new(0.5, 0.2) + 0.24 * DVec2::new(0.2, 0.7)) / 0.64;
        assert!((centroid(&polygon, area(&polygon)) - expected).length() < 1e-14);
        let mut repeated = polygon;
        repeated.insert(2, repeated[2] - DVec2::new(0.0, 1e-16));
        repeated.insert(0, repeated[0]);
        assert!((centroid(&repeated, area(&repeated)) - expected).length() < 1e-14);
        repeated.reverse();
        assert!((centroid(&repeated, area(&repeated)) - expected).length() < 1e-14, "clockwise");
    }

    #[test]
    fn moments_of_the_whole_cell_are_those_of_orthonormal_functions() {
        let unit = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec2::new(x, y));
        let m = moments(&unit, Basis::M3);
        assert!((m[0] - 1.0).abs() < 1e-14);
        assert!(m[1..].iter().all(|v| v.abs() < 1e-14), "{m:?}");
    }

    #[test]
    fn moments_of_an_l_are_the_square_less_its_corner() {
        let m = moments(&concave(), Basis::M3);
        let corner = [(0.4, 0.4), (1.0, 0.4), (1.0, 1.0), (0.4, 1.0)].map(|(x, y)| DVec2::new(x, y));
        let c = moments(&corner, Basis::M3);
        for a in 0..9 {
            let unit = if a == 0 { 1.0 } else { 0.0 };
            assert!((m[a] - (unit - c[a])).abs() < 1e-14);
        }
    }

    #[test]
    fn nearest_point_lies_at_the_foot_of_the_perpendicular() {
        let square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec2::new(x, y));
        let near = nearest_on_boundary(&square, DVec2::new(0.3, -2.0), |d| d.length_squared());
        assert!((near - DVec2::new(0.3, 0.0)).length() < 1e-12);
        assert!(contains(&square, DVec2::new(0.3, 0.2)) && !contains(&square, DVec2::new(0.3, 1.2)));
    }

    #[test]
    fn a_point_taken_inside_keeps_off_edges_corners_and_what_runs_there_and_back() {
        // A square whose corner a box stands on, as clipping leaves it: joined by an edge along the bottom and back.
        let cut = [(0.0, 0.0), (0.4, 0.0), (0.0, 0.4), (0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (1.0, 0.0)]
            .map(|(x, y)| DVec2::new(x, y));
        let square = |d: DVec2| d.length_squared();
        for point in [(0.3, 0.3), (0.9, 0.5), (0.5, -0.1), (0.7, 0.01), (-0.2, -0.2), (0.6, 0.0)] {
            let inside = nearest_inside(&cut, DVec2::from(point), square);
            assert!(contains(&cut, inside), "{point:?}: {inside}");
            assert!((inside.x.min(inside.y)).min(0.4 - inside.x - inside.y) > 1e-6, "{point:?}: {inside}");
        }
        assert!(nearest_inside(&cut, DVec2::new(0.3, 0.3), square).distance(DVec2::splat(0.2)) < 1e-3);
    }
}
