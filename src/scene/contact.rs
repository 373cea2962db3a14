//! Contacts: the lines on which other faces stand on a face, and what of it lies under them.
//!
//! Along such a line irradiance jumps. Where contacts close a loop, with each other or with the face's own
//! boundary, the face is cut there, so that no element straddles the jump. Only the faces that rise on the
//! side in question count, by what of them lies above the plane: standing on it or passing through it alike.
//!
//! A *foot* is the end of a solid: a one-sided face with one-sided faces behind it along its whole outline
//! that show their black backs to the inside. Where a foot lies on a face that faces it, both are covered,
//! and no surface. Other coplanar faces leave each other alone, because nothing tells which is on top:
//! pictures on walls, sheets made of two faces back to back, shells of rooms. So do faces that emit.

use std::cell::OnceCell;

use glam::{DVec2, DVec3};

use super::arrangement::{Cells, cells, interior_point};
use super::boxes::Boxes;
use super::planar::{Plane, plane};
use super::rim::Rim;
use super::{Face, Scene, Sides};
use crate::math::polygon;

/// What is nearer than this share of the scene's size touches: 10 µm in a room of 10 m, well above the
/// rounding of single precision.
const TOUCHING: f64 = 1e-6;
/// Parts smaller than this share of the area of all faces are not cut out: more surfaces cost more than
/// elements across so short a line.
const LEAST_AREA: f64 = 1e-5;
/// Faces whose normals differ less than this (in radians) have no line in common.
const PARALLEL: f64 = 1e-6;
/// What contacts leave of one side of a face.
#[derive(Clone, Debug, PartialEq)]
pub enum Contact {
    /// It is not cut.
    None,
    /// It is cut into the polygons `lit`, corners in metres, counter-clockwise seen from the face's front,
    /// and `covered` others that lie under feet.
    Parts {
        /// What light may reach.
        lit: Vec<Vec<DVec3>>,
        /// How many are covered.
        covered: usize,
    },
}

/// The faces of a scene with what it takes to find their contacts.
pub struct Contacts<'a> {
    scene: &'a Scene,
    /// `None` for faces without area, which a valid scene does not have.
    planes: Vec<Option<Plane>>,
    bounds: Vec<(DVec3, DVec3)>,
    boxes: Boxes,
    tolerance_m: f64,
    least_area_m2: f64,
    is_foot: Vec<OnceCell<bool>>,
}

/// A face's plane with coordinates in it, right-handed with the face's normal.
struct Flat {
    origin: DVec3,
    u: DVec3,
    v: DVec3,
    normal: DVec3,
    outline: Vec<DVec2>,
}

impl Flat {
    fn new(face: &Face, plane: &Plane) -> Flat {
        let origin = face.vertices[0];
        let along = (face.vertices[1] - origin).reject_from_normalized(plane.normal);
        let (u, v) = along.try_normalize().map_or(plane.axes(), |u| (u, plane.normal.cross(u)));
        let mut flat = Flat { origin, u, v, normal: plane.normal, outline: Vec::new() };
        flat.outline = face.vertices.iter().map(|p| flat.project(*p)).collect();
        flat
    }

    fn project(&self, point: DVec3) -> DVec2 {
        DVec2::new(self.u.dot(point - self.origin), self.v.dot(point - self.origin))
    }

    fn point(&self, p: DVec2) -> DVec3 {
        self.origin + p.x * self.u + p.y * self.v
    }

    fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point - self.origin)
    }
}

impl<'a> Contacts<'a> {
    /// Prepares the faces of a valid scene.
    pub fn new(scene: &'a Scene) -> Contacts<'a> {
        let bounds: Vec<(DVec3, DVec3)> = scene
            .faces
            .iter()
            .map(|face| {
                let first = face.vertices[0];
                face.vertices.iter().fold((first, first), |(low, high), p| (low.min(*p), high.max(*p)))
            })
            .collect();
        let planes: Vec<Option<Plane>> = scene.faces.iter().map(|face| plane(&face.vertices)).collect();
        Contacts {
            scene,
            least_area_m2: LEAST_AREA * planes.iter().flatten().map(|plane| plane.area_m2).sum::<f64>(),
            planes,
            boxes: Boxes::new(&bounds),
            bounds,
            tolerance_m: TOUCHING * scene.bounds_m().map_or(0.0, |(low, high)| (high - low).length()),
            is_foot: vec![OnceCell::new(); scene.faces.len()],
        }
    }

    /// What contacts leave of the front or back of a face.
    pub fn of(&self, face: usize, back: bool) -> Contact {
        let Some(plane) = &self.planes[face] else { return Contact::None };
        let flat = Flat::new(&self.scene.faces[face], plane);
        let mut near = Vec::new();
        self.near(face, |other| near.push(other));
        let covers = near.iter().filter(|other| self.covers(**other, face, back, &flat));
        let covers: Vec<Vec<DVec2>> = covers.map(|other| self.outline(*other, &flat)).collect();
        if covers.is_empty() && plane.area_m2 < 2.0 * self.least_area_m2 {
            return Contact::None;
        }
        let mut segments: Vec<(DVec2, DVec2)> =
            near.iter().flat_map(|other| self.trace(*other, &flat, back)).collect();
        segments.extend(covers.iter().flat_map(|cover| polygon::edges(cover)));
        let is_covered = |p: DVec2| covers.iter().any(|cover| polygon::contains(cover, p));
        let is_under = |part: &[DVec2]| interior_point(part).is_some_and(is_covered);
        match cells(&flat.outline, &segments, self.tolerance_m, self.least_area_m2, is_covered) {
            Cells::Whole if is_under(&flat.outline) => Contact::Parts { lit: Vec::new(), covered: 1 },
            Cells::Whole | Cells::Unclear => Contact::None,
            Cells::Parts(parts) => {
                let all = parts.len();
                let lit: Vec<Vec<DVec3>> = parts
                    .into_iter()
                    .filter(|part| !is_under(part))
                    .map(|part| part.into_iter().map(|p| flat.point(p)).collect())
                    .collect();
                Contact::Parts { covered: all - lit.len(), lit }
            }
        }
    }

    /// Calls `found` with the faces whose boxes touch that of `face`, and some more.
    fn near(&self, face: usize, mut found: impl FnMut(usize)) {
        let (low, high) = self.bounds[face];
        self.boxes.near(low - self.tolerance_m, high + self.tolerance_m, |other| {
            if other as usize != face {
                found(other as usize);
            }
        });
    }

    fn outline(&self, face: usize, flat: &Flat) -> Vec<DVec2> {
        self.scene.faces[face].vertices.iter().map(|p| flat.project(*p)).collect()
    }

    /// The line on which the part of a face above (below if `back`) a plane ends: segments in the plane.
    fn trace(&self, face: usize, flat: &Flat, back: bool) -> Vec<(DVec2, DVec2)> {
        let vertices = &self.scene.faces[face].vertices;
        let sign = if back { -1.0 } else { 1.0 };
        let height = |p: DVec3| sign * flat.height(p);
        let rises = |h: f64| h > self.tolerance_m;
        let count = vertices.iter().filter(|p| rises(height(**p))).count();
        if count == 0 || count == vertices.len() {
            return Vec::new();
        }
        let along = self.planes[face].map_or(DVec3::ZERO, |plane| plane.normal.cross(flat.normal));
        let Some(along) = (along.length() > PARALLEL).then(|| flat.project(flat.origin + along)) else {
            return Vec::new();
        };
        // The outline passes the plane as often upwards as downwards; between the first and the second
        // passage along the line the face rises, between the second and the third it does not, and so on.
        let mut passages: Vec<DVec2> = (0..vertices.len())
            .filter_map(|i| {
                let (a, b) = (vertices[i], vertices[(i + 1) % vertices.len()]);
                let (low, high) = if rises(height(a)) { (b, a) } else { (a, b) };
                let (least, most) = (height(low), height(high));
                let passes = rises(most) && !rises(least);
                passes.then(|| match least < -self.tolerance_m {
                    true => flat.project(low + (high - low) * (least / (least - most))),
                    false => flat.project(low),
                })
            })
            .collect();
        passages.sort_by(|p, q| along.dot(*p).total_cmp(&along.dot(*q)));
        let pairs = passages.chunks_exact(2).map(|pair| (pair[0], pair[1]));
        pairs.filter(|(a, b)| a.distance(*b) > self.tolerance_m).collect()
    }

    /// Whether `other` covers `face`'s side where they overlap: one of them is the foot of a solid that
    /// stands on the other.
    fn covers(&self, other: usize, face: usize, back: bool, flat: &Flat) -> bool {
        let (a, b) = (&self.scene.faces[face], &self.scene.faces[other]);
        let Some(facing) = &self.planes[other] else { return false };
        let opposite = flat.normal.dot(facing.normal) < 0.0;
        let is_lit_towards = b.sides == Sides::Two || opposite != back;
        // The plane of a small face is uncertain far away: the larger one's tells.
        let touches = |height: f64| height.abs() <= self.tolerance_m;
        let coplanar = || {
            b.vertices.iter().all(|p| touches(flat.height(*p)))
                || a.vertices.iter().all(|p| touches(facing.normal.dot(*p) - facing.offset))
        };
        is_lit_towards
            && !self.emits(a)
            && coplanar()
            && ((!back && self.is_foot(face)) || (opposite != back && self.is_foot(other)))
    }

    fn emits(&self, face: &Face) -> bool {
        self.scene.materials[face.material as usize].exitance_w_m2.iter().any(|m| *m > 0.0)
    }

    /// Whether a face is the end of a solid behind it.
    fn is_foot(&self, face: usize) -> bool {
        *self.is_foot[face].get_or_init(|| self.find_foot(face).unwrap_or(false))
    }

    /// `None` where something stands behind the face away from its outline.
    fn find_foot(&self, face: usize) -> Option<bool> {
        if self.scene.faces[face].sides != Sides::One {
            return Some(false);
        }
        let flat = Flat::new(&self.scene.faces[face], self.planes[face].as_ref()?);
        let mut rim = Rim::new(&flat.outline, self.tolerance_m);
        let mut walls = Vec::new();
        self.near(face, |other| {
            let normal = self.planes[other].map_or(DVec3::ZERO, |plane| plane.normal);
            let outwards = DVec2::new(flat.u.dot(normal), flat.v.dot(normal));
            let two_sided = self.scene.faces[other].sides == Sides::Two;
            let black_behind = (!two_sided).then_some(outwards);
            walls.extend(self.trace(other, &flat, true).into_iter().map(|segment| (segment, black_behind)));
        });
        for (segment, black_behind) in walls {
            rim.add(segment, black_behind)?;
        }
        Some(rim.is_dark_inside())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Cut, Material, cut};

    type Corner = [f64; 3];

    const SQUARE: [(f64, f64); 4] = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];

    /// A floor of 4 m × 3 m.
    const FLOOR: [Corner; 4] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 3.0, 0.0], [0.0, 3.0, 0.0]];

    fn scene(faces: &[(Vec<Corner>, Sides)]) -> Scene {
        let face = |(corners, sides): &(Vec<Corner>, Sides)| Face {
            vertices: corners.iter().map(|p| DVec3::from(*p)).collect(),
            material: 0,
            sides: *sides,
        };
        Scene {
            faces: faces.iter().map(face).collect(),
            materials: vec![Material { reflectance: vec![0.5], exitance_w_m2: vec![0.0] }],
            ..Scene::default()
        }
    }

    fn floor() -> (Vec<Corner>, Sides) {
        (FLOOR.to_vec(), Sides::One)
    }

    /// A solid on the floor, a metre high: its walls and its top, and its bottom where it has one.
    fn solid(outline: &[(f64, f64)], has_bottom: bool, sides: Sides) -> Vec<(Vec<Corner>, Sides)> {
        let n = outline.len();
        let at = |i: usize, z: f64| [outline[i % n].0, outline[i % n].1, z];
        let walls = (0..n).map(|i| vec![at(i, 0.0), at(i + 1, 0.0), at(i + 1, 1.0), at(i, 1.0)]);
        let top = (0..n).map(|i| at(i, 1.0)).collect();
        let bottom = has_bottom.then(|| (0..n).rev().map(|i| at(i, 0.0)).collect());
        walls.chain([top]).chain(bottom).map(|corners| (corners, sides)).collect()
    }

    fn moved(outline: &[(f64, f64)], x: f64, y: f64, turn: f64) -> Vec<(f64, f64)> {
        let turned = outline.iter().map(|p| DVec2::from_angle(turn).rotate(DVec2::from(*p)));
        turned.map(|p| (p.x + x, p.y + y)).collect()
    }

    /// Areas of the surfaces of the floor, face 0, on one side, greatest first.
    fn areas(cut: &Cut, back: bool) -> Vec<f64> {
        let of_floor = cut.surfaces.iter().filter(|s| s.face == 0 && s.back == back);
        let mut areas: Vec<f64> = of_floor.map(|s| s.area_m2).collect();
        areas.sort_by(|a, b| b.total_cmp(a));
        areas
    }

    fn assert_near(found: &[f64], expected: &[f64]) {
        let is_near = found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(found.len() == expected.len() && is_near, "{found:?} instead of {expected:?}");
    }

    fn on_floor(solids: &[Vec<(Vec<Corner>, Sides)>]) -> Cut {
        cut(&scene(&[&[floor()], &solids.concat()[..]].concat()))
    }

    #[test]
    fn under_a_box_with_a_bottom_there_is_no_surface() {
        for turn in [0.0, 0.3, 2.0] {
            let cut = on_floor(&[solid(&moved(&SQUARE, 1.5, 1.0, turn), true, Sides::One)]);
            assert_near(&areas(&cut, false), &[11.0]);
            // Neither is the bottom one.
            assert_eq!((cut.surfaces.len(), cut.covered, cut.cut_sides), (6, 2, 1));
            let floor = &cut.surfaces[0];
            assert!((floor.frame.area_m2 - 12.0).abs() < 1e-9 && !floor.full);
            let middle = moved(&[(0.5, 0.5)], 1.5, 1.0, turn)[0];
            let holds = |x, y| polygon::contains(&floor.outline, floor.frame.uv(DVec3::new(x, y, 0.0)));
            assert!(!holds(middle.0, middle.1) && holds(0.1, 0.1) && holds(3.9, 2.9));
        }
    }

    #[test]
    fn under_a_box_without_a_bottom_there_is_one_of_its_own() {
        for turn in [0.0, 0.3] {
            let cut = on_floor(&[solid(&moved(&SQUARE, 1.5, 1.0, turn), false, Sides::One)]);
            assert_near(&areas(&cut, false), &[11.0, 1.0]);
            assert!(cut.surfaces.iter().any(|s| s.face == 0 && s.full));
            assert_eq!((cut.covered, cut.cut_sides), (0, 1));
        }
    }

    #[test]
    fn loops_close_with_the_boundary_of_the_face() {
        // Against one edge, in a corner, right across, and over the edge.
        for (x, y, footprint) in [(1.0, 0.0, 1.0), (0.0, 2.0, 1.0), (3.5, 1.0, 0.5)] {
            let cut = on_floor(&[solid(&moved(&SQUARE, x, y, 0.0), false, Sides::One)]);
            assert_near(&areas(&cut, false), &[12.0 - footprint, footprint]);
        }
        let across = [(1.0, 0.0), (2.0, 0.0), (2.0, 3.0), (1.0, 3.0)];
        assert_near(&areas(&on_floor(&[solid(&across, false, Sides::One)]), false), &[6.0, 3.0, 3.0]);
        // One wall that stands free is nothing, one from edge to edge parts the floor.
        let wall = |from: f64| {
            let corners = vec![[1.0, from, 0.0], [1.0, 3.0, 0.0], [1.0, 3.0, 1.0], [1.0, from, 1.0]];
            on_floor(&[vec![(corners, Sides::Two)]])
        };
        assert_near(&areas(&wall(0.5), false), &[12.0]);
        assert_near(&areas(&wall(0.0), false), &[9.0, 3.0]);
    }

    #[test]
    fn each_of_several_boxes_leaves_its_hole() {
        let boxes = [(0.5, 0.5, 0.0), (2.0, 1.5, 0.2), (2.5, 0.2, 0.0)];
        let solids: Vec<_> = boxes
            .iter()
            .map(|(x, y, turn)| solid(&moved(&SQUARE, *x, *y, *turn), false, Sides::One))
            .collect();
        assert_near(&areas(&on_floor(&solids), false), &[9.0, 1.0, 1.0, 1.0]);
        let l = [(1.0, 1.0), (3.0, 1.0), (3.0, 1.5), (1.5, 1.5), (1.5, 2.5), (1.0, 2.5)];
        assert_near(&areas(&on_floor(&[solid(&l, false, Sides::One)]), false), &[10.5, 1.5]);
        let cut = on_floor(&[solid(&l, true, Sides::One)]);
        assert_near(&areas(&cut, false), &[10.5]);
        assert_eq!(cut.covered, 2);
    }

    #[test]
    fn what_touches_almost_touches() {
        // A box a rounding error inside the edge of the floor, and as much above it.
        let mut raised = solid(&moved(&SQUARE, 1.0, 1e-7, 1e-8), true, Sides::One);
        raised.iter_mut().flat_map(|(corners, _)| corners).for_each(|p| p[2] += 1e-7);
        let cut = on_floor(&[raised]);
        assert!((areas(&cut, false)[0] - 11.0).abs() < 1e-6);
        assert_eq!((areas(&cut, false).len(), cut.covered), (1, 2));
    }

    #[test]
    fn a_face_that_passes_through_is_a_contact_on_both_sides() {
        let mut pile = solid(&moved(&SQUARE, 1.5, 1.0, 0.4), false, Sides::One);
        pile.iter_mut().flat_map(|(corners, _)| corners).for_each(|p| p[2] -= 0.5);
        let cut = cut(&scene(&[&[(FLOOR.to_vec(), Sides::Two)], &pile[..]].concat()));
        assert_near(&areas(&cut, false), &[11.0, 1.0]);
        assert_near(&areas(&cut, true), &[11.0, 1.0]);
    }

    #[test]
    fn sides_are_cut_for_themselves() {
        let standing = solid(&moved(&SQUARE, 1.5, 1.0, 0.0), true, Sides::One);
        let cut = cut(&scene(&[&[(FLOOR.to_vec(), Sides::Two)], &standing[..]].concat()));
        assert_near(&areas(&cut, false), &[11.0]);
        assert_near(&areas(&cut, true), &[12.0]);
        for surface in cut.surfaces.iter().filter(|s| s.face == 0) {
            assert!(surface.frame.normal.z == if surface.back { -1.0 } else { 1.0 });
        }
    }

    #[test]
    fn two_sided_solids_cover_nothing() {
        let cut = on_floor(&[solid(&moved(&SQUARE, 1.5, 1.0, 0.0), true, Sides::Two)]);
        assert_near(&areas(&cut, false), &[11.0, 1.0]);
        assert_eq!(cut.covered, 0);
    }

    #[test]
    fn tiles_pictures_and_sheets_are_left_alone() {
        let tile = |x: f64| {
            (vec![[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x + 1.0, 1.0, 0.0], [x, 1.0, 0.0]], Sides::One)
        };
        let flipped = |(corners, sides): (Vec<Corner>, Sides)| (corners.into_iter().rev().collect(), sides);
        for faces in [
            vec![tile(0.0), tile(1.0), tile(2.0)],
            vec![floor(), tile(1.0)],
            vec![tile(0.0), flipped(tile(0.0))],
            // A room's floor with an outer shell.
            vec![floor(), flipped(floor())],
        ] {
            let cut = cut(&scene(&faces));
            assert_eq!((cut.surfaces.len(), cut.cut_sides, cut.covered), (faces.len(), 0, 0));
        }
    }

    #[test]
    fn a_room_of_two_shells_keeps_its_lit_inside() {
        let outer = solid(&[(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)], true, Sides::One);
        let inner = outer.iter().map(|(corners, sides)| (corners.iter().rev().copied().collect(), *sides));
        let faces: Vec<_> = outer.iter().cloned().chain(inner).collect();
        let cut = cut(&scene(&faces));
        assert_eq!((cut.surfaces.len(), cut.covered), (faces.len(), 0));
    }

    #[test]
    fn boxes_on_boxes_cover_each_other() {
        let mut upper = solid(&moved(&SQUARE, 1.5, 1.0, 0.0), true, Sides::One);
        upper.iter_mut().flat_map(|(corners, _)| corners).for_each(|p| p[2] += 1.0);
        let cut = on_floor(&[solid(&moved(&SQUARE, 1.5, 1.0, 0.0), true, Sides::One), upper]);
        // The hole in the floor, the lower bottom, the lower top and the upper bottom.
        assert_eq!((cut.surfaces.len(), cut.covered), (13 - 3, 4));
    }

    #[test]
    fn what_emits_stays() {
        let mut scene =
            scene(&[&[floor()], &solid(&moved(&SQUARE, 1.0, 1.0, 0.0), true, Sides::One)[..]].concat());
        scene.materials[0].exitance_w_m2[0] = 1.0;
        assert_eq!(cut(&scene).covered, 0);
    }

    #[test]
    fn small_contacts_cut_nothing() {
        let leg: Vec<(f64, f64)> = SQUARE.iter().map(|(x, y)| (1.0 + 0.005 * x, 1.0 + 0.005 * y)).collect();
        assert_near(&areas(&on_floor(&[solid(&leg, false, Sides::One)]), false), &[12.0]);
        // A covered part is worth it at any size.
        let cut = on_floor(&[solid(&leg, true, Sides::One)]);
        assert_near(&areas(&cut, false), &[12.0 - 0.005 * 0.005]);
    }

    #[test]
    fn a_speck_over_the_middle_covers_nothing() {
        // As small as what counts as touching.
        let at = |x: f64, y: f64| [2.0 + x, 1.5 + y, 1e-6];
        let speck = vec![at(0.0, 0.0), at(0.0, 2e-6), at(2e-6, 2e-6), at(2e-6, 0.0)];
        let cut = cut(&scene(&[floor(), (speck, Sides::One)]));
        assert_eq!((cut.surfaces.len(), cut.covered), (2, 0));
    }

    #[test]
    fn a_closed_room_has_no_contacts() {
        let room = solid(&[(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)], true, Sides::Two);
        let cut = cut(&scene(&room));
        assert_eq!((cut.surfaces.len(), cut.cut_sides, cut.covered), (12, 0, 0));
    }
}
