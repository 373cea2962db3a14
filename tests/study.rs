//! `wrad study` as its users meet it: results whole, refusals that say what is expected.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

const CORNELL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box.iv");

/// Runs in the directory: exit code, standard output, standard error.
fn run(directory: &Path, arguments: &[&str]) -> (i32, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_wrad"));
    let output = command.current_dir(directory).args(arguments).stdin(Stdio::null()).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

/// The one directory in this one.
fn only(directory: &Path) -> PathBuf {
    let mut entries = std::fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path());
    let first = entries.next().expect("there is something in it");
    assert!(entries.next().is_none());
    first
}

const SCHEDULES: &str = "sequential,stealing,inner-loop,inner-loop-whole,single-queue,outer-loop+lure";

#[test]
fn a_study_measures_predicts_and_writes_all_of_it() {
    let place = tempfile::tempdir().unwrap();
    let arguments = [
        "study",
        "speedup",
        CORNELL,
        "--error",
        "0.6",
        "--basis",
        "haar",
        "--threads",
        "1,2",
        "--pin",
        "none",
        "--repeat",
        "1",
        "--predict",
        "1,4,16",
        "--machine",
        "pack:4 numa:1 core:4 pu:1",
        "--schedules",
        SCHEDULES,
    ];
    let (code, out, err) = run(place.path(), &arguments);
    assert_eq!((code, err.as_str()), (0, ""), "{out}");
    let directory = only(&only(&place.path().join("results")));
    assert_eq!(directory.file_name().unwrap(), "speedup-cornell-box");
    assert!(out.contains("predicted for pack:4 numa:1 core:4 pu:1") && out.contains("written to "));
    let text = |name: &str| std::fs::read_to_string(directory.join(name)).unwrap();
    let study: Value = serde_json::from_str(&text("study.json")).unwrap();
    let result = &study["result"];
    let measured = result["measured"].as_array().unwrap();
    let find = |schedule: &str, threads: u64| {
        measured.iter().find(|m| m["schedule"] == schedule && m["threads"] == threads).unwrap()
    };
    assert_eq!(find("stealing", 2)["seconds"]["count"], 1);
    assert_eq!(find("stealing", 2)["elements"], find("sequential", 1)["elements"]);
    assert!(find("stealing", 1)["speed_up"].as_f64().unwrap() <= 1.0, "the base is the least on one thread");
    // Where a machine counts nothing, that is said and why.
    let rate = &find("stealing", 1)["l1_hit_rate"];
    assert!(
        rate["value"].as_f64().is_some_and(|r| r > 0.0)
            || rate["unavailable"].as_str().is_some_and(|r| r.len() > 10)
    );
    let predicted = result["predicted"].as_array().unwrap();
    assert_eq!(predicted.len(), 3 * 5, "every schedule that can be replayed");
    for prediction in predicted {
        let number = |name: &str| prediction[name].as_f64().unwrap();
        let replayed = |name: &str| prediction["replayed"][name].as_f64().unwrap();
        // Two recordings of the same work differ by what else the machine does.
        assert!(number("speed_up") > 0.0 && number("speed_up") < 1.1 * number("workers"), "{prediction}");
        let parts = ["busy_s", "remote_s", "overhead_s", "lock_s", "merge_s", "barrier_s", "alone_s"];
        let (sum, all) = (parts.map(replayed).iter().sum::<f64>(), number("workers") * replayed("seconds"));
        assert!((sum - all).abs() < 0.01 * all, "the time of all workers is accounted for: {prediction}");
    }
    assert_eq!(text("measured.csv").lines().count(), 1 + measured.len());
    assert_eq!(text("predicted.csv").lines().count(), 1 + predicted.len());
    assert!(text("speedup-1.svg").starts_with("<svg") && text("speedup-1.svg").contains("outer-loop+lure"));
    let readme = text("README.md");
    for part in
        ["# Speed-up on", "commit", "study speedup", "## Measured here", "speedup-1.svg", "unavailable"]
    {
        assert!(readme.contains(part), "{part}");
    }
    let (code, _, err) = run(place.path(), &arguments);
    assert!(code == 2 && err.contains("there are results of today and this commit"), "{err}");
}

/// A room of two facing squares, one of them a lamp, and two walls.
const ROOM: &str = "#Inventor V2.1 ascii
Separator {
  ShapeHints { vertexOrdering COUNTERCLOCKWISE shapeType SOLID }
  Separator { Material { diffuseColor 0.5 0.4 0.3 } Coordinate3 { point [ 0 0 0, 1 0 0, 1 1 0, 0 1 0 ] }
    IndexedFaceSet { coordIndex [ 0, 1, 2, 3, -1 ] } }
  Separator { Material { diffuseColor 0.1 0.1 0.1 emissiveColor 4 3 2 } Coordinate3 { point [ 0 0 1, 0 1 1, 1 1 1, 1 0 1 ] }
    IndexedFaceSet { coordIndex [ 0, 1, 2, 3, -1 ] } }
  Separator { Material { diffuseColor 0.8 0.6 0.6 } Coordinate3 { point [ 0 0 0, 0 1 0, 0 1 1, 0 0 1 ] }
    IndexedFaceSet { coordIndex [ 0, 1, 2, 3, -1 ] } }
  Separator { Material { diffuseColor 0.8 0.6 0.6 } Coordinate3 { point [ 1 1 0, 1 0 0, 1 0 1, 1 1 1 ] }
    IndexedFaceSet { coordIndex [ 0, 1, 2, 3, -1 ] } }
}
";

#[test]
fn a_study_of_errors_compares_and_writes_all_of_it() {
    let place = tempfile::tempdir().unwrap();
    std::fs::write(place.path().join("room.iv"), ROOM).unwrap();
    let probe = "x,y,z,nx,ny,nz,E_r,E_g,E_b,se_r,se_g,se_b\n0.5,0.5,0,0,0,1,1.4,1,0.6,0.01,0.01,0.01\n";
    std::fs::write(place.path().join("room.probes.csv"), probe).unwrap();
    let arguments =
        ["study", "error", "room.iv", "--errors", "0.05,0.4", "--bases", "haar,m2", "--repeat", "2"];
    let (code, out, err) = run(place.path(), &arguments);
    assert_eq!((code, err.as_str()), (0, ""), "{out}");
    let directory = only(&only(&place.path().join("results")));
    assert_eq!(directory.file_name().unwrap(), "error-room");
    let text = |name: &str| std::fs::read_to_string(directory.join(name)).unwrap();
    let study: Value = serde_json::from_str(&text("study.json")).unwrap();
    let scene = &study["result"]["scenes"][0];
    assert!(scene["truth"]["noise"].as_f64().is_some_and(|noise| (0.005..0.015).contains(&noise)));
    for curve in scene["curves"].as_array().unwrap() {
        let cases = curve["cases"].as_array().unwrap();
        let number = |case: usize, name: &str| cases[case].pointer(name).unwrap().as_f64().unwrap();
        assert_eq!((cases.len(), number(0, "/error"), number(1, "/error")), (2, 0.4, 0.05));
        assert_eq!(cases[1]["seconds"]["count"], 2);
        assert!(number(1, "/elements") > number(0, "/elements"));
        for norm in ["/reflected/rms", "/irradiance/rms", "/irradiance/median"] {
            assert!(number(1, norm) < number(0, norm), "{norm}: {curve}");
        }
        assert!(number(1, "/reflected/rms") < 0.05 && number(1, "/at_probes/rms") > 0.0, "{curve}");
    }
    assert_eq!(text("solutions.csv").lines().count(), 1 + 2 * 2);
    for plot in ["time-room.svg", "elements-room.svg", "estimate.svg"] {
        assert!(text(plot).starts_with("<svg") && text(plot).contains("m2"), "{plot}");
    }
    let readme = text("README.md");
    for part in
        ["# Time against error on room", "commit", "study error", "## room", "time-room.svg", "## Estimates"]
    {
        assert!(readme.contains(part), "{part}");
    }
    assert!(out.contains("| m2 |") && out.contains("estimates") && out.contains("written to "), "{out}");
}

#[test]
fn a_run_that_takes_too_long_ends_its_curve() {
    let place = tempfile::tempdir().unwrap();
    let arguments = ["--errors", "0.3", "--bases", "m3", "--repeat", "1", "--longest", "0.001", "--quiet"];
    let (code, out, err) = run(place.path(), &[vec!["study", "error", CORNELL], arguments.to_vec()].concat());
    assert_eq!((code, out.as_str(), err.as_str()), (0, "", ""));
    let directory = only(&only(&place.path().join("results")));
    let readme = std::fs::read_to_string(directory.join("README.md")).unwrap();
    assert!(readme.contains("| m3 | 30 % | too long |"), "{readme}");
}

#[test]
fn refusals_say_what_is_expected_and_nothing_is_written() {
    let place = tempfile::tempdir().unwrap();
    let cases = [
        (vec![], "Usage: wrad study"),
        (vec!["figure1"], "unrecognized subcommand 'figure1'"),
        (vec!["error"], "<SCENE>"),
        (vec!["error", "none.iv"], "none.iv"),
        (vec!["error", CORNELL, CORNELL], "SCENE: cornell-box is named twice"),
        (vec!["error", CORNELL, "--errors", "0.1,0"], "--errors 0: expected a number above 0"),
        (vec!["error", CORNELL, "--errors", "0.1,0.1"], "--errors: 0.1 is named twice"),
        (vec!["error", CORNELL, "--bases", "haar,m4"], "--bases m4: there is no such value; available: haar"),
        (vec!["error", CORNELL, "--repeat", "0"], "--repeat 0: expected whole numbers"),
        (vec!["error", CORNELL, "--longest", "-5"], "--longest -5: expected a number above 0"),
        (vec!["speedup"], "<SCENE>"),
        (vec!["speedup", "none.iv"], "none.iv"),
        (vec!["speedup", CORNELL, "--threads", "0"], "--threads 0: expected whole numbers from 1"),
        (vec!["speedup", CORNELL, "--threads", "1,1"], "--threads: 1 is named twice"),
        (vec!["speedup", CORNELL, "--threads", "9999"], "9999"),
        (vec!["speedup", CORNELL, "--predict", "1,two"], "found \"two\""),
        (vec!["speedup", CORNELL, "--repeat", "-1"], "--repeat -1: expected whole numbers"),
        (vec!["speedup", CORNELL, "--repeat", "1,2"], "--repeat 1,2: expected one number"),
        (vec!["speedup", CORNELL, "--schedules", "guided"], "--schedules guided: there is no such value"),
        (vec!["speedup", CORNELL, "--schedules", "stealing,stealing"], "stealing is named twice"),
        (vec!["speedup", CORNELL, "--machine", "core:x"], "core:x"),
        (vec!["speedup", CORNELL, "--machine", "core:2 pu:1", "--predict", "3"], "it has 2 cores"),
        (vec!["speedup", CORNELL, "--error", "2"], "--error 2: expected a number above 0, at most 1"),
        (vec!["speedup", CORNELL, "--pin", "compakt"], "compakt"),
    ];
    for (arguments, message) in cases {
        let (code, out, err) = run(place.path(), &[vec!["study"], arguments.clone()].concat());
        assert_eq!(code, 2, "{arguments:?}: {err}");
        assert!(err.contains(message) && out.is_empty(), "{arguments:?}: {err}");
    }
    assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 0);
}
