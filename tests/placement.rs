//! Where the elements of a solution lie, on the machine at hand: on one node nothing can be elsewhere, so `scripts/virtual-numa` boots these
//! tests on virtual machines with several nodes.

use std::path::Path;
use std::sync::LazyLock;

use ccnuma::arena::Memory;
use ccnuma::{Machine, Plan, Policy, Team};
use wavelet_radiosity::math::Basis;
use wavelet_radiosity::scene;
use wavelet_radiosity::schedule::{Options, Outcome, Schedule, Silent, solve_by};
use wavelet_radiosity::transport::Oracle;
use wavelet_radiosity::visibility::{Bvh, OpaqueFaces};

fn machine() -> Machine {
    Machine::this_machine().expect("the machine is readable")
}

/// Solves the Cornell box to `error` with a worker on each core, and shows where its elements lie.
fn solve(memory: Memory, error: f64) -> Outcome {
    let text = include_str!("../scenes/cornell-box.iv");
    let scene = scene::read::inventor::parse(text, Path::new("cornell-box.iv")).expect("a scene");
    let surfaces = scene::surfaces(&scene);
    let bvh = Bvh::new(OpaqueFaces::new(&scene));
    let options = Options { error, basis: Basis::M3, oracle: Oracle::Energy, direct_only: false };
    let plan = Plan::new(machine().into(), Policy::Compact, None).expect("a plan");
    let mut team = Team::new(&plan).expect("a team");
    let schedule = Schedule { team: Some(&mut team), memory, ..Schedule::default() };
    let outcome =
        solve_by(schedule, &scene, &surfaces, &bvh, &options, &mut Silent).expect("no worker fails");
    println!("{} elements: {:?}", outcome.elements, outcome.footprint);
    outcome
}

/// What both need that look at homes and at bits: solving takes its time on emulated processors.
static AT_HOME: LazyLock<Outcome> = LazyLock::new(|| solve(Memory::Node, 0.3));

/// Whether this process may bind pages: containers often may not.
fn may_bind() -> bool {
    let may = !ccnuma::warnings::all().iter().any(|warning| warning.contains("cannot be placed"));
    if !may {
        println!("memory cannot be placed here: nothing to see");
    }
    may
}

#[test]
fn elements_are_at_home() {
    let footprint = AT_HOME.footprint.clone();
    let nodes = machine().nodes;
    if may_bind() {
        let at_home = footprint.pages_at_home.expect("counted");
        assert!(at_home >= 0.99, "{at_home} of the pages with elements are at home");
        let pages = footprint.pages_per_node.expect("counted");
        let staffed = nodes.iter().filter(|node| node.has_cpus).map(|node| node.os);
        assert!(pages.keys().copied().eq(staffed), "pages on every node with CPUs: {pages:?}");
        let arenas = footprint.arena_bytes_per_node.expect("counted");
        assert!(arenas.keys().eq(pages.keys()), "{arenas:?}");
    }
}

#[test]
fn interleaved_elements_are_everywhere() {
    // All workers begin the round on the same node: each needs more pages than there are nodes.
    let footprint = solve(Memory::Interleave, 0.03).footprint;
    let nodes = machine().nodes.iter().filter(|node| node.has_cpus).count();
    if may_bind() {
        let pages = footprint.pages_per_node.expect("counted");
        let total: u64 = pages.values().sum();
        assert_eq!(pages.len(), nodes, "{pages:?}");
        let most = pages.values().max().expect("a node");
        assert!(nodes == 1 || 3 * most <= 2 * total, "{pages:?}");
        let at_home = footprint.pages_at_home.expect("counted");
        assert!(nodes == 1 || at_home < 0.75, "{at_home} of the pages with elements are at home");
    }
}

#[test]
fn the_solution_is_the_same_wherever_it_lies() {
    let expected = &*AT_HOME;
    for memory in [Memory::FirstTouch, Memory::Malloc] {
        let found = solve(memory, 0.3);
        assert_eq!(found.footprint.element_bytes, expected.footprint.element_bytes);
        assert!(found.solution.fields == expected.solution.fields, "{memory}");
        assert!(found.footprint.pages_at_home.is_ok(), "{memory}");
    }
}
