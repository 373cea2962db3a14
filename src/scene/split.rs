//! Faces → surfaces: one per lit side, each with the parallelogram that carries its function space.
//!
//! A face that is a parallelogram is its own. Any other is enclosed by the smallest rectangle with a side
//! along one of its edges: for a triangle that is twice its area, as small as a parallelogram can be; for
//! concave faces it lines the elements up with an edge. A side on which other faces stand in closed loops
//! becomes several surfaces, cut along the loops ([`super::contact`]); those that are covered are left out.

use glam::{DVec2, DVec3};

use super::contact::{Contact, Contacts};
use super::planar::{Plane, diameter, plane};
use super::{Frame, Scene, Sides, Surface};
use crate::math::polygon;

/// Corners off the line of their neighbours by no more than this share of the diameter are dropped from the
/// outline.
const STRAIGHT: f64 = 1e-9;
/// A quadrilateral whose fourth corner misses by no more than this share of its diameter is a parallelogram.
const PARALLEL: f64 = 1e-6;
/// An enclosing rectangle must be smaller by this share to be preferred to an earlier one, so that ties go by
/// the file's order.
const SMALLER: f64 = 1e-9;

/// The surfaces of a scene, and what became of its lit sides.
#[derive(Clone, Debug, Default)]
pub struct Cut {
    /// In the order of the faces, front before back.
    pub surfaces: Vec<Surface>,
    /// Lit sides cut along the lines on which other faces stand.
    pub cut_sides: usize,
    /// Parts of lit sides, or whole ones, without surface because they are covered.
    pub covered: usize,
}

/// The surfaces of a valid scene, in the order of its faces, front before back.
pub fn surfaces(scene: &Scene) -> Vec<Surface> {
    cut(scene).surfaces
}

/// The surfaces of a valid scene and how its faces were cut.
pub fn cut(scene: &Scene) -> Cut {
    let contacts = Contacts::new(scene);
    let mut cut = Cut { surfaces: Vec::with_capacity(scene.faces.len() * 2), ..Cut::default() };
    for (index, face) in scene.faces.iter().enumerate() {
        let Some(front) = front(scene, index, &face.vertices, None) else { continue };
        let sides = if face.sides == Sides::Two { &[false, true][..] } else { &[false] };
        for back in sides {
            let turn = |surface: Surface| if *back { back_of(&surface) } else { surface };
            match contacts.of(index, *back) {
                Contact::None => cut.surfaces.push(turn(front.clone())),
                Contact::Parts { lit, covered } => {
                    cut.cut_sides += usize::from(lit.len() + covered > 1);
                    cut.covered += covered;
                    let whole = front.full.then_some(front.frame);
                    let parts = lit.iter().filter_map(|part| self::front(scene, index, part, whole));
                    cut.surfaces.extend(parts.map(turn));
                }
            }
        }
    }
    cut
}

/// The front of a face, or of a part of one; `whole` is the parallelogram that the face is.
fn front(scene: &Scene, index: usize, vertices: &[DVec3], whole: Option<Frame>) -> Option<Surface> {
    let plane = plane(vertices)?;
    let corners = without_straight(vertices, &plane);
    let (frame, outline, full) = match parallelogram(&corners, &plane) {
        Some(frame) => {
            let unit = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(DVec2::from);
            (frame, unit.to_vec(), true)
        }
        None => {
            let around = rectangle(&corners, &plane)?;
            let frame = whole.filter(|whole| whole.area_m2 <= around.area_m2 * (1.0 + SMALLER));
            let frame = frame.unwrap_or(around);
            let outline: Vec<DVec2> =
                corners.iter().map(|p| frame.uv(*p).clamp(DVec2::ZERO, DVec2::ONE)).collect();
            (frame, outline, false)
        }
    };
    let material = &scene.materials[scene.faces[index].material as usize];
    Some(Surface {
        face: index as u32,
        back: false,
        area_m2: polygon::area(&outline) * frame.area_m2,
        frame,
        outline,
        full,
        reflectance: material.reflectance.clone(),
        exitance_w_m2: material.exitance_w_m2.clone(),
    })
}

/// The same face from behind: the edges of the frame change places, which turns its normal around.
fn back_of(front: &Surface) -> Surface {
    let Frame { origin, u, v, normal, area_m2 } = front.frame;
    let mut outline: Vec<DVec2> = front.outline.iter().rev().map(|p| DVec2::new(p.y, p.x)).collect();
    if front.full {
        // Start at the frame's origin again.
        outline.rotate_right(1);
    }
    Surface {
        back: true,
        frame: Frame { origin, u: v, v: u, normal: -normal, area_m2 },
        outline,
        ..front.clone()
    }
}

/// The corners without those on a straight line between their neighbours. The turning points of bridge edges
/// stay.
fn without_straight(vertices: &[DVec3], plane: &Plane) -> Vec<DVec3> {
    let tolerance = STRAIGHT * diameter(vertices);
    let mut kept: Vec<DVec3> = Vec::with_capacity(vertices.len());
    let n = vertices.len();
    for (i, corner) in vertices.iter().enumerate() {
        let before = kept.last().copied().unwrap_or(vertices[n - 1]);
        let (arriving, leaving) = (corner - before, vertices[(i + 1) % n] - corner);
        let height = plane.normal.dot(arriving.cross(leaving)).abs();
        let straight =
            height <= tolerance * arriving.length().min(leaving.length()) && arriving.dot(leaving) > 0.0;
        if !straight {
            kept.push(*corner);
        }
    }
    kept
}

/// The frame of four corners that are a parallelogram.
fn parallelogram(corners: &[DVec3], plane: &Plane) -> Option<Frame> {
    let &[a, b, c, d] = corners else { return None };
    let miss = (b - a) - (c - d);
    if miss.length() > PARALLEL * diameter(corners) {
        return None;
    }
    let (u, v) = (b - a, d - a);
    let normal = u.cross(v);
    // A crossed quadrilateral turns against its own plane.
    (normal.dot(plane.normal) > 0.0).then(|| Frame {
        origin: a,
        u,
        v,
        normal: normal.normalize(),
        area_m2: normal.length(),
    })
}

/// The smallest rectangle around the corners with a side along one of their edges.
fn rectangle(corners: &[DVec3], plane: &Plane) -> Option<Frame> {
    let (x_axis, y_axis) = plane.axes();
    let anchor = *corners.first()?;
    let flat: Vec<DVec2> =
        corners.iter().map(|p| DVec2::new(x_axis.dot(p - anchor), y_axis.dot(p - anchor))).collect();
    let hull = Hull::new(&flat);
    let mut best: Option<(f64, DVec2)> = None;
    for (a, b) in polygon::edges(&flat) {
        let Some(along) = (b - a).try_normalize() else { continue };
        let area = hull.width(along) * hull.width(along.perp());
        if best.is_none_or(|(least, _)| area < least * (1.0 - SMALLER)) {
            best = Some((area, along));
        }
    }
    let (_, along) = best?;
    let across = along.perp();
    let extent = |axis: DVec2| {
        flat.iter()
            .map(|p| axis.dot(*p))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), d| (l.min(d), h.max(d)))
    };
    let ((low_u, high_u), (low_v, high_v)) = (extent(along), extent(across));
    let to_space = |p: DVec2| p.x * x_axis + p.y * y_axis;
    let frame = Frame {
        origin: anchor + to_space(low_u * along + low_v * across),
        u: to_space(along) * (high_u - low_u),
        v: to_space(across) * (high_v - low_v),
        normal: plane.normal,
        area_m2: (high_u - low_u) * (high_v - low_v),
    };
    (frame.area_m2 > 0.0).then_some(frame)
}

/// A convex hull that answers how wide it is in a direction, in logarithmic time.
struct Hull {
    /// Counter-clockwise from the leftmost point.
    corners: Vec<DVec2>,
    /// The angle of the edge that starts at each corner, ascending within one turn from −π/2.
    angles: Vec<f64>,
}

impl Hull {
    /// Andrew's monotone chain.
    fn new(points: &[DVec2]) -> Hull {
        let mut sorted = points.to_vec();
        sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        sorted.dedup();
        let mut corners: Vec<DVec2> = Vec::new();
        for half in 0..2 {
            let floor = corners.len();
            for p in &sorted {
                while corners.len() >= floor + 2 {
                    let (a, b) = (corners[corners.len() - 2], corners[corners.len() - 1]);
                    if (b - a).perp_dot(*p - b) > 0.0 {
                        break;
                    }
                    corners.pop();
                }
                corners.push(*p);
            }
            // The end of one chain is the start of the other.
            if corners.len() > 1 {
                corners.pop();
            }
            if half == 0 {
                sorted.reverse();
            }
        }
        let mut turned = f64::NEG_INFINITY;
        let angles = polygon::edges(&corners)
            .map(|(a, b)| {
                let angle = from_down((b - a).y.atan2((b - a).x));
                turned = turned.max(angle);
                turned
            })
            .collect();
        Hull { corners, angles }
    }

    /// The extent along a unit `axis`.
    fn width(&self, axis: DVec2) -> f64 {
        self.reach(axis) + self.reach(-axis)
    }

    /// The greatest `axis · p`: at the corner between the edges before and after the direction perpendicular
    /// to `axis`.
    fn reach(&self, axis: DVec2) -> f64 {
        let tangent = from_down(axis.x.atan2(-axis.y));
        let n = self.corners.len();
        let at = self.angles.partition_point(|angle| *angle < tangent) % n;
        // Rounding may be off by one edge.
        [at + n - 1, at, at + 1]
            .into_iter()
            .map(|i| axis.dot(self.corners[i % n]))
            .fold(f64::NEG_INFINITY, f64::max)
    }
}

/// An angle brought into one turn that starts at −π/2, where the lower chain of a hull starts.
fn from_down(angle: f64) -> f64 {
    use std::f64::consts::{FRAC_PI_2, TAU};
    if angle < -FRAC_PI_2 { angle + TAU } else { angle }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::scene::{Face, Material};

    fn scene(vertices: &[(f64, f64, f64)], sides: Sides) -> Scene {
        Scene {
            faces: vec![Face {
                vertices: vertices.iter().map(|v| DVec3::from(*v)).collect(),
                material: 0,
                sides,
            }],
            materials: vec![Material { reflectance: vec![0.5], exitance_w_m2: vec![1.0] }],
            ..Scene::default()
        }
    }

    #[test]
    fn a_parallelogram_is_its_own_frame_and_its_back_turns_around() {
        let scene = scene(&[(0.0, 0.0, 1.0), (2.0, 0.0, 1.0), (3.0, 1.0, 1.0), (1.0, 1.0, 1.0)], Sides::Two);
        let surfaces = surfaces(&scene);
        let [front, back] = &surfaces[..] else { panic!("{surfaces:?}") };
        assert!(front.full && back.full && back.back);
        assert_eq!((front.frame.normal, back.frame.normal), (DVec3::Z, DVec3::NEG_Z));
        assert_eq!((front.frame.u, back.frame.v), (DVec3::new(2.0, 0.0, 0.0), DVec3::new(2.0, 0.0, 0.0)));
        assert_eq!(front.outline, back.outline);
        assert_eq!((front.area_m2, front.frame.area_m2), (2.0, 2.0));
    }

    #[test]
    fn straight_corners_do_not_hide_a_rectangle() {
        let scene = scene(
            &[(1.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)],
            Sides::One,
        );
        let surfaces = surfaces(&scene);
        assert_eq!(surfaces.len(), 1);
        assert!(surfaces[0].full && (surfaces[0].area_m2 - 2.0).abs() < 1e-15);
    }

    #[test]
    fn a_concave_face_keeps_its_outline() {
        let l = [
            (0.0, 0.0, 0.0),
            (8.0, 0.0, 0.0),
            (8.0, 3.0, 0.0),
            (3.0, 3.0, 0.0),
            (3.0, 7.0, 0.0),
            (0.0, 7.0, 0.0),
        ];
        let surface = &surfaces(&scene(&l, Sides::One))[0];
        assert!(!surface.full);
        assert_eq!(surface.outline.len(), 6);
        assert!((surface.frame.area_m2 - 56.0).abs() < 1e-12 && (surface.area_m2 - 36.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn frames_enclose_their_polygons(
            radii in proptest::collection::vec(0.01f64..3.0, 3..60),
            turn in 0.0f64..6.3,
            squeeze in 1e-4f64..1.0,
        ) {
            // A star-shaped polygon, squeezed to a sliver and turned.
            let n = radii.len();
            let star: Vec<(f64, f64, f64)> = radii.iter().enumerate().map(|(i, r)| {
                let angle = std::f64::consts::TAU * i as f64 / n as f64;
                let p = DVec2::from_angle(turn).rotate(DVec2::new(r * angle.cos(), squeeze * r * angle.sin()));
                (p.x, 0.6 * p.y, 0.8 * p.y)
            }).collect();
            let scene = scene(&star, Sides::Two);
            let whole = plane(&scene.faces[0].vertices).unwrap().area_m2;
            for surface in surfaces(&scene) {
                let scale = surface.frame.area_m2;
                prop_assert!((surface.area_m2 - whole).abs() <= 1e-9 * scale);
                prop_assert!((surface.frame.u.cross(surface.frame.v).length() - scale).abs() <= 1e-9 * scale);
                prop_assert!(surface.frame.u.cross(surface.frame.v).dot(surface.frame.normal) > 0.0);
                // No rectangle along an edge is smaller.
                let vertices = &scene.faces[0].vertices;
                for (i, a) in vertices.iter().enumerate() {
                    let along = (vertices[(i + 1) % n] - a).normalize();
                    let across = surface.frame.normal.cross(along);
                    let width = |axis: DVec3| {
                        let d = vertices.iter().map(|p| axis.dot(*p));
                        d.clone().fold(f64::MIN, f64::max) - d.fold(f64::MAX, f64::min)
                    };
                    prop_assert!(surface.full || scale <= width(along) * width(across) * (1.0 + 1e-6));
                }
            }
        }
    }
}
