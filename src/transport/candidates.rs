//! Which faces may stand between: blocker lists that a shaft fills once and that sub-pairs narrow (Teller and Hanrahan 1993).

use glam::DVec3;

use super::pair::Scratch;
use crate::visibility::{Occluder, OpaqueFaces, Shaft};

/// Which faces may stand between a bundle and a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Candidates {
    /// None: proven unoccluded.
    Free,
    /// One of them blocks everything: proven hidden.
    Hidden,
    /// The entries of the scratch list in this range.
    List(usize, usize),
    /// Too many to list: ask the structure.
    Scene,
}

/// The most candidates listed for a shaft.
pub const LIST_LIMIT: usize = 48;

/// Narrows `candidates` to those that reach into `shaft`, the hull of `a` and `b`. A new list stands at the end of the scratch list.
pub fn narrow(
    occluder: &dyn Occluder,
    shaft: &Shaft,
    candidates: Candidates,
    skip: [u32; 2],
    a: &[DVec3],
    b: &[DVec3],
    scratch: &mut Scratch,
) -> Candidates {
    let top = scratch.candidates.len();
    match candidates {
        Candidates::Free | Candidates::Hidden => return candidates,
        Candidates::List(start, end) => {
            for i in start..end {
                let face = scratch.candidates[i];
                if shaft.may_hold(occluder.faces().vertices(face)) {
                    scratch.candidates.push(face);
                }
            }
        }
        Candidates::Scene => {
            if !occluder.candidates(shaft, skip, LIST_LIMIT, &mut scratch.candidates) {
                return Candidates::Scene;
            }
        }
    }
    let list = &scratch.candidates[top..];
    if list.is_empty() {
        return Candidates::Free;
    }
    if list.iter().any(|face| hides(occluder.faces(), *face, a, b)) {
        scratch.candidates.truncate(top);
        return Candidates::Hidden;
    }
    Candidates::List(top, scratch.candidates.len())
}

/// Whether a convex face blocks every segment between two convex polygons. It does when it blocks those between their corners: seen from a
/// point of one, the other projects onto the face's plane within the hull of its corners' projections.
fn hides(faces: &OpaqueFaces, face: u32, a: &[DVec3], b: &[DVec3]) -> bool {
    faces.piece_count(face) == 1 && a.iter().all(|p| b.iter().all(|q| faces.blocks(face, *p, *q - *p)))
}
