//! Visibility: is the segment between two points blocked, and which faces could block any segment of a bundle?
//!
//! Faces block from both sides. Hits within a relative `1e-6` of either end of a segment do not count, so that touching,
//! coplanar and duplicate faces neither shadow themselves nor each other.

mod beam;
mod binned;
mod block;
mod brute;
mod bvh;
mod convex;
mod opaque;
mod shaft;

use glam::DVec3;

pub use brute::Brute;
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
}
