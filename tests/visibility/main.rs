//! Stress of the visibility structures: segments through the edges and corners of closed solids, and around them, answered by brute
//! force, the hierarchy, the partition and shaft lists.
//!
//! Nothing may leave a closed solid, and all must agree. The number of segments per kind of solid comes from `WRAD_SEGMENTS`; the long
//! form is `scripts/visibility-stress`.

mod solids;

use glam::DVec3;
use solids::{Dice, Kind, Solid};
use wavelet_radiosity::scene::{Face, Material, Scene, Sides};
use wavelet_radiosity::visibility::{Brute, Bsp, Bvh, Occluder, OpaqueFaces, Shaft};

const SEGMENTS_PER_SOLID: usize = 10_000;

/// Of eight segments in turn, of which two run across, shafts list the faces around so many: a list of its own for one segment costs
/// more than all other answers together.
const LISTED: usize = 4;

/// What is counted: leaks and disagreements by structure.
#[derive(Debug, Default, PartialEq)]
struct Counts {
    segments: usize,
    /// Ways out that no face blocks.
    leaks: usize,
    /// Answers of the hierarchy, of its bundles, of the partition and of shaft lists that brute force does not give.
    different: [usize; 4],
}

fn scene(solid: &Solid) -> Scene {
    let face = |vertices: &Vec<DVec3>| Face { vertices: vertices.clone(), material: 0, sides: Sides::Two };
    let grey = Material { reflectance: vec![0.5], exitance_w_m2: vec![0.0] };
    Scene {
        faces: solid.faces.iter().map(face).collect(),
        materials: vec![grey],
        bands: vec!["grey".into()],
        ..Scene::default()
    }
}

/// No face of a segment is left out.
const NONE: [u32; 2] = [u32::MAX; 2];

/// The answer of the faces that a shaft around the segment lists.
fn by_list(structure: &dyn Occluder, from: DVec3, to: DVec3, dice: &mut Dice) -> bool {
    let around = |p: DVec3, dice: &mut Dice| {
        let size = 0.05 * from.distance(to);
        let (u, v) = (size * dice.direction(), size * dice.direction());
        [p + u, p + v, p - u - v]
    };
    let (a, b) = (around(from, dice), around(to, dice));
    let mut list = Vec::new();
    structure.candidates(&Shaft::between(&a, None, &b, None), NONE, usize::MAX, &mut list);
    list.iter().any(|face| structure.faces().blocks(*face, from, to - from))
}

fn stress(kind: Kind, segments: usize, seed: u64) -> Counts {
    let mut dice = Dice::new(seed);
    let mut counts = Counts::default();
    while counts.segments < segments {
        let solid = Solid::new(kind, &mut dice);
        let faces = OpaqueFaces::new(&scene(&solid));
        let (bvh, bsp) = (Bvh::new(faces.clone()), Bsp::new(faces.clone()));
        let brute = Brute(faces);
        let mut last = u32::MAX;
        for i in 0..SEGMENTS_PER_SOLID {
            let leaving = i % 4 != 0;
            let (from, to) = if leaving { solid.way_out(&mut dice) } else { solid.way_across(&mut dice) };
            let truth = brute.blocker(from, to, NONE).is_some();
            counts.segments += 1;
            if leaving && !truth {
                counts.leaks += 1;
                println!("{kind:?}: nothing blocks {from:?} to {to:?}");
                if counts.leaks == 1 {
                    println!("through {:?}", solid.faces);
                }
            }
            let answers = [
                bvh.blocker(from, to, NONE).is_some(),
                bvh.blocked(from, &[to, from + 0.9 * (to - from)], NONE, &mut last) & 1 != 0,
                bsp.blocker(from, to, NONE).is_some(),
                if i % 8 < LISTED { by_list(&bvh, from, to, &mut dice) } else { truth },
            ];
            for (different, answer) in counts.different.iter_mut().zip(answers) {
                *different += (answer != truth) as usize;
            }
        }
    }
    counts
}

#[test]
fn nothing_leaves_a_closed_solid_and_all_structures_agree() {
    let asked =
        std::env::var("WRAD_SEGMENTS").ok().map(|text| text.parse().expect("WRAD_SEGMENTS: a number"));
    let segments = asked.unwrap_or(200_000);
    let mut wrong = Vec::new();
    println!(
        "| solid | segments | leaks | hierarchy | bundles | partition | shaft lists |\n|---|---|---|---|---|---|---|"
    );
    for kind in Kind::ALL {
        let counts = stress(kind, segments, 11);
        let [bvh, bundles, bsp, lists] = counts.different;
        println!(
            "| {kind:?} | {} | {} | {bvh} | {bundles} | {bsp} | {lists} |",
            counts.segments, counts.leaks
        );
        if counts.leaks > 0 || counts.different != [0; 4] {
            wrong.push((kind, counts));
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}
