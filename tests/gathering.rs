//! Gathering, with links recomputed and stored: closed forms, the reference scenes, the two beside each other, and the same bits whoever works.

use std::path::Path;

use ccnuma::arena::Memory;
use ccnuma::{Machine, Plan, Policy, Team};
use deviation::deviation;
use glam::DVec2;
use wavelet_radiosity::math::{Basis, polygon};
use wavelet_radiosity::scene::{self, Scene, Surface};
use wavelet_radiosity::schedule::{Batches, Options, Outcome, Schedule, Silent, solve_by};
use wavelet_radiosity::transport::Oracle;
use wavelet_radiosity::visibility::{Bvh, OpaqueFaces};

#[path = "support/deviation.rs"]
mod deviation;
#[path = "support/probes.rs"]
mod probes;

const RECOMPUTE: Batches = Batches::All { link_bytes: 0 };
const STORE: Batches = Batches::All { link_bytes: 64 << 20 };

struct Room {
    scene: Scene,
    surfaces: Vec<Surface>,
    bvh: Bvh,
}

impl Room {
    fn of(scene: Scene) -> Self {
        let (surfaces, bvh) = (scene::surfaces(&scene), Bvh::new(OpaqueFaces::new(&scene)));
        Self { scene, surfaces, bvh }
    }

    fn read(name: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}.iv"));
        Self::of(scene::read::read_file(&path).unwrap())
    }

    /// A unit cube seen from inside, all of it emitting 1 W/m².
    fn furnace(rho: f64) -> Self {
        let text = format!(
            "#Inventor V2.1 ascii\nSeparator {{ ShapeHints {{ vertexOrdering COUNTERCLOCKWISE shapeType SOLID }}
             Material {{ diffuseColor {rho} {rho} {rho} emissiveColor 1 1 1 }}
             Coordinate3 {{ point [ 0 0 0, 1 0 0, 1 1 0, 0 1 0, 0 0 1, 1 0 1, 1 1 1, 0 1 1 ] }}
             IndexedFaceSet {{ coordIndex [ 0, 1, 2, 3, -1, 4, 7, 6, 5, -1, 0, 4, 5, 1, -1,
                                           2, 6, 7, 3, -1, 0, 3, 7, 4, -1, 1, 5, 6, 2, -1 ] }} }}"
        );
        Self::of(scene::read::inventor::parse(&text, Path::new("cube.iv")).unwrap())
    }

    fn solve(&self, basis: Basis, error: f64, batches: Batches, team: Option<&mut Team>) -> Outcome {
        let options = Options { error, basis, oracle: Oracle::Energy, direct_only: false };
        let schedule = Schedule { team, batches, memory: Memory::Node, ..Schedule::default() };
        solve_by(schedule, &self.scene, &self.surfaces, &self.bvh, &options, &mut Silent).unwrap()
    }

    /// RMS over area and bands of what `value` makes of the reflected radiosity at each of 32 × 32 points a surface, and the RMS of that.
    fn rms(&self, value: impl Fn(usize, DVec2, usize) -> (f64, f64)) -> f64 {
        let (mut difference, mut norm) = (0.0, 0.0);
        for (index, surface) in self.surfaces.iter().enumerate() {
            for point in 0..32 * 32 {
                let uv = (DVec2::new((point % 32) as f64, (point / 32) as f64) + 0.5) / 32.0;
                if !surface.full && !polygon::contains(&surface.outline, uv) {
                    continue;
                }
                for band in 0..self.scene.bands.len() {
                    let weight = surface.frame.area_m2 * surface.reflectance[band].powi(2);
                    let (found, expected) = value(index, uv, band);
                    difference += weight * (found - expected).powi(2);
                    norm += weight * expected.powi(2);
                }
            }
        }
        (difference / norm).sqrt()
    }

    /// `‖B − B'‖ / ‖B'‖` of reflected radiosity.
    fn distance(&self, found: &Outcome, expected: &Outcome) -> f64 {
        let irradiance = |outcome: &Outcome, index: usize, uv: DVec2, band: usize| {
            let mut bands = vec![0.0; self.scene.bands.len()];
            outcome.solution.fields[index].irradiance(uv, &mut bands);
            bands[band]
        };
        self.rms(|index, uv, band| {
            (irradiance(found, index, uv, band), irradiance(expected, index, uv, band))
        })
    }
}

#[test]
fn a_furnace_glows_evenly() {
    for rho in [0.5, 0.9] {
        let room = Room::furnace(rho);
        for (basis, error) in [(Basis::M2, 0.03), (Basis::M3, 0.03), (Basis::M3, 0.01), (Basis::M3, 0.003)] {
            for batches in [RECOMPUTE, STORE] {
                let outcome = room.solve(basis, error, batches, None);
                let rms = room.rms(|index, uv, band| {
                    let mut bands = [0.0; 3];
                    outcome.solution.fields[index].irradiance(uv, &mut bands);
                    (bands[band], 1.0 / (1.0 - rho))
                });
                println!("cube rho {rho} {basis:?} --error {error} {batches:?}: rms {rms:.2e}");
                assert!(rms <= error, "rho {rho} {basis:?} --error {error} {batches:?}: {rms}");
                assert!(outcome.solution.error_estimate <= 1.01 * error && outcome.statistics.iterations > 0);
            }
        }
    }
}

/// Both solutions hold the error and the estimate, and so does their distance; storing saves many evaluations.
fn links_may_be_stored(name: &str, basis: Basis, error: f64) {
    let room = Room::read(name);
    let [recomputed, stored] = [RECOMPUTE, STORE].map(|batches| {
        let outcome = room.solve(basis, error, batches, None);
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}.probes.csv"));
        let rms = deviation(&outcome.solution, &room.bvh, &file);
        let estimate = outcome.solution.error_estimate;
        println!(
            "{name} {basis:?} --error {error} {batches:?}: rms {rms:.4}, estimate {estimate:.4}, cost {}, {} bytes of links",
            outcome.work.cost(),
            outcome.statistics.link_bytes
        );
        assert!(rms <= error && estimate <= 1.01 * error && rms <= 1.2 * estimate, "{name} {batches:?}: {rms}");
        outcome
    });
    let distance = room.distance(&stored, &recomputed);
    println!("{name}: stored and recomputed are {distance:.5} apart");
    assert!(distance <= 0.7 * error, "{name}: {distance}");
    assert_eq!((recomputed.work.links_stored, recomputed.statistics.link_bytes), (0, 0));
    assert!(stored.work.links_reused > 0, "{name}");
    // Constants have so many links that some receivers' parts of the bytes run short, and save a quarter only.
    assert!(basis == Basis::Haar || !stored.statistics.links_refused, "{name}");
    let most = if basis == Basis::Haar { 0.85 } else { 0.6 };
    let share = stored.work.cost() as f64 / recomputed.work.cost() as f64;
    assert!(share < most, "{name}: {share} of the evaluations");
}

#[test]
fn stored_links_in_the_cornell_box() {
    links_may_be_stored("cornell-box", Basis::M3, 0.03);
}

#[test]
fn stored_links_in_the_gallery() {
    links_may_be_stored("l-gallery", Basis::M3, 0.03);
}

#[test]
fn stored_links_in_the_furnished_room() {
    links_may_be_stored("furnished-room", Basis::M2, 0.08);
}

#[test]
fn stored_links_of_constants() {
    links_may_be_stored("cornell-box", Basis::Haar, 0.08);
}

/// All that makes up a solution, to the last bit.
fn bits(outcome: &Outcome) -> Vec<u64> {
    let coefficients = outcome.solution.fields.iter().flat_map(|field| &field.coefficients);
    let estimate = [&outcome.solution.error_estimate, &outcome.unshot_fraction];
    estimate.into_iter().chain(coefficients).map(|c| c.to_bits()).collect()
}

#[test]
fn whoever_gathers_the_bits_are_the_same() {
    for (name, basis, error) in [("cornell-box", Basis::M3, 0.08), ("furnished-room", Basis::M2, 0.2)] {
        let room = Room::read(name);
        let full = room.solve(basis, error, STORE, None).statistics.link_bytes;
        // The last has room for a part only.
        for batches in [RECOMPUTE, STORE, Batches::All { link_bytes: full / 4 }] {
            let alone = room.solve(basis, error, batches, None);
            for workers in [1, 2, 3, 5] {
                let machine = Machine::synthetic("numa:2 core:4 pu:1").unwrap();
                let plan = Plan::new(machine.into(), Policy::None, Some(workers)).unwrap();
                let found = room.solve(basis, error, batches, Some(&mut Team::new(&plan).unwrap()));
                assert_eq!(found.work, alone.work, "{name} {batches:?} on {workers} workers");
                assert_eq!(found.statistics.link_bytes, alone.statistics.link_bytes);
                assert!(bits(&found) == bits(&alone), "{name} {batches:?} on {workers} workers");
            }
        }
    }
}

#[test]
fn a_small_budget_is_kept_and_used() {
    let room = Room::read("cornell-box");
    let (basis, error) = (Basis::M3, 0.02);
    let [none, all] = [RECOMPUTE, STORE].map(|batches| room.solve(basis, error, batches, None));
    let mut cost = none.work.cost();
    for share in [8, 4, 2] {
        let link_bytes = all.statistics.link_bytes / share;
        let some = room.solve(basis, error, Batches::All { link_bytes }, None);
        let held = some.statistics.link_bytes;
        println!("{held} of {link_bytes} bytes, cost {} of {}", some.work.cost(), none.work.cost());
        assert!(held <= link_bytes && 10 * held >= 8 * link_bytes, "{held} of {link_bytes}");
        assert!(some.statistics.links_refused && some.work.links_reused > 0);
        assert!(some.work.cost() < cost, "the more is stored, the less is evaluated");
        cost = some.work.cost();
        assert!(room.distance(&some, &none) <= 0.5 * error);
    }
    assert!(all.work.cost() < cost);
}
