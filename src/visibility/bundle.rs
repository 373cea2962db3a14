//! Segments from one point side by side: a face is tested against four of them at once, by the arithmetic of [`OpaqueFaces::blocks`],
//! so that the answers are the same to the last bit. How high the point lies over the face's plane is found once for all of them.

use glam::DVec3;
use wide::f64x4;

use super::opaque::{MOST_OVERLAP, Parts, doubts, grazing, grazing_height, overlaps};
use super::{END_MARGIN, MAX_BUNDLE, OpaqueFaces};
use crate::math::lanes::{DVec3x4, LANES};

/// At most [`MAX_BUNDLE`] segments from one point.
pub struct Bundle {
    from: DVec3,
    count: usize,
    along: [DVec3x4; MAX_BUNDLE / LANES],
}

impl Bundle {
    /// The segments from `from` to the first `count` of these points.
    #[inline(always)]
    pub fn new(from: DVec3, to: &[DVec3x4], count: usize) -> Self {
        assert!(count <= MAX_BUNDLE, "{count} segments at once, at most {MAX_BUNDLE} are answered");
        let mut along = [DVec3x4::default(); MAX_BUNDLE / LANES];
        for (along, to) in along.iter_mut().zip(to) {
            *along = *to - DVec3x4::splat(from);
        }
        Self { from, count, along }
    }

    /// All of them, as a bit mask.
    #[inline]
    pub fn all(&self) -> u32 {
        (1 << self.count) - 1
    }
}

impl OpaqueFaces {
    /// Which of the segments the face blocks, as a bit mask.
    #[inline]
    pub fn blocked_by(&self, face: u32, bundle: &Bundle) -> u32 {
        let (height, normal) = self.before(face, bundle.from);
        let mut blocked = 0;
        for (group, along) in bundle.along[..bundle.count.div_ceil(LANES)].iter().enumerate() {
            let slope = normal.dot(along);
            // Most segments end before the plane or lead away from it, which shows without a division.
            if slope.simd_gt(f64x4::splat(height)).any() {
                blocked |= self.blocked_along(face, bundle.from, along, height, slope) << (LANES * group);
            }
        }
        blocked & bundle.all()
    }

    /// Whether the face hides all that lies between these four points from the point `from`: a convex face does that blocks the segments to
    /// them, for the hull of the points projects onto its plane within the hull of their projections. Of others it is not told.
    #[inline]
    pub fn hides(&self, face: u32, from: DVec3, corners: &DVec3x4) -> bool {
        let (height, normal) = self.before(face, from);
        let along = *corners - DVec3x4::splat(from);
        let slope = normal.dot(&along);
        slope.simd_gt(f64x4::splat(height)).all()
            && self.piece_count(face) == 1
            && self.blocked_along(face, from, &along, height, slope) == (1 << LANES) - 1
    }

    /// How high the point lies over the face's plane, and the plane's normal turned away from it, so that slopes towards the plane are positive.
    #[inline]
    fn before(&self, face: u32, from: DVec3) -> (f64, DVec3x4) {
        let Parts { normal, offset, .. } = self.parts(face);
        let height = offset - normal.dot(from);
        let (height, normal) = if height < 0.0 { (-height, -*normal) } else { (height, *normal) };
        (height, DVec3x4::splat(normal))
    }

    /// Which of four segments the face blocks, from a point this high over its plane, which they fall towards by these slopes.
    #[inline]
    fn blocked_along(&self, face: u32, from: DVec3, along: &DVec3x4, height: f64, slope: f64x4) -> u32 {
        let Parts { corner, polygon, far: greatest, .. } = self.parts(face);
        let t = f64x4::splat(height) / slope;
        let inside = t.simd_gt(f64x4::splat(END_MARGIN)) & t.simd_lt(f64x4::splat(1.0 - END_MARGIN));
        let p = DVec3x4::splat(from) + *along * t;
        let a = DVec3x4::splat(corner.a).dot(&p) - f64x4::splat(corner.a0);
        let b = DVec3x4::splat(corner.b).dot(&p) - f64x4::splat(corner.b0);
        let (near, far) = (a.fast_min(b), if corner.parallelogram { a.fast_max(b) } else { a + b });
        let within = |overlap: f64x4| inside & near.simd_ge(-overlap) & far.simd_le(f64x4::ONE + overlap);
        let is_low = || height < grazing_height(from, *greatest, corner.per_size);
        if !(within(f64x4::splat(MOST_OVERLAP)).any() || inside.any() && is_low()) {
            return 0;
        }
        let (doubts, per_size) =
            (doubts(from, along, f64x4::splat(*greatest)), f64x4::splat(corner.per_size));
        let hits = within(overlaps(doubts, per_size, slope)).to_bitmask();
        let grazing = if is_low() { (inside & grazing(doubts, per_size, slope)).to_bitmask() } else { 0 };
        let asked = if *polygon { hits | grazing } else { grazing };
        if asked == 0 {
            return hits;
        }
        hits & !asked | self.certain(face, from, along, (t, slope), (asked, grazing))
    }

    /// Which of the segments `asked` about the face blocks, that meet its plane at `t`: polygons, of which the rectangle around is met, and those
    /// that graze it.
    fn certain(
        &self,
        face: u32,
        from: DVec3,
        along: &DVec3x4,
        (t, slope): (f64x4, f64x4),
        (asked, grazing): (u32, u32),
    ) -> u32 {
        let along = along.0.map(f64x4::to_array);
        let (t, slope) = (t.to_array(), slope.to_array());
        let is_blocked = |i: usize| {
            let along = DVec3::new(along[0][i], along[1][i], along[2][i]);
            match grazing >> i & 1 {
                0 => self.is_certain(face, from, along, t[i], slope[i]),
                _ => self.blocks(face, from, along),
            }
        };
        (0..LANES).filter(|i| asked >> i & 1 != 0 && is_blocked(*i)).map(|i| 1 << i).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Face, Material, Scene, Sides};
    use proptest::prelude::*;

    /// A triangle, a parallelogram, and a concave polygon, in one plane each.
    fn faces(t: &[f64; 9]) -> OpaqueFaces {
        let [p, u, v] = [0, 3, 6].map(|i| DVec3::from_slice(&t[i..]));
        let at = |places: &[(f64, f64)]| places.iter().map(|(a, b)| p + u * *a + v * *b).collect();
        let shapes: [&[(f64, f64)]; 3] = [
            &[(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)],
            &[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)],
            &[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.5, 0.25), (0.0, 1.0)],
        ];
        let face = |shape: &&[(f64, f64)]| Face { vertices: at(shape), material: 0, sides: Sides::Two };
        let grey = Material { reflectance: vec![0.5], exitance_w_m2: vec![0.0] };
        OpaqueFaces::new(&Scene {
            faces: shapes.iter().map(face).collect(),
            materials: vec![grey],
            bands: vec!["grey".into()],
            ..Scene::default()
        })
    }

    proptest! {
        #[test]
        fn answers_as_one_segment_at_a_time(
            corners in proptest::array::uniform9(-1.0..1.0f64),
            from in proptest::array::uniform3(-1.5..1.5f64),
            ends in proptest::collection::vec(proptest::array::uniform3(-1.5..1.5f64), 1..=MAX_BUNDLE),
            grid in proptest::bool::ANY,
        ) {
            // Ends on a coarse grid: segments in planes of faces, through edges and corners.
            let snap = |x: f64| if grid { (2.0 * x).round() / 2.0 } else { x };
            let faces = faces(&corners.map(snap));
            let from = DVec3::from_array(from.map(snap));
            let ends: Vec<DVec3> = ends.iter().map(|end| DVec3::from_array(end.map(snap))).collect();
            let lanes: Vec<DVec3x4> = ends.chunks(LANES).map(DVec3x4::new).collect();
            let bundle = Bundle::new(from, &lanes, ends.len());
            for face in 0..3 {
                let blocked = faces.blocked_by(face, &bundle);
                for (i, end) in ends.iter().enumerate() {
                    prop_assert_eq!(blocked >> i & 1 != 0, faces.blocks(face, from, *end - from));
                }
            }
        }
    }
}
