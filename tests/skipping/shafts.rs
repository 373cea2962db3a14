//! What shafts tell before any ray: that nothing stands between, that one face hides all, or the few faces that may. Each
//! told and untold.

use glam::DVec3;
use wavelet_radiosity::scene::{self, Scene};
use wavelet_radiosity::schedule::Outcome;
use wavelet_radiosity::visibility::{Bvh, Occluder, OpaqueFaces, Shaft};

use super::distance::distance;
use super::{ERROR, bvh, read, run};

/// A structure that never lists a face, so that rays ask the whole scene. It may tell of empty shafts.
pub struct Unlisted {
    pub bvh: Bvh,
    pub tells_empty: bool,
}

impl Occluder for Unlisted {
    fn faces(&self) -> &OpaqueFaces {
        self.bvh.faces()
    }

    fn blocker(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> Option<u32> {
        self.bvh.blocker(from, to, skip)
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

    fn candidates(&self, shaft: &Shaft, skip: [u32; 2], limit: usize, out: &mut Vec<u32>) -> bool {
        let top = out.len();
        let is_empty = self.tells_empty && self.bvh.candidates(shaft, skip, limit, out) && out.len() == top;
        out.truncate(top);
        is_empty
    }

    fn first_hit(&self, origin: DVec3, direction: DVec3) -> Option<(u32, f64)> {
        self.bvh.first_hit(origin, direction)
    }

    fn bytes(&self) -> usize {
        self.bvh.bytes()
    }
}

/// The scene with a notch of a ten millionth in every face: it blocks as before, but is not convex, and such a face is
/// never seen to hide a pair.
fn notched(scene: &Scene) -> Scene {
    let mut notched = scene.clone();
    for face in &mut notched.faces {
        let (a, b) = (face.vertices[0], face.vertices[1]);
        let middle = face.vertices.iter().sum::<DVec3>() / face.vertices.len() as f64;
        let between = 0.5 * (a + b);
        face.vertices.insert(1, between + 1e-7 * (middle - between));
    }
    notched
}

/// Without lists, every face may be as narrow as any: refinement guards against more than there is.
#[test]
fn each_that_shafts_tell_changes_no_more_than_half_the_error() {
    for (name, fewer) in [("cornell-box", 2.0), ("furnished-room", 0.9), ("l-gallery", 2.0)] {
        let scene = read(name);
        let surfaces = scene::surfaces(&scene);
        let unlisted = |tells_empty| Unlisted { bvh: bvh(&notched(&scene)), tells_empty };
        // Each tells one thing less than the one before.
        let all = run(&scene, &bvh(&scene), false);
        let no_hidden = run(&scene, &bvh(&notched(&scene)), false);
        let empty_only = run(&scene, &unlisted(true), false);
        let none = run(&scene, &unlisted(false), false);
        let rays = |a: &Outcome, b: &Outcome| a.work.visibility_rays as f64 / b.work.visibility_rays as f64;
        for (what, with, without) in [
            ("hidden", &all, &no_hidden),
            ("short lists", &no_hidden, &empty_only),
            ("empty shafts", &empty_only, &none),
            ("all", &all, &none),
        ] {
            let apart = distance((&scene, &surfaces), with, without);
            println!("{name}, {what}: {apart:.1e} apart, {:.2} times the rays without", rays(without, with));
            assert!(apart <= 0.5 * ERROR, "{name}, {what}: {apart}");
        }
        let work = [&all, &no_hidden, &empty_only, &none].map(|outcome| outcome.work);
        assert_eq!(work.map(|w| w.pairs_hidden > 0), [true, false, false, false], "{name}");
        assert_eq!(work.map(|w| w.sights_hidden > 0), [true, false, false, false], "{name}");
        assert_eq!(work.map(|w| w.rays_listed > 0), [true, true, false, false], "{name}");
        assert_eq!(work.map(|w| w.pairs_unoccluded > 0), [true, true, true, false], "{name}");
        assert!(work[0].cost() < work[1].cost(), "{name}: hidden pairs need no look");
        assert!(rays(&none, &empty_only) > 3.0, "{name}: empty shafts need no ray");
        assert!(rays(&none, &all) > fewer, "{name}: {}", rays(&none, &all));
    }
}
