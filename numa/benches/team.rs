//! Barrier, fork-join and empty-task costs against rayon's and std's, interleaved in one run; medians.
//!
//! `cargo bench -p ccnuma --bench team`

use std::hint::black_box;
use std::time::Instant;

use ccnuma::{Home, Machine, Plan, Policy, Team, Worker};
use rayon::prelude::*;

const ROUNDS: usize = 15;

/// Seconds of one call.
fn time(call: impl FnOnce()) -> f64 {
    let started = Instant::now();
    call();
    started.elapsed().as_secs_f64()
}

fn median(mut samples: Vec<f64>) -> f64 {
    samples.sort_by(f64::total_cmp);
    samples[samples.len() / 2]
}

/// Alternates two candidates, each doing `count` operations per call, and prints nanoseconds per operation.
fn compare(name: &str, count: u32, mut ours: impl FnMut(), theirs_name: &str, mut theirs: impl FnMut()) {
    let (mut a, mut b) = (Vec::new(), Vec::new());
    for round in 0..=ROUNDS {
        let (ours, theirs) = (time(&mut ours), time(&mut theirs));
        // The first round warms up.
        if round > 0 {
            a.push(ours);
            b.push(theirs);
        }
    }
    let per = |samples| 1e9 * median(samples) / f64::from(count);
    let (ours, theirs) = (per(a), per(b));
    println!("{name:<44} {ours:>10.1} ns   {theirs_name} {theirs:>10.1} ns   ratio {:.2}", ours / theirs);
}

fn tree(worker: &Worker, depth: u32) -> u64 {
    if depth == 0 {
        return black_box(1);
    }
    let (a, b) = worker.join(|worker| tree(worker, depth - 1), |worker| tree(worker, depth - 1));
    a + b
}

fn rayon_tree(depth: u32) -> u64 {
    if depth == 0 {
        return black_box(1);
    }
    let (a, b) = rayon::join(|| rayon_tree(depth - 1), || rayon_tree(depth - 1));
    a + b
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let plan = Plan::new(Machine::this_machine()?.into(), Policy::Compact, None)?;
    let mut team = Team::new(&plan)?;
    let workers = team.len();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(workers).build()?;
    println!(
        "{workers} workers, {ROUNDS} interleaved rounds, medians per operation; ratio below 1: ours is faster"
    );
    bench(&mut team, &pool);
    Ok(())
}

fn bench(team: &mut Team, pool: &rayon::ThreadPool) {
    let workers = team.len();
    let std_barrier = std::sync::Barrier::new(workers);
    compare(
        "barrier",
        2000,
        || drop(team.run(|worker| (0..2000).for_each(|_| worker.barrier())).expect("runs")),
        "std  ",
        || {
            drop(pool.broadcast(|_| {
                (0..2000).for_each(|_| {
                    std_barrier.wait();
                })
            }))
        },
    );
    compare(
        "same function on all workers, from outside",
        200,
        || (0..200).for_each(|_| drop(team.run(|_| ()).expect("runs"))),
        "rayon",
        || (0..200).for_each(|_| drop(pool.broadcast(|_| ()))),
    );
    compare(
        "enter one task, from outside",
        200,
        || (0..200).for_each(|_| team.enter(|_| ()).expect("runs")),
        "rayon",
        || (0..200).for_each(|_| pool.install(|| ())),
    );
    compare(
        "fork-join tree of 2^18 empty leaves, per leaf",
        1 << 18,
        || assert_eq!(team.enter(|worker| tree(worker, 18)).expect("runs"), 1 << 18),
        "rayon",
        || assert_eq!(pool.install(|| rayon_tree(18)), 1 << 18),
    );
    items(team, pool);
}

fn items(team: &mut Team, pool: &rayon::ThreadPool) {
    let mut ours = vec![0u64; 1_000_000];
    let mut theirs = ours.clone();
    compare(
        "10^6 empty items, per item",
        1_000_000,
        || {
            let home = |_: &u64| Home { node: 0, weight: 1 };
            team.for_each_mut(&mut ours, home, |_, item| *item += 1).expect("runs");
        },
        "rayon",
        || pool.install(|| theirs.par_iter_mut().with_max_len(1).for_each(|item| *item += 1)),
    );
    let mut ours = vec![0u64; 64];
    let mut theirs = ours.clone();
    let spin = |item: &mut u64| (0..20_000u64).for_each(|step| *item = black_box(item.wrapping_add(step)));
    compare(
        "64 items of about 10 us, per item",
        64,
        || {
            let home = |_: &u64| Home { node: 0, weight: 1 };
            team.for_each_mut(&mut ours, home, |_, item| spin(item)).expect("runs");
        },
        "rayon",
        || pool.install(|| theirs.par_iter_mut().with_max_len(1).for_each(spin)),
    );
}
