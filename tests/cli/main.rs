//! The command line as its users meet it: exit codes, messages, files whole or not at all.

#[cfg(target_os = "linux")]
mod limits;
mod place;
mod refusals;
mod reports;

use std::path::Path;

use serde_json::Value;

use place::{CORNELL, Place};

#[test]
fn pictures_come_from_scenes_and_from_saved_solutions_alike() {
    let place = Place::new();
    let picture = "--size 64x48 --exposure 0.5";
    let solve = place.run("solve box.iv --error 0.2 --out a.wrad --quiet");
    assert_eq!(solve.0, 0, "{}", solve.2);
    assert_eq!(place.run(&format!("render a.wrad --out saved.png {picture}")).0, 0);
    assert_eq!(place.run(&format!("render box.iv --error 0.2 --out scene.png {picture}")).0, 0);
    let bytes = |name| std::fs::read(place.at(name)).unwrap();
    assert!(bytes("saved.png") == bytes("scene.png"));
    assert_eq!(place.run("render a.wrad --out mesh.png --size 64x160 --mesh --falsecolor").0, 0);
    assert_eq!(place.run("render a.wrad --out a.exr --size 32x24").0, 0);
}

/// As `compare.py` beside the reference probes does: RMS of the deviations over RMS of the truth.
#[test]
fn probes_of_a_coarse_run_follow_the_reference() {
    let reference = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/reference/cornell-box.probes.csv");
    if !reference.is_file() {
        println!("skipped: {} is missing", reference.display());
        return;
    }
    let place = Place::new();
    std::fs::copy(CORNELL, place.at("cornell.iv")).unwrap();
    std::fs::copy(reference, place.at("p.csv")).unwrap();
    let (code, _, err) =
        place.run("solve cornell.iv --error 0.1 --basis m2 --probes p.csv --probes-out q.csv");
    assert_eq!(code, 0, "{err}");
    let mut rows = csv::Reader::from_path(place.at("q.csv")).unwrap();
    let header = rows.headers().unwrap().clone();
    let column = |name: String| header.iter().position(|h| *h == name).unwrap();
    let (mut deviation, mut truth, mut count) = (0.0f64, 0.0f64, 0);
    for row in rows.records() {
        let row = row.unwrap();
        for band in ["r", "g", "b"] {
            let value = |name: &str| row[column(format!("{name}_{band}"))].parse::<f64>().unwrap();
            deviation += (value("irradiance") - value("E")).powi(2);
            truth += value("E").powi(2);
            count += 1;
        }
    }
    let rms = (deviation / truth).sqrt();
    assert!(count == 3 * 307 && rms < 0.1, "RMS deviation {rms} over {count} readings");
}

#[test]
fn topology_shows_this_machine_and_plans_for_others() {
    let place = Place::new();
    let (code, text, _) = place.run("topology");
    assert!(code == 0 && text.contains("this machine") && text.contains("worker   0"), "{text}");
    let mut command = place.command("topology --json --threads 4 --pin scatter --synthetic");
    let output = command.arg("numa:4 core:8 pu:2").output().unwrap();
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(output.status.success() && report.is_object(), "{report}");
    let (code, _, problem) = place.run("topology --synthetic nonsense");
    assert!(code == 2 && problem.contains("nonsense"), "{problem}");
    let (code, _, problem) = place.run("topology --threads 100000");
    assert!(code == 2 && problem.contains("100000"), "{problem}");
}

#[test]
fn a_generated_scene_can_be_read_and_comes_out_the_same_again() {
    let place = Place::new();
    let (code, out, err) = place.run("generate soda-room --out a.iv --surfaces 2000 --seed 7");
    assert_eq!((code, out.as_str(), err.as_str()), (0, "a.iv: 2000 surfaces, 3 lights\n", ""));
    place.run("generate soda-room --out b.iv --surfaces 2000 --seed 7");
    assert_eq!(place.text("a.iv"), place.text("b.iv"));
    let (code, out, _) = place.run("info a.iv");
    assert!(code == 0 && out.contains("faces      2000 ") && !out.contains("repaired"), "{out}");
    for part in
        ["where 16 shoot at once (at most ", "listed if at most 48 of 2.00 k; smaller elements inherit"]
    {
        assert!(out.contains(part), "{part}: {out}");
    }
}
