//! Points against polygons in the plane: edges are kept by bands across the polygon, and a point is compared with those of its band alone,
//! which are all that it could cross or touch.

use glam::DVec2;

/// Bands of a polygon, at most.
const MAX_BANDS: usize = 32;

/// The edges of polygons, by band.
#[derive(Clone)]
pub(super) struct Edges {
    edges: Vec<[DVec2; 2]>,
    /// Where each band's edges end.
    ends: Vec<u32>,
}

/// The bands of one polygon along y.
#[derive(Clone, Copy, Default)]
pub(super) struct Bands {
    first: u32,
    count: u32,
    low: f64,
    /// Bands per metre.
    per_metre: f64,
}

impl Bands {
    /// The band at this height; it never falls as the height rises.
    #[inline]
    fn at(&self, y: f64) -> usize {
        self.first as usize + (((y - self.low) * self.per_metre) as usize).min(self.count as usize - 1)
    }
}

impl Default for Edges {
    fn default() -> Self {
        Self { edges: Vec::new(), ends: vec![0] }
    }
}

impl Edges {
    /// Adds a polygon whose edges are felt as far as `reach` from them.
    pub fn add(&mut self, corners: &[DVec2], reach: f64) -> Bands {
        let low = corners.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        let high = corners.iter().map(|p| p.y).fold(f64::NEG_INFINITY, f64::max);
        let (first, count) = (self.ends.len() - 1, corners.len().min(MAX_BANDS));
        let per_metre = count as f64 / (high - low);
        let bands = Bands { first: first as u32, count: count as u32, low, per_metre };
        for band in first..first + count {
            for (i, &a) in corners.iter().enumerate() {
                let b = corners[(i + 1) % corners.len()];
                if (bands.at(a.y.min(b.y) - reach)..=bands.at(a.y.max(b.y) + reach)).contains(&band) {
                    self.edges.push([a, b]);
                }
            }
            self.ends.push(self.edges.len() as u32);
        }
        bands
    }

    /// Whether a point lies in the polygon, or as near as this to an edge.
    pub fn contain(&self, bands: &Bands, p: DVec2, near: f64) -> bool {
        let band = bands.at(p.y);
        let edges = &self.edges[self.ends[band] as usize..self.ends[band + 1] as usize];
        is_inside(edges, p) || edges.iter().any(|edge| is_on(edge, p, near))
    }

    /// Bytes that they take.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.edges) + size_of_val(&*self.ends)
    }
}

/// Even–odd test. Each edge is evaluated from its lower end, so that two faces that share it agree to the last bit.
fn is_inside(edges: &[[DVec2; 2]], p: DVec2) -> bool {
    let mut inside = false;
    for &[a, b] in edges {
        if (a.y > p.y) != (b.y > p.y) {
            let (low, high) = if a.y < b.y { (a, b) } else { (b, a) };
            inside ^= (p.x - low.x) * (high.y - low.y) < (p.y - low.y) * (high.x - low.x);
        }
    }
    inside
}

/// Whether a point is this near to an edge.
fn is_on([a, b]: &[DVec2; 2], p: DVec2, near: f64) -> bool {
    // Most edges are elsewhere. Bands know how far edges reach in y; in x both measures of nearness may add up beyond a corner.
    let around = DVec2::new(2.0 * near, near);
    if p.cmplt(a.min(*b) - around).any() || p.cmpgt(a.max(*b) + around).any() {
        return false;
    }
    let (edge, to) = (*b - *a, p - *a);
    let (square, off) = (edge.length_squared(), edge.perp_dot(to));
    off * off <= near * near * square && square > 0.0 && {
        let (along, slack) = (edge.dot(to), near * square.sqrt());
        along >= -slack && along <= square + slack
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Corners and points on a coarse grid lie at the same heights and on each other's edges.
        #[test]
        fn the_edges_of_a_band_answer_as_all_do(
            corners in proptest::collection::vec((-1.0..1.0f64, -1.0..1.0f64), 3..60),
            points in proptest::collection::vec((-1.2..1.2f64, -1.2..1.2f64), 40),
            grid in proptest::bool::ANY,
        ) {
            let snap = |x: f64| if grid { (4.0 * x).round() / 4.0 } else { x };
            let at = |(x, y): &(f64, f64)| DVec2::new(snap(*x), snap(*y));
            let corners: Vec<DVec2> = corners.iter().map(at).collect();
            let mut edges = Edges::default();
            edges.add(&[DVec2::ZERO, DVec2::X, DVec2::ONE], 0.0);
            let bands = edges.add(&corners, 1e-7);
            let all: Vec<[DVec2; 2]> =
                (0..corners.len()).map(|i| [corners[i], corners[(i + 1) % corners.len()]]).collect();
            for p in points.iter().map(at) {
                for near in [1e-12, 1e-7] {
                    let expected = is_inside(&all, p) || all.iter().any(|edge| is_on(edge, p, near));
                    prop_assert_eq!(edges.contain(&bands, p, near), expected, "{} in {:?}", p, corners);
                }
            }
        }
    }
}
