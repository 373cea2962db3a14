//! The command line as its users meet it: exit codes, messages, files whole or not at all.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

const CORNELL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box.iv");

/// A directory with a small scene in it: a box with a lamp below its ceiling.
struct Place {
    directory: TempDir,
}

impl Place {
    fn new() -> Place {
        let place = Place { directory: tempfile::tempdir().unwrap() };
        place.put("box.iv", &box_scene("0.7 0.5 0.3", true));
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    fn put(&self, name: &str, text: &str) {
        std::fs::write(self.at(name), text).unwrap();
    }

    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.at(name)).unwrap()
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.text(name)).unwrap()
    }

    fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wrad"));
        command.current_dir(self.directory.path()).args(arguments.split_whitespace()).stdin(Stdio::null());
        command
    }

    /// Runs in the directory: exit code, standard output, standard error.
    fn run(&self, arguments: &str) -> (i32, String, String) {
        let Output { status, stdout, stderr } = self.command(arguments).output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (status.code().unwrap(), text(stdout), text(stderr))
    }

    /// Files in the directory, hidden ones included.
    fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.directory.path()).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

/// A unit box seen from inside; with a lamp, its lower half is hidden from the ceiling by a shelf.
fn box_scene(reflectance: &str, furnished: bool) -> String {
    let points = "0 0 0, 1 0 0, 1 1 0, 0 1 0, 0 0 1, 1 0 1, 1 1 1, 0 1 1, \
                  0.3 0.3 0.5, 0.7 0.3 0.5, 0.7 0.7 0.5, 0.3 0.7 0.5";
    let walls = "0 1 2 3 -1 4 7 6 5 -1 0 4 5 1 -1 2 6 7 3 -1 0 3 7 4 -1 1 5 6 2 -1";
    let shelf = if furnished { "8 9 10 11 -1 8 11 10 9 -1" } else { "" };
    format!(
        "#Inventor V2.1 ascii\nSeparator {{\n\
         ShapeHints {{ vertexOrdering COUNTERCLOCKWISE shapeType SOLID }}\n\
         Coordinate3 {{ point [ {points} ] }}\n\
         Material {{ diffuseColor {reflectance} }}\n\
         IndexedFaceSet {{ coordIndex [ {walls} {shelf} ] }}\n\
         Translation {{ translation 0 0 -0.001 }}\n\
         Material {{ diffuseColor 0 0 0 emissiveColor 10 10 10 }}\n\
         Coordinate3 {{ point [ 0.4 0.4 1, 0.4 0.6 1, 0.6 0.6 1, 0.6 0.4 1 ] }}\n\
         IndexedFaceSet {{ coordIndex [ 0 1 2 3 -1 ] }}\n\
         }}\n"
    )
}

const PROBES: &str =
    "name,x,y,z,nx,ny,nz\nfloor,0.1,0.5,0,0,0,1\nwall,0,0.5,0.7,3,0,0\nfree,0.5,0.5,0.25,0,0,1\n";

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
fn a_run_writes_its_results_and_the_report_says_what_happened() {
    let place = Place::new();
    place.put("p.csv", PROBES);
    let results = "--out a.glb --out a.ply --out a.vtu --out a.wrad --report a.json";
    let (code, out, err) = place
        .run(&format!("solve box.iv --error 0.1 --basis m2 --probes p.csv --probes-out q.csv {results}"));
    assert_eq!((code, err.as_str()), (0, ""));
    assert!(out.contains("box: 9 surfaces, 1 lights, bands r g b"), "{out}");
    assert_eq!(
        place.files(),
        ["a.glb", "a.json", "a.ply", "a.vtu", "a.wrad", "box.iv", "p.csv", "q.csv"],
        "no temporary file is left"
    );
    let report = place.json("a.json");
    let options = &report["options"];
    assert_eq!((&options["basis"], &options["error"]), (&Value::from("m2"), &Value::from(0.1)));
    assert_eq!((&options["visibility"], &options["links"]), (&Value::from("bvh"), &Value::from("recompute")));
    assert_eq!(report["result"]["incomplete"], false);
    assert!(report["result"]["error_estimate"].as_f64().unwrap() <= 0.1, "{}", report["result"]);
    assert!(report["result"]["energy_balance"].as_f64().unwrap().abs() < 0.1, "{}", report["result"]);
    let work = &report["work"];
    assert!(work["visibility_rays"].as_u64().unwrap() > 0 && work["pairs_resolved"].as_u64().unwrap() > 0);
    let behind = &work["saved"]["behind"];
    assert_eq!((&behind["spared"], &behind["bound"]), (&work["pairs_skipped"]["behind"], &"about".into()));
    assert!(behind["seconds_estimated"].as_f64().unwrap() > 0.0 && behind["how"].is_string(), "{behind}");
    assert!(work["saved"]["short_lists"]["seconds_estimated"]["unavailable"].is_string(), "{work}");
    assert!(out.contains(" per interaction; ") && out.contains("behind ") && out.contains("(estimates)"));
    assert_eq!(options["schedule"], "stealing");
    assert_eq!(report["workers"].as_array().unwrap().len() as u64, options["threads"].as_u64().unwrap());
    let times = &report["time_s"];
    let sum: f64 = ["load", "build", "direct", "interreflection", "output"]
        .iter()
        .map(|phase| times[phase].as_f64().unwrap())
        .sum();
    let total = times["total"].as_f64().unwrap();
    assert!(sum <= total && sum > 0.5 * total, "{times}");
    let probes = place.text("q.csv");
    let header =
        "name,x,y,z,nx,ny,nz,irradiance_r,irradiance_g,irradiance_b,radiosity_r,radiosity_g,radiosity_b";
    let lines: Vec<&str> = probes.lines().collect();
    assert_eq!((lines[0], lines.len()), (header, 4));
    let number = |line: &str, column: usize| line.split(',').nth(column).unwrap().parse::<f64>().unwrap();
    for line in &lines[1..3] {
        // B = ρE on surfaces that do not emit.
        assert!((number(line, 10) - 0.7 * number(line, 7)).abs() < 1e-9 * number(line, 7), "{line}");
    }
    assert!(lines[3].starts_with("free,") && lines[3].ends_with(",,,") && number(lines[3], 8) > 0.0);
}

#[test]
fn equal_runs_give_equal_bytes() {
    let place = Place::new();
    place.put("p.csv", PROBES);
    for run in ["1", "2"] {
        let results = format!("--probes-out {run}.csv --out {run}.wrad --quiet");
        let (code, out, err) = place.run(&format!("solve box.iv --error 0.2 --probes p.csv {results}"));
        assert_eq!((code, out.as_str(), err.as_str()), (0, "", ""), "--quiet is silent");
    }
    assert_eq!(place.text("1.csv"), place.text("2.csv"));
    let bytes = |name| std::fs::read(place.at(name)).unwrap();
    assert!(bytes("1.wrad") == bytes("2.wrad"));
}

#[test]
fn schedules_differ_in_who_works_only_and_the_report_says_who_did() {
    let place = Place::new();
    let cases = [
        ("sequential", "", 1),
        ("stealing", "--threads 3 --pin none", 3),
        ("stealing", "--threads 1", 1),
        ("outer-loop+lure", "--threads 3 --pin none", 3),
    ];
    for (schedule, workers, count) in cases {
        let results = format!("--out {schedule}{count}.wrad --report a.json --quiet");
        let (code, _, err) =
            place.run(&format!("solve box.iv --error 0.05 --schedule {schedule} {workers} {results}"));
        assert_eq!(code, 0, "{err}");
        let report = place.json("a.json");
        assert_eq!(
            (&report["options"]["schedule"], &report["options"]["threads"]),
            (&schedule.into(), &count.into())
        );
        let seconds = |worker: &Value, of: &str| worker[of].as_f64().unwrap();
        let time = seconds(&report["time_s"], "direct") + seconds(&report["time_s"], "interreflection");
        let members = report["workers"].as_array().unwrap();
        assert_eq!(members.len(), count);
        for worker in members {
            assert_eq!(worker["cpu"].is_u64(), workers == "--threads 1", "{worker}");
            let spent: f64 = ["busy_s", "idle_s", "steal_s", "barrier_s", "lock_s"]
                .iter()
                .map(|of| seconds(worker, of))
                .sum();
            assert!((spent - time).abs() < 0.1 * time, "{worker} in {time} s");
            assert!(worker["lock_waits"].is_u64() && worker["lures"].is_u64(), "{worker}");
        }
        let work = |of: &str| report["work"][of].as_f64().unwrap();
        let (receiver, chain) = (work("longest_receivers"), work("longest_chains"));
        assert!((0.1..1.0).contains(&receiver), "{receiver}: one of nine receivers");
        assert!(0.0 < chain && chain < 0.5 * receiver, "{chain}: receivers are divided");
    }
    let bytes = |name| std::fs::read(place.at(name)).unwrap();
    assert!(bytes("sequential1.wrad") == bytes("stealing3.wrad"));
    assert!(bytes("sequential1.wrad") == bytes("stealing1.wrad"));
}

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

#[test]
fn the_partition_answers_as_the_hierarchy_does() {
    let place = Place::new();
    place.put("box.iv", &box_scene("0.7 0.5 0.3", true));
    place.put("p.csv", PROBES);
    for structure in ["bvh", "bsp"] {
        let command = format!(
            "solve box.iv --error 0.1 --visibility {structure} --probes p.csv --probes-out {structure}.csv --report {structure}.json"
        );
        assert_eq!(place.run(&command).0, 0);
        let report = place.json(&format!("{structure}.json"));
        assert_eq!(report["options"]["visibility"], structure);
        assert!(report["memory"]["visibility_depth"].is_u64(), "{}", report["memory"]);
    }
    let readings = |name: &str| -> Vec<f64> {
        let text = place.text(name);
        let numbers = |line: &str| line.split(',').filter_map(|x| x.parse().ok()).collect::<Vec<f64>>();
        text.lines().skip(1).flat_map(numbers).collect()
    };
    for (a, b) in readings("bvh.csv").iter().zip(readings("bsp.csv")) {
        assert!(
            (a - b).abs() <= 1e-9 * a.abs(),
            "{a} and {b}: candidates are summed in another order, no more"
        );
    }
}

#[test]
fn grey_and_convex_scenes_cost_less_and_say_so() {
    let place = Place::new();
    place.put("grey.iv", &box_scene("0.5 0.5 0.5", false).replace("0 0 -0.001", "0 0 0"));
    place.put("p.csv", PROBES);
    let (code, out, _) =
        place.run("solve grey.iv --error 0.1 --probes p.csv --probes-out q.csv --report a.json");
    assert_eq!(code, 0);
    assert!(out.contains("bands 2 bands, at most ") && out.contains("nothing between "), "{out}");
    let report = place.json("a.json");
    assert_eq!(
        (&report["work"]["bands_computed"], &report["options"]["visibility"]),
        (&1.into(), &"none".into())
    );
    assert_eq!(report["work"]["visibility_rays"], 0);
    for line in place.text("q.csv").lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        assert!(fields[7] == fields[8] && fields[8] == fields[9] && fields[7] != "0", "{line}");
    }
    let (code, info, _) = place.run("info grey.iv");
    assert_eq!(code, 0);
    for part in ["the scene is grey, 2 skipped", "nothing can stand in between", "1 of 7 surfaces is black"] {
        assert!(info.contains(part), "{part}: {info}");
    }
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
}

#[test]
fn gathering_reports_its_iterations_and_links() {
    let place = Place::new();
    let solve = |more: &str| {
        let arguments =
            format!("solve box.iv --error 0.05 --pin none --method gather --report r.json {more}");
        let (code, out, err) = place.run(&arguments);
        assert_eq!(code, 0, "{arguments}: {err}");
        (place.json("r.json"), out, err)
    };
    let (report, out, err) = solve("");
    let number = |report: &Value, pointer: &str| report.pointer(pointer).and_then(Value::as_u64).unwrap();
    let links = |report: &Value| {
        ["/work/links_stored", "/work/links_reused", "/memory/bytes_by_kind/links"]
            .map(|at| number(report, at))
    };
    assert_eq!(
        (&report["options"]["method"], &report["options"]["links"]),
        (&"gather".into(), &"store".into())
    );
    assert_eq!(report["options"]["link_memory"], 512 << 20);
    assert!(number(&report, "/work/iterations") > 0 && links(&report).iter().all(|n| *n > 0));
    assert!(out.contains("iterations in the last") && out.contains("links stored") && err.is_empty());
    let (report, ..) = solve("--links recompute");
    assert_eq!((&report["options"]["links"], links(&report)), (&"recompute".into(), [0; 3]));
    let (report, _, err) = solve("--links store --link-memory 20K");
    assert!(links(&report)[2] <= 20 << 10 && err.contains("Allow more with --link-memory"), "{err}");
    let (_, _, err) = solve("--link-memory 20K");
    assert!(err.is_empty(), "auto says nothing: {err}");
}

#[test]
fn the_solve_is_counted_and_what_is_not_says_why() {
    let place = Place::new();
    let counters = |options: &str| {
        let (code, out, err) = place.run(&format!("solve box.iv --error 0.3 --report c.json {options}"));
        assert_eq!((code, err.as_str()), (0, ""), "{options}");
        (place.json("c.json")["counters"].clone(), out)
    };
    for (options, workers) in
        [("--threads 1", 1), ("--threads 2 --pin none", 2), ("--schedule sequential", 1)]
    {
        let (counters, out) = counters(options);
        assert_eq!(counters["workers"].as_array().unwrap().len(), workers, "{options}");
        assert_eq!(counters["leader"].is_null(), options.contains("sequential"));
        assert!(counters["events"]["task_clock_ns"].as_u64().unwrap() > 10_000, "{options}: {counters}");
        assert!(counters["events"]["page_faults"].as_u64().unwrap() > 0, "{options}: {counters}");
        for name in ["l1_hit_rate", "l2_hit_rate", "memory_overhead_stalls", "dram_local_share"] {
            for counted in std::iter::once(&counters).chain(counters["workers"].as_array().unwrap()) {
                let metric = &counted["metrics"][name];
                let why = metric["unavailable"].as_str().is_some_and(|why| why.len() > 10);
                assert!(
                    why || metric.as_f64().is_some_and(|share| share > 0.0),
                    "{options}: {name} {metric}"
                );
            }
        }
        assert!(out.contains(" page faults, ") && out.contains(" cpu migrations"), "{out}");
    }
    let (off, out) = counters("--counters off");
    assert_eq!(off["unavailable"], "switched off by --counters off");
    assert!(out.contains("counters  unavailable: switched off by --counters off"), "{out}");
    let (code, _, err) = place.run("solve box.iv --error 0.3 --counters hardware --report h.json");
    match code {
        0 => assert_eq!(place.json("h.json")["counters"]["source"], "hardware"),
        _ => {
            assert!(code == 1 && err.starts_with("wrad: --counters hardware: "), "{err}");
            assert!(
                err.contains("--counters auto") && !place.files().contains(&"h.json".to_owned()),
                "{err}"
            );
        }
    }
}
