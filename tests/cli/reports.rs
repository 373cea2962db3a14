//! What runs write, and what their reports and summaries say of them.

use serde_json::Value;

use super::place::{PROBES, Place, box_scene};

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
    assert!(report["result"]["energy_balance"].as_f64().unwrap().abs() < 1e-4, "{}", report["result"]);
    assert!(report["result"]["transport_lost"].as_f64().unwrap().abs() < 0.1, "{}", report["result"]);
    let work = &report["work"];
    assert!(work["visibility_rays"].as_u64().unwrap() > 0 && work["pairs_resolved"].as_u64().unwrap() > 0);
    let behind = &work["saved"]["behind"];
    assert_eq!((&behind["spared"], &behind["bound"]), (&work["pairs_skipped"]["behind"], &"about".into()));
    assert!(behind["seconds_estimated"].as_f64().unwrap() > 0.0 && behind["how"].is_string(), "{behind}");
    let coarse = work["saved"]["coarse"]["error_estimate"].as_f64().unwrap();
    let all = report["result"]["error_estimate"].as_f64().unwrap();
    assert!(0.0 < coarse && coarse < all && behind["error_estimate"].is_null(), "{coarse} of {all}");
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
    for part in [
        "bands: 1 computed",
        "shine in proportion, 2 skipped",
        "nothing can stand in between",
        "1 of 7 surfaces is black",
        "no clusters: 1 emit and 6 reflect, and 16 must shoot at once",
    ] {
        assert!(info.contains(part), "{part}: {info}");
    }
    assert!(!info.contains("blockers"), "{info}");
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
