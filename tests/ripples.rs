//! Ripples: a lamp of 5 cm, the straight edge of a plate, and a floor across which its shadow ends. At the limit of refinement a polynomial
//! cannot follow; by how much it leaves the range of the true irradiance on its element is measured at dense points, and bounded.
//!
//! The truth is Lambert's formula for the part of the lamp that lies before the plane through the point and the plate's edge.
//! `cargo test --release --test ripples -- --nocapture` prints what is measured.

use glam::{DVec2, DVec3};
use wavelet_radiosity::math::Basis;
use wavelet_radiosity::radiosity::Solution;
use wavelet_radiosity::scene::{self, Face, Material, Scene, Sides};
use wavelet_radiosity::schedule::{Options, Silent, solve};
use wavelet_radiosity::transport::{Oracle, lambert::form_factor};
use wavelet_radiosity::visibility::{Bvh, OpaqueFaces};

/// Half the lamp's side and its height, half the floor's side, and the height of the plate, in m.
const LAMP: (f64, f64) = (0.025, 2.0);
const FLOOR: f64 = 1.0;
const PLATE: f64 = 1.0;
/// Exitance of the lamp in W/m².
const EXITANCE: f64 = 1000.0;

/// Along the plate's edge, which runs under the lamp, and to the side on which the plate lies.
fn edge() -> (DVec2, DVec2) {
    let along = DVec2::from_angle(0.35);
    (along, along.perp())
}

fn lamp() -> Vec<DVec3> {
    let (h, z) = LAMP;
    [(-h, -h), (-h, h), (h, h), (h, -h)].map(|(x, y)| DVec3::new(x, y, z)).to_vec()
}

fn scene() -> Scene {
    let square =
        |h: f64, z: f64| [(-h, -h), (h, -h), (h, h), (-h, h)].map(|(x, y)| DVec3::new(x, y, z)).to_vec();
    let (along, aside) = edge();
    let plate = [-3.0 * along, 3.0 * along, 3.0 * (along + aside), 3.0 * (aside - along)];
    let plate = plate.map(|p| p.extend(PLATE)).to_vec();
    let material = |reflectance: f64, exitance: f64| Material {
        reflectance: vec![reflectance],
        exitance_w_m2: vec![exitance],
    };
    let face = |vertices: Vec<DVec3>, material: u32| Face { vertices, material, sides: Sides::One };
    let mut scene = Scene {
        bands: vec!["grey".to_owned()],
        materials: vec![material(0.5, 0.0), material(0.0, EXITANCE)],
        faces: vec![face(square(FLOOR, 0.0), 0), face(lamp(), 1), face(plate, 0)],
        ..Scene::default()
    };
    scene::validate(&mut scene);
    assert_eq!(scene.faces.len(), 3);
    scene
}

/// The irradiance of the floor at a point, in W/m².
fn exact(x: DVec3) -> f64 {
    let (along, aside) = edge();
    let normal = along.extend(0.0).cross(DVec3::new(0.0, 0.0, PLATE) - x);
    // The plate lies to the other side of the plane as seen from below.
    let normal = if normal.dot(aside.extend(0.0)) > 0.0 { -normal } else { normal };
    let side = |p: &DVec3| normal.dot(*p - x);
    let lamp = lamp();
    let mut seen = Vec::new();
    for (i, a) in lamp.iter().enumerate() {
        let b = lamp[(i + 1) % lamp.len()];
        let (here, there) = (side(a), side(&b));
        if here >= 0.0 {
            seen.push(*a);
        }
        if here * there < 0.0 {
            seen.push(a.lerp(b, here / (here - there)));
        }
    }
    if seen.len() < 3 { 0.0 } else { EXITANCE * form_factor(x, DVec3::Z, seen.into_iter()) }
}

fn solution(basis: Basis, error: f64) -> (Solution, u64) {
    let scene = scene();
    let bvh = Bvh::new(OpaqueFaces::new(&scene));
    let options = Options { error, basis, oracle: Oracle::Energy, direct_only: true };
    let outcome = solve(&scene, &scene::surfaces(&scene), &bvh, &options, &mut Silent);
    (outcome.solution, outcome.work.cost())
}

/// What is measured on the floor; all but the last relative to the largest true irradiance.
#[derive(Debug)]
struct Ripple {
    /// How far the irradiance rises above the largest true one around, and falls below the least.
    over: f64,
    under: f64,
    /// The least irradiance.
    least: f64,
    /// RMS error over the RMS of the truth.
    rms: f64,
}

/// Of what is read, or of the `raw` polynomials.
fn ripple(solution: &Solution, raw: bool) -> Ripple {
    let floor = &solution.surfaces[0];
    let (mut over, mut under, mut least) = (0.0f64, 0.0f64, f64::INFINITY);
    let (mut brightest, mut square, mut norm) = (0.0f64, 0.0, 0.0);
    solution.fields[0].for_each_leaf(&mut |leaf| {
        const N: usize = 24;
        let points = (0..N * N).map(|i| DVec2::new((i % N) as f64, (i / N) as f64) / (N - 1) as f64);
        let (mut high, mut low) = (0.0f64, f64::INFINITY);
        let (mut top, mut bottom) = (f64::NEG_INFINITY, f64::INFINITY);
        for local in points {
            // The true range is that of the element and as much again on every side.
            let around = exact(floor.frame.point(leaf.cell.to_surface(3.0 * local - 1.0)));
            (high, low) = (high.max(around), low.min(around));
            let uv = leaf.cell.to_surface(local);
            let (truth, mut found) = (exact(floor.frame.point(uv)), [0.0]);
            if raw {
                leaf.polynomial(solution.fields[0].basis, uv, &mut found);
            } else {
                leaf.irradiance(solution.fields[0].basis, uv, &mut found);
            }
            (top, bottom) = (top.max(found[0]), bottom.min(found[0]));
            square += leaf.cell.area() * (found[0] - truth).powi(2);
            norm += leaf.cell.area() * truth * truth;
        }
        (over, under) = (over.max(top - high), under.max(low - bottom));
        (brightest, least) = (brightest.max(high), least.min(bottom));
    });
    let relative = |value: f64| value / brightest;
    Ripple {
        over: relative(over),
        under: relative(under),
        least: relative(least),
        rms: (square / norm).sqrt(),
    }
}

#[test]
fn ripples_are_bounded() {
    for basis in [Basis::Haar, Basis::M2, Basis::M3, Basis::Auto] {
        for error in [0.1, 0.03, 0.01] {
            let (solution, cost) = solution(basis, error);
            let (read, raw) = (ripple(&solution, false), ripple(&solution, true));
            let leaves = solution.fields[0].leaves();
            println!("{basis:?} {error}: {leaves} leaves, cost {cost}, read {read:.3?}, raw {raw:.3?}");
            let what = format!("{basis:?} {error}: {read:?}");
            assert!(read.least >= 0.0 && read.under <= 0.01 && read.over <= 0.15, "{what}");
            assert!(read.rms <= 1.01 * raw.rms, "limits must not cost accuracy: {what}, {raw:?}");
        }
    }
}
