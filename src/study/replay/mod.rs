//! Replay of a recorded run on any number of workers of any machine, by any schedule: what would it take, and where would the time go?
//!
//! Every step of the record waits for the one before it. Work done alone and the loops over all receivers are taken as they were; batches
//! are simulated event by event ([`stealing`], [`locking`]), with costs of distance, waking and sharing ([`site`]). What is not modelled:
//! that workers share caches and the way to memory, and that the system takes CPUs away.

mod bound;
mod locking;
mod site;
mod stealing;

use serde::Serialize;

use crate::schedule::homes::homes;
use crate::schedule::record::{Batch, Map, Record, Step};

pub use bound::{Bound, bound};
use locking::{Receivers, Shot, by_emitter, central_queue};
pub use site::Site;
use stealing::Item;

/// Times in replays are whole numbers, so that they do not depend on the order of sums.
type Nanos = u64;

/// A schedule that can be replayed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// Batches, or single shooters where the record has these, by a stealing team that divides receivers.
    Stealing,
    /// One emitter at a time, whole receivers handed out by a shared counter: the paper's inner loop.
    WholeReceivers,
    /// A central queue of the pairs that are known; receivers locked.
    SingleQueue {
        /// Whether to shoot on a private copy instead of waiting.
        lure: bool,
    },
    /// One emitter per worker; receivers locked.
    OuterLoop {
        /// Whether to shoot on a private copy instead of waiting.
        lure: bool,
    },
}

/// What a replay counts while batches run, all workers together.
#[derive(Clone, Copy, Debug, Default)]
struct Account {
    busy: Nanos,
    remote: Nanos,
    overhead: Nanos,
    lock: Nanos,
    merge: Nanos,
    forks: u64,
    steals_near: u64,
    steals_far: u64,
}

/// How long a run would take, and where the time of its workers would go. Seconds of all workers together, which add up to the workers times
/// [`Replayed::seconds`], unless said otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Replayed {
    /// Seconds from start to end.
    pub seconds: f64,
    /// At work on tasks.
    pub busy_s: f64,
    /// Longer than that, for data on other nodes.
    pub remote_s: f64,
    /// In queues, forks and steals; where receivers are locked, choosing shooters too.
    pub overhead_s: f64,
    /// Waiting for a locked receiver.
    pub lock_s: f64,
    /// Merging private copies.
    pub merge_s: f64,
    /// Waiting for the others at the end of a batch, and for its start.
    pub barrier_s: f64,
    /// While one thread works alone, and for what is uneven in loops over all receivers.
    pub alone_s: f64,
    /// Batches, each with a barrier at its end.
    pub batches: u64,
    /// Steals on a node.
    pub steals_near: u64,
    /// Steals across nodes.
    pub steals_far: u64,
}

/// Replays a record by a schedule. The record of single shooters is for all but [`Model::Stealing`], which takes either.
pub fn replay(record: &Record, site: &Site, model: Model) -> Replayed {
    let mut replay = Replay::new(record, site);
    match model {
        Model::Stealing | Model::WholeReceivers => {
            for step in &record.steps {
                match step {
                    Step::Alone(seconds) => replay.alone(*seconds),
                    Step::Expect(costs) => replay.expect(costs),
                    Step::Settle => replay.settle(),
                    Step::Map(map) => replay.map(map),
                    Step::Batch(batch) => replay.batch(batch, model),
                }
            }
        }
        Model::SingleQueue { lure } | Model::OuterLoop { lure } => {
            let rule = if lure { Receivers::Lure } else { Receivers::Wait };
            replay.by_groups(matches!(model, Model::OuterLoop { .. }), rule);
        }
    }
    replay.finish()
}

struct Replay<'a> {
    record: &'a Record,
    site: &'a Site,
    along: Vec<usize>,
    homes: Vec<usize>,
    /// What each receiver cost in the last batch, and since homes were given.
    costs: Vec<u64>,
    work: Vec<u64>,
    account: Account,
    now: Nanos,
    /// Of it, in batches.
    in_batches: Nanos,
    /// At work on what loops over receivers do.
    in_loops: Nanos,
    batches: u64,
}

fn nanos(seconds: f64) -> Nanos {
    (seconds * 1e9).round() as Nanos
}

impl<'a> Replay<'a> {
    fn new(record: &'a Record, site: &'a Site) -> Self {
        let none = vec![0; record.along_curve.len()];
        Self {
            record,
            site,
            along: record.along_curve.iter().map(|receiver| *receiver as usize).collect(),
            homes: vec![0; none.len()],
            costs: none.clone(),
            work: none,
            account: Account::default(),
            now: 0,
            in_batches: 0,
            in_loops: 0,
            batches: 0,
        }
    }

    fn expect(&mut self, costs: &[u64]) {
        self.costs.copy_from_slice(costs);
        self.work.copy_from_slice(costs);
    }

    fn settle(&mut self) {
        self.homes = homes(&self.along, &self.work, &self.site.staff);
        self.work.fill(0);
    }

    fn alone(&mut self, seconds: f64) {
        self.now += nanos(seconds);
    }

    fn map(&mut self, map: &Map) {
        let workers = self.site.workers();
        let (start, end) =
            (self.site.start(workers.min(map.items as usize).saturating_sub(1)), self.site.end());
        let share = (map.seconds / workers as f64).max(map.longest_s);
        self.in_loops += nanos(map.seconds);
        self.now += start + nanos(share) + end;
    }

    fn batch(&mut self, batch: &Batch, model: Model) {
        let seconds = match model {
            Model::Stealing => self.steal(batch),
            _ => central_queue(self.site, &[self.shot(batch, 0)], Receivers::Free, &mut self.account),
        };
        self.end_batch(seconds);
        self.learn(batch);
    }

    fn end_batch(&mut self, time: Nanos) {
        self.now += time;
        self.in_batches += time;
        self.batches += 1;
    }

    fn steal(&mut self, batch: &Batch) -> Nanos {
        let mut tasks: Vec<_> = batch.tasks.iter().collect();
        tasks.sort_by_key(|task| std::cmp::Reverse(self.costs[task.receiver as usize]));
        let item = |task: &&'_ crate::schedule::record::Task| Item {
            home: self.homes[task.receiver as usize],
            weight: 1 + self.costs[task.receiver as usize],
            work: nanos(task.seconds.into()),
            parts: batch.parts_of(task),
            scale: 1e9 * f64::from(task.seconds) / f64::from(task.cost.max(1)),
        };
        let mut items: Vec<Item<'_>> = tasks.iter().map(item).collect();
        // The small ones stand at the end of everybody's range.
        let lump = nanos(batch.small.seconds / self.site.workers() as f64);
        let lump = |node: &usize| Item { home: *node, weight: 1, work: lump, parts: &[], scale: 0.0 };
        if batch.small.tasks > 0 {
            items.extend(self.site.node.iter().map(lump));
        }
        stealing::replay(self.site, items, &mut self.account)
    }

    /// Homes and order follow what receivers cost.
    fn learn(&mut self, batch: &Batch) {
        self.costs.fill(0);
        for task in &batch.tasks {
            self.costs[task.receiver as usize] = task.cost.into();
            self.work[task.receiver as usize] += u64::from(task.cost);
        }
    }

    fn shot(&self, batch: &Batch, prepare: Nanos) -> Shot {
        let pair = |task: &crate::schedule::record::Task| {
            (task.receiver, self.homes[task.receiver as usize], nanos(task.seconds.into()))
        };
        Shot { prepare, pairs: batch.tasks.iter().map(pair).collect(), small: nanos(batch.small.seconds) }
    }

    /// Shots that are all known, and then shots with nothing between them but the choice of the next one, form groups, within which a schedule
    /// that locks receivers need not wait.
    fn by_groups(&mut self, by_worker: bool, rule: Receivers) {
        let (mut group, mut prepare, mut chosen): (Vec<Shot>, f64, bool) = (Vec::new(), 0.0, false);
        let record = self.record;
        for step in &record.steps {
            match step {
                Step::Alone(seconds) => prepare += seconds,
                // What the shooter sends is taken from it.
                Step::Map(map) if map.items <= 1 => {
                    if !std::mem::replace(&mut chosen, true) {
                        self.end_group(&mut group, by_worker, rule);
                    }
                    prepare += map.seconds;
                }
                Step::Batch(batch) => {
                    let shot = self.shot(batch, nanos(std::mem::take(&mut prepare)));
                    group.push(shot);
                    self.learn(batch);
                }
                Step::Expect(costs) => self.expect(costs),
                Step::Settle | Step::Map(_) => {
                    chosen = false;
                    self.end_group(&mut group, by_worker, rule);
                    self.alone(std::mem::take(&mut prepare));
                    match step {
                        Step::Map(map) => self.map(map),
                        _ => self.settle(),
                    }
                }
            }
        }
        self.end_group(&mut group, by_worker, rule);
        self.alone(prepare);
    }

    fn end_group(&mut self, group: &mut Vec<Shot>, by_worker: bool, rule: Receivers) {
        if group.is_empty() {
            return;
        }
        let time = if by_worker {
            by_emitter(self.site, group, self.homes.len(), rule, &mut self.account)
        } else {
            central_queue(self.site, group, rule, &mut self.account)
        };
        group.clear();
        self.end_batch(time);
    }

    fn finish(self) -> Replayed {
        let seconds = |nanos: Nanos| nanos as f64 * 1e-9;
        let workers = self.site.workers() as f64;
        let Account { busy, remote, overhead, lock, merge, steals_near, steals_far, .. } = self.account;
        let at_work = seconds(busy + remote + overhead + lock + merge);
        let (all, batches) = (workers * seconds(self.now), workers * seconds(self.in_batches));
        let barrier_s = (batches - at_work).max(0.0);
        Replayed {
            seconds: seconds(self.now),
            busy_s: seconds(busy + self.in_loops),
            remote_s: seconds(remote),
            overhead_s: seconds(overhead),
            lock_s: seconds(lock),
            merge_s: seconds(merge),
            barrier_s,
            alone_s: all - at_work - seconds(self.in_loops) - barrier_s,
            batches: self.batches,
            steals_near,
            steals_far,
        }
    }
}

#[cfg(test)]
mod tests;
