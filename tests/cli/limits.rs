//! Runs within a limit on memory: they end with a message and what is done, not by the system's hand.

use std::process::{Command, Output};

use super::place::{CORNELL, Place};

/// What fills memory by some 20 MB a second for longer than anyone waits: elements by the million, whatever their light.
const RUN: &str = "solve cornell.iv --oracle geometry --basis haar --error 0.000001 --direct-only --schedule sequential \
                   --memory malloc --out a.wrad --report a.json";

/// Somewhat more than half of it is mapped when a run begins, and what is left is filled to a margin: far from either end.
const LIMIT_KIB: u64 = 350_000;

/// The program can be loaded, but there is no room for the stacks of a run.
const TOO_LITTLE_KIB: u64 = 100_000;

/// Runs within so many KiB of address space: exit code and standard error; `None` where that cannot be limited.
fn within(place: &Place, kib: u64, arguments: &str) -> Option<(Option<i32>, String)> {
    let limit = |then: &str| format!("ulimit -v {kib} && {then}");
    if !Command::new("sh").args(["-c", &limit("true")]).status().is_ok_and(|status| status.success()) {
        println!("skipped: sh knows no ulimit -v here");
        return None;
    }
    let inner = place.command(arguments);
    let mut command = Command::new("sh");
    command.args(["-c", &limit("exec \"$0\" \"$@\"")]).arg(inner.get_program()).args(inner.get_args());
    let Output { status, stderr, .. } = command.current_dir(place.at("")).output().unwrap();
    Some((status.code(), String::from_utf8_lossy(&stderr).into_owned()))
}

#[test]
fn a_run_that_fills_its_memory_writes_what_is_done_and_says_so() {
    let place = Place::new();
    std::fs::copy(CORNELL, place.at("cornell.iv")).unwrap();
    let Some((code, err)) = within(&place, LIMIT_KIB, RUN) else { return };
    assert_eq!(code, Some(1), "{err}");
    assert!(err.contains("stopped because memory runs out") && err.contains("ulimit -v"), "{err}");
    assert!(!err.contains("panicked"), "{err}");
    assert_eq!(place.json("a.json")["result"]["incomplete"], true);
    let (code, _, err) = place.run("render a.wrad --out a.png --size 32x32");
    assert!(code == 0 && err.contains("the solution is incomplete"), "{err}");
}

#[test]
fn a_scene_that_does_not_fit_says_so() {
    let place = Place::new();
    let (code, _, err) = place.run("generate soda-room --surfaces 20000 --out soda.iv");
    assert_eq!(code, 0, "{err}");
    // The lower end is short of stacks, the upper of room for the trees.
    for kib in [200_000, 300_000, 350_000, 400_000] {
        let run = "solve soda.iv --error 0.1 --threads 2 --out a.wrad --report a.json --quiet";
        let Some((code, err)) = within(&place, kib, run) else { return };
        println!("{kib} KiB: {err}");
        assert_eq!(code, Some(1), "{kib} KiB: {err}");
        assert!(err.starts_with("wrad: ") && err.lines().count() == 1, "{kib} KiB: {err}");
        assert!(["memory", "cannot start worker"].iter().any(|why| err.contains(why)), "{kib} KiB: {err}");
    }
}

#[test]
fn a_run_without_memory_to_begin_says_so() {
    let place = Place::new();
    let Some((code, err)) = within(&place, TOO_LITTLE_KIB, "solve box.iv --schedule sequential --out a.wrad")
    else {
        return;
    };
    assert_eq!(code, Some(1), "{err}");
    assert!(err.contains("too little memory to begin") && !err.contains("panicked"), "{err}");
    assert_eq!(place.files(), ["box.iv"]);
}
