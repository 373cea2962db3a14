//! A sense-reversing barrier in two levels, node then machine, that spins, then parks.
//!
//! Workers of a node arrive at their node's counter; the last of them arrives for the node at the machine's counter;
//! the last node advances every node's **sense**, a counter whose change is the release. A waiting worker reads only
//! its own node's sense, so waiting makes no traffic between nodes: a crossing costs one remote arrival and one
//! remote release per node, not per worker.
//!
//! * **Arrival** is `AcqRel`: along the chain of read-modify-writes, what every worker did before its arrival happens
//!   before the last arrival, hence before the release (`Release` store, `Acquire` load of the sense).
//! * **Counters are reset** by the last arrival, before the release: whoever arrives next has seen the release.
//! * **Parking** cannot lose a wake-up. A sleeper counts itself, fences, and looks at the sense again under the lock;
//!   the releaser changes the sense, fences, and looks at the count. One of the two sees the other (`SeqCst` fences on
//!   both sides), and the lock keeps a notification from falling between the look and the wait.
//! * **Poisoning**: when a worker panics it will never arrive, so the others must not wait for it. They get
//!   [`Poisoned`], at their next arrival at the latest, until [`Barrier::reset`].

use crossbeam_utils::CachePadded;

use crate::sync::{AtomicBool, AtomicUsize, Condvar, Mutex, fence, lock, spin_loop, wait};
use std::sync::atomic::Ordering::{AcqRel, Acquire, Relaxed, Release, SeqCst};

/// A worker of the team panicked: the barrier will never be complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Poisoned;

#[derive(Debug)]
struct NodeLevel {
    members: usize,
    arrived: AtomicUsize,
    sense: AtomicUsize,
    sleepers: AtomicUsize,
    lock: Mutex<()>,
    wake: Condvar,
}

/// The barrier of one team.
#[derive(Debug)]
pub struct Barrier {
    nodes: Box<[CachePadded<NodeLevel>]>,
    arrived_nodes: CachePadded<AtomicUsize>,
    poisoned: CachePadded<AtomicBool>,
    spins: u32,
}

impl Barrier {
    /// For `members[k]` workers in group `k`; empty groups are not allowed. `spins` looks before parking.
    pub fn new(members: &[usize], spins: u32) -> Self {
        assert!(members.iter().all(|&members| members > 0), "a group without members would never arrive");
        let level = |&members: &usize| {
            CachePadded::new(NodeLevel {
                members,
                arrived: AtomicUsize::new(0),
                sense: AtomicUsize::new(0),
                sleepers: AtomicUsize::new(0),
                lock: Mutex::new(()),
                wake: Condvar::new(),
            })
        };
        Self {
            nodes: members.iter().map(level).collect(),
            arrived_nodes: CachePadded::new(AtomicUsize::new(0)),
            poisoned: CachePadded::new(AtomicBool::new(false)),
            spins,
        }
    }

    /// Waits for everybody; `true` for the one that arrived last.
    pub fn wait(&self, group: usize) -> Result<bool, Poisoned> {
        let level = &self.nodes[group];
        if self.poisoned.load(Acquire) {
            return Err(Poisoned);
        }
        // Relaxed: the sense cannot advance before this worker has arrived, and it has seen the last advance.
        let sense = level.sense.load(Relaxed);
        if level.arrived.fetch_add(1, AcqRel) + 1 == level.members {
            level.arrived.store(0, Relaxed);
            if self.arrived_nodes.fetch_add(1, AcqRel) + 1 == self.nodes.len() {
                self.arrived_nodes.store(0, Relaxed);
                self.nodes.iter().for_each(|level| level.release(sense.wrapping_add(1)));
                return Ok(true);
            }
        }
        for _ in 0..self.spins {
            if level.sense.load(Acquire) != sense {
                return Ok(false);
            }
            if self.poisoned.load(Acquire) {
                return Err(Poisoned);
            }
            spin_loop();
        }
        self.park(level, sense)
    }

    #[cold]
    fn park(&self, level: &NodeLevel, sense: usize) -> Result<bool, Poisoned> {
        let mut guard = lock(&level.lock);
        level.sleepers.fetch_add(1, Relaxed);
        fence(SeqCst);
        let outcome = loop {
            if level.sense.load(Acquire) != sense {
                break Ok(false);
            }
            if self.poisoned.load(Acquire) {
                break Err(Poisoned);
            }
            guard = wait(&level.wake, guard);
        };
        level.sleepers.fetch_sub(1, Relaxed);
        drop(guard);
        outcome
    }

    /// Lets everybody go who waits or will come, with [`Poisoned`].
    pub fn poison(&self) {
        self.poisoned.store(true, Release);
        fence(SeqCst);
        self.nodes.iter().for_each(|level| level.wake_sleepers());
    }

    /// Whether somebody panicked since the last reset.
    pub fn is_poisoned(&self) -> bool {
        self.poisoned.load(Acquire)
    }

    /// Makes a poisoned barrier whole again. Nobody may be inside; `&mut self` is not asked for because the team
    /// shares the barrier, and knows that all workers are out.
    pub fn reset(&self) {
        for level in &self.nodes {
            level.arrived.store(0, Relaxed);
        }
        self.arrived_nodes.store(0, Relaxed);
        // Senses may differ where poisoning met a release half-way.
        let sense = self.nodes.iter().map(|level| level.sense.load(Relaxed)).max().unwrap_or(0);
        self.nodes.iter().for_each(|level| level.sense.store(sense, Relaxed));
        self.poisoned.store(false, Release);
    }
}

impl NodeLevel {
    fn release(&self, sense: usize) {
        self.sense.store(sense, Release);
        fence(SeqCst);
        self.wake_sleepers();
    }

    fn wake_sleepers(&self) {
        if self.sleepers.load(Relaxed) > 0 {
            drop(lock(&self.lock));
            self.wake.notify_all();
        }
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    /// Group of each worker, for so many members per group.
    fn groups(members: &[usize]) -> Vec<usize> {
        members.iter().enumerate().flat_map(|(group, &members)| std::iter::repeat_n(group, members)).collect()
    }

    fn cross(members: &[usize], spins: u32, rounds: usize) {
        let barrier = Barrier::new(members, spins);
        let groups = groups(members);
        let count = AtomicUsize::new(0);
        let worker = |group| {
            for round in 1..=rounds {
                count.fetch_add(1, Relaxed);
                barrier.wait(group).unwrap();
                assert_eq!(count.load(Relaxed), groups.len() * round, "all arrived");
                barrier.wait(group).unwrap();
            }
        };
        std::thread::scope(|scope| {
            let worker = &worker;
            groups.iter().for_each(|&group| drop(scope.spawn(move || worker(group))));
        });
    }

    #[test]
    fn nobody_passes_before_all_arrive() {
        cross(&[1], 0, 1000);
        cross(&[2, 1, 3], 0, 2000);
        cross(&[1, 1], 1000, 20_000);
    }

    #[test]
    fn poison_frees_those_who_wait_and_reset_heals() {
        for spins in [0, u32::MAX] {
            let barrier = &Barrier::new(&[2, 1], spins);
            let results = |groups: &[usize], poison: bool| -> Vec<_> {
                std::thread::scope(|scope| {
                    let waiting: Vec<_> =
                        groups.iter().map(|&group| scope.spawn(move || barrier.wait(group))).collect();
                    if poison {
                        std::thread::sleep(std::time::Duration::from_millis(5));
                        barrier.poison();
                    }
                    waiting.into_iter().map(|thread| thread.join().unwrap()).collect()
                })
            };
            assert_eq!(results(&[0, 1], true), [Err(Poisoned); 2]);
            assert_eq!(barrier.wait(0), Err(Poisoned));
            barrier.reset();
            let healed = results(&[0, 0, 1], false);
            assert_eq!(healed.iter().filter(|&&result| result == Ok(true)).count(), 1);
        }
    }
}

#[cfg(all(test, loom))]
mod models {
    use super::*;
    use loom::sync::Arc;

    /// Two groups of one, two crossings each: data written before a crossing is seen after it, counters are reused.
    #[test]
    fn loom_two_groups_cross_twice() {
        let mut model = loom::model::Builder::new();
        model.preemption_bound = Some(3);
        model.check(|| {
            let barrier = Arc::new(Barrier::new(&[1, 1], 1));
            let data = Arc::new([AtomicUsize::new(0), AtomicUsize::new(0)]);
            let cross = |me: usize, barrier: &Barrier, data: &[AtomicUsize; 2]| {
                for round in 1..=2 {
                    data[me].store(round, Relaxed);
                    barrier.wait(me).unwrap();
                    assert!(data[1 - me].load(Relaxed) >= round);
                    barrier.wait(me).unwrap();
                }
            };
            let other = {
                let (barrier, data) = (Arc::clone(&barrier), Arc::clone(&data));
                loom::thread::spawn(move || cross(1, &barrier, &data))
            };
            cross(0, &barrier, &data);
            other.join().unwrap();
        });
    }

    /// Three workers on two nodes park without spinning; nobody is left asleep.
    #[test]
    fn loom_three_park() {
        let mut model = loom::model::Builder::new();
        model.preemption_bound = Some(2);
        model.check(|| {
            let barrier = Arc::new(Barrier::new(&[2, 1], 0));
            let others = [0, 1].map(|group| {
                let barrier = Arc::clone(&barrier);
                loom::thread::spawn(move || barrier.wait(group).unwrap())
            });
            let last = barrier.wait(0).unwrap();
            let lasts = others.map(|other| other.join().unwrap());
            assert_eq!(lasts.into_iter().chain([last]).filter(|&last| last).count(), 1);
        });
    }

    /// A panic of the other worker is always noticed, however early or late it comes.
    #[test]
    fn loom_poison_reaches_sleepers() {
        loom::model(|| {
            let barrier = Arc::new(Barrier::new(&[2], 0));
            let other = {
                let barrier = Arc::clone(&barrier);
                loom::thread::spawn(move || barrier.poison())
            };
            assert_eq!(barrier.wait(0), Err(Poisoned));
            other.join().unwrap();
        });
    }
}
