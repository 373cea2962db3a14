//! Four faces side by side: one segment is tested against all of them at once, by the arithmetic of [`OpaqueFaces::blocks`], so
//! that the answers are the same to the last bit.

use glam::DVec3;
use wide::f64x4;

use super::opaque::{Parts, doubts, grazing, overlaps};
use super::{END_MARGIN, OpaqueFaces};
use crate::math::lanes::{DVec3x4, LANES};

/// Stands where there is no face.
pub const NO_FACE: u32 = u32::MAX;

/// Up to four faces; the others have no normal, which nothing meets.
#[derive(Clone)]
pub(super) struct Block {
    normal: DVec3x4,
    offset: f64x4,
    a: DVec3x4,
    a0: f64x4,
    b: DVec3x4,
    b0: f64x4,
    per_size: f64x4,
    far: f64x4,
    /// All bits where the far half of the parallelogram belongs to the face.
    parallelogram: f64x4,
    /// Which faces these are.
    pub face: [u32; LANES],
    /// Which lanes hold polygons, of which only rectangles around them stand here.
    polygons: u32,
}

/// The same line in all lanes.
pub(super) struct Line {
    from: DVec3,
    along: DVec3,
}

impl Line {
    #[inline]
    pub fn new(from: DVec3, along: DVec3) -> Self {
        Self { from, along }
    }
}

impl Block {
    /// The block of these faces, of which there are at most four.
    pub fn new(faces: &OpaqueFaces, list: &[u32]) -> Self {
        let none = Parts::default();
        let parts: [&Parts; LANES] =
            std::array::from_fn(|i| list.get(i).map_or(&none, |face| faces.parts(*face)));
        let lanes = |value: &dyn Fn(&Parts) -> f64| f64x4::from(parts.map(value));
        let vector = |value: &dyn Fn(&Parts) -> DVec3| DVec3x4::new(&parts.map(value));
        let mask = |part: &Parts| f64::from_bits(if part.corner.parallelogram { u64::MAX } else { 0 });
        Self {
            normal: vector(&|part| part.normal),
            offset: lanes(&|part| part.offset),
            a: vector(&|part| part.corner.a),
            a0: lanes(&|part| part.corner.a0),
            b: vector(&|part| part.corner.b),
            b0: lanes(&|part| part.corner.b0),
            per_size: lanes(&|part| part.corner.per_size),
            far: lanes(&|part| part.far),
            parallelogram: lanes(&mask),
            face: std::array::from_fn(|i| list.get(i).copied().unwrap_or(NO_FACE)),
            polygons: (0..LANES).map(|i| (parts[i].polygon as u32) << i).sum(),
        }
    }

    /// Which of the `open` segments from `from` along these are blocked by a face other than those in `skip`, as a bit mask; the last face
    /// that blocks one goes to `last`.
    #[inline]
    pub fn blocked(
        &self,
        faces: &OpaqueFaces,
        from: DVec3,
        along: &[DVec3],
        skip: [u32; 2],
        open: u32,
        last: &mut u32,
    ) -> u32 {
        let height = self.offset - self.normal.dot(&DVec3x4::splat(from));
        let (least, greatest) = (f64x4::splat(END_MARGIN), f64x4::splat(1.0 - END_MARGIN));
        let mut blocked = 0;
        let mut rest = open;
        while rest != 0 {
            let i = rest.trailing_zeros() as usize % along.len();
            rest &= rest - 1;
            let line = Line { from, along: along[i] };
            let slope = self.normal.dot(&DVec3x4::splat(line.along));
            let t = height / slope;
            let inside = t.simd_gt(least) & t.simd_lt(greatest);
            if inside.any() {
                let (met, asked) = self.contains(&line, t, slope);
                let hits = (inside & met).to_bitmask();
                if let Some(face) = self.certain(faces, &line, skip, hits, asked) {
                    *last = face;
                    blocked |= 1 << i;
                }
            }
        }
        blocked
    }

    /// The first face among these hits that blocks; those `asked` are tested alone.
    #[inline]
    fn certain(
        &self,
        faces: &OpaqueFaces,
        line: &Line,
        skip: [u32; 2],
        mut hits: u32,
        asked: u32,
    ) -> Option<u32> {
        while hits != 0 {
            let lane = hits.trailing_zeros() as usize % LANES;
            let face = self.face[lane];
            let certain = asked >> lane & 1 == 0;
            if !skip.contains(&face) && (certain || faces.blocks(face, line.from, line.along)) {
                return Some(face);
            }
            hits &= hits - 1;
        }
        None
    }

    /// Calls `found` with each face that the line meets in front of its origin up to `reach`, and where.
    #[inline]
    pub fn hits(&self, faces: &OpaqueFaces, line: &Line, reach: f64, mut found: impl FnMut(u32, f64)) {
        let slope = self.normal.dot(&DVec3x4::splat(line.along));
        let t = (self.offset - self.normal.dot(&DVec3x4::splat(line.from))) / slope;
        let is_ahead = |t: f64| t > 0.0 && t <= reach.min(f64::MAX);
        let (met, asked) = self.contains(line, t, slope);
        let (met, t) = (met.to_bitmask(), t.to_array());
        for lane in (0..LANES).filter(|lane| met >> lane & 1 != 0) {
            let face = self.face[lane];
            // Edges may be met ahead where the plane is met behind.
            let at =
                if asked >> lane & 1 == 0 { Some(t[lane]) } else { faces.hit(face, line.from, line.along) };
            if let Some(at) = at.filter(|t| is_ahead(*t)) {
                found(face, at);
            }
        }
    }

    /// Which faces the point at `t` may lie in or the line pass the edges of, and which must be asked about it: polygons, of which the rectangle
    /// around is looked at here, and those that the line grazes.
    #[inline]
    fn contains(&self, line: &Line, t: f64x4, slope: f64x4) -> (f64x4, u32) {
        let p = DVec3x4::splat(line.from) + DVec3x4::splat(line.along) * t;
        let (a, b) = (self.a.dot(&p) - self.a0, self.b.dot(&p) - self.b0);
        let far = self.parallelogram.bitselect(a.fast_max(b), a + b);
        let doubt = doubts(line.from, &DVec3x4::splat(line.along), self.far);
        let overlap = overlaps(doubt, self.per_size, slope);
        let grazed = grazing(doubt, self.per_size, slope);
        let met = a.fast_min(b).simd_ge(-overlap) & far.simd_le(f64x4::ONE + overlap) | grazed;
        (met, self.polygons | grazed.to_bitmask())
    }
}
