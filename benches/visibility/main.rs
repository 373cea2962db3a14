//! Occlusion queries per second by each structure, on the bundles that the solver casts and on pairs of points:
//! `cargo bench --bench visibility -- [SUBJECT=SURFACES]… [--segments N] [--repeat N] [--only STRUCTURE] [--kind KIND]
//! [--write DIRECTORY]`
//!
//! Structures take turns on the same segments, so that a busy machine slows all alike; the median of their rates is printed. Under
//! callgrind, `--repeat 1 --only NAME` counts instructions. `--write` leaves the segments for `scripts/peers/visibility`.

mod peers;
mod structures;
mod workload;

use std::time::Instant;

use structures::{Structure, structures};
use wavelet_radiosity::scene::procedural::Subject;
use wavelet_radiosity::visibility::{Bvh, Occluder, OpaqueFaces};
use workload::{Bundle, Dice, Kind, bundles, scene};

struct Plan {
    scenes: Vec<(Subject, usize)>,
    segments: usize,
    repeat: usize,
    only: Option<String>,
    kind: Option<String>,
    write: Option<std::path::PathBuf>,
}

fn main() {
    let plan = arguments();
    println!(
        "| scene | segments | blocked | structure | M/s | spread | bytes per face |\n|---|---|---|---|---|---|---|"
    );
    for (subject, surfaces) in &plan.scenes {
        let scene = scene(*subject, *surfaces);
        let finder = Bvh::new(OpaqueFaces::new(&scene));
        let structures = structures(&scene, plan.only.as_deref());
        for kind in Kind::ALL {
            if plan.kind.as_deref().is_some_and(|name| name != kind.name()) {
                continue;
            }
            let bundles = bundles(&finder, kind, plan.segments, &mut Dice::new(7));
            let name = format!("{} {}k", subject.name(), surfaces / 1000);
            if let Some(directory) = &plan.write {
                let path = directory.join(format!("{name} {}.segments", kind.name()));
                peers::write(&path, finder.faces(), &bundles).expect("the segments can be written");
            }
            measure(&name, kind, &structures, &bundles, plan.repeat, scene.faces.len());
        }
    }
}

fn arguments() -> Plan {
    let mut plan =
        Plan { scenes: Vec::new(), segments: 400_000, repeat: 5, only: None, kind: None, write: None };
    let mut given = std::env::args().skip(1);
    let usage =
        "SUBJECT=SURFACES… [--segments N] [--repeat N] [--only STRUCTURE] [--kind KIND] [--write DIRECTORY]";
    let number = |text: Option<String>| -> usize { text.and_then(|t| t.parse().ok()).expect(usage) };
    while let Some(argument) = given.next() {
        match argument.as_str() {
            "--segments" => plan.segments = number(given.next()),
            "--repeat" => plan.repeat = number(given.next()),
            "--only" => plan.only = given.next(),
            "--kind" => plan.kind = given.next(),
            "--write" => plan.write = given.next().map(Into::into),
            // Cargo says so to every benchmark.
            "--bench" => {}
            scene => {
                let (name, surfaces) = scene.split_once('=').expect(usage);
                let subject = Subject::ALL.into_iter().find(|s| s.name() == name).expect(usage);
                plan.scenes.push((subject, number(Some(surfaces.to_owned()))));
            }
        }
    }
    if plan.scenes.is_empty() {
        for surfaces in [20_000, 200_000] {
            plan.scenes
                .extend([Subject::Stanislas, Subject::Quito, Subject::SodaFloor].map(|s| (s, surfaces)));
        }
    }
    plan
}

/// Has the structures take turns on the bundles.
fn measure(
    scene: &str,
    kind: Kind,
    structures: &[Structure],
    bundles: &[Bundle],
    repeat: usize,
    faces: usize,
) {
    let segments: usize = bundles.iter().map(|b| b.from.len() * b.to.len()).sum();
    let mut seconds = vec![Vec::new(); structures.len()];
    let mut blocked = vec![0; structures.len()];
    for _ in 0..repeat {
        for (i, structure) in structures.iter().enumerate() {
            let start = Instant::now();
            blocked[i] = (structure.count_blocked)(bundles);
            seconds[i].push(start.elapsed().as_secs_f64());
        }
    }
    for (i, structure) in structures.iter().enumerate() {
        let ours = structure.name != "obvhs";
        assert!(
            !ours || blocked[i] == blocked[0],
            "{} disagrees with {}",
            structure.name,
            structures[0].name
        );
        let mut rates: Vec<f64> = seconds[i].iter().map(|s| segments as f64 / s / 1e6).collect();
        rates.sort_by(f64::total_cmp);
        println!(
            "| {scene} | {} | {:.0} % | {} | {:.2} | {:.2}–{:.2} | {} |",
            kind.name(),
            100.0 * blocked[i] as f64 / segments as f64,
            structure.name,
            rates[rates.len() / 2],
            rates[0],
            rates[rates.len() - 1],
            structure.bytes / faces
        );
    }
}
