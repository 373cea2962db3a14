//! Which faces may stand between: blocker lists that a shaft fills once and that sub-pairs narrow (Teller and Hanrahan 1993).

use glam::DVec3;

use super::pair::Scratch;
use crate::math::lanes::DVec3x4;
use crate::visibility::{Bundle, Occluder, OpaqueFaces, Shaft};

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

impl Candidates {
    /// The one of them that blocked a segment last, if one did.
    pub fn likely(self, faces: &OpaqueFaces, skip: [u32; 2], scratch: &Scratch) -> Option<u32> {
        match self {
            Candidates::Free | Candidates::Hidden => None,
            Candidates::List(start, _) => Some(scratch.candidates[start]),
            Candidates::Scene => {
                let last = scratch.last_blocker;
                ((last as usize) < faces.len() && !skip.contains(&last)).then_some(last)
            }
        }
    }
}

/// One side of a shaft: at most four corners of a plane, and its unit normal where it has a front.
pub type Side<'a> = (&'a [DVec3], Option<DVec3>);

/// Narrows `candidates` to those that reach into the shaft between `a` and `b`. A new list stands at the end of the scratch list.
pub fn narrow(
    occluder: &dyn Occluder,
    candidates: Candidates,
    skip: [u32; 2],
    (a, a_normal): Side<'_>,
    (b, b_normal): Side<'_>,
    scratch: &mut Scratch,
) -> Candidates {
    let (faces, top, corners) = (occluder.faces(), scratch.candidates.len(), DVec3x4::new(b));
    let hides = |face: u32| a.iter().all(|from| faces.hides(face, *from, &corners));
    // Before a shaft is made.
    if candidates.likely(faces, skip, scratch).is_some_and(hides) {
        return Candidates::Hidden;
    }
    let shaft = Shaft::between(a, a_normal, b, b_normal);
    match candidates {
        Candidates::Free | Candidates::Hidden => return candidates,
        Candidates::List(start, end) => {
            for i in start..end {
                let face = scratch.candidates[i];
                if shaft.may_hold(faces, face) {
                    scratch.candidates.push(face);
                }
            }
        }
        Candidates::Scene => {
            if !occluder.candidates(&shaft, skip, LIST_LIMIT, &mut scratch.candidates) {
                // What hides one from the other stands between their middles.
                let (from, to) = shaft.middles();
                let is_hidden = occluder.any_blocks(from, to, skip, &mut |face| hides(face));
                return if is_hidden { Candidates::Hidden } else { Candidates::Scene };
            }
        }
    }
    let list = &scratch.candidates[top..];
    if list.is_empty() {
        return Candidates::Free;
    }
    if list.iter().any(|face| hides(*face)) {
        scratch.candidates.truncate(top);
        return Candidates::Hidden;
    }
    Candidates::List(top, scratch.candidates.len())
}

/// Whether no face of a list blocks the segment from `from` to `to`; the first one that does moves to the front, where the next segment
/// finds it first.
pub fn is_open(faces: &OpaqueFaces, list: &mut [u32], from: DVec3, to: DVec3) -> bool {
    let Some(found) = list.iter().position(|face| faces.blocks(*face, from, to - from)) else { return true };
    list.swap(0, found);
    false
}

/// The same for several segments from one point, which take turns: those that no face blocks, as a bit mask.
pub fn open_ones(faces: &OpaqueFaces, list: &mut [u32], bundle: &Bundle) -> u32 {
    let mut blocked = [0; LIST_LIMIT];
    let mut open = bundle.all();
    let mut asked = 0;
    while open != 0 && asked < list.len() {
        blocked[asked] = faces.blocked_by(list[asked], bundle);
        open &= !blocked[asked];
        asked += 1;
    }
    let mut rest = bundle.all() & !open;
    while rest != 0 {
        let segment = rest & rest.wrapping_neg();
        rest &= rest - 1;
        if let Some(first) = blocked[..asked].iter().position(|by| by & segment != 0) {
            blocked.swap(0, first);
            list.swap(0, first);
        }
    }
    open
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::lanes::{DVec3x4, LANES};
    use crate::scene::{Face, Material, Scene, Sides};
    use proptest::prelude::*;

    proptest! {
        /// The list ends in the same order too, which later answers rest on.
        #[test]
        fn segments_together_are_as_one_after_the_other(
            triangles in proptest::collection::vec(proptest::array::uniform9(-1.0..1.0f64), 1..LIST_LIMIT),
            from in proptest::array::uniform3(-1.5..1.5f64),
            ends in proptest::collection::vec(proptest::array::uniform3(-1.5..1.5f64), 1..=9),
        ) {
            let face = |t: &[f64; 9]| Face {
                vertices: t.chunks(3).map(DVec3::from_slice).collect(),
                material: 0,
                sides: Sides::Two,
            };
            let grey = Material { reflectance: vec![0.5], exitance_w_m2: vec![0.0] };
            let faces = OpaqueFaces::new(&Scene {
                faces: triangles.iter().map(face).collect(),
                materials: vec![grey],
                bands: vec!["grey".into()],
                ..Scene::default()
            });
            let from = DVec3::from_array(from);
            let ends: Vec<DVec3> = ends.into_iter().map(DVec3::from_array).collect();
            let lanes: Vec<DVec3x4> = ends.chunks(LANES).map(DVec3x4::new).collect();
            let mut one_by_one: Vec<u32> = (0..triangles.len() as u32).collect();
            let mut together = one_by_one.clone();
            let open = open_ones(&faces, &mut together, &Bundle::new(from, &lanes, ends.len()));
            for (i, to) in ends.iter().enumerate() {
                prop_assert_eq!(is_open(&faces, &mut one_by_one, from, *to), open >> i & 1 != 0);
            }
            prop_assert_eq!(together, one_by_one);
        }
    }
}
