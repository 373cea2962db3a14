//! Teams on this machine, with and without pins, and on simulated nodes; small enough for every run, with a stress
//! of a million tasks.

use std::collections::BTreeSet;
use std::sync::Condvar;
use std::sync::atomic::Ordering::SeqCst;

use super::*;
use crate::deferred::Deferred;
use crate::error::Error;
use crate::pinning::Policy;
use crate::topology::Machine;

fn here(policy: Policy, workers: Option<usize>) -> Team {
    Team::new(&Plan::new(Arc::new(Machine::this_machine().unwrap()), policy, workers).unwrap()).unwrap()
}

/// More workers than CPUs, on nodes that are not here.
fn simulated(machine: &str, workers: usize) -> Team {
    let machine = Arc::new(Machine::synthetic(machine).unwrap());
    Team::new(&Plan::new(machine, Policy::None, Some(workers)).unwrap()).unwrap()
}

fn teams() -> Vec<Team> {
    vec![here(Policy::Compact, None), here(Policy::Scatter, Some(1)), simulated("numa:2 core:2 pu:1", 7)]
}

#[test]
fn every_worker_runs_once_on_its_cpu() {
    let mut team = here(Policy::Compact, None);
    for _ in 0..100 {
        let cpus = team.run(|worker| (worker.index(), crate::affinity::current_cpu())).unwrap();
        assert_eq!(cpus.len(), team.len());
        for (index, (worker, cpu)) in cpus.into_iter().enumerate() {
            assert_eq!((worker, cpu), (index, team.plan().slots[index].cpu));
            assert_eq!(team.seats()[index].mask.iter().next(), cpu);
        }
    }
}

#[test]
fn plans_for_other_machines_are_only_run_without_pins() {
    let machine = Arc::new(Machine::synthetic("numa:2 core:1 pu:1").unwrap());
    let error = Team::new(&Plan::new(machine, Policy::Compact, None).unwrap()).unwrap_err();
    assert!(matches!(error, Error::ForeignMachine { .. }));
}

#[test]
fn a_pin_that_the_kernel_refuses_is_an_error() {
    // A machine that claims a CPU which is not here.
    let mut machine = Machine::this_machine().unwrap();
    machine.cpus[0].os = 1000;
    let plan = Plan::new(Arc::new(machine), Policy::List(vec![1000]), None).unwrap();
    assert!(matches!(Team::new(&plan).unwrap_err(), Error::Pin { cpu: 1000, .. }));
}

#[test]
fn the_barrier_separates_phases() {
    for mut team in teams() {
        let count = AtomicUsize::new(0);
        let workers = team.len();
        team.run(|worker| {
            for phase in 1..=200 {
                count.fetch_add(1, SeqCst);
                worker.barrier();
                assert_eq!(count.load(SeqCst), phase * workers);
                worker.barrier();
            }
        })
        .unwrap();
    }
}

#[test]
fn items_are_each_visited_once() {
    for mut team in teams() {
        let nodes = team.plan().machine.nodes.len();
        for (len, limit) in [(0, 0), (1, 0), (2, 0), (1000, 0), (1000, 100), (777, u64::MAX)] {
            team.set_far_limit(limit);
            let mut items: Vec<(usize, u32)> = (0..len).map(|index| (index, 0)).collect();
            // Homes in no order, one of them on a node that does not exist, weights from none to huge.
            let home = |&(index, _): &(usize, u32)| Home {
                node: (index * 7) % (nodes + 1),
                weight: [0, 1, 5, u64::MAX / 4096][index % 4],
            };
            team.for_each_mut(&mut items, home, |_, item| item.1 += 1).unwrap();
            assert!(items.iter().enumerate().all(|(index, item)| *item == (index, 1)));
        }
    }
}

#[test]
fn small_pieces_stay_at_home_and_large_ones_travel() {
    let mut team = simulated("numa:2 core:2 pu:1", 4);
    let mut visit = |limit| {
        team.set_far_limit(limit);
        let mut nodes = vec![usize::MAX; 400];
        let home = |_: &usize| Home { node: 1, weight: 1 };
        team.for_each_mut(&mut nodes, home, |worker, node| {
            std::thread::sleep(std::time::Duration::from_micros(100));
            *node = worker.node();
        })
        .unwrap();
        nodes.into_iter().collect::<BTreeSet<_>>()
    };
    assert_eq!(visit(1000), BTreeSet::from([1]), "less than the limit in all");
    assert_eq!(visit(0), BTreeSet::from([0, 1]), "the other node helps");
}

fn fibonacci(worker: &Worker, n: u64) -> u64 {
    if n < 2 {
        return n;
    }
    let (a, b) =
        worker.join_weighted(n, |worker| fibonacci(worker, n - 1), |worker| fibonacci(worker, n - 2));
    a + b
}

#[test]
fn joins_nest() {
    for mut team in teams() {
        assert_eq!(team.enter(|worker| fibonacci(worker, 20)).unwrap(), 6765);
        team.set_far_limit(10);
        assert_eq!(team.run(|worker| fibonacci(worker, 12)).unwrap(), vec![144; team.len()]);
    }
}

#[test]
fn items_split_themselves_inside() {
    for mut team in teams() {
        let mut items: Vec<u64> = (0..24).collect();
        let home = |&n: &u64| Home { node: n as usize % 2, weight: 1 << n };
        team.for_each_mut(&mut items, home, |worker, item| *item = fibonacci(worker, *item % 16)).unwrap();
        assert_eq!(items[10], 55);
        let nested = team.enter(|worker| {
            let mut inner = vec![1u64; 100];
            worker.for_each_mut(&mut inner, |_| Home { node: 0, weight: 1 }, |_, value| *value += 1);
            inner.iter().sum::<u64>()
        });
        assert_eq!(nested.unwrap(), 200);
    }
}

#[test]
fn a_panic_names_its_worker_and_the_team_survives() {
    for mut team in teams() {
        let last = team.len() - 1;
        for round in 0..20 {
            let panic = team
                .run(|worker| {
                    if worker.index() == last {
                        panic!("round {round}");
                    }
                    worker.barrier();
                })
                .unwrap_err();
            assert_eq!((panic.worker, panic.message), (last, format!("round {round}")));
            assert_eq!(panic.cpu, team.plan().slots[last].cpu);
            team.run(Worker::barrier).unwrap();
        }
    }
}

#[test]
fn panics_in_items_and_joins_reach_the_caller() {
    for mut team in teams() {
        let mut items: Vec<usize> = (0..1000).collect();
        let home = |_: &usize| Home { node: 0, weight: 1 };
        let panic =
            team.for_each_mut(&mut items, home, |_, item| assert_ne!(*item, 500, "on purpose")).unwrap_err();
        assert!(panic.to_string().contains("on purpose"), "{panic}");
        for left in [true, false] {
            let fail = move |fails: bool| {
                move |_: &Worker| {
                    if fails {
                        panic!("one side")
                    }
                }
            };
            let panic = team.enter(|worker| worker.join(fail(left), fail(!left))).unwrap_err();
            assert_eq!(panic.message, "one side");
        }
        assert_eq!(team.enter(|worker| fibonacci(worker, 10)).unwrap(), 55);
    }
}

#[test]
fn time_adds_up() {
    let mut team = here(Policy::Compact, None);
    team.reset_times();
    let mutex = Mutex::new(());
    let nap = std::time::Duration::from_millis(20);
    team.run(|worker| {
        drop(worker.lock(&mutex));
        if worker.index() == 0 {
            std::thread::sleep(nap);
        }
        worker.barrier();
        let guard = worker.lock(&mutex);
        std::thread::sleep(nap);
        drop(guard);
    })
    .unwrap();
    let times = team.times();
    assert!(times[0].busy_s > 0.035, "{times:?}");
    for (other, time) in times.iter().enumerate().skip(1) {
        assert!(time.barrier_s > 0.01 && time.lock_s + times[0].lock_s > 0.01, "{other} {times:?}");
        let sum =
            time.busy_s + time.idle_s + time.barrier_s + time.lock_s + time.steal_near_s + time.steal_far_s;
        assert!(sum > 0.05 && sum < 0.5, "{times:?}");
    }
}

#[test]
fn waits_for_locks_and_notifications_are_told_apart() {
    let mut team = simulated("core:2 pu:1", 2);
    let (count, woken) = (Mutex::new(0), Condvar::new());
    let value = Deferred::new(0);
    let add = |value: &mut i32, more: i32| *value += more;
    let nap = std::time::Duration::from_millis(20);
    let arrive = |worker: &Worker| {
        *worker.lock(&count) += 1;
        woken.notify_all();
    };
    let wait_for = |worker: &Worker, number: i32| {
        let mut count = worker.lock(&count);
        while *count < number {
            count = worker.wait(&woken, count);
        }
    };
    team.run(|worker| match worker.index() {
        0 => {
            let held = value.lock(add);
            arrive(worker);
            wait_for(worker, 2);
            std::thread::sleep(nap);
            drop(held);
        }
        _ => {
            wait_for(worker, 1);
            assert!(value.try_lock(add).is_none());
            worker.defer(&value, 1);
            arrive(worker);
            *worker.lock_deferred(&value, add) *= 10;
        }
    })
    .unwrap();
    assert_eq!(*value.lock(add), 10, "the lock's next holder found what was left");
    let other = team.times()[1];
    assert!(other.lock_waits >= 1 && other.lock_s > 0.5 * nap.as_secs_f64(), "{other:?}");
    assert_eq!(other.deferrals, 1);
    team.reset_times();
    assert_eq!((team.times()[1].lock_waits, team.times()[1].deferrals), (0, 0));
}

/// A deterministic scatter of numbers: splitmix64 (Steele, Lea, Flood, OOPSLA 2014).
fn scatter(seed: u64) -> u64 {
    let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A million small tasks of random size, some of which split, some of which fail.
#[test]
fn stress() {
    for mut team in teams() {
        let work = |worker: &Worker, item: &mut u64| {
            let random = scatter(*item);
            let spin = (0..random % 50).fold(random, |x, step| scatter(x ^ step));
            if random.is_multiple_of(1000) {
                let split = 4 + (random >> 32) % 8;
                assert!(fibonacci(worker, split) < 200, "{spin}");
            }
            *item += 1;
        };
        let mut items: Vec<u64> = (0..1_000_000).collect();
        let home = |item: &u64| Home { node: (scatter(!*item) % 2) as usize, weight: 1 + item % 9 };
        team.set_far_limit(64);
        team.for_each_mut(&mut items, home, work).unwrap();
        assert!(items.iter().zip(1..).all(|(item, expected)| *item == expected));
        let tasks: u64 = team.times().iter().map(|times| times.tasks).sum();
        assert!(tasks >= team.len() as u64);
        for round in 0..50 {
            let mut items: Vec<u64> = (0..2000).collect();
            let failing = scatter(round) % 2000;
            let result = team.for_each_mut(&mut items, home, |worker, item| {
                assert_ne!(*item, failing, "expected in the stress");
                work(worker, item);
            });
            assert!(result.unwrap_err().message.contains("expected in the stress"));
        }
    }
}

/// Jobs so short that workers are always about to sleep or about to be woken.
#[test]
fn short_jobs_lose_no_wake_up() {
    for mut team in [here(Policy::Compact, None), simulated("numa:2 core:2 pu:1", 5)] {
        for round in 0..3000u64 {
            if round % 100 == 0 {
                std::thread::sleep(std::time::Duration::from_millis(1));
            }
            assert_eq!(
                team.enter(|worker| fibonacci(worker, round % 6)).unwrap(),
                [0, 1, 1, 2, 3, 5][(round % 6) as usize]
            );
            team.run(|_| ()).unwrap();
        }
    }
}
