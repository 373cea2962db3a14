//! Brute force: every face is tested. The reference the other structures are held to.

use glam::DVec3;

use super::{Occluder, OpaqueFaces, Shaft};

/// Tests every face.
pub struct Brute(
    /// The faces.
    pub OpaqueFaces,
);

impl Occluder for Brute {
    fn faces(&self) -> &OpaqueFaces {
        &self.0
    }

    fn blocker(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> Option<u32> {
        (0..self.0.len() as u32).find(|f| !skip.contains(f) && self.0.blocks(*f, from, to - from))
    }

    fn any_blocks(
        &self,
        from: DVec3,
        to: DVec3,
        skip: [u32; 2],
        is_wanted: &mut dyn FnMut(u32) -> bool,
    ) -> bool {
        let is_found = |f: u32| !skip.contains(&f) && self.0.blocks(f, from, to - from) && is_wanted(f);
        (0..self.0.len() as u32).any(is_found)
    }

    fn candidates(&self, shaft: &Shaft, skip: [u32; 2], limit: usize, out: &mut Vec<u32>) -> bool {
        let start = out.len();
        for face in 0..self.0.len() as u32 {
            if !skip.contains(&face) && shaft.may_hold(&self.0, face) {
                if out.len() - start == limit {
                    out.truncate(start);
                    return false;
                }
                out.push(face);
            }
        }
        true
    }

    fn first_hit(&self, origin: DVec3, direction: DVec3) -> Option<(u32, f64)> {
        (0..self.0.len() as u32)
            .filter_map(|f| self.0.hit(f, origin, direction).filter(|t| *t > 0.0).map(|t| (f, t)))
            .min_by(|a, b| a.1.total_cmp(&b.1))
    }
    fn bytes(&self) -> usize {
        self.0.bytes()
    }
}
