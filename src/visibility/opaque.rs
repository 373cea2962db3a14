//! The faces of a scene prepared for segment tests: planes, boxes, and corners projected along the dominant axis.

use glam::{DVec2, DVec3};
use wide::f64x4;

use super::bands::{Bands, Edges};
use crate::math::lanes::DVec3x4;
use crate::scene::Scene;

/// Convex faces with more corners than this are cut in triangles too, so that pieces stay small.
const MAX_CONVEX_CORNERS: usize = 8;

/// All faces of a scene as opaque polygons.
#[derive(Clone)]
pub struct OpaqueFaces {
    faces: Vec<Prepared>,
    edges: Edges,
    vertices: Vec<DVec3>,
    /// Where each convex piece ends in `piece_vertices`; where each face's pieces end in `piece_ends`.
    piece_ends: Vec<u32>,
    piece_vertices: Vec<DVec3>,
}

#[derive(Clone)]
struct Prepared {
    parts: Parts,
    low: DVec3,
    high: DVec3,
    /// The longest side of the box.
    size: f64,
    axis: u8,
    first: u32,
    count: u32,
    bands: Bands,
    pieces: (u32, u32),
    width: f64,
}

impl Prepared {
    /// Whether lines from a point this high over the plane may graze the face.
    #[inline]
    fn may_be_grazed(&self, from: DVec3, height: f64) -> bool {
        height.abs() < grazing_height(from, self.parts.far, self.parts.corner.per_size)
    }
}

/// What a segment is tested against.
#[derive(Clone, Default)]
pub(super) struct Parts {
    pub normal: DVec3,
    pub offset: f64,
    pub corner: Corner,
    /// Whether the face is a polygon, of which `corner` only holds a rectangle around.
    pub polygon: bool,
    /// The greatest sum of a corner's coordinates, signs aside: what rounding goes by.
    pub far: f64,
}

/// A triangle or parallelogram: `a·p − a0` and `b·p − b0` are the coordinates along the two edges at the first corner.
#[derive(Clone, Default)]
pub(super) struct Corner {
    pub a: DVec3,
    pub a0: f64,
    pub b: DVec3,
    pub b0: f64,
    /// Whether the far half belongs to the face too.
    pub parallelogram: bool,
    /// One over the lesser height, of a polygon over the longest side of its box, per metre.
    pub per_size: f64,
}

/// Faces reach this much further than their edges, relative to their size, so that neighbours leave no gap.
const EDGE_OVERLAP: f64 = 1e-12;
/// The most that they reach further for a segment that all but lies in their plane.
pub(super) const MOST_OVERLAP: f64 = 1e-7;
/// Triangles and parallelograms this many times as long as wide are tested as polygons, as are those so small that rounding is more than they
/// reach beyond their edges: coordinates in shares of their width are rounding.
const MOST_ASPECT: f64 = 1e4;
/// Roundings in where a segment meets a plane, relative to the coordinates.
pub(super) const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// How uncertain the meeting of a segment and a face's plane is, in metres along the segment: this over the slope `n·along`. Two faces that
/// share an edge each take the segment through it to end up beyond by this much, and both must still say yes.
#[inline]
fn doubt(from: DVec3, along: DVec3, far: f64) -> f64 {
    let length = along.abs().element_sum();
    ROUNDING * (from.abs().element_sum() + length + far) * length
}

/// How far a face reaches beyond its edges, relative to its size, where `per_size` is one over that.
#[inline]
fn overlap(doubt: f64, per_size: f64, slope: f64) -> f64 {
    (EDGE_OVERLAP + doubt * per_size / slope.abs()).min(MOST_OVERLAP)
}

/// Whether the meeting is more uncertain than a face may reach beyond its edges. Whether the segment passes an edge is asked in space then, where
/// it is as certain as the coordinates, however small the face and flat the angle.
#[inline]
fn grazes(doubt: f64, per_size: f64, slope: f64) -> bool {
    doubt * per_size > MOST_OVERLAP * slope.abs()
}

/// How low over a face's plane segments start that graze the face, told without the segment, so that most need ask no further. To where the
/// segment meets it, it is at most as far as the coordinates of both add up to, m: its slope is the height over m or more, and its doubt that of
/// m twice over. Twice that, to be safe.
#[inline]
pub(super) fn grazing_height(from: DVec3, far: f64, per_size: f64) -> f64 {
    let most = from.abs().element_sum() + far;
    4.0 * ROUNDING / MOST_OVERLAP * most * most * per_size
}

/// As [`doubt`], for four segments or faces.
#[inline(always)]
pub(super) fn doubts(from: DVec3, along: &DVec3x4, far: f64x4) -> f64x4 {
    let length = along.absolute_sum();
    f64x4::splat(ROUNDING) * (f64x4::splat(from.abs().element_sum()) + length + far) * length
}

/// As [`overlap`], for four faces or segments.
#[inline(always)]
pub(super) fn overlaps(doubt: f64x4, per_size: f64x4, slope: f64x4) -> f64x4 {
    let overlap = f64x4::splat(EDGE_OVERLAP) + doubt * per_size / slope.abs();
    overlap.fast_min(f64x4::splat(MOST_OVERLAP))
}

/// As [`grazes`], for four faces or segments.
#[inline(always)]
pub(super) fn grazing(doubt: f64x4, per_size: f64x4, slope: f64x4) -> f64x4 {
    (doubt * per_size).simd_gt(f64x4::splat(MOST_OVERLAP) * slope.abs())
}

impl Corner {
    fn new(vertices: &[DVec3], far: f64) -> Option<Self> {
        let (u, v, parallelogram) = match vertices {
            [p, q, r] => (*q - *p, *r - *p, false),
            [p, q, r, s] if (*p + *r - *q - *s).length() <= 1e-12 * (*r - *p).length() => {
                (*q - *p, *s - *p, true)
            }
            _ => return None,
        };
        let normal = u.cross(v);
        let square = normal.length_squared();
        let (a, b) = (v.cross(normal) / square, normal.cross(u) / square);
        let (a0, b0, per_size) = (a.dot(vertices[0]), b.dot(vertices[0]), a.length().max(b.length()));
        let usable =
            per_size * u.length().max(v.length()) <= MOST_ASPECT && per_size * ROUNDING * far <= MOST_OVERLAP;
        usable.then_some(Self { a, a0, b, b0, parallelogram, per_size })
    }

    /// A rectangle around a polygon, along its longest edge, larger than any rounding.
    pub fn around(vertices: &[DVec3], normal: DVec3) -> Self {
        let (_, along) = longest_edge(vertices);
        let directions = [along, normal.cross(along)];
        let ranges = directions.map(|direction| {
            let places = || vertices.iter().map(|v| direction.dot(*v));
            (places().fold(f64::INFINITY, f64::min), places().fold(f64::NEG_INFINITY, f64::max))
        });
        let longest = ranges.iter().map(|(low, high)| high - low).fold(0.0, f64::max);
        let side = |i: usize| {
            let (low, high) = ranges[i];
            let margin = 10.0 * MOST_OVERLAP * longest + 1e-13 * (low.abs() + high.abs());
            let range = high - low + 2.0 * margin;
            if range > 0.0 { (directions[i] / range, (low - margin) / range) } else { (DVec3::ZERO, 0.0) }
        };
        let ((a, a0), (b, b0)) = (side(0), side(1));
        Self { a, a0, b, b0, parallelogram: true, per_size: 0.0 }
    }

    #[inline]
    fn contains(&self, p: DVec3, overlap: f64) -> bool {
        let (a, b) = (self.a.dot(p) - self.a0, self.b.dot(p) - self.b0);
        let far = if self.parallelogram { a.max(b) } else { a + b };
        a.min(b) >= -overlap && far <= 1.0 + overlap
    }
}

fn project(v: DVec3, axis: u8) -> DVec2 {
    match axis {
        0 => DVec2::new(v.y, v.z),
        1 => DVec2::new(v.z, v.x),
        _ => DVec2::new(v.x, v.y),
    }
}

/// Newell's normal: twice the vector area of a polygon.
fn vector_area(vertices: &[DVec3]) -> DVec3 {
    let anchor = vertices[0];
    (1..vertices.len() - 1).map(|i| (vertices[i] - anchor).cross(vertices[i + 1] - anchor)).sum()
}

/// Where a polygon's longest edge starts, and its direction, 0 where all edges are points.
fn longest_edge(vertices: &[DVec3]) -> (DVec3, DVec3) {
    let edges = (0..vertices.len()).map(|i| (vertices[i], vertices[(i + 1) % vertices.len()] - vertices[i]));
    let longest = edges.max_by(|a, b| a.1.length_squared().total_cmp(&b.1.length_squared()));
    longest.map_or_else(Default::default, |(start, edge)| (start, edge.normalize_or_zero()))
}

/// The unit normal of a polygon's plane, 0 for a polygon without area.
///
/// At right angles to the longest edge, towards the corner farthest off it: the vector area of a thin polygon, which only tells the side
/// here, is as wrong along as across, and a plane tilted along a strip misses its far end.
pub(super) fn unit_normal(vertices: &[DVec3]) -> DVec3 {
    let (start, along) = longest_edge(vertices);
    let across = |v: &DVec3| {
        // Twice, for what is left of a corner near to the edge is mostly rounding along it.
        let off = (*v - start).reject_from_normalized(along);
        off.reject_from_normalized(along)
    };
    let farthest =
        vertices.iter().map(across).max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    let normal = along.cross(farthest.unwrap_or_default()).normalize_or_zero();
    let side = normal.dot(vector_area(vertices));
    if side == 0.0 { DVec3::ZERO } else { normal * side.signum() }
}

/// Twice the area of a polygon over its perimeter.
fn width(vertices: &[DVec3]) -> f64 {
    let perimeter: f64 =
        (0..vertices.len()).map(|i| vertices[i].distance(vertices[(i + 1) % vertices.len()])).sum();
    if perimeter > 0.0 { vector_area(vertices).length() / perimeter } else { 0.0 }
}

impl OpaqueFaces {
    /// Prepares the faces of `scene`.
    pub fn new(scene: &Scene) -> Self {
        let mut prepared = Self {
            faces: Vec::new(),
            edges: Edges::default(),
            vertices: Vec::new(),
            piece_ends: vec![0],
            piece_vertices: Vec::new(),
        };
        for face in &scene.faces {
            let normal = unit_normal(&face.vertices);
            let size = normal.abs();
            let axis = if size.x > size.y && size.x > size.z {
                0
            } else if size.y > size.z {
                1
            } else {
                2
            };
            let start = face.vertices[0];
            let offset =
                face.vertices.iter().map(|v| v.dot(normal)).sum::<f64>() / face.vertices.len() as f64;
            // Hits lie on the plane, which corners may miss by a little: along the dominant axis by at most √3 times the distance.
            let off_plane = face.vertices.iter().map(|v| (v.dot(normal) - offset).abs()).fold(0.0, f64::max);
            let pieces = prepared.add_pieces(&face.vertices, normal, axis);
            let far = face.vertices.iter().map(|v| v.abs().element_sum()).fold(0.0, f64::max);
            let corner = Corner::new(&face.vertices, far);
            let polygon = corner.is_none();
            let low = face.vertices.iter().fold(start, |a, v| a.min(*v)) - 2.0 * off_plane;
            let high = face.vertices.iter().fold(start, |a, v| a.max(*v)) + 2.0 * off_plane;
            let size = (high - low).max_element();
            let corner = corner
                .unwrap_or_else(|| Corner { per_size: 1.0 / size, ..Corner::around(&face.vertices, normal) });
            let mut bands = Bands::default();
            if polygon {
                let corners: Vec<DVec2> = face.vertices.iter().map(|v| project(*v, axis)).collect();
                bands = prepared.edges.add(&corners, size * MOST_OVERLAP);
            }
            prepared.faces.push(Prepared {
                parts: Parts { normal, offset, corner, polygon, far },
                low,
                high,
                size,
                axis,
                first: prepared.vertices.len() as u32,
                count: face.vertices.len() as u32,
                bands,
                pieces,
                width: width(&face.vertices),
            });
            prepared.vertices.extend_from_slice(&face.vertices);
        }
        prepared
    }

    /// Adds the convex pieces of a face: itself, or its triangles.
    fn add_pieces(&mut self, vertices: &[DVec3], normal: DVec3, axis: u8) -> (u32, u32) {
        let first = self.piece_ends.len() as u32 - 1;
        let n = vertices.len();
        let turns_left = |i: usize| {
            let (a, b, c) = (vertices[i], vertices[(i + 1) % n], vertices[(i + 2) % n]);
            (b - a).cross(c - b).dot(normal) >= 0.0
        };
        if n <= MAX_CONVEX_CORNERS && (0..n).all(turns_left) {
            self.piece_vertices.extend_from_slice(vertices);
            self.piece_ends.push(self.piece_vertices.len() as u32);
        } else {
            let mut triangles: Vec<u32> = Vec::new();
            let flat = vertices.iter().map(|v| project(*v, axis).to_array());
            earcut::Earcut::new().earcut(flat, &[], &mut triangles);
            for triangle in triangles.chunks_exact(3) {
                self.piece_vertices.extend(triangle.iter().map(|i| vertices[*i as usize]));
                self.piece_ends.push(self.piece_vertices.len() as u32);
            }
        }
        (first, self.piece_ends.len() as u32 - 1)
    }

    /// How many convex pieces the face consists of.
    pub fn piece_count(&self, face: u32) -> usize {
        let (first, end) = self.faces[face as usize].pieces;
        (end - first) as usize
    }

    /// The convex pieces of the face.
    pub fn pieces(&self, face: u32) -> impl Iterator<Item = &[DVec3]> {
        let (first, end) = self.faces[face as usize].pieces;
        (first..end).map(|i| {
            let (start, end) = (self.piece_ends[i as usize], self.piece_ends[i as usize + 1]);
            &self.piece_vertices[start as usize..end as usize]
        })
    }

    /// Twice the face's area over its perimeter, in metres: the width of a strip, half the side of a square.
    pub fn width(&self, face: u32) -> f64 {
        self.faces[face as usize].width
    }

    /// Bytes that they take.
    pub fn bytes(&self) -> usize {
        let corners = size_of_val(&*self.vertices) + self.edges.bytes();
        let pieces = size_of_val(&*self.piece_ends) + size_of_val(&*self.piece_vertices);
        size_of_val(&*self.faces) + corners + pieces
    }

    /// How many faces there are.
    pub fn len(&self) -> usize {
        self.faces.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.faces.is_empty()
    }

    /// The corners (least, greatest) of a box around the face, and around all points at which it is hit but for rounding.
    pub fn bounds(&self, face: u32) -> (DVec3, DVec3) {
        let face = &self.faces[face as usize];
        (face.low, face.high)
    }

    /// The face's plane: unit normal, 0 for a face that nothing hits, and the offset along it.
    pub(super) fn plane(&self, face: u32) -> (DVec3, f64) {
        let parts = self.parts(face);
        (parts.normal, parts.offset)
    }

    /// What segments are tested against.
    #[inline]
    pub(super) fn parts(&self, face: u32) -> &Parts {
        &self.faces[face as usize].parts
    }

    /// The face's corners.
    pub fn vertices(&self, face: u32) -> &[DVec3] {
        let face = &self.faces[face as usize];
        &self.vertices[face.first as usize..(face.first + face.count) as usize]
    }

    /// Where the line `from + t · along` meets the face, if it does inside the polygon.
    #[inline]
    pub fn hit(&self, face: u32, from: DVec3, along: DVec3) -> Option<f64> {
        let face = &self.faces[face as usize];
        let slope = face.parts.normal.dot(along);
        if slope == 0.0 {
            return None;
        }
        let height = face.parts.offset - face.parts.normal.dot(from);
        let t = height / slope;
        if t.is_finite() && self.contains(face, from, along, t, slope) {
            return Some(t);
        }
        let always = (f64::NEG_INFINITY, f64::INFINITY);
        face.may_be_grazed(from, height).then(|| self.grazed_at(face, from, along, slope, always)).flatten()
    }

    /// Whether the face blocks the open segment from `from` along `along` (t from 0 to 1, less the end margins).
    #[inline(always)]
    pub fn blocks(&self, face: u32, from: DVec3, along: DVec3) -> bool {
        let face = &self.faces[face as usize];
        let slope = face.parts.normal.dot(along);
        let height = face.parts.offset - face.parts.normal.dot(from);
        // Most segments end before the plane or lead away from it, which shows without a division.
        let beyond = if height < 0.0 { slope < height } else { slope > height };
        if !beyond {
            return false;
        }
        let t = height / slope;
        let (least, greatest) = (super::END_MARGIN, 1.0 - super::END_MARGIN);
        if !(t > least && t < greatest) {
            return false;
        }
        self.contains(face, from, along, t, slope)
            || face.may_be_grazed(from, height)
                && self.grazed_at(face, from, along, slope, (least, greatest)).is_some()
    }

    /// Where a line that meets the face's plane at this slope passes an edge as near as coordinates can tell, within this range, if it grazes.
    #[cold]
    fn grazed_at(
        &self,
        face: &Prepared,
        from: DVec3,
        along: DVec3,
        slope: f64,
        range: (f64, f64),
    ) -> Option<f64> {
        let Parts { corner, far, .. } = &face.parts;
        if !grazes(doubt(from, along, *far), corner.per_size, slope) {
            return None;
        }
        let near = ROUNDING * (from.abs().element_sum() + along.abs().element_sum() + far);
        let square = along.length_squared();
        // Where along the line a corner lies, and how far off.
        let place = |corner: DVec3| {
            let to = corner - from;
            let t = to.dot(along) / square;
            (t, to - along * t)
        };
        let corners = &self.vertices[face.first as usize..(face.first + face.count) as usize];
        (0..corners.len()).find_map(|i| {
            let ((start, off), (end, end_off)) = (place(corners[i]), place(corners[(i + 1) % corners.len()]));
            let edge = end_off - off;
            let nearest = -off.dot(edge) / edge.length_squared();
            let share = if nearest > 0.0 { nearest.min(1.0) } else { 0.0 };
            let (distance, t) = (off + edge * share, start + (end - start) * share);
            (distance.length_squared() <= near * near && t > range.0 && t < range.1).then_some(t)
        })
    }

    /// Whether the point at `t` of the face's plane lies in the polygon, or as near to its edges as the segment's meeting with them is
    /// uncertain.
    #[inline]
    fn contains(&self, face: &Prepared, from: DVec3, along: DVec3, t: f64, slope: f64) -> bool {
        let p = from + along * t;
        let Parts { corner, polygon, far, .. } = &face.parts;
        let doubt = doubt(from, along, *far);
        corner.contains(p, overlap(doubt, corner.per_size, slope))
            && (!polygon || self.polygon_contains(face, p, doubt, slope))
    }

    /// As [`OpaqueFaces::contains`], for a polygon whose rectangle contains the point `p` of the plane.
    fn polygon_contains(&self, face: &Prepared, p: DVec3, doubt: f64, slope: f64) -> bool {
        let near = face.size * overlap(doubt, face.parts.corner.per_size, slope);
        let (p, low, high) =
            (project(p, face.axis), project(face.low, face.axis), project(face.high, face.axis));
        let is_around = p.cmpge(low - near).all() && p.cmple(high + near).all();
        is_around && self.edges.contain(&face.bands, p, near)
    }

    /// Whether a polygon whose rectangle contains where this segment meets its plane does so too.
    pub(super) fn is_certain(&self, face: u32, from: DVec3, along: DVec3, t: f64, slope: f64) -> bool {
        let face = &self.faces[face as usize];
        self.polygon_contains(face, from + along * t, doubt(from, along, face.parts.far), slope)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Face, Material, Sides};
    use glam::DQuat;

    fn faces(outlines: &[Vec<DVec3>]) -> OpaqueFaces {
        let face =
            |vertices: &Vec<DVec3>| Face { vertices: vertices.clone(), material: 0, sides: Sides::Two };
        let grey = Material { reflectance: vec![0.5], exitance_w_m2: vec![0.0] };
        OpaqueFaces::new(&Scene {
            faces: outlines.iter().map(face).collect(),
            materials: vec![grey],
            bands: vec!["grey".into()],
            ..Scene::default()
        })
    }

    fn turns() -> impl Iterator<Item = DQuat> {
        (0..500).map(f64::from).map(|i| {
            let axis = DVec3::new(i.sin(), (2.0 * i).cos(), 0.5);
            DQuat::from_axis_angle(axis.normalize(), 0.1 * i)
        })
    }

    /// Which of two, a square and a polygon of this size, block segments of this length and slope that pass their common edge at this height.
    fn blockers(size: f64, at: DVec3, length: f64, slope: f64, height: f64) -> Vec<[bool; 2]> {
        let blockers = |turn: DQuat| {
            let place = |x: f64, y: f64| at + turn * (size * DVec3::new(x, y, 0.0));
            let square = vec![place(-1.0, -1.0), place(0.0, -1.0), place(0.0, 1.0), place(-1.0, 1.0)];
            let polygon = vec![place(0.0, -1.0), place(0.9, 0.0), place(0.5, 0.8), place(0.0, 1.0)];
            let faces = faces(&[square, polygon]);
            let along = turn * (length * DVec3::new(0.8, 0.6, slope));
            let from = at + turn * DVec3::new(0.0, 0.0, height) - 0.4 * along;
            [0, 1].map(|face| faces.blocks(face, from, along))
        };
        turns().map(blockers).collect()
    }

    #[test]
    fn specks_that_segments_graze_have_no_gap() {
        assert!(blockers(2e-8, DVec3::new(0.05, 0.3, -0.05), 0.06, 6e-5, 0.0).iter().all(|[a, b]| *a || *b));
    }

    #[test]
    fn faces_far_from_the_origin_that_segments_graze_have_no_gap() {
        assert!(blockers(2e-3, DVec3::new(2e3, -3e3, 500.0), 30.0, 1e-4, 0.0).iter().all(|[a, b]| *a || *b));
    }

    #[test]
    fn large_faces_that_short_segments_graze_near_the_origin_have_no_gap() {
        assert!(blockers(50.0, DVec3::ZERO, 0.01, 1e-6, 0.0).iter().all(|[a, b]| *a || *b));
    }

    #[test]
    fn needles_of_a_width_near_to_rounding_have_no_gap() {
        let (length, width) = (3e-9, 4e-13);
        let is_open = |turn: &DQuat| {
            let place = |x: f64, y: f64| DVec3::new(1.5, 1.4, -2.3) + *turn * DVec3::new(x, y, 0.0);
            let needle = faces(&[vec![place(0.0, 0.0), place(length, 0.0), place(length, width)]]);
            let along = *turn * DVec3::new(0.1, -0.2, 1.0);
            !needle.blocks(0, place(length - width, 0.5 * width) - 0.4 * along, along)
        };
        assert_eq!(turns().filter(is_open).count(), 0);
    }

    /// Rounding moves where they meet the plane by half a micrometre; 0.2 nm above the edge they meet it 2 µm from there.
    #[test]
    fn grazing_segments_pass_beside_a_face_that_they_miss_by_more_than_rounding() {
        let at = DVec3::new(2e3, -3e3, 500.0);
        assert!(blockers(2e-3, at, 30.0, 1e-4, 2e-10).iter().all(|blockers| *blockers == [true, false]));
        assert!(blockers(2e-3, at, 30.0, -1e-4, 2e-10).iter().all(|blockers| *blockers == [false, true]));
    }
}
