//! Shafts: the convex hull of an emitter's and a receiver's corners. A face outside of it blocks no segment between the two.
//!
//! After Haines and Wallace 1991, with planes through an edge of one side and a corner of the other instead of boxes, so that the
//! shaft is the hull itself wherever both sides are flat.

use glam::DVec3;
use wide::{f32x8, f64x4};

use super::OpaqueFaces;
use super::beam::Boxes;
use crate::math::lanes::{DVec3x4, LANES};

/// The most planes a shaft keeps: two per edge of each side and the planes of both sides.
const MAX_PLANES: usize = 18;

/// Polygons of at most so many corners are cut by the planes.
const MAX_CUT: usize = 8;
/// Corners that one may have while it is cut.
const MAX_CORNERS: usize = MAX_CUT + MAX_PLANES;

/// A convex region given by half-spaces `n·x ≤ d`, and its box.
#[derive(Clone, Debug)]
pub struct Shaft {
    /// Normals and distances, four half-spaces side by side; the last one fills its register.
    planes: [(DVec3x4, f64x4); MAX_PLANES.div_ceil(LANES)],
    count: usize,
    low: DVec3,
    high: DVec3,
    /// From the middle of one side to that of the other: where it starts, and along what.
    axis: (DVec3, DVec3),
}

/// The half-spaces found so far.
struct Planes {
    planes: [(DVec3, f64); MAX_PLANES],
    count: usize,
}

impl Shaft {
    /// The shaft between two flat sides of at most four corners each. A side with a `normal` also bounds the shaft by its own
    /// plane: only what lies in front of it can block.
    pub fn between(a: &[DVec3], a_normal: Option<DVec3>, b: &[DVec3], b_normal: Option<DVec3>) -> Self {
        let points = || a.iter().chain(b).copied();
        let (low, high) = points().fold((a[0], a[0]), |(l, h), p| (l.min(p), h.max(p)));
        let extent = (high - low).max_element();
        let margin = extent * 1e-9;
        let mut planes = Planes { planes: [(DVec3::ZERO, 0.0); MAX_PLANES], count: 0 };
        for (side, normal) in [(a, a_normal), (b, b_normal)] {
            if let Some(normal) = normal {
                planes.push(-normal, -normal.dot(side[0]) - margin);
            }
        }
        let (of_a, of_b) = (DVec3x4::new(a), DVec3x4::new(b));
        for (side, lanes, others) in [(a, [&of_a, &of_b], b.len()), (b, [&of_b, &of_a], a.len())] {
            // A point has no edges.
            for i in (0..side.len()).filter(|_| side.len() > 1) {
                let (p, q) = (side[i], side[(i + 1) % side.len()]);
                planes.push_supports(p, q - p, lanes, others, extent);
            }
        }
        let middle = |side: &[DVec3]| side.iter().sum::<DVec3>() / side.len() as f64;
        let axis = (middle(a), middle(b) - middle(a));
        let mut shaft = Self { planes: Default::default(), count: planes.count, low, high, axis };
        for (lanes, planes) in shaft.planes.iter_mut().zip(planes.planes().chunks(LANES)) {
            let lane = |i: usize| planes[i.min(planes.len() - 1)];
            let four: [(DVec3, f64); LANES] = std::array::from_fn(lane);
            *lanes = (DVec3x4::new(&four.map(|(n, _)| n)), f64x4::from(four.map(|(_, d)| d)));
        }
        shaft
    }

    /// The middles of both sides.
    pub fn middles(&self) -> (DVec3, DVec3) {
        let (from, along) = self.axis;
        (from, from + along)
    }

    fn planes(&self) -> impl Iterator<Item = (DVec3, f64)> {
        (0..self.count).map(|i| self.plane(i))
    }

    fn plane(&self, i: usize) -> (DVec3, f64) {
        let (DVec3x4(n), d) = &self.planes[i / LANES];
        let lane = |lanes: &f64x4| lanes.to_array()[i % LANES];
        (DVec3::new(lane(&n[0]), lane(&n[1]), lane(&n[2])), lane(d))
    }

    /// Whether a face may reach into the shaft; `false` is certain. One that only touches it does not reach in. Of faces of few corners it is
    /// told exactly, so that the answer does not turn with the axes, as that of boxes does.
    pub fn may_hold(&self, faces: &OpaqueFaces, face: u32) -> bool {
        let ((low, high), (from, along)) = (faces.bounds(face), self.axis);
        low.cmple(self.high).all()
            && high.cmpge(self.low).all()
            && self.may_hold_polygon(faces.vertices(face), || faces.blocks(face, from, along))
    }

    /// The same for a convex or concave polygon that reaches into the shaft's box, and is asked whether the shaft's axis crosses it where its
    /// corners do not tell.
    fn may_hold_polygon(&self, polygon: &[DVec3], is_crossed: impl FnOnce() -> bool) -> bool {
        let groups = &self.planes[..self.count.div_ceil(LANES)];
        let mut cutting = 0;
        for (group, (n, d)) in groups.iter().enumerate() {
            let (mut deepest, mut highest) = (f64x4::splat(f64::INFINITY), f64x4::splat(f64::NEG_INFINITY));
            for v in polygon {
                let along = n.dot(&DVec3x4::splat(*v));
                (deepest, highest) = (deepest.fast_min(along), highest.fast_max(along));
                // Of many corners it is enough to know that each half-space holds one.
                if polygon.len() > MAX_CUT && deepest.simd_lt(*d).all() {
                    break;
                }
            }
            if !deepest.simd_lt(*d).all() {
                return false;
            }
            cutting |= highest.simd_ge(*d).to_bitmask() << (LANES * group);
        }
        let is_inside = |v: &DVec3| groups.iter().all(|(n, d)| n.dot(&DVec3x4::splat(*v)).simd_lt(*d).all());
        polygon.len() > MAX_CUT
            || cutting == 0
            || is_crossed()
            || polygon.iter().any(is_inside)
            || self.leaves(polygon, cutting & ((1 << self.count) - 1))
    }

    /// Whether these half-spaces together leave something of a polygon of at most [`MAX_CUT`] corners.
    fn leaves(&self, polygon: &[DVec3], cutting: u32) -> bool {
        let mut buffers = [[DVec3::ZERO; MAX_CORNERS]; 2];
        let [part, whole] = &mut buffers;
        let (mut part, mut whole) = (part, whole);
        let mut count = polygon.len();
        part[..count].copy_from_slice(polygon);
        for plane in (0..self.count).filter(|plane| cutting >> plane & 1 != 0) {
            let (n, d) = self.plane(plane);
            std::mem::swap(&mut part, &mut whole);
            let corners = &whole[..count];
            let Some(mut a) = corners.last().copied() else { return false };
            let mut depth_a = d - n.dot(a);
            count = 0;
            for b in corners.iter().copied() {
                // Each edge gives two corners at most.
                if count + 2 > MAX_CORNERS {
                    return true;
                }
                let depth_b = d - n.dot(b);
                if (depth_a > 0.0) != (depth_b > 0.0) {
                    part[count] = a + (b - a) * (depth_a / (depth_a - depth_b));
                    count += 1;
                }
                if depth_b > 0.0 {
                    part[count] = b;
                    count += 1;
                }
                (a, depth_a) = (b, depth_b);
            }
        }
        count > 0
    }

    /// The shaft's sides in single precision, for boxes told from `centre` whose greatest coordinate is `extent`.
    pub(super) fn told_from(&self, centre: DVec3, extent: f64) -> Sides {
        let margin = |d: f64| (d.abs() + 2.0 * extent) * ROUNDING;
        let mut planes = [([0; 3], [0.0; 3], 0.0); MAX_PLANES];
        for (i, (n, d)) in self.planes().enumerate() {
            let d = d - n.dot(centre);
            let nearest = std::array::from_fn(|axis| axis + if n[axis] >= 0.0 { 0 } else { 3 });
            planes[i] = (nearest, n.to_array().map(|c| c as f32), (d + margin(d)) as f32);
        }
        let (low, high) = (self.low - centre, self.high - centre);
        Sides {
            planes,
            count: self.count,
            low: low.to_array().map(|c| (c - margin(c)) as f32),
            high: high.to_array().map(|c| (c + margin(c)) as f32),
        }
    }

    /// Whether a box may reach into the shaft; `false` is certain.
    pub fn may_hold_box(&self, low: DVec3, high: DVec3) -> bool {
        if low.cmpgt(self.high).any() || high.cmplt(self.low).any() {
            return false;
        }
        self.planes().all(|(n, d)| {
            let nearest = DVec3::select(n.cmpge(DVec3::ZERO), low, high);
            n.dot(nearest) < d
        })
    }
}

impl Planes {
    /// Adds the planes through the edge of a side that starts at `p` and one of the other side's `others` corners that have all corners of both on
    /// the same side: these are faces of the hull.
    fn push_supports(
        &mut self,
        p: DVec3,
        edge: DVec3,
        [own, other]: [&DVec3x4; 2],
        others: usize,
        extent: f64,
    ) {
        let at = DVec3x4::splat(p);
        let (own, other) = (*own - at, *other - at);
        let swung = DVec3x4::splat(edge).cross(&other);
        let lengths = swung.length_squared().sqrt().to_array();
        let [x, y, z] = [swung.0[0].to_array(), swung.0[1].to_array(), swung.0[2].to_array()];
        let margin = extent * 1e-9;
        for i in (0..others).filter(|i| lengths[*i] > extent * extent * 1e-12) {
            let normal = DVec3::new(x[i], y[i], z[i]) / lengths[i];
            let lanes = DVec3x4::splat(normal);
            let (height, other_height) = (lanes.dot(&own), lanes.dot(&other));
            if height.fast_max(other_height).simd_le(f64x4::splat(margin)).all() {
                self.push(normal, normal.dot(p) - margin);
            }
            if height.fast_min(other_height).simd_ge(f64x4::splat(-margin)).all() {
                self.push(-normal, -normal.dot(p) - margin);
            }
        }
    }

    fn push(&mut self, normal: DVec3, d: f64) {
        let known = self.planes().iter().any(|(n, _)| n.dot(normal) > 1.0 - 1e-12);
        if !known && self.count < MAX_PLANES {
            self.planes[self.count] = (normal, d);
            self.count += 1;
        }
    }

    fn planes(&self) -> &[(DVec3, f64)] {
        &self.planes[..self.count]
    }
}

/// Share of a coordinate that is on the safe side of some roundings to single precision.
const ROUNDING: f64 = 1.0 / (1u32 << 20) as f64;

/// A shaft's half-spaces and box, for eight boxes at once.
pub(super) struct Sides {
    /// Of each half-space: which sides of a box meet in the corner that lies deepest in it, the normal, and the distance.
    planes: [([usize; 3], [f32; 3], f32); MAX_PLANES],
    count: usize,
    low: [f32; 3],
    high: [f32; 3],
}

impl Sides {
    /// Which boxes may reach into the shaft, as a bit mask; that others do not is certain.
    #[inline]
    pub fn may_hold(&self, boxes: &Boxes) -> u32 {
        let mut held = boxes[0].simd_le(f32x8::splat(self.high[0]));
        for axis in 0..3 {
            held &= boxes[axis].simd_le(f32x8::splat(self.high[axis]));
            held &= f32x8::splat(self.low[axis]).simd_le(boxes[axis + 3]);
        }
        for (nearest, n, d) in &self.planes[..self.count] {
            if !held.any() {
                return 0;
            }
            let along = |axis: usize| (boxes[nearest[axis]], f32x8::splat(n[axis]));
            let ((x, n_x), (y, n_y), (z, n_z)) = (along(0), along(1), along(2));
            held &= z.mul_add(n_z, y.mul_add(n_y, x * n_x)).simd_lt(f32x8::splat(*d));
        }
        held.to_bitmask()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn square(z: f64, half: f64) -> [DVec3; 4] {
        [(-half, -half), (half, -half), (half, half), (-half, half)].map(|(x, y)| DVec3::new(x, y, z))
    }

    #[test]
    fn holds_what_stands_between_and_nothing_beside_or_behind() {
        let (a, b) = (square(0.0, 1.0), square(4.0, 0.5));
        let shaft = Shaft::between(&a, Some(DVec3::Z), &b, Some(DVec3::NEG_Z));
        let may_hold = |polygon: &[DVec3]| shaft.may_hold_polygon(polygon, || false);
        assert!(may_hold(&square(2.0, 0.1)));
        assert!(may_hold(&square(2.0, 9.0)));
        let beside = square(2.0, 0.2).map(|p| p + DVec3::X * 1.2);
        assert!(!may_hold(&beside), "the hull is 0.75 wide at this height");
        assert!(!may_hold(&square(-0.5, 0.3)) && !may_hold(&square(4.5, 0.3)));
        assert!(!may_hold(&a) && !may_hold(&b), "the sides themselves only touch");
    }

    #[test]
    fn what_lies_beside_is_not_held_however_all_of_it_is_turned() {
        let (a, b) = (square(0.0, 1.0), square(4.0, 0.5));
        // Across a corner of the shaft, which each half-space holds a part of, and a little nearer, so that it reaches in.
        let across = |x: f64| {
            [(x, -2.0, 1.9), (-2.0, x, 1.9), (-2.0, x, 2.1), (x, -2.0, 2.1)]
                .map(|(x, y, z)| DVec3::new(x, y, z))
        };
        for turn in 0..20 {
            let turned = |p: DVec3| {
                DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -1.5).normalize(), 0.31 * f64::from(turn)) * p
            };
            let shaft = Shaft::between(
                &a.map(turned),
                Some(turned(DVec3::Z)),
                &b.map(turned),
                Some(turned(-DVec3::Z)),
            );
            // The shaft's corner at height 2 is (-0.75, -0.75), at 1.9 (-0.7625, -0.7625).
            let may_hold = |x| shaft.may_hold_polygon(&across(x).map(turned), || false);
            assert!(!may_hold(0.46) && may_hold(0.48), "turn {turn}");
        }
    }
}
