//! Visibility: is the segment between two points blocked, and which faces could block any segment of a bundle?
//!
//! Faces block from both sides. Hits within a relative `1e-6` of either end of a segment do not count, so that touching,
//! coplanar and duplicate faces neither shadow themselves nor each other.

mod bands;
mod beam;
mod binned;
mod block;
mod brute;
mod bsp;
mod bundle;
mod bvh;
mod convex;
mod opaque;
mod shaft;

use glam::DVec3;

pub use block::NO_FACE;
pub use brute::Brute;
pub use bsp::Bsp;
pub use bundle::Bundle;
pub use bvh::Bvh;
pub use convex::nothing_between;
pub use opaque::OpaqueFaces;
pub use shaft::Shaft;

/// The share of a segment next to each end in which hits do not count.
pub const END_MARGIN: f64 = 1e-6;

/// The most segments that are asked for at once.
pub const MAX_BUNDLE: usize = 16;

/// The structure that answers visibility questions about a scene's faces.
pub trait Occluder: Sync {
    /// The faces themselves.
    fn faces(&self) -> &OpaqueFaces;

    /// Whether a face other than the two in `skip` blocks the open segment; returns the blocking face.
    fn blocker(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> Option<u32>;

    /// Which of at most [`MAX_BUNDLE`] open segments from `from` are blocked, as a bit mask. The face `last` is tried first; a face that
    /// blocks one of them comes back in it.
    fn blocked(&self, from: DVec3, to: &[DVec3], skip: [u32; 2], last: &mut u32) -> u32 {
        let mut blocked = 0;
        for (i, target) in to.iter().enumerate() {
            if let Some(face) = self.blocker(from, *target, skip) {
                *last = face;
                blocked |= 1 << i;
            }
        }
        blocked
    }

    /// Whether a face other than the two in `skip` blocks the open segment that `is_wanted`; all that do are asked about, in any order.
    fn any_blocks(
        &self,
        from: DVec3,
        to: DVec3,
        skip: [u32; 2],
        is_wanted: &mut dyn FnMut(u32) -> bool,
    ) -> bool;

    /// Appends the faces that may block a segment inside `shaft`; gives up and returns `false` beyond `limit` faces, `out` then
    /// being as it was.
    fn candidates(&self, shaft: &Shaft, skip: [u32; 2], limit: usize, out: &mut Vec<u32>) -> bool;

    /// The first face hit by the ray and the distance in units of `direction`'s length.
    fn first_hit(&self, origin: DVec3, direction: DVec3) -> Option<(u32, f64)>;

    /// Whether no face ever blocks, so that no ray need be cast.
    fn never_blocks(&self) -> bool {
        false
    }

    /// Bytes that it takes.
    fn bytes(&self) -> usize;

    /// Nodes on the longest path from its root to a leaf, leaves not counted; 0 where it has no root.
    fn depth(&self) -> usize {
        0
    }

    /// A copy in memory that the calling thread touches first; `None` where it is not asked often enough for copies to pay.
    fn replica(&self) -> Option<Box<dyn Occluder + Send>> {
        None
    }
}

impl<T: Occluder + ?Sized> Occluder for &T {
    fn faces(&self) -> &OpaqueFaces {
        (**self).faces()
    }

    fn blocker(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> Option<u32> {
        (**self).blocker(from, to, skip)
    }

    fn blocked(&self, from: DVec3, to: &[DVec3], skip: [u32; 2], last: &mut u32) -> u32 {
        (**self).blocked(from, to, skip, last)
    }

    fn any_blocks(
        &self,
        from: DVec3,
        to: DVec3,
        skip: [u32; 2],
        is_wanted: &mut dyn FnMut(u32) -> bool,
    ) -> bool {
        (**self).any_blocks(from, to, skip, is_wanted)
    }

    fn candidates(&self, shaft: &Shaft, skip: [u32; 2], limit: usize, out: &mut Vec<u32>) -> bool {
        (**self).candidates(shaft, skip, limit, out)
    }

    fn first_hit(&self, origin: DVec3, direction: DVec3) -> Option<(u32, f64)> {
        (**self).first_hit(origin, direction)
    }

    fn never_blocks(&self) -> bool {
        (**self).never_blocks()
    }

    fn bytes(&self) -> usize {
        (**self).bytes()
    }

    fn depth(&self) -> usize {
        (**self).depth()
    }

    fn replica(&self) -> Option<Box<dyn Occluder + Send>> {
        (**self).replica()
    }
}

/// No occluder at all, for scenes and studies where nothing can stand in between; rays still find faces.
pub struct Unoccluded<T>(
    /// The structure that answers [`Occluder::first_hit`].
    pub T,
);

impl<T: Occluder> Occluder for Unoccluded<T> {
    fn faces(&self) -> &OpaqueFaces {
        self.0.faces()
    }

    fn blocker(&self, _from: DVec3, _to: DVec3, _skip: [u32; 2]) -> Option<u32> {
        None
    }

    fn blocked(&self, _from: DVec3, _to: &[DVec3], _skip: [u32; 2], _last: &mut u32) -> u32 {
        0
    }

    fn any_blocks(
        &self,
        _from: DVec3,
        _to: DVec3,
        _skip: [u32; 2],
        _is_wanted: &mut dyn FnMut(u32) -> bool,
    ) -> bool {
        false
    }

    fn candidates(&self, _shaft: &Shaft, _skip: [u32; 2], _limit: usize, _out: &mut Vec<u32>) -> bool {
        true
    }

    fn first_hit(&self, origin: DVec3, direction: DVec3) -> Option<(u32, f64)> {
        self.0.first_hit(origin, direction)
    }

    fn never_blocks(&self) -> bool {
        true
    }

    fn bytes(&self) -> usize {
        self.0.bytes()
    }

    fn depth(&self) -> usize {
        self.0.depth()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Face, Material, Scene, Sides};
    use proptest::prelude::*;

    fn soup(triangles: &[[f64; 9]]) -> Scene {
        let face = |t: &[f64; 9]| Face {
            vertices: t.chunks(3).map(DVec3::from_slice).collect(),
            material: 0,
            sides: Sides::Two,
        };
        let grey = Material { reflectance: vec![0.5], exitance_w_m2: vec![0.0] };
        Scene {
            faces: triangles.iter().map(face).collect(),
            materials: vec![grey],
            bands: vec!["grey".into()],
            ..Scene::default()
        }
    }

    /// Whether a structure answers as brute force does about what lies between `a` and points around `b`.
    fn check(structure: &dyn Occluder, brute: &Brute, a: DVec3, b: DVec3) -> Result<(), TestCaseError> {
        prop_assert_eq!(structure.blocker(a, b, [0, 1]).is_some(), brute.blocker(a, b, [0, 1]).is_some());
        prop_assert_eq!(structure.first_hit(a, b - a), brute.first_hit(a, b - a));
        let all = |occluder: &dyn Occluder| {
            let mut all = std::collections::BTreeSet::new();
            let none = occluder.any_blocks(a, b, [0, 1], &mut |face| {
                all.insert(face);
                false
            });
            assert!(!none);
            all
        };
        prop_assert_eq!(all(structure), all(brute));
        prop_assert!(
            all(brute).iter().all(|wanted| structure.any_blocks(a, b, [0, 1], &mut |face| face == *wanted))
        );
        let around: Vec<DVec3> =
            (0..11).map(|i| b + 0.2 * i as f64 * (DVec3::new(a.z, a.x, a.y) - b)).collect();
        let mut last = 1;
        let (found, truth) =
            (structure.blocked(a, &around, [0, 1], &mut last), brute.blocked(a, &around, [0, 1], &mut 1));
        prop_assert_eq!(found, truth, "depth {} from {:?} to {:?}", structure.depth(), a, around);
        let blocks = |to: &DVec3| brute.faces().blocks(last, a, to - a);
        prop_assert!(found == 0 || around.iter().any(blocks), "face {} blocks none", last);
        if a == b {
            // A shaft from a side to one of its corners is flat, and holds nothing.
            return Ok(());
        }
        // Askew, so that it is flat on no face.
        let (u, v) = (DVec3::new(0.1, 0.031, 0.017), DVec3::new(0.023, 0.1, -0.041));
        let shaft = Shaft::between(&[a, a + u, a + v], None, &[b], None);
        let (mut listed, mut all) = (Vec::new(), Vec::new());
        structure.candidates(&shaft, [0, 0], usize::MAX, &mut listed);
        brute.candidates(&shaft, [0, 0], usize::MAX, &mut all);
        prop_assert!(listed.iter().all(|face| all.contains(face)), "{:?} besides {:?}", listed, all);
        for w in [0.2, 0.5, 0.9] {
            let from = a + 0.5 * (u + w * v);
            if let Some(f) = brute.blocker(from, b, [0, 0]) {
                prop_assert!(
                    listed.contains(&f),
                    "blocker {} is missing among the candidates {:?}",
                    f,
                    listed
                );
            }
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn structures_agree_with_brute_force(
            triangles in proptest::collection::vec(proptest::array::uniform9(-1.0..1.0f64), 1..80),
            segments in proptest::collection::vec(proptest::array::uniform6(-1.5..1.5f64), 40),
            grid in proptest::bool::ANY,
        ) {
            // Corners and ends on a coarse grid: segments in planes of boxes, through edges and corners.
            let snap = |x: f64| if grid { (4.0 * x).round() / 4.0 } else { x };
            let triangles: Vec<[f64; 9]> = triangles.iter().map(|t| t.map(snap)).collect();
            let faces = || OpaqueFaces::new(&soup(&triangles));
            let (bvh, bsp, brute) = (Bvh::new(faces()), Bsp::new(faces()), Brute(faces()));
            for s in segments {
                let s = s.map(snap);
                let (a, b) = (DVec3::from_slice(&s[..3]), DVec3::from_slice(&s[3..]));
                check(&bvh, &brute, a, b)?;
                check(&bsp, &brute, a, b)?;
            }
        }
    }
}
