//! Real scenes that others made: they solve at `--error 0.05` and render, and sensors on workplanes follow Radiance.
//!
//! The files lie beside the project in `../shared/scenes`; without them these tests say so and pass. By itself this runs what takes a minute;
//! with `WRAD_REAL_SCENES=all` (`scripts/real-scenes`) it runs all of them.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use serde_json::Value;

fn shared(path: &str) -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/scenes")).join(path);
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
        return None;
    }
    Some(path)
}

fn all() -> bool {
    std::env::var("WRAD_REAL_SCENES").is_ok_and(|which| which == "all")
}

/// Solves a scene, checks its report and picture, and returns the irradiances (red, green, blue) at `probes`.
fn solve(scene: &Path, error: f64, probes: Option<&Path>) -> Vec<[f64; 3]> {
    let place = tempfile::tempdir().unwrap();
    let at = |name: &str| place.path().join(name);
    let mut command = Command::new(env!("CARGO_BIN_EXE_wrad"));
    command.args(["solve", "--quiet", "--error", &error.to_string()]).arg(scene);
    command.arg("--report").arg(at("report.json")).arg("--out").arg(at("picture.png"));
    if let Some(probes) = probes {
        command.arg("--probes").arg(probes).arg("--probes-out").arg(at("readings.csv"));
    }
    let start = Instant::now();
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}: {}", scene.display(), String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&std::fs::read(at("report.json")).unwrap()).unwrap();
    let estimate = report["result"]["error_estimate"].as_f64().unwrap();
    assert!(estimate <= 1.01 * error, "{}: the target was not met: {estimate}", scene.display());
    assert!(at("picture.png").metadata().unwrap().len() > 1000);
    println!(
        "{} --error {error}: {:.1} s, estimate {:.3} %, {} elements",
        scene.file_name().unwrap().to_string_lossy(),
        start.elapsed().as_secs_f64(),
        100.0 * estimate,
        report["result"]["elements"]
    );
    let Some(_) = probes else { return Vec::new() };
    let mut readings = csv::Reader::from_path(at("readings.csv")).unwrap();
    let header = readings.headers().unwrap().clone();
    let columns = ["irradiance_r", "irradiance_g", "irradiance_b"]
        .map(|name| header.iter().position(|column| column == name).unwrap());
    readings.records().map(|row| row.unwrap()).map(|row| columns.map(|c| row[c].parse().unwrap())).collect()
}

/// RMS deviation of illuminance from Radiance's after the best common scale factor, relative to the RMS.
fn deviation(scene: &str, workplane: &str, error: f64) -> Option<f64> {
    let (scene, workplane) = (shared(scene)?, shared(workplane)?);
    let readings = solve(&scene, error, Some(&workplane));
    let mut rows = csv::Reader::from_path(&workplane).unwrap();
    let truth: Vec<f64> = rows.records().map(|row| row.unwrap()[6].parse().unwrap()).collect();
    // Radiance's luminance of a colour.
    let ours: Vec<f64> = readings.iter().map(|[r, g, b]| 0.265 * r + 0.670 * g + 0.065 * b).collect();
    assert_eq!(ours.len(), truth.len());
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let scale = dot(&ours, &truth) / dot(&ours, &ours);
    let square: f64 = ours.iter().zip(&truth).map(|(x, t)| (scale * x - t).powi(2)).sum();
    let rms = (square / dot(&truth, &truth)).sqrt();
    println!("{}: RMS deviation from Radiance {:.2} %", workplane.display(), 100.0 * rms);
    Some(rms)
}

#[test]
fn a_corridor_and_small_models_solve_and_render() {
    for scene in ["corridor.iv", "inventor-data/chessboard.iv", "inventor-data/slotMachine.iv"] {
        if let Some(scene) = shared(&format!("iv/{scene}")) {
            solve(&scene, 0.05, None);
        }
    }
}

#[test]
fn sensors_in_an_office_follow_radiance() {
    if let Some(rms) = deviation("iv/office_b90.iv", "workplane/office_workplane.csv", 0.1) {
        assert!(rms < 0.03, "{rms}");
    }
}

#[test]
fn rooms_at_five_percent_follow_radiance() {
    if !all() {
        return println!("skipped: takes minutes; run scripts/real-scenes");
    }
    for (scene, limit) in [("office_b90", 0.025), ("classroom_kul", 0.05), ("soda", 0.08)] {
        let workplane = scene.split('_').next().unwrap_or(scene);
        let workplane = format!("workplane/{workplane}_workplane.csv");
        if let Some(rms) = deviation(&format!("iv/{scene}.iv"), &workplane, 0.05) {
            assert!(rms < limit, "{scene}: {rms}");
        }
    }
}

#[test]
fn all_models_solve_and_render() {
    if !all() {
        return println!("skipped: takes minutes; run scripts/real-scenes");
    }
    let Some(folder) = shared("iv/inventor-data") else { return };
    let mut scenes: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    scenes.extend(shared("iv/hospital.iv"));
    scenes.retain(|path| path.extension().is_some_and(|e| e == "iv"));
    scenes.sort();
    for scene in scenes {
        solve(&scene, 0.05, None);
    }
}
