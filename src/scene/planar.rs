//! Planarity: the best-fit plane of a polygon, and flattening onto it.
//!
//! The plane is Newell's: its normal is the polygon's vector area, exact for planar polygons, concave ones
//! and ones with bridge edges included; it passes through the mean of the corners.

use glam::DVec3;

/// A polygon counts as planar when no corner is farther from its plane than this share of its diameter.
///
/// In the real scenes this was chosen by, rounding of the file's numbers stays below 1e-4 and deliberate
/// twist begins above 1e-3, with nothing in between; on a wall of 10 m it is 1 mm, below what visibility and
/// transport resolve.
pub const PLANARITY: f64 = 1e-4;

/// A plane: `normal · x = offset`.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    /// Unit normal, by the right-hand rule of the polygon.
    pub normal: DVec3,
    /// Distance from the origin along the normal.
    pub offset: f64,
    /// Area of the polygon projected onto the plane.
    pub area_m2: f64,
}

/// The best-fit plane of a polygon; `None` when its vector area vanishes.
pub fn plane(vertices: &[DVec3]) -> Option<Plane> {
    let anchor = *vertices.first()?;
    let mut doubled = DVec3::ZERO;
    for pair in vertices.windows(2) {
        doubled += (pair[0] - anchor).cross(pair[1] - anchor);
    }
    let normal = doubled.try_normalize()?;
    let mean = vertices.iter().map(|v| *v - anchor).sum::<DVec3>() / vertices.len() as f64;
    Some(Plane { normal, offset: normal.dot(anchor) + normal.dot(mean), area_m2: 0.5 * doubled.length() })
}

impl Plane {
    /// The greatest distance of a corner from the plane.
    pub fn deviation(&self, vertices: &[DVec3]) -> f64 {
        vertices.iter().map(|v| (self.normal.dot(*v) - self.offset).abs()).fold(0.0, f64::max)
    }

    /// Moves the corners onto the plane.
    pub fn flatten(&self, vertices: &mut [DVec3]) {
        for vertex in vertices {
            *vertex -= (self.normal.dot(*vertex) - self.offset) * self.normal;
        }
    }

    /// Two unit vectors that span the plane, right-handed with the normal.
    pub fn axes(&self) -> (DVec3, DVec3) {
        let u = self.normal.any_orthonormal_vector();
        (u, self.normal.cross(u))
    }
}

/// The diagonal of the box around the corners.
pub fn diameter(vertices: &[DVec3]) -> f64 {
    let first = vertices.first().copied().unwrap_or_default();
    let (low, high) = vertices.iter().fold((first, first), |(low, high), v| (low.min(*v), high.max(*v)));
    (high - low).length()
}

/// Whether a planar polygon is strictly convex, and hence does not overlap itself.
pub fn is_convex(vertices: &[DVec3], plane: &Plane) -> bool {
    let n = vertices.len();
    let edge = |i: usize| vertices[(i + 1) % n] - vertices[i % n];
    let (u, _) = plane.axes();
    let mut reversals = 0;
    for i in 0..n {
        let (arriving, leaving) = (edge(i), edge(i + 1));
        if plane.normal.dot(arriving.cross(leaving)) <= 0.0 {
            return false;
        }
        reversals += usize::from((u.dot(arriving) > 0.0) != (u.dot(leaving) > 0.0));
    }
    // Once around turns back twice; a pentagram, which also turns left everywhere, turns back more often.
    reversals <= 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plane_of_a_polygon_with_a_hole_is_exact() {
        // A square with a square hole, joined by a bridge edge.
        let ring = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)]
            .map(|(x, y)| DVec3::new(x as f64, y as f64, x as f64));
        let plane = plane(&ring).unwrap();
        assert!((plane.area_m2 - 15.0 * 2f64.sqrt()).abs() < 1e-12);
        assert!(plane.deviation(&ring) < 1e-12);
    }

    #[test]
    fn a_pentagram_is_not_convex_although_it_turns_left_everywhere() {
        let star = |step: usize| {
            let corners = (0..5).map(|i| std::f64::consts::TAU * (i * step) as f64 / 5.0);
            let corners: Vec<DVec3> =
                corners.map(|angle| DVec3::new(angle.cos(), angle.sin(), 0.0)).collect();
            is_convex(&corners, &plane(&corners).unwrap())
        };
        assert!(star(1) && !star(2));
    }
}
