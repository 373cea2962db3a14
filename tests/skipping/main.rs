//! What a scene does not need is skipped, and that changes no result beyond the error: each rule on and off.

use std::path::Path;

use glam::DVec2;
use wavelet_radiosity::math::Basis;
use wavelet_radiosity::scene::{self, Scene, Sides, procedural};
use wavelet_radiosity::schedule::{Batches, Options, Outcome, Schedule, Silent, solve, solve_by};
use wavelet_radiosity::transport::{Oracle, Unresolved};
use wavelet_radiosity::visibility::{Bvh, Occluder, OpaqueFaces, Unoccluded, nothing_between};

use distance::distance;
use shafts::Unlisted;

#[path = "../support/distance.rs"]
mod distance;
mod pairs;
mod shafts;

const ERROR: f64 = 0.05;

fn read(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}.iv"));
    scene::read::read_file(&path).unwrap()
}

fn run(scene: &Scene, occluder: &dyn Occluder, direct_only: bool) -> Outcome {
    solve(scene, &scene::surfaces(scene), occluder, &options(direct_only), &mut Silent)
}

fn options(direct_only: bool) -> Options {
    Options { error: ERROR, basis: Basis::M2, oracle: Oracle::Energy, direct_only }
}

/// The Cornell box in so many pieces that they cluster.
fn many() -> Scene {
    let options = procedural::Options { surfaces: Some(400), seed: 1, shuffle: false };
    let (drawing, mut text) = (procedural::draw(procedural::Subject::Cornell, &options).unwrap(), Vec::new());
    drawing.write(&mut text).unwrap();
    scene::read::inventor::parse(&String::from_utf8(text).unwrap(), Path::new("many.iv")).unwrap()
}

/// A room of six walls that face inwards, on this many sides each; the ceiling shines.
fn empty_room(sides: Sides) -> Scene {
    let text = "#Inventor V2.1 ascii
        ShapeHints { vertexOrdering COUNTERCLOCKWISE shapeType SOLID }
        Coordinate3 { point [ 0 0 0, 2 0 0, 2 3 0, 0 3 0, 0 0 2.5, 2 0 2.5, 2 3 2.5, 0 3 2.5 ] }
        Material { diffuseColor 0.7 0.5 0.3 }
        IndexedFaceSet { coordIndex [ 0, 1, 2, 3, -1, 4, 5, 1, 0, -1, 5, 6, 2, 1, -1, 6, 7, 3, 2, -1, 7, 4, 0, 3, -1 ] }
        Material { diffuseColor 0.8 0.8 0.8 emissiveColor 10 9 8 }
        IndexedFaceSet { coordIndex [ 7, 6, 5, 4, -1 ] }";
    let mut scene = scene::read::inventor::parse(text, Path::new("room.iv")).unwrap();
    scene.faces.iter_mut().for_each(|face| face.sides = sides);
    scene
}

fn bvh(scene: &Scene) -> Bvh {
    Bvh::new(OpaqueFaces::new(scene))
}

#[test]
fn convex_scenes_need_no_rays() {
    let scene = empty_room(Sides::One);
    assert!(nothing_between(&scene));
    let (with, without) = (
        run(&scene, &Unlisted { bvh: bvh(&scene), tells_empty: false }, false),
        run(&scene, &Unoccluded(bvh(&scene)), false),
    );
    let apart = distance((&scene, &scene::surfaces(&scene)), &without, &with);
    println!("{apart:.1e} apart, {} rays", with.work.visibility_rays);
    assert!(apart <= 0.5 * ERROR, "{apart}");
    assert!(with.work.visibility_rays > 0);
    assert_eq!(without.work.visibility_rays, 0);
}

#[test]
fn backs_that_nobody_sees_stay_dark_and_whole() {
    let (one, two) = (empty_room(Sides::One), empty_room(Sides::Two));
    let (few, many) = (scene::surfaces(&one), scene::surfaces(&two));
    assert_eq!((few.len(), many.len()), (6, 12));
    let (inside, mut both) = (run(&one, &bvh(&one), false), run(&two, &bvh(&two), false));
    let is_inside =
        |s: &scene::Surface| few.iter().any(|o| o.face == s.face && o.frame.normal == s.frame.normal);
    let mut kept = Vec::new();
    for (field, surface) in std::mem::take(&mut both.solution.fields).into_iter().zip(&many) {
        if is_inside(surface) {
            kept.push(field);
        } else {
            let mut leaves = 0;
            field.for_each_leaf(&mut |leaf| {
                leaves += 1;
                assert!(leaf.coefficients.iter().all(|c| *c == 0.0));
            });
            assert_eq!(leaves, 1, "what receives nothing is never divided");
        }
    }
    both.solution.fields = kept;
    let apart = distance((&one, &few), &both, &inside);
    assert!(apart <= 0.5 * ERROR, "{apart}");
}

#[test]
fn black_surfaces_never_shoot() {
    let mut black = read("cornell-box");
    for material in &mut black.materials {
        material.reflectance.fill(0.0);
    }
    let (all, direct) = (run(&black, &bvh(&black), false), run(&black, &bvh(&black), true));
    assert!(all.solution.fields == direct.solution.fields, "nothing reflects: direct light is all there is");
    assert_eq!(all.statistics.shots, direct.statistics.shots);
}

/// One surface at a time clusters with none. The batches of the reference scenes are too small for clusters, or nearly.
#[test]
fn clusters_of_emitters_change_no_more_than_half_the_error() {
    let scene = many();
    let (surfaces, bvh) = (scene::surfaces(&scene), bvh(&scene));
    let solve = |batches| {
        let schedule = Schedule { batches, ..Schedule::default() };
        solve_by(schedule, &scene, &surfaces, &bvh, &options(false), &mut Silent).unwrap()
    };
    let (with, without) = (solve(Batches::Fitted), solve(Batches::Single));
    let apart = distance((&scene, &surfaces), &with, &without);
    let (clustered, alone) = (with.work.pairs_clustered, without.work.pairs_clustered);
    let times = without.work.interactions as f64 / with.work.interactions as f64;
    println!("{apart:.1e} apart, {times:.2} times the interactions without; {clustered} clustered");
    assert!(apart <= 0.5 * ERROR, "{apart}");
    assert!(clustered > 0 && alone == 0 && times > 1.3, "{clustered}, {times}");
    let Unresolved { coarse, clusters, .. } = with.unresolved_errors;
    let all = with.solution.error_estimate;
    println!("of the error {all:.1e} small pairs cause {coarse:.1e}, clusters {clusters:.1e}");
    assert!(
        coarse.min(clusters) > 0.0
            && coarse.hypot(clusters) < all
            && without.unresolved_errors.clusters == 0.0
    );
}

#[test]
fn equal_bands_are_one() {
    let mut grey = read("furnished-room");
    for material in &mut grey.materials {
        let (reflectance, exitance) = (material.reflectance[0], material.exitance_w_m2[0]);
        material.reflectance.fill(reflectance);
        material.exitance_w_m2.fill(exitance);
    }
    let mut one = grey.clone();
    one.bands.truncate(1);
    for material in &mut one.materials {
        material.reflectance.truncate(1);
        material.exitance_w_m2.truncate(1);
    }
    let (three, one) = (run(&grey, &bvh(&grey), false), run(&one, &bvh(&one), false));
    let (mut square, mut norm) = (0.0, 0.0);
    for (a, b) in three.solution.fields.iter().zip(&one.solution.fields) {
        for point in 0..16 {
            let uv = (DVec2::new((point % 4) as f64, (point / 4) as f64) + 0.5) / 4.0;
            let (mut in_three, mut in_one) = ([0.0; 3], [0.0]);
            a.irradiance(uv, &mut in_three);
            b.irradiance(uv, &mut in_one);
            assert!(in_three.into_iter().all(|e| e == in_three[0]), "{in_three:?}");
            square += (in_three[0] - in_one[0]).powi(2);
            norm += in_one[0].powi(2);
        }
    }
    let apart = (square / norm).sqrt();
    println!("{apart:.1e} apart");
    assert!(apart <= 1e-12, "{apart}");
}
