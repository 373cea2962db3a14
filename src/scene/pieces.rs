//! Polygons that one surface cannot carry, cut into ones that it can: triangles, joined again as far as they
//! may be.
//!
//! Joining along one shared edge at a time keeps every piece a closed walk around its region: holes end up
//! reached by bridge edges.

use std::collections::HashMap;

use glam::{DVec2, DVec3};
use i_overlay::core::fill_rule::FillRule;
use i_overlay::float::simplify::SimplifyShape;

use super::planar::{PLANARITY, Plane, diameter, plane};
use crate::math::polygon;

/// Polygons with more corners are left in triangles, because joining takes quadratic time.
const MAX_JOINED: usize = 256;
/// A polygon overlaps itself when its area differs by more than this share from the area it covers.
const OVERLAP: f64 = 1e-6;

/// The planar pieces of a non-planar polygon.
pub fn split(vertices: &[DVec3], plane: &Plane) -> Vec<Vec<DVec3>> {
    let flat = project(vertices, plane);
    let tolerance = PLANARITY * diameter(vertices);
    let pieces = pieces(&flat, &[], |piece| {
        let corners = pick(piece, vertices);
        self::plane(&corners).is_some_and(|plane| plane.deviation(&corners) <= tolerance)
    });
    pieces.iter().map(|piece| pick(piece, vertices)).collect()
}

/// How a planar polygon covers its region.
#[derive(Clone, Debug, PartialEq)]
pub enum Cover {
    /// Once everywhere.
    Once,
    /// More than once somewhere; these polygons cover the same once.
    By(Vec<Vec<DVec3>>),
    /// It crosses itself more often than it has corners: no region was meant, and naming one could take forever.
    Tangle,
}

/// Whether a planar polygon covers its region once, and what does if not.
pub fn cover(vertices: &[DVec3], plane: &Plane) -> Cover {
    let flat = project(vertices, plane);
    if crosses_more_often(&flat, flat.len()) {
        return Cover::Tangle;
    }
    // Every point enclosed counts, however often and in whatever sense the polygon runs around it.
    let shapes = flat.simplify_shape_as::<i64>(FillRule::NonZero);
    let area: f64 = shapes.iter().flatten().map(|contour| signed_area(contour)).sum();
    if (area - plane.area_m2).abs() <= OVERLAP * plane.area_m2 {
        return Cover::Once;
    }
    let (u, v) = plane.axes();
    let mut all = Vec::new();
    for shape in &shapes {
        let flat = shape.concat();
        let mut end = 0;
        let mut holes: Vec<u32> = Vec::new();
        for contour in &shape[..shape.len().saturating_sub(1)] {
            end += contour.len() as u32;
            holes.push(end);
        }
        let corners: Vec<DVec3> =
            flat.iter().map(|p| p[0] * u + p[1] * v + plane.offset * plane.normal).collect();
        all.extend(pieces(&flat, &holes, |_| true).iter().map(|piece| pick(piece, &corners)));
    }
    Cover::By(all)
}

/// Whether more than `limit` pairs of edges cross properly, by a sweep over the edges' extents along the first axis.
fn crosses_more_often(flat: &[[f64; 2]], limit: usize) -> bool {
    let corners: Vec<DVec2> = flat.iter().map(|p| DVec2::from_array(*p)).collect();
    let mut edges: Vec<(DVec2, DVec2)> =
        polygon::edges(&corners).map(|(a, b)| if a.x <= b.x { (a, b) } else { (b, a) }).collect();
    edges.sort_by(|e, f| e.0.x.total_cmp(&f.0.x));
    let parts = |(a, b): (DVec2, DVec2), (c, d): (DVec2, DVec2)| {
        let (side_c, side_d) = ((b - a).perp_dot(c - a), (b - a).perp_dot(d - a));
        (side_c > 0.0 && side_d < 0.0) || (side_c < 0.0 && side_d > 0.0)
    };
    let mut crossings = 0;
    for (i, e) in edges.iter().enumerate() {
        for f in edges[i + 1..].iter().take_while(|f| f.0.x < e.1.x) {
            crossings += usize::from(parts(*e, *f) && parts(*f, *e));
        }
        if crossings > limit {
            return true;
        }
    }
    false
}

fn project(vertices: &[DVec3], plane: &Plane) -> Vec<[f64; 2]> {
    let (u, v) = plane.axes();
    vertices.iter().map(|p| [u.dot(*p), v.dot(*p)]).collect()
}

fn signed_area(contour: &[[f64; 2]]) -> f64 {
    let contour: Vec<DVec2> = contour.iter().map(|p| DVec2::from_array(*p)).collect();
    polygon::area(&contour)
}

fn pick(indices: &[u32], vertices: &[DVec3]) -> Vec<DVec3> {
    indices.iter().map(|i| vertices[*i as usize]).collect()
}

/// The triangles of a polygon, counter-clockwise, joined where `may_join` allows; `holes` are the starts of
/// hole contours.
fn pieces(flat: &[[f64; 2]], holes: &[u32], may_join: impl Fn(&[u32]) -> bool) -> Vec<Vec<u32>> {
    let mut indices: Vec<u32> = Vec::new();
    earcut::Earcut::new().earcut(flat.iter().copied(), holes, &mut indices);
    let mut pieces: Vec<Vec<u32>> = indices
        .chunks_exact(3)
        .map(|corners| {
            let [a, b, c] = [0, 1, 2].map(|i| DVec2::from_array(flat[corners[i] as usize]));
            match (b - a).perp_dot(c - a) < 0.0 {
                true => vec![corners[0], corners[2], corners[1]],
                false => corners.to_vec(),
            }
        })
        .collect();
    if flat.len() <= MAX_JOINED {
        join(&mut pieces, may_join);
    }
    pieces
}

/// Joins pieces along shared edges as long as the union passes `may_join`.
fn join(pieces: &mut Vec<Vec<u32>>, may_join: impl Fn(&[u32]) -> bool) {
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
            may_join(&union).then_some((owner, union))
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

/// `piece` with edge number `at`, which ends before corner `at + 1`, replaced by the way around `other` from
/// `start`.
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
        pieces.iter().filter_map(|piece| plane(piece)).map(|plane| plane.area_m2).sum()
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
    fn a_ring_keeps_its_bridge_edge() {
        let ring = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)]
            .map(|(x, y)| DVec3::new(x as f64, y as f64, 3.0));
        assert_eq!(cover(&ring, &plane(&ring).unwrap()), Cover::Once);
    }

    #[test]
    fn what_overlaps_itself_is_covered_once() {
        let walk = |corners: &[(i32, i32)]| -> Vec<DVec3> {
            corners.iter().map(|(x, y)| DVec3::new(f64::from(*x), f64::from(*y), 3.0)).collect()
        };
        for (corners, expected) in [
            // A triangle run around twice, then the square it is half of.
            (walk(&[(0, 0), (2, 0), (2, 2), (0, 0), (2, 0), (2, 2), (0, 2)]), 4.0),
            // A bow tie with unequal wings.
            (walk(&[(0, 0), (2, 2), (2, 0), (0, 2), (-3, 1)]), 1.0 + 4.0),
            // A square with an inner square in the same sense.
            (walk(&[(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (2, 1), (2, 2), (1, 2), (1, 1)]), 16.0),
            // A frame that crosses itself, around a hole.
            (
                walk(&[
                    (0, 0),
                    (6, 0),
                    (6, 6),
                    (0, 6),
                    (0, 0),
                    (2, 2),
                    (2, 4),
                    (4, 4),
                    (4, 2),
                    (1, 2),
                    (1, 1),
                ]),
                32.0,
            ),
        ] {
            let Cover::By(pieces) = cover(&corners, &plane(&corners).unwrap()) else { panic!("{corners:?}") };
            assert!((area(&pieces) - expected).abs() < 1e-6, "{} {pieces:?}", area(&pieces));
        }
    }

    #[test]
    fn a_tangle_is_recognised_before_it_costs() {
        // Every edge crosses half of all others.
        let tangle: Vec<DVec3> = (0..4001u32)
            .map(|i| f64::from(i * 1999 % 4001) * std::f64::consts::TAU / 4001.0)
            .map(|angle| DVec3::new(angle.cos(), angle.sin(), 0.0))
            .collect();
        let plane = Plane { normal: DVec3::Z, offset: 0.0, area_m2: 1.0 };
        assert_eq!(cover(&tangle, &plane), Cover::Tangle);
    }
}
