//! Planarity: the best-fit plane of a polygon, flattening onto it, and splitting what is not planar.
//!
//! The plane is Newell's: its normal is the polygon's vector area, exact for planar polygons, concave ones and ones with bridge
//! edges included; it passes through the mean of the corners.

use std::collections::HashMap;

use glam::{DVec2, DVec3};

/// A polygon counts as planar when no corner is farther from its plane than this share of its diameter.
///
/// In the real scenes this was chosen by, rounding of the file's numbers stays below 1e-4 and deliberate twist begins above 1e-3,
/// with nothing in between; on a wall of 10 m it is 1 mm, below what visibility and transport resolve.
pub const PLANARITY: f64 = 1e-4;

/// Polygons with more corners are split into bare triangles without trying to join them again.
const MAX_JOINED: usize = 256;

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

/// Splits a non-planar polygon into planar pieces: triangles of its projection, joined again where they lie in one plane.
pub fn split(vertices: &[DVec3], plane: &Plane) -> Vec<Vec<DVec3>> {
    let (u, v) = plane.axes();
    let flat: Vec<[f64; 2]> = vertices.iter().map(|p| DVec2::new(u.dot(*p), v.dot(*p)).to_array()).collect();
    let mut indices: Vec<u32> = Vec::new();
    earcut::Earcut::new().earcut(flat.iter().copied(), &[], &mut indices);
    let mut pieces: Vec<Vec<u32>> = indices
        .chunks_exact(3)
        .map(|corners| match signed_area(corners, &flat) < 0.0 {
            true => vec![corners[0], corners[2], corners[1]],
            false => corners.to_vec(),
        })
        .collect();
    if vertices.len() <= MAX_JOINED {
        let tolerance = PLANARITY * diameter(vertices);
        join(&mut pieces, |piece| {
            let corners = points(piece, vertices);
            self::plane(&corners).is_some_and(|plane| plane.deviation(&corners) <= tolerance)
        });
    }
    pieces.iter().map(|piece| points(piece, vertices)).collect()
}

fn points(indices: &[u32], vertices: &[DVec3]) -> Vec<DVec3> {
    indices.iter().map(|i| vertices[*i as usize]).collect()
}

fn signed_area(corners: &[u32], flat: &[[f64; 2]]) -> f64 {
    let [a, b, c] = [0, 1, 2].map(|i| DVec2::from_array(flat[corners[i] as usize]));
    (b - a).perp_dot(c - a)
}

/// Joins pieces along shared edges as long as the union satisfies `is_planar`.
fn join(pieces: &mut Vec<Vec<u32>>, is_planar: impl Fn(&[u32]) -> bool) {
    let mut i = 0;
    while i < pieces.len() {
        // The owner of every edge but this piece's own; a neighbour runs along a shared edge the other way.
        let owners: HashMap<(u32, u32), usize> = pieces
            .iter()
            .enumerate()
            .skip(i + 1)
            .flat_map(|(owner, piece)| edges(piece).map(move |edge| (edge, owner)))
            .collect();
        let union = edges(&pieces[i]).enumerate().find_map(|(at, (a, b))| {
            let owner = *owners.get(&(b, a))?;
            let union = spliced(&pieces[i], at, &pieces[owner], a);
            is_planar(&union).then_some((owner, union))
        });
        match union {
            Some((owner, union)) => {
                pieces[i] = union;
                pieces.swap_remove(owner);
            }
            None => i += 1,
        }
    }
}

/// `piece` with edge number `at`, which ends before corner `at + 1`, replaced by the way around `other` from `start`.
fn spliced(piece: &[u32], at: usize, other: &[u32], start: u32) -> Vec<u32> {
    let n = other.len();
    let from = other.iter().position(|i| *i == start).unwrap_or(0);
    let mut union = piece[..=at].to_vec();
    union.extend((1..n - 1).map(|k| other[(from + k) % n]));
    union.extend(&piece[at + 1..]);
    union
}

fn edges(piece: &[u32]) -> impl Iterator<Item = (u32, u32)> + '_ {
    (0..piece.len()).map(|i| (piece[i], piece[(i + 1) % piece.len()]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(pieces: &[Vec<DVec3>]) -> f64 {
        pieces.iter().map(|piece| plane(piece).unwrap().area_m2).sum()
    }

    #[test]
    fn a_twisted_quadrilateral_becomes_two_triangles() {
        let quad = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.5), DVec3::Y];
        let pieces = split(&quad, &plane(&quad).unwrap());
        assert_eq!(pieces.len(), 2);
        assert!(pieces.iter().all(|piece| plane(piece).unwrap().normal.z > 0.0));
    }

    #[test]
    fn a_folded_l_becomes_its_two_planar_wings() {
        // An L in the plane z = 0 whose upper wing is bent up along y = 1.
        let l = [
            (0.0, 0.0, 0.0),
            (2.0, 0.0, 0.0),
            (2.0, 1.0, 0.0),
            (1.0, 1.0, 0.0),
            (1.0, 2.0, 0.5),
            (0.0, 2.0, 0.5),
            (0.0, 1.0, 0.0),
        ]
        .map(|(x, y, z)| DVec3::new(x, y, z));
        let pieces = split(&l, &plane(&l).unwrap());
        assert_eq!(pieces.len(), 2, "{pieces:?}");
        assert!((area(&pieces) - (2.0 + 1.25f64.sqrt())).abs() < 1e-12);
    }

    #[test]
    fn the_plane_of_a_polygon_with_a_hole_is_exact() {
        // A square with a square hole, joined by a bridge edge.
        let ring = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)]
            .map(|(x, y)| DVec3::new(x as f64, y as f64, x as f64));
        let plane = plane(&ring).unwrap();
        assert!((plane.area_m2 - 15.0 * 2f64.sqrt()).abs() < 1e-12);
        assert!(plane.deviation(&ring) < 1e-12);
    }
}
