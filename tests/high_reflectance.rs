//! Closed scenes of high reflectance, where light is reflected up to a thousand times: the solver ends in a bounded number of batches, and
//! states an error that it keeps, and the balance of energy.
//!
//! `WRAD_HIGH_REFLECTANCE=long` runs more errors and reflectances. Rows go to standard output: scene, ρ, error asked for, true error (of
//! furnaces), estimate, balance, what transport lost before that was made up for, passes, shots and batches of the last pass, elements, cost, seconds.

use std::time::{Duration, Instant};

use ccnuma::{Machine, Plan, Policy, Team};
use glam::{DQuat, DVec2, DVec3};
use wavelet_radiosity::math::{Basis, polygon};
use wavelet_radiosity::output::energy_balance;
use wavelet_radiosity::scene::{self, Face, Material, Scene, Sides};
use wavelet_radiosity::schedule::{Observer, Options, Outcome, Schedule, Silent, solve, solve_by};
use wavelet_radiosity::transport::Oracle;
use wavelet_radiosity::visibility::{Bvh, OpaqueFaces};

/// Polygons of one reflectance and exitance.
type Part = (Vec<Vec<DVec3>>, f64, f64);

fn scene_of(parts: &[Part]) -> Scene {
    let mut scene = Scene { bands: vec!["grey".to_owned()], ..Scene::default() };
    for (faces, rho, m) in parts {
        let material = scene.materials.len() as u32;
        scene.materials.push(Material { reflectance: vec![*rho], exitance_w_m2: vec![*m] });
        let face = |vertices: &Vec<DVec3>| Face { vertices: vertices.clone(), material, sides: Sides::One };
        scene.faces.extend(faces.iter().map(face));
    }
    scene::validate(&mut scene);
    scene
}

/// The faces of a prism over a base given counter-clockwise from above, seen from inside.
fn room(base: &[DVec2], low: f64, high: f64) -> Vec<Vec<DVec3>> {
    let at = |z: f64| base.iter().map(move |p| p.extend(z));
    let mut faces = vec![at(low).collect(), at(high).rev().collect()];
    let edges = (0..base.len()).map(|i| (base[i], base[(i + 1) % base.len()]));
    faces.extend(edges.map(|(a, b)| vec![b.extend(low), a.extend(low), a.extend(high), b.extend(high)]));
    faces
}

/// A box that stands on the floor, turned, seen from outside.
fn block(at: DVec2, size: DVec3, turn: f64) -> Vec<Vec<DVec3>> {
    let half = 0.5 * size.truncate();
    let base = [-half, DVec2::new(half.x, -half.y), half, DVec2::new(-half.x, half.y)];
    let turn = DQuat::from_rotation_z(turn);
    let mut faces = room(&base, 0.2, 0.2 + size.z);
    for face in &mut faces {
        face.reverse();
        face.iter_mut().for_each(|p| *p = turn * *p + at.extend(0.0));
    }
    faces
}

fn furniture() -> Vec<Vec<DVec3>> {
    [
        block(DVec2::new(0.9, 0.8), DVec3::new(0.8, 0.5, 0.6), 0.4),
        block(DVec2::new(2.4, 1.1), DVec3::new(0.6, 0.9, 1.3), -0.3),
        block(DVec2::new(1.4, 2.2), DVec3::new(1.1, 0.4, 0.3), 0.1),
    ]
    .concat()
}

fn rectangle(low: (f64, f64), high: (f64, f64)) -> Vec<DVec2> {
    [low, (high.0, low.1), high, (low.0, high.1)].map(DVec2::from).to_vec()
}

/// A room 3.2 × 3 × 2.5 m with three blocks, all of it reflecting `rho`; a square of the ceiling emits.
fn furnished(rho: f64) -> Scene {
    let walls = room(&rectangle((0.0, 0.0), (3.2, 3.0)), 0.0, 2.5);
    let lamp = rectangle((1.3, 1.2), (1.9, 1.8)).into_iter().rev().map(|p| p.extend(2.4)).collect();
    let back = rectangle((1.3, 1.2), (1.9, 1.8)).into_iter().map(|p| p.extend(2.4)).collect();
    scene_of(&[(walls, rho, 0.0), (furniture(), rho, 0.0), (vec![lamp], rho, 10.0), (vec![back], rho, 0.0)])
}

/// Two rooms joined by a door; one face of the first emits. Light that has filled the one only leaks into the other.
fn joined(rho: f64) -> Scene {
    let base = [
        (0.0, 0.0),
        (2.0, 0.0),
        (2.0, 0.9),
        (2.2, 0.9),
        (2.2, 0.0),
        (4.2, 0.0),
        (4.2, 2.0),
        (2.2, 2.0),
        (2.2, 1.2),
        (2.0, 1.2),
        (2.0, 2.0),
        (0.0, 2.0),
    ]
    .map(DVec2::from);
    let mut faces = room(&base, 0.0, 1.5);
    let lamp = faces.pop().expect("the last wall");
    scene_of(&[(faces, rho, 0.0), (vec![lamp], rho, 10.0)])
}

fn furnace(rho: f64) -> Scene {
    let walls = room(&rectangle((0.0, 0.0), (3.2, 3.0)), 0.0, 2.5);
    scene_of(&[(walls, rho, 1.0), (furniture(), rho, 1.0)])
}

fn cube(rho: f64) -> Scene {
    scene_of(&[(room(&rectangle((0.0, 0.0), (1.0, 1.0)), 0.0, 1.0), rho, 1.0)])
}

/// Gives up after a while.
struct Patience(Instant);

impl Observer for Patience {
    fn interrupted(&mut self) -> bool {
        self.0.elapsed() > Duration::from_secs(60)
    }
}

/// RMS deviation of radiosity from `exact`, relative.
fn deviation(outcome: &Outcome, exact: f64) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for (index, surface) in outcome.solution.surfaces.iter().enumerate() {
        for i in 0..400 {
            let uv = (DVec2::new((i % 20) as f64, (i / 20) as f64) + 0.5) / 20.0;
            if polygon::contains(&surface.outline, uv) {
                let mut b = [0.0];
                outcome.solution.radiosity(index, uv, &mut b);
                sum += surface.frame.area_m2 * (b[0] / exact - 1.0).powi(2);
                weight += surface.frame.area_m2;
            }
        }
    }
    (sum / weight).sqrt()
}

/// A scene by its reflectance, and its radiosity by the same where it is known.
type Room = (&'static str, fn(f64) -> Scene, Option<fn(f64) -> f64>);

fn judge((name, make, exact): Room, rho: f64, error: f64) {
    let scene = make(rho);
    let surfaces = scene::surfaces(&scene);
    let bvh = Bvh::new(OpaqueFaces::new(&scene));
    let start = Instant::now();
    let options = Options { error, basis: Basis::M3, oracle: Oracle::Energy, direct_only: false };
    let outcome = solve(&scene, &surfaces, &bvh, &options, &mut Patience(start));
    let off = exact.map(|exact| deviation(&outcome, exact(rho)));
    let balance = energy_balance(&outcome.solution).as_result().map_or(f64::NAN, |balance| *balance);
    let lost = outcome.statistics.lost.unwrap_or(f64::NAN);
    let estimate = outcome.solution.error_estimate;
    println!(
        "{name} | {rho} | {error} | {} | {estimate:.1e} | {balance:.1e} | {lost:.1e} | {} | {} | {} | {} | {:.1e} | {:.1}",
        off.map_or("-".to_owned(), |off| format!("{off:.1e}")),
        outcome.passes,
        outcome.statistics.shots,
        outcome.statistics.batches,
        outcome.elements,
        outcome.work.cost() as f64,
        start.elapsed().as_secs_f64()
    );
    if outcome.solution.incomplete {
        return assert!(long(), "given up");
    }
    let place = format!("{name} at ρ {rho} and {error}");
    assert!(off.is_none_or(|off| off <= estimate.max(error)), "{place}: off by {off:?}, stated {estimate}");
    assert!(rho > 0.99 || estimate <= error, "{place}: {estimate}");
    assert!(outcome.statistics.batches <= 100, "{place}: {} batches", outcome.statistics.batches);
    assert!(balance.abs() <= 1e-4, "{place}: balance {balance}");
    assert!(lost.abs() <= 0.1 * error, "{place}: transport lost {lost}");
}

fn long() -> bool {
    std::env::var_os("WRAD_HIGH_REFLECTANCE").is_some_and(|form| form == "long")
}

fn judge_all(rooms: &[Room]) {
    let errors: &[f64] = if long() { &[0.1, 0.03, 0.01] } else { &[0.1] };
    let reflectances: &[f64] = if long() { &[0.8, 0.9, 0.99, 0.999] } else { &[0.9, 0.99] };
    for room in rooms {
        for rho in reflectances {
            errors.iter().for_each(|error| judge(*room, *rho, *error));
        }
    }
}

#[test]
fn furnaces() {
    let exact: Option<fn(f64) -> f64> = Some(|rho| 1.0 / (1.0 - rho));
    judge_all(&[("cube", cube, exact), ("furnished furnace", furnace, exact)]);
}

/// Mixing is part of the specification too: bit by bit the same whoever works.
#[test]
fn whoever_works_the_solution_is_the_same() {
    let scene = furnished(0.95);
    let (surfaces, bvh) = (scene::surfaces(&scene), Bvh::new(OpaqueFaces::new(&scene)));
    let options = Options { error: 0.1, basis: Basis::M3, oracle: Oracle::Energy, direct_only: false };
    let alone = solve(&scene, &surfaces, &bvh, &options, &mut Silent);
    for workers in [1, 2, 3] {
        let machine = Machine::synthetic("numa:2 core:2 pu:1").expect("a machine");
        let plan = Plan::new(machine.into(), Policy::None, Some(workers)).expect("a plan");
        let mut team = Team::new(&plan).expect("a team");
        let schedule = Schedule { team: Some(&mut team), ..Schedule::default() };
        let outcome =
            solve_by(schedule, &scene, &surfaces, &bvh, &options, &mut Silent).expect("no worker fails");
        assert!(outcome.solution.fields == alone.solution.fields, "{workers} workers");
        assert_eq!(outcome.solution.error_estimate, alone.solution.error_estimate);
    }
}

#[test]
fn lamps() {
    judge_all(&[("furnished room", furnished, None), ("two rooms", joined, None)]);
}
