//! Replays of records made by hand, whose answers are known.

use ccnuma::Machine;

use super::*;
use crate::schedule::Part;
use crate::schedule::record::{Small, Task};

const ALL: [Model; 6] = [
    Model::Stealing,
    Model::WholeReceivers,
    Model::SingleQueue { lure: false },
    Model::SingleQueue { lure: true },
    Model::OuterLoop { lure: false },
    Model::OuterLoop { lure: true },
];

fn site(machine: &str, workers: usize) -> Site {
    Site::new(&Machine::synthetic(machine).unwrap(), workers).unwrap()
}

/// A batch with a task of so many seconds for each receiver; costs in milliseconds.
fn batch(seconds: &[f64]) -> Step {
    let task = |(receiver, seconds): (usize, &f64)| {
        let cost = (seconds * 1e3) as u32;
        Task { receiver: receiver as u32, cost, chain: cost, seconds: *seconds as f32, parts: (0, 0) }
    };
    Step::Batch(Batch { tasks: seconds.iter().enumerate().map(task).collect(), ..Batch::default() })
}

fn record(receivers: usize, steps: Vec<Step>) -> Record {
    let mut all = vec![Step::Expect(vec![1; receivers]), Step::Settle];
    all.extend(steps);
    let along_curve = (0..receivers as u32).collect();
    Record { along_curve, steps: all }
}

/// To choose a shooter and take its light.
fn choice() -> Step {
    Step::Map(Map { items: 1, seconds: 0.0, longest_s: 0.0 })
}

fn assert_near(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() < 2e-3 * expected, "{what}: {found} is not {expected}");
}

#[test]
fn equal_tasks_go_as_fast_as_there_are_workers() {
    let record = record(64, vec![batch(&[1.0; 64])]);
    for workers in [1, 2, 8, 64] {
        let site = site("numa:1 core:64 pu:1", workers);
        for model in ALL {
            let expected = match model {
                // A single emitter is one worker's.
                Model::OuterLoop { .. } => 64.0,
                _ => 64.0 / workers as f64,
            };
            let found = replay(&record, &site, model);
            assert_near(found.seconds, expected, &format!("{model:?} on {workers}"));
            assert_near(found.busy_s, 64.0, "busy");
        }
    }
    let shots = self::record(64, (0..64).flat_map(|_| [choice(), batch(&[1.0; 64])]).collect());
    let found = replay(&shots, &site("numa:1 core:64 pu:1", 64), Model::OuterLoop { lure: true });
    assert_near(found.busy_s, 64.0 * 64.0, "busy");
    assert!(found.seconds < 1.05 * 64.0, "an emitter for each worker: {}", found.seconds);
}

#[test]
fn nothing_is_faster_than_the_longest_task_nor_the_serial_part() {
    let mut seconds = [0.5; 40];
    seconds[7] = 30.0;
    let record = record(40, vec![Step::Alone(3.0), batch(&seconds)]);
    for model in [Model::Stealing, Model::WholeReceivers] {
        let found = replay(&record, &site("numa:4 core:4 pu:1", 16), model);
        let first = if model == Model::Stealing { 0.0 } else { 0.5 };
        assert!(found.seconds >= 33.0 && found.seconds < 33.1 + first + 1.5, "{model:?}: {}", found.seconds);
        assert_near(found.barrier_s + found.remote_s, 16.0 * (found.seconds - 3.0) - found.busy_s, "waiting");
        assert_near(found.alone_s, 16.0 * 3.0, "alone");
    }
    let bound = bound(&record);
    assert_near(bound.work_s, 52.5, "work");
    assert_near(bound.least_s(16), 33.0, "span");
    assert_near(bound.least_s(1), 52.5, "work");
}

/// A task whose fork tree has 2^depth leaves; every element takes a second.
fn divided(depth: u32) -> (Task, Vec<Part>) {
    fn add(depth: u32, parts: &mut Vec<Part>) {
        parts.push(Part::Run(1000));
        if depth > 0 {
            let at = parts.len();
            parts.push(Part::Run(0));
            add(depth - 1, parts);
            let middle = parts.len();
            add(depth - 1, parts);
            let (first, second) = (middle - at - 1, parts.len() - middle);
            parts[at] = Part::Fork { first: first as u32, second: second as u32 };
        }
    }
    let mut parts = Vec::new();
    add(depth, &mut parts);
    let cost = 1000 * ((2 << depth) - 1);
    let (chain, count) = (1000 * (depth + 1), (0, parts.len() as u32));
    (Task { receiver: 0, cost, chain, seconds: cost as f32 / 1e3, parts: count }, parts)
}

#[test]
fn a_receiver_is_shared_out_down_to_its_chain() {
    let (task, parts) = divided(8);
    let batch = Batch { tasks: vec![task], parts, small: Small::default() };
    let record = record(1, vec![Step::Batch(batch)]);
    assert_near(bound(&record).chains_s, 9.0, "chain");
    for workers in [1, 3, 16, 64] {
        let found = replay(&record, &site("numa:4 core:16 pu:1", workers), Model::Stealing);
        // Data of the home node costs those of others more; and who goes down a tree offers what it finds only while nothing else is on offer.
        let least = (511.0 / workers as f64).max(9.0);
        assert!(found.seconds >= least && found.seconds < 1.3 * least + 9.0, "{workers}: {}", found.seconds);
        assert_eq!(found.steals_near + found.steals_far > 0, workers > 1);
    }
    let whole = replay(&record, &site("numa:4 core:16 pu:1", 64), Model::WholeReceivers);
    assert!((511.0..522.0).contains(&whole.seconds), "a receiver that stays whole: {}", whole.seconds);
}

#[test]
fn locked_receivers_are_waited_for_and_lures_are_not() {
    // Two emitters that light the same one receiver.
    let record = record(1, vec![batch(&[1.0]), batch(&[1.0])]);
    let site = site("numa:1 core:2 pu:1", 2);
    for model in [Model::SingleQueue { lure: false }, Model::OuterLoop { lure: false }] {
        let found = replay(&record, &site, model);
        assert_near(found.seconds, 2.0, "one after the other");
        assert_near(found.lock_s, 1.0, "the second waits");
    }
    for model in [Model::SingleQueue { lure: true }, Model::OuterLoop { lure: true }] {
        let found = replay(&record, &site, model);
        assert!(found.seconds < 1.05 && found.lock_s == 0.0 && found.merge_s > 0.0, "{found:?}");
    }
    assert_near(replay(&record, &site, Model::WholeReceivers).seconds, 2.0, "a barrier for each emitter");
}

#[test]
fn the_central_queue_goes_on_with_the_next_emitter() {
    let shot = || [Step::Alone(0.25), choice(), batch(&[1.0, 1.0])];
    let record = record(2, shot().into_iter().chain(shot()).collect());
    let site = site("numa:1 core:4 pu:1", 4);
    let found = replay(&record, &site, Model::SingleQueue { lure: true });
    // The choices are one after the other, and the second emitter finds the receivers locked.
    assert!((1.5..1.53).contains(&found.seconds) && found.merge_s > 0.0, "{found:?}");
    assert_eq!(found.batches, 1);
    assert_near(replay(&record, &site, Model::WholeReceivers).seconds, 2.5, "emitter by emitter");
}

#[test]
fn tasks_start_at_home_and_are_stolen_across_nodes_only_when_it_is_idle() {
    let even = record(32, vec![batch(&[1.0; 32]), batch(&[1.0; 32])]);
    let found = replay(&even, &site("numa:4 core:2 pu:1", 8), Model::Stealing);
    assert_eq!((found.steals_far, found.remote_s), (0, 0.0), "every node has its share");
    // All the work is on the first node's stretch of the curve, and is expected elsewhere too.
    let mut seconds = [0.0; 32];
    seconds[..8].fill(1.0);
    let uneven = record(32, vec![batch(&seconds)]);
    let found = replay(&uneven, &site("numa:4 core:2 pu:1", 8), Model::Stealing);
    assert!(found.steals_far > 0 && found.remote_s > 0.0 && found.seconds < 2.5, "{found:?}");
}

#[test]
fn a_pass_gives_homes_by_the_work_of_the_last() {
    let mut seconds = [0.001; 32];
    seconds[..8].fill(1.0);
    let record = record(32, vec![batch(&seconds), Step::Settle, batch(&seconds)]);
    let site = site("numa:4 core:2 pu:1", 8);
    let first = replay(&self::record(32, vec![batch(&seconds)]), &site, Model::Stealing);
    let both = replay(&record, &site, Model::Stealing);
    assert_eq!(both.steals_far, first.steals_far, "the second time all are at home");
}

#[test]
fn loops_and_small_tasks_are_shared() {
    let small = Batch { small: Small { tasks: 1000, cost: 1000, seconds: 8.0 }, ..Batch::default() };
    let map = Map { items: 100, seconds: 4.0, longest_s: 0.1 };
    let record = record(4, vec![Step::Batch(small), Step::Map(map)]);
    for model in [Model::Stealing, Model::WholeReceivers, Model::SingleQueue { lure: false }] {
        let found = replay(&record, &site("numa:1 core:8 pu:1", 8), model);
        assert_near(found.seconds, 1.0 + 0.5, &format!("{model:?}"));
    }
}
