//! What ends otherwise than asked for: wrong usage, bad input, results that cannot be written, interrupts.

use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use super::place::{CORNELL, PROBES, Place};

#[test]
fn wrong_usage_ends_with_2_says_what_is_available_and_writes_nothing() {
    let place = Place::new();
    place.put("p.csv", PROBES);
    let cases = [
        ("solve", "Usage: wrad solve"),
        ("dance", "unrecognized subcommand 'dance'"),
        ("solve box.iv --error 0", "--error 0: expected a number above 0, at most 1"),
        ("solve box.iv --error -1", "--error -1: expected a number above 0"),
        ("solve box.iv --error fine", "--error fine: expected a number"),
        ("solve box.iv --basis m4", "--basis m4: there is no such value; available: haar, m2, m3, auto"),
        ("solve box.iv --method pull", "--method pull: there is no such value; available: shoot, gather"),
        ("solve box.iv --method gather --schedule outer-loop", "use stealing or sequential"),
        ("solve box.iv --links store", "leave it out, or use --method gather"),
        (
            "solve box.iv --links keep",
            "--links keep: there is no such value; available: recompute, store, auto",
        ),
        ("solve box.iv --link-memory 5M", "--link-memory 5M: --method shoot stores no links"),
        (
            "solve box.iv --method gather --links recompute --link-memory 5M",
            "--links recompute stores no links; leave one of them out",
        ),
        ("solve box.iv --method gather --link-memory 5X", "expected a whole number of bytes above 0"),
        (
            "solve box.iv --visibility kd",
            "--visibility kd: there is no such value; available: bvh, bsp, none",
        ),
        (
            "solve box.iv --schedule inner-loop+lure",
            "--schedule inner-loop+lure: inner-loop locks no receiver, so there is nothing to lure; +lure goes with single-queue and outer-loop",
        ),
        ("solve box.iv --schedule fast", "--schedule fast: there is no such value"),
        ("solve box.iv --threads 0", "--threads 0: expected a number of workers, at least 1"),
        ("solve box.iv --threads -2", "--threads -2: expected a number of workers"),
        ("solve box.iv --threads 100000", "100000"),
        ("solve box.iv --pin compakt", "compakt"),
        ("solve box.iv --pin 0,0", "twice"),
        (
            "solve box.iv --schedule sequential --threads 2",
            "--threads 2: --schedule sequential runs on one thread",
        ),
        ("solve box.iv --schedule sequential --pin compact", "leave --pin out or name another schedule"),
        ("solve box.iv --memory near", "available: node, interleave, first-touch, malloc"),
        ("solve box.iv --schedule sequential --memory node", "--schedule sequential runs on one thread"),
        ("solve box.iv --counters simulated", "--counters simulated: not available in this version"),
        ("solve box.iv --probes p.csv", "--probes-out"),
        ("solve box.iv --probes-out q.csv", "--probes"),
        ("solve box.iv --out a.jpg", "a.jpg: no format is known for the extension .jpg; supported are .glb"),
        ("solve box.iv --out none/a.png", "none/a.png: its directory does not exist; create it first"),
        ("solve box.iv --out a.png --out ./a.png", "./a.png: two results have this name"),
        ("solve box.iv --report box.iv", "box.iv: the result would overwrite the input"),
        ("render box.iv --out a.glb", "a.glb: wrad render writes pictures"),
        ("render box.iv --out a.png --size 10", "--size 10: expected width and height in pixels"),
        ("render box.iv --out a.png --size 0x10", "0 x 10 pixels cannot be made"),
        ("render box.iv --out a.png --camera left", "the scene has no camera named 'left'"),
        ("render box.iv --out a.png --exposure 0", "--exposure 0: expected a finite number above 0"),
        ("render box.iv --out a.exr --mesh", "--mesh, --falsecolor and --exposure are for .png"),
        ("generate nancy --out a.iv", "generate nancy: there is no such value; available: stanislas, quito"),
        ("generate cornell --out a.obj", "a.obj: wrad generate writes Open Inventor scenes: .iv"),
        ("generate cornell --out none/a.iv", "none/a.iv: its directory does not exist"),
        (
            "generate cornell --out a.iv --surfaces -3",
            "--surfaces -3: expected a whole number from 1 to 2000000",
        ),
        (
            "generate cornell --out a.iv --surfaces 16",
            "cornell needs at least 17 surfaces, 16 were asked for",
        ),
        ("generate cornell --out a.iv --seed one", "--seed one: expected a whole number"),
        ("render none.wrad --out a.png --error 0.1", "--error and --basis are for scenes"),
    ];
    for (arguments, message) in cases {
        let (code, out, err) = place.run(arguments);
        assert_eq!(code, 2, "{arguments}: {err}");
        assert!(err.contains(message) && out.is_empty(), "{arguments}: {err}");
    }
    assert_eq!(place.files(), ["box.iv", "p.csv"]);
}

#[test]
fn bad_input_ends_with_2_names_the_place_and_writes_nothing() {
    let place = Place::new();
    place.put("bad.iv", "#Inventor V2.1 ascii\nSeparator {\n  Cube { width two }\n}\n");
    place.put("empty.iv", "#Inventor V2.1 ascii\nSeparator { }\n");
    place.put("bad.csv", "x,y,z,nx,ny,nz\n0.5,0.5,0,0,0,1\n0.5,0.5,0,0,0,0\n");
    place.put("done.csv", "x,y,z,nx,ny,nz,irradiance_g\n0.5,0.5,0,0,0,1,1\n");
    place.put("bad.wrad", "not a solution");
    let before = place.files();
    let results = "--out a.png --out a.wrad --report a.json";
    let cases = [
        (format!("solve bad.iv {results}"), "bad.iv:3:16: expected"),
        (format!("solve none.iv {results}"), "none.iv: cannot be read"),
        (format!("solve empty.iv {results}"), "empty.iv: the scene has no faces"),
        (
            format!("solve box.iv {results} --probes bad.csv --probes-out a.csv"),
            "bad.csv: row 2 (line 3): columns nx, ny, nz: expected a direction",
        ),
        (
            format!("solve box.iv {results} --probes done.csv --probes-out a.csv"),
            "done.csv: the column irradiance_g is there already",
        ),
        ("render bad.wrad --out a.png".to_owned(), "bad.wrad: not a saved solution"),
        ("render none.wrad --out a.png".to_owned(), "none.wrad: cannot read"),
        ("info bad.iv".to_owned(), "bad.iv:3:16: expected"),
    ];
    for (arguments, message) in cases {
        let (code, out, err) = place.run(&arguments);
        assert_eq!(code, 2, "{arguments}: {err}");
        assert!(err.starts_with("wrad: ") && err.contains(message) && out.is_empty(), "{arguments}: {err}");
    }
    assert_eq!(place.files(), before);
}

#[test]
fn info_describes_what_cannot_be_solved_too() {
    let place = Place::new();
    place.put("empty.iv", "#Inventor V2.1 ascii\nSeparator { Text3 { string \"hello\" } }\n");
    place.put("dark.iv", "#Inventor V2.1 ascii\nCube { }\n");
    let (code, out, err) = place.run("info empty.iv");
    assert_eq!((code, err.as_str()), (0, ""));
    assert!(out.contains("Text3") && out.contains("nothing to solve"), "{out}");
    assert!(place.run("info dark.iv").1.contains("nothing emits light"));
    let (code, _, err) = place.run("solve dark.iv");
    assert_eq!(code, 0);
    assert!(err.contains("warning: nothing in the scene emits light"), "{err}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_result_that_cannot_be_written_ends_with_1_and_costs_no_other() {
    let place = Place::new();
    std::os::unix::fs::symlink("/dev/full", place.at("full.ply")).unwrap();
    let (code, out, err) = place.run("solve box.iv --error 0.3 --out full.ply --out a.wrad --report a.json");
    assert_eq!(code, 1);
    assert!(err.contains("full.ply: cannot write") && err.contains("free some space"), "{err}");
    assert!(!out.is_empty() && place.at("a.wrad").is_file() && place.at("a.json").is_file());
}

#[cfg(unix)]
#[test]
fn a_first_interrupt_writes_what_is_done_and_marks_it() {
    let place = Place::new();
    std::fs::copy(CORNELL, place.at("cornell.iv")).unwrap();
    let results = "--out a.wrad --report a.json";
    let mut command = place.command(&format!("solve cornell.iv --error 0.00001 --basis m3 {results}"));
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(Duration::from_millis(700));
    let asked = Instant::now();
    // `timeout` signals the program, then the group that it is in: one press may come twice.
    for _ in 0..2 {
        let signal = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
        assert!(signal.success());
        std::thread::sleep(Duration::from_millis(20));
    }
    let Output { status, stdout, stderr } = child.wait_with_output().unwrap();
    assert_eq!(status.code(), Some(130), "{}", String::from_utf8_lossy(&stderr));
    assert!(asked.elapsed() < Duration::from_secs(30), "stopping took {:?}", asked.elapsed());
    assert!(String::from_utf8_lossy(&stderr).contains("stopping and writing what is done"));
    assert!(String::from_utf8_lossy(&stdout).contains("the solution is incomplete"));
    let report = place.json("a.json");
    assert_eq!(report["result"]["incomplete"], true);
    assert!(report["result"]["error_estimate"]["unavailable"].as_str().is_some());
    let (code, _, err) = place.run("render a.wrad --out a.png --size 32x32");
    assert_eq!(code, 0);
    assert!(err.contains("the solution is incomplete"), "{err}");
    assert_eq!(place.files(), ["a.json", "a.png", "a.wrad", "box.iv", "cornell.iv"]);
}
