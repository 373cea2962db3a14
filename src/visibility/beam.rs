//! Segments with a common origin against eight boxes at once, in single precision, on the safe side: a box that one of them
//! meets is never missed.
//!
//! At parameter t the segments fill the box `o + t [d⁻, d⁺]`. It reaches the slab `[l, h]` of an axis where `o + t d⁺ ≥ l` and
//! `o + t d⁻ ≤ h`: two bounds on t, from below or above by the signs of d⁺ and d⁻. For a single segment these are the usual slabs.
//! What rounding to single precision may lose is made up by moving the origin out by [`PAD`] of the coordinates' size, and by
//! [`SLACK`] on t.

use glam::DVec3;
use wide::f32x8;

use super::MAX_BUNDLE;

/// Share of the coordinates by which boxes are taken to be larger: sixteen roundings of an f32, and three times what faces at most reach
/// beyond their edges.
pub(super) const PAD: f64 = 1.0 / (1u32 << 20) as f64;
/// Share by which the greatest t is taken to be larger.
const SLACK: f32 = 1.0 + 1.0 / (1u32 << 20) as f32;
/// Directions are taken to be at least this steep, relative to the longest, so that bounds stay finite.
const LEAST_SLOPE: f64 = 1e-12;

/// Eight boxes, lanes side by side: least x, y, z, greatest x, y, z.
pub(super) type Boxes = [f32x8; 6];

/// The segments.
pub(super) struct Beam {
    /// Bounds on t, those from below first: which side of the box, and t = side · inverse + shift.
    bounds: [(usize, f32, f32); 6],
    from_below: usize,
    /// One over the greatest component of all directions: t times this is what is compared.
    scale: f64,
    /// How far boxes are moved out.
    pad: f64,
    reach: f32,
}

impl Beam {
    /// Segments from `origin` up to `reach` times their directions, each of which lies between `least` and `greatest`. `extent` is the
    /// greatest coordinate of all boxes, or more. `None` where all directions are 0.
    #[inline(always)]
    pub fn new(origin: DVec3, least: DVec3, greatest: DVec3, reach: f64, extent: f64) -> Option<Self> {
        let longest = least.abs().max(greatest.abs()).max_element();
        if longest == 0.0 {
            return None;
        }
        let pad = (origin.abs().max_element() + extent + longest * 1e-5) * PAD;
        let mut beam = Self { bounds: [(0, 0.0, 0.0); 6], from_below: 0, scale: longest, pad, reach: 0.0 };
        beam.shorten(reach);
        let mut above = 6;
        for axis in 0..3 {
            let lean = |d: f64| {
                if d.abs() < LEAST_SLOPE * longest { (LEAST_SLOPE * longest).copysign(d) } else { d }
            };
            let (l, h) = (lean(least[axis]), lean(greatest[axis]));
            for (side, d, origin, below) in
                [(axis, h, origin[axis] + pad, h > 0.0), (axis + 3, l, origin[axis] - pad, l < 0.0)]
            {
                let inverse = (longest / d) as f32;
                let bound = (side, inverse, (-origin * inverse as f64) as f32);
                if below {
                    beam.bounds[beam.from_below] = bound;
                    beam.from_below += 1;
                } else {
                    above -= 1;
                    beam.bounds[above] = bound;
                }
            }
        }
        Some(beam)
    }

    /// Lets the segments end at `reach` times their directions.
    #[inline]
    pub fn shorten(&mut self, reach: f64) {
        self.reach = (reach * self.scale) as f32;
    }

    /// Which boxes a segment may meet, as a bit mask; a box that is left out is met by none.
    #[inline]
    pub fn meets(&self, boxes: &Boxes) -> u32 {
        let (mut near, mut far) = (f32x8::ZERO, f32x8::splat(self.reach));
        let bound = |(side, inverse, shift): &(usize, f32, f32)| {
            boxes[side % boxes.len()].mul_add(f32x8::splat(*inverse), f32x8::splat(*shift))
        };
        for below in &self.bounds[..self.from_below] {
            near = near.fast_max(bound(below));
        }
        for above in &self.bounds[self.from_below..] {
            far = far.fast_min(bound(above));
        }
        near.simd_le(far * f32x8::splat(SLACK)).to_bitmask()
    }
}

/// The single segments of a beam, eight to a register, against one box.
pub(super) struct Fan {
    inverse: [[f32x8; 3]; GROUPS],
    shift: [[[f32x8; 3]; 2]; GROUPS],
    groups: usize,
    reach: f32,
}

const GROUPS: usize = MAX_BUNDLE / 8;

impl Fan {
    /// The segments of `beam` from the same origin along these.
    #[inline(always)]
    pub fn new(beam: &Beam, origin: DVec3, along: &[DVec3]) -> Self {
        let groups = along.len().div_ceil(8);
        let mut fan = Self {
            inverse: [[f32x8::ZERO; 3]; GROUPS],
            shift: [[[f32x8::ZERO; 3]; 2]; GROUPS],
            groups,
            reach: beam.reach,
        };
        let scale = 1.0 / beam.scale;
        for group in 0..groups {
            for axis in 0..3 {
                let mut lanes = [1.0f32; 8];
                for (lane, along) in lanes.iter_mut().zip(&along[8 * group..]) {
                    let d = (along[axis] * scale) as f32;
                    *lane = if d.abs() < LEAST_SLOPE as f32 { (LEAST_SLOPE as f32).copysign(d) } else { d };
                }
                let inverse = f32x8::splat(1.0) / f32x8::from(lanes);
                fan.inverse[group][axis] = inverse;
                for (side, pad) in [beam.pad, -beam.pad].into_iter().enumerate() {
                    fan.shift[group][side][axis] = inverse * f32x8::splat(-(origin[axis] + pad) as f32);
                }
            }
        }
        fan
    }

    /// Which of the segments may meet the box in this lane, as a bit mask.
    #[inline]
    pub fn meets(&self, boxes: &Boxes, lane: usize) -> u32 {
        let side = |i: usize| f32x8::splat(boxes[i].as_array()[lane % 8]);
        let mut met = 0;
        for group in 0..self.groups {
            let (mut near, mut far) = (f32x8::ZERO, f32x8::splat(self.reach));
            for axis in 0..3 {
                let inverse = self.inverse[group][axis];
                let a = side(axis).mul_add(inverse, self.shift[group][0][axis]);
                let b = side(axis + 3).mul_add(inverse, self.shift[group][1][axis]);
                near = near.fast_max(a.fast_min(b));
                far = far.fast_min(a.fast_max(b));
            }
            met |= near.simd_le(far * f32x8::splat(SLACK)).to_bitmask() << (8 * group);
        }
        met
    }
}
