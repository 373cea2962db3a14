//! Schedules against the sequential one: the same solution bit by bit, whoever worked, on however many workers and nodes, or for those that
//! lock receivers, one as good; what fails, and who is told.

use std::path::Path;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::thread::{self, ThreadId};

use ccnuma::arena::Memory;
use ccnuma::{Machine, Plan, Policy, Team};
use glam::DVec3;
use wavelet_radiosity::math::Basis;
use wavelet_radiosity::scene::{self, Scene, Surface};
use wavelet_radiosity::schedule::{
    Batches, Observer, Options, Outcome, Part, Schedule, Silent, Stage, Walks, solve, solve_by,
    solve_recorded,
};
use wavelet_radiosity::transport::Oracle;
use wavelet_radiosity::visibility::{Bvh, Occluder, OpaqueFaces, Shaft};

use distance::distance;

#[path = "support/distance.rs"]
mod distance;

struct Room {
    scene: Scene,
    surfaces: Vec<Surface>,
    bvh: Bvh,
    options: Options,
}

impl Room {
    fn new(name: &str, basis: Basis, error: f64) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}.iv"));
        let scene = scene::read::read_file(&path).unwrap();
        let surfaces = scene::surfaces(&scene);
        let bvh = Bvh::new(OpaqueFaces::new(&scene));
        Self {
            scene,
            surfaces,
            bvh,
            options: Options { error, basis, oracle: Oracle::Energy, direct_only: false },
        }
    }

    fn solve(&self, team: Option<&mut Team>, batches: Batches) -> Outcome {
        self.solve_in(Memory::Node, team, batches)
    }

    fn solve_in(&self, memory: Memory, team: Option<&mut Team>, batches: Batches) -> Outcome {
        let schedule = Schedule { team, batches, memory, ..Schedule::default() };
        solve_by(schedule, &self.scene, &self.surfaces, &self.bvh, &self.options, &mut Silent).unwrap()
    }
}

/// A team on a machine of two nodes, unpinned: there may be more workers than this machine has CPUs.
fn team(workers: usize) -> Team {
    let machine = Machine::synthetic("numa:2 core:4 pu:1").unwrap();
    Team::new(&Plan::new(machine.into(), Policy::None, Some(workers)).unwrap()).unwrap()
}

/// All that makes up a solution, to the last bit.
fn bits(outcome: &Outcome) -> Vec<u64> {
    let mut bits: Vec<u64> =
        vec![outcome.solution.error_estimate.to_bits(), outcome.unshot_fraction.to_bits()];
    for field in &outcome.solution.fields {
        bits.push(field.nodes.len() as u64);
        bits.extend(field.coefficients.iter().map(|c| c.to_bits()));
    }
    bits
}

fn assert_same(found: &Outcome, expected: &Outcome, what: &str) {
    assert_eq!(found.work, expected.work, "{what}: other work was done");
    assert_eq!(found.elements, expected.elements, "{what}");
    assert_eq!(found.statistics.longest, expected.statistics.longest, "{what}");
    assert!(bits(found) == bits(expected), "{what}: the solutions differ");
}

fn every_schedule_gives_the_same_bits(room: &Room) {
    let fitted = room.solve(None, Batches::Fitted);
    let single = room.solve(None, Batches::Single);
    assert!(fitted.elements > 2 * room.surfaces.len() as u64 && fitted.passes > 1);
    for workers in [1, 2, 3, 5, 8, 16] {
        let mut team = team(workers);
        let what = |name| format!("{name} on {workers} workers");
        assert_same(&room.solve(Some(&mut team), Batches::Fitted), &fitted, &what("stealing"));
        assert_same(&room.solve(Some(&mut team), Batches::Single), &single, &what("inner-loop"));
    }
}

#[test]
fn the_cornell_box_is_the_same_on_any_number_of_workers() {
    every_schedule_gives_the_same_bits(&Room::new("cornell-box", Basis::Auto, 0.05));
}

#[test]
fn the_furnished_room_is_the_same_on_any_number_of_workers() {
    let room = Room::new("furnished-room", Basis::M2, 0.08);
    every_schedule_gives_the_same_bits(&room);
    let (fitted, single) = (room.solve(None, Batches::Fitted), room.solve(None, Batches::Single));
    assert!(fitted.statistics.batches < single.statistics.batches, "batches hold more than one shooter");
    assert!(bits(&fitted) != bits(&single), "and so the comparison can tell solutions apart");
}

#[test]
fn memory_policies_do_not_show_in_the_solution() {
    let room = Room::new("furnished-room", Basis::M2, 0.2);
    let expected = room.solve(None, Batches::Fitted);
    assert_same(&room.solve_in(Memory::FirstTouch, None, Batches::Fitted), &expected, "alone, first touch");
    for memory in [Memory::Node, Memory::Interleave, Memory::FirstTouch, Memory::Malloc] {
        for workers in [1, 2, 3] {
            let what = format!("{memory} with {workers} workers");
            let found = room.solve_in(memory, Some(&mut team(workers)), Batches::Fitted);
            assert_same(&found, &expected, &what);
            let footprint = &found.footprint;
            assert_eq!(footprint.memory, memory);
            assert_eq!(footprint.element_bytes, expected.footprint.element_bytes, "{what}");
            assert_eq!(footprint.arena_bytes_per_node.is_ok(), memory == Memory::Node, "{what}");
            assert_eq!(footprint.pages_per_node.is_ok(), memory != Memory::Malloc, "{what}");
            let copies =
                footprint.bytes_by_kind["visibility"] / expected.footprint.bytes_by_kind["visibility"];
            let expected = match memory {
                Memory::Node if workers > 1 => 3,
                Memory::Interleave if workers > 1 => 2,
                _ => 1,
            };
            assert_eq!(copies, expected, "{what}");
            assert!(memory == Memory::Node || footprint.moved == 0, "{what}");
        }
    }
}

#[test]
fn a_record_tells_all_that_was_done_and_changes_nothing() {
    for (name, batches) in [("cornell-box", Batches::Fitted), ("cornell-box", Batches::Single)] {
        let room = Room::new(name, Basis::M2, 0.1);
        let plain = room.solve(None, batches);
        let (outcome, record) =
            solve_recorded(batches, &room.scene, &room.surfaces, &room.bvh, &room.options, &mut Silent);
        assert_same(&outcome, &plain, "recorded");
        let costs: u64 = record.batches().map(|batch| batch.cost()).sum();
        assert_eq!(costs, outcome.work.cost(), "every evaluation is in the record");
        for batch in record.batches() {
            let has_parts = batch.tasks.iter().filter(|task| task.parts.1 > 0);
            for task in has_parts {
                let runs = |part: &Part| if let Part::Run(cost) = part { u64::from(*cost) } else { 0 };
                let parts = batch.parts_of(task);
                assert_eq!(parts.iter().map(runs).sum::<u64>(), u64::from(task.cost));
                assert!(task.chain < task.cost);
            }
        }
        assert!(record.batches().any(|batch| !batch.parts.is_empty()));
        let most = record.batches().map(|batch| batch.tasks.iter().map(|task| task.chain).max().unwrap_or(0));
        assert!(most.map(u64::from).sum::<u64>() >= outcome.statistics.longest.chain * 9 / 10);
    }
}

/// The schedules that lock receivers.
const LOCKING: [Walks; 4] = [
    Walks { together: true, lure: false },
    Walks { together: true, lure: true },
    Walks { together: false, lure: false },
    Walks { together: false, lure: true },
];

/// Solves with receivers locked on several teams: one worker shoots in sequence, more of them find a solution within the error for hardly more
/// work.
fn every_locking_schedule_is_as_good(room: &Room) {
    let single = room.solve(None, Batches::Single);
    let error = room.options.error;
    for walks in LOCKING {
        for team in [None, Some(&mut team(1))] {
            let alone = room.solve(team, Batches::None(walks));
            assert_eq!(alone.work, single.work, "{walks:?}");
            assert!(bits(&alone) == bits(&single), "{walks:?} on one worker is shooting in sequence");
        }
        for workers in [3, 16] {
            let mut team = team(workers);
            let found = room.solve(Some(&mut team), Batches::None(walks));
            let distance = distance((&room.scene, &room.surfaces), &found, &single);
            let lures: u64 = team.times().iter().map(|times| times.deferrals).sum();
            let interactions = found.work.interactions as f64 / single.work.interactions as f64;
            let cost = found.work.cost() as f64 / single.work.cost() as f64;
            println!(
                "{walks:?} on {workers}: {:.3} % off, {} against {} shots in the last pass, {cost:.3} of the cost, \
                 {interactions:.3} of the interactions, {lures} lures",
                100.0 * distance,
                found.statistics.shots,
                single.statistics.shots,
            );
            assert!(distance < 0.5 * error, "{walks:?} on {workers}: {distance}");
            assert!(cost < 1.25 && interactions < 1.8, "{walks:?} on {workers}: {cost}, {interactions}");
            assert!(found.solution.error_estimate <= 1.01 * error, "{walks:?} on {workers}");
            assert!(!found.solution.incomplete && (lures == 0 || walks.lure));
        }
    }
}

#[test]
fn locking_schedules_solve_the_cornell_box_within_the_error() {
    every_locking_schedule_is_as_good(&Room::new("cornell-box", Basis::M3, 0.05));
}

#[test]
fn locking_schedules_solve_the_furnished_room_within_the_error() {
    every_locking_schedule_is_as_good(&Room::new("furnished-room", Basis::M2, 0.08));
}

#[test]
fn direct_light_adds_up_whoever_locks() {
    let mut room = Room::new("furnished-room", Basis::M2, 0.1);
    room.options.direct_only = true;
    let single = room.solve(None, Batches::Single);
    for walks in LOCKING {
        let found = room.solve(Some(&mut team(4)), Batches::None(walks));
        assert_eq!(found.statistics.shots, single.statistics.shots, "each light once, {walks:?}");
        assert!(
            distance((&room.scene, &room.surfaces), &found, &single) < 0.5 * room.options.error,
            "{walks:?}"
        );
    }
}

/// Answers as the hierarchy does, and disturbs every so many questions.
struct Disturbed<'a, F> {
    bvh: &'a Bvh,
    asked: AtomicU64,
    disturb: F,
}

impl<F: Fn(u64) + Sync> Occluder for Disturbed<'_, F> {
    fn faces(&self) -> &OpaqueFaces {
        self.bvh.faces()
    }

    fn blocker(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> Option<u32> {
        self.bvh.blocker(from, to, skip)
    }

    fn any_blocks(
        &self,
        from: DVec3,
        to: DVec3,
        skip: [u32; 2],
        is_wanted: &mut dyn FnMut(u32) -> bool,
    ) -> bool {
        self.bvh.any_blocks(from, to, skip, is_wanted)
    }

    fn candidates(&self, shaft: &Shaft, skip: [u32; 2], limit: usize, out: &mut Vec<u32>) -> bool {
        (self.disturb)(self.asked.fetch_add(1, Relaxed));
        self.bvh.candidates(shaft, skip, limit, out)
    }

    fn first_hit(&self, origin: DVec3, direction: DVec3) -> Option<(u32, f64)> {
        self.bvh.first_hit(origin, direction)
    }

    fn bytes(&self) -> usize {
        self.bvh.bytes()
    }
}

/// Sleeps or yields now and then.
fn delay(n: u64) {
    match n.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 60 {
        0 => thread::sleep(std::time::Duration::from_micros(n % 300)),
        1..4 => thread::yield_now(),
        _ => {}
    }
}

#[test]
fn delays_do_not_show_in_the_solution() {
    let room = Room::new("cornell-box", Basis::M2, 0.2);
    let expected = room.solve(None, Batches::Fitted);
    for seed in 0..4 {
        let late = Disturbed { bvh: &room.bvh, asked: AtomicU64::new(seed), disturb: delay };
        let mut team = team(3);
        let schedule = Schedule { team: Some(&mut team), ..Schedule::default() };
        let found =
            solve_by(schedule, &room.scene, &room.surfaces, &late, &room.options, &mut Silent).unwrap();
        assert_same(&found, &expected, "with delays");
    }
}

#[test]
fn locks_and_lures_bear_delays() {
    let room = Room::new("cornell-box", Basis::M2, 0.2);
    let single = room.solve(None, Batches::Single);
    for (seed, walks) in (0..3).flat_map(|seed| LOCKING.map(|walks| (seed, walks))) {
        let late = Disturbed { bvh: &room.bvh, asked: AtomicU64::new(seed), disturb: delay };
        // More workers than receivers: most find what they want locked.
        let mut team = team(12);
        let schedule =
            Schedule { team: Some(&mut team), batches: Batches::None(walks), ..Schedule::default() };
        let found =
            solve_by(schedule, &room.scene, &room.surfaces, &late, &room.options, &mut Silent).unwrap();
        let distance = distance((&room.scene, &room.surfaces), &found, &single);
        assert!(distance < 0.5 * room.options.error, "{walks:?}, seed {seed}: {distance}");
        let times = team.times();
        let (lures, waits) =
            times.iter().fold((0, 0), |(lures, waits), t| (lures + t.deferrals, waits + t.lock_waits));
        assert_eq!(lures > 0, walks.lure, "{walks:?}");
        assert!(waits > 0 || walks.lure, "{walks:?}");
    }
}

#[test]
fn a_panic_names_its_worker_and_the_team_goes_on() {
    panics_under(Batches::Fitted);
    LOCKING.into_iter().for_each(|walks| panics_under(Batches::None(walks)));
}

fn panics_under(batches: Batches) {
    let room = Room::new("cornell-box", Basis::M2, 0.2);
    let mut team = team(3);
    let failing = |n| assert!(n != 100, "shaft {n} fails on purpose");
    let occluder = Disturbed { bvh: &room.bvh, asked: AtomicU64::new(0), disturb: failing };
    let schedule = Schedule { team: Some(&mut team), batches, ..Schedule::default() };
    let panic = solve_by(schedule, &room.scene, &room.surfaces, &occluder, &room.options, &mut Silent)
        .err()
        .expect("the panic reaches the caller");
    assert!(panic.worker < 3 && panic.message.contains("shaft 100 fails on purpose"), "{panic}");
    assert!(panic.to_string().starts_with(&format!("worker {} panicked", panic.worker)), "{panic}");
    assert_same(
        &room.solve(Some(&mut team), Batches::Fitted),
        &room.solve(None, Batches::Fitted),
        "afterwards",
    );
}

/// Notes who calls and what is told; interrupts in a stage.
struct Notes {
    thread: ThreadId,
    passes: Vec<usize>,
    stages: Vec<Stage>,
    stop_in: Option<Stage>,
}

impl Notes {
    fn new(stop_in: Option<Stage>) -> Self {
        Self { thread: thread::current().id(), passes: Vec::new(), stages: Vec::new(), stop_in }
    }
}

impl Observer for Notes {
    fn pass(&mut self, number: usize) {
        assert_eq!(thread::current().id(), self.thread);
        self.passes.push(number);
    }

    fn progress(&mut self, stage: Stage, share: f64) {
        assert_eq!(thread::current().id(), self.thread);
        assert!(!share.is_nan(), "{stage:?}");
        if self.stages.last() != Some(&stage) {
            self.stages.push(stage);
        }
    }

    fn interrupted(&mut self) -> bool {
        self.passes.len() > 1 && self.stages.last() == self.stop_in.as_ref()
    }
}

#[test]
fn the_observer_is_told_on_its_own_thread_and_may_stop_the_workers() {
    let room = Room::new("cornell-box", Basis::M2, 0.02);
    let all = [Batches::Fitted].into_iter().chain(LOCKING.map(Batches::None));
    let stages = [Stage::Direct, Stage::Interreflection];
    for (batches, stop_in) in all.flat_map(|batches| stages.map(|stage| (batches, stage))) {
        let mut team = team(2);
        let mut notes = Notes::new(Some(stop_in));
        let schedule = Schedule { team: Some(&mut team), batches, ..Schedule::default() };
        let outcome =
            solve_by(schedule, &room.scene, &room.surfaces, &room.bvh, &room.options, &mut notes).unwrap();
        assert!(outcome.solution.incomplete, "stopped in {stop_in:?}");
        assert_eq!(notes.passes, [0, 1]);
    }
    let mut notes = Notes::new(None);
    let coarse = Options { error: 0.2, ..room.options };
    let outcome = solve(&room.scene, &room.surfaces, &room.bvh, &coarse, &mut notes);
    assert_eq!(notes.passes, (0..outcome.passes).collect::<Vec<_>>());
    assert_eq!(notes.stages, [Stage::Direct, Stage::Interreflection].repeat(outcome.passes));
    assert!(!outcome.solution.incomplete);
}
