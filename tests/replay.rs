//! The replay of a record against the team itself: workers that sleep for what tasks took need no CPU, so there can be many of them here, and
//! what is compared is the scheduling alone.

use std::cell::Cell;
use std::path::Path;
use std::time::{Duration, Instant};

use ccnuma::{Home, Machine, Plan, Policy, Team, Worker};
use wavelet_radiosity::math::Basis;
use wavelet_radiosity::scene;
use wavelet_radiosity::schedule::record::{Batch, Step, Task};
use wavelet_radiosity::schedule::{Batches, Options, Part, Record, Silent, solve_recorded};
use wavelet_radiosity::study::replay::{Model, Site, replay};
use wavelet_radiosity::transport::Oracle;
use wavelet_radiosity::visibility::{Bvh, OpaqueFaces};

/// The batches of a solution, in which every evaluation takes a second.
fn record(name: &str, error: f64) -> Record {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}.iv"));
    let scene = scene::read::read_file(&path).unwrap();
    let surfaces = scene::surfaces(&scene);
    let bvh = Bvh::new(OpaqueFaces::new(&scene));
    let options = Options { error, basis: Basis::M2, oracle: Oracle::Energy, direct_only: false };
    let (_, mut record) = solve_recorded(Batches::Fitted, &scene, &surfaces, &bvh, &options, &mut Silent);
    record.steps.retain(|step| matches!(step, Step::Batch(_) | Step::Expect(_)));
    for step in &mut record.steps {
        let Step::Batch(batch) = step else { continue };
        batch.small = Default::default();
        batch.tasks.iter_mut().for_each(|task| task.seconds = task.cost as f32);
    }
    record.steps.insert(1, Step::Settle);
    record
}

/// Sleeps; what one sleep is too long, the next one is shorter.
fn sleep(seconds: f64) {
    thread_local! { static LATE: Cell<f64> = const { Cell::new(0.0) } }
    let start = Instant::now();
    let wanted = seconds - LATE.get();
    if wanted > 0.0 {
        std::thread::sleep(Duration::from_secs_f64(wanted));
    }
    LATE.set(start.elapsed().as_secs_f64() - wanted);
}

/// Does the parts of a task as a receiver's tree is visited.
fn perform(worker: &Worker, mut parts: &[Part], scale: f64) {
    while let [part, rest @ ..] = parts {
        match *part {
            Part::Run(cost) => {
                sleep(f64::from(cost) * scale);
                parts = rest;
            }
            Part::Fork { first, second } => {
                let (first, rest) = rest.split_at(first as usize);
                let (second, after) = rest.split_at(second as usize);
                worker.join(|w| perform(w, first, scale), |w| perform(w, second, scale));
                parts = after;
            }
        }
    }
}

/// How often a machine may be too busy.
const ATTEMPTS: usize = 3;

/// Seconds in which a team sleeps through the batches, costliest first by the batch before, as `schedule::crew` does.
fn slept(record: &Record, workers: usize) -> f64 {
    let machine = Machine::synthetic("numa:1 core:64 pu:1").unwrap();
    let plan = Plan::new(machine.into(), Policy::None, Some(workers)).unwrap();
    let mut team = Team::new(&plan).unwrap();
    let Step::Expect(expected) = &record.steps[0] else { panic!("nothing was expected of the first batch") };
    let mut costs = expected.clone();
    let start = Instant::now();
    for batch in record.batches() {
        batch_slept(&mut team, batch, &costs);
        costs.fill(0);
        batch.tasks.iter().for_each(|task| costs[task.receiver as usize] = task.cost.into());
    }
    start.elapsed().as_secs_f64()
}

fn batch_slept(team: &mut Team, batch: &Batch, costs: &[u64]) {
    let mut tasks: Vec<_> = batch.tasks.iter().collect();
    tasks.sort_by_key(|task| std::cmp::Reverse(costs[task.receiver as usize]));
    let home = |task: &&_| {
        let task: &Task = task;
        Home { node: 0, weight: 1 + costs[task.receiver as usize] }
    };
    let each = |worker: &Worker, task: &mut &Task| {
        let scale = f64::from(task.seconds) / f64::from(task.cost);
        match batch.parts_of(task) {
            [] => sleep(task.seconds.into()),
            parts => perform(worker, parts, scale),
        }
    };
    team.for_each_mut(&mut tasks, home, each).unwrap();
}

#[test]
fn a_team_takes_as_long_as_its_replay() {
    for (name, error) in [("cornell-box", 0.1), ("furnished-room", 0.2)] {
        let mut record = record(name, error);
        for workers in [2, 8, 32] {
            record.scale(workers as f64 / record.seconds());
            let site = Site::new(&Machine::synthetic("numa:1 core:64 pu:1").unwrap(), workers).unwrap();
            let predicted = replay(&record, &site, Model::Stealing).seconds;
            // Neighbours on the machine delay those who wake up, which says nothing: the best of some attempts counts.
            let mut best = f64::INFINITY;
            for _ in 0..ATTEMPTS {
                best = best.min(slept(&record, workers));
                if best < 1.3 * predicted {
                    break;
                }
            }
            eprintln!("{name}, {workers} workers: predicted {predicted:.3} s, took {best:.3} s");
            assert!(best > 0.85 * predicted, "{name} on {workers}: {best} s, not {predicted} s");
            if best > 1.3 * predicted {
                eprintln!("{name} on {workers}: the machine is too busy to tell");
            }
        }
    }
}
