//! The reference scenes against irradiance from an unrelated Monte Carlo code (1,048,576 paths a probe, standard errors of 0.06 to
//! 0.085 %): `RMS |E − E_ref| / RMS E_ref` over all probes and bands, and the honesty of the estimate. In the gallery, whose reference is off
//! (`results/accuracy`), what `tests/tracing.rs` finds.

use std::path::{Path, PathBuf};

use deviation::deviation;
use wavelet_radiosity::math::Basis;
use wavelet_radiosity::output::energy_balance;
use wavelet_radiosity::scene;
use wavelet_radiosity::schedule::{Options, Outcome, Silent, solve};
use wavelet_radiosity::transport::Oracle;
use wavelet_radiosity::visibility::{Bvh, OpaqueFaces};

#[path = "support/deviation.rs"]
mod deviation;
#[path = "support/probes.rs"]
mod probes;

/// Solves a scene of `scenes/`; returns the RMS deviation at the probes, the estimate and what it cost.
fn judged(name: &str, basis: Basis, error: f64) -> (f64, f64, u64) {
    let (rms, outcome) = solved(name, basis, error);
    (rms, outcome.solution.error_estimate, outcome.work.cost())
}

/// The file of what is true at the probes of a scene.
fn true_probes(name: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let traced = root.join(format!("tests/data/{name}.traced.csv"));
    if traced.exists() { traced } else { root.join(format!("scenes/{name}.probes.csv")) }
}

/// Solves a scene of `scenes/`; returns the RMS deviation at the probes beside what came of it.
fn solved(name: &str, basis: Basis, error: f64) -> (f64, Outcome) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let scene = scene::read::read_file(&root.join(format!("scenes/{name}.iv"))).unwrap();
    let surfaces = scene::surfaces(&scene);
    let bvh = Bvh::new(OpaqueFaces::new(&scene));
    let options = Options { error, basis, oracle: Oracle::Energy, direct_only: false };
    let outcome = solve(&scene, &surfaces, &bvh, &options, &mut Silent);
    let rms = deviation(&outcome.solution, &bvh, &true_probes(name));
    println!(
        "{name} {basis:?} --error {error}: rms {:.3} %, estimate {:.3} %, {} elements, {} passes",
        100.0 * rms,
        100.0 * outcome.solution.error_estimate,
        outcome.elements,
        outcome.passes
    );
    (rms, outcome)
}

/// The deviation stays below `limit` and `honest` times the estimate, and the estimate is not idle.
fn check(name: &str, basis: Basis, error: f64, limit: f64, honest: f64) {
    let (rms, estimate, _) = judged(name, basis, error);
    assert!(rms <= limit, "{name} {basis:?} --error {error}: {rms} above {limit}");
    assert!(estimate <= 1.01 * error, "the target was not met: {estimate}");
    assert!(rms <= honest * estimate && estimate <= 4.0 * rms, "{rms} against the estimate {estimate}");
}

#[test]
fn haar_reaches_three_percent() {
    for name in ["cornell-box", "furnished-room", "l-gallery"] {
        check(name, Basis::Haar, 0.03, 0.03, 1.2);
    }
}

/// In constants the direct light of the first guess is too coarse: it alone is computed again.
#[test]
fn one_pass_meets_a_coarse_target() {
    for name in ["cornell-box", "furnished-room", "l-gallery"] {
        for basis in [Basis::Haar, Basis::M2, Basis::M3] {
            let (rms, outcome) = solved(name, basis, 0.1);
            assert_eq!(outcome.passes, 1, "{name} {basis:?}");
            let estimate = outcome.solution.error_estimate;
            assert!(rms < 0.1 && estimate < 0.1, "{name} {basis:?}: {rms}, {estimate} estimated");
        }
    }
}

#[test]
fn auto_costs_less_than_m3_and_errs_no_more() {
    // Neighbouring errors deviate by a tenth more or less, in either basis: several are taken together.
    for name in ["cornell-box", "furnished-room", "l-gallery"] {
        let (mut squares, mut costs) = ([0.0, 0.0], [0, 0]);
        for error in [0.028, 0.025, 0.022, 0.02] {
            for (i, basis) in [Basis::M3, Basis::Auto].into_iter().enumerate() {
                let (rms, _, cost) = judged(name, basis, error);
                squares[i] += rms * rms;
                costs[i] += cost;
            }
        }
        assert!(costs[1] < costs[0], "{name}: {costs:?}");
        assert!(squares[1] <= 1.1 * squares[0], "{name}: mean squares {squares:?}");
    }
}

/// In closed rooms what transport loses is made up for; without that, these are off by 7e-4, 6e-4 and 1.1e-3.
#[test]
fn energy_is_in_balance() {
    for name in ["cornell-box", "l-gallery", "furnished-room"] {
        let (_, outcome) = solved(name, Basis::Auto, 0.03);
        let balance = energy_balance(&outcome.solution).as_result().copied().unwrap();
        assert!(balance.abs() <= 3e-4, "{name}: {balance}");
        assert!(outcome.statistics.lost.is_some_and(|lost| lost.abs() <= 0.003), "{name}");
    }
}

#[test]
fn m2_and_m3_at_one_percent_on_the_cornell_box() {
    check("cornell-box", Basis::M2, 0.01, 0.015, 1.2);
    check("cornell-box", Basis::M3, 0.01, 0.015, 1.2);
}

#[test]
fn m2_and_m3_at_one_percent_in_the_gallery() {
    check("l-gallery", Basis::M2, 0.01, 0.015, 1.2);
    check("l-gallery", Basis::M3, 0.01, 0.015, 1.2);
}

#[test]
fn m2_at_one_percent_in_the_furnished_room() {
    check("furnished-room", Basis::M2, 0.01, 0.015, 1.2);
}

#[test]
fn m3_at_one_percent_in_the_furnished_room() {
    check("furnished-room", Basis::M3, 0.01, 0.015, 1.2);
}

#[test]
fn m3_at_three_per_mille_on_the_cornell_box() {
    check("cornell-box", Basis::M3, 0.003, 0.006, 1.5);
}

#[test]
fn m3_at_three_per_mille_in_the_gallery() {
    // 0.28 % off the reference, in which half of the star is black.
    check("l-gallery", Basis::M3, 0.003, 0.003, 1.2);
}
