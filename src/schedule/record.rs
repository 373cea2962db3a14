//! The record of a sequential run: what every task cost, in evaluations and in seconds, in which batch it stood and how it could have been
//! shared out; and what went on between the batches. With it the run can be replayed on any number of workers ([`crate::study`]).
//!
//! Steps follow each other: each waits for the one before it. Costs do not depend on the machine and are the same in every run; seconds
//! are this machine's, neighbours included, so that of several runs the least of each is kept ([`Record::keep_least`]).

use std::time::Instant;

use ccnuma::Arena;

use crate::transport::Helpers;

use super::parts::{Noting, Part};

/// Tasks that cost less than this are booked together: what one look at a receiver out of sight, or one sample, costs.
const LEAST_TASK: u64 = 32;

/// A run, step by step.
#[derive(Clone, Debug, Default)]
pub struct Record {
    /// Receivers along the space-filling curve that home nodes are stretches of.
    pub along_curve: Vec<u32>,
    /// What was done, in order.
    pub steps: Vec<Step>,
}

/// A step of a run.
#[derive(Clone, Debug)]
pub enum Step {
    /// Work that one thread does while the others wait: seconds.
    Alone(f64),
    /// What each receiver is expected to cost, in proportion, as nothing is known yet.
    Expect(Vec<u64>),
    /// A pass begins: receivers get home nodes anew.
    Settle,
    /// The same small thing done to many receivers, each by itself.
    Map(Map),
    /// A batch of shots.
    Batch(Batch),
}

/// The same small thing done to many receivers.
#[derive(Clone, Copy, Debug)]
pub struct Map {
    /// Receivers.
    pub items: u32,
    /// Seconds in all.
    pub seconds: f64,
    /// Seconds of the longest.
    pub longest_s: f64,
}

/// A batch: one task for each receiver.
#[derive(Clone, Debug, Default)]
pub struct Batch {
    /// The tasks that cost something, by receiver.
    pub tasks: Vec<Task>,
    /// Parts of the tasks that have some.
    pub parts: Vec<Part>,
    /// Tasks that cost next to nothing.
    pub small: Small,
}

/// One receiver and the whole batch.
#[derive(Clone, Copy, Debug, Default)]
pub struct Task {
    /// The receiver's number.
    pub receiver: u32,
    /// Its cost in evaluations ([`crate::transport::Work::cost`]).
    pub cost: u32,
    /// Cost of its longest chain of parts that wait for each other.
    pub chain: u32,
    /// Seconds it took.
    pub seconds: f32,
    /// Where its parts lie in the batch's list: from, and how many. A task without parts is in one piece.
    pub parts: (u32, u32),
}

/// Tasks booked together.
#[derive(Clone, Copy, Debug, Default)]
pub struct Small {
    /// How many.
    pub tasks: u32,
    /// Their cost.
    pub cost: u64,
    /// Their seconds.
    pub seconds: f64,
}

impl Batch {
    /// The parts of one of its tasks.
    pub fn parts_of(&self, task: &Task) -> &[Part] {
        let (from, count) = (task.parts.0 as usize, task.parts.1 as usize);
        &self.parts[from..from + count]
    }

    /// Cost of all tasks.
    pub fn cost(&self) -> u64 {
        self.small.cost + self.tasks.iter().map(|task| u64::from(task.cost)).sum::<u64>()
    }

    /// Seconds of all tasks.
    pub fn seconds(&self) -> f64 {
        self.small.seconds + self.tasks.iter().map(|task| f64::from(task.seconds)).sum::<f64>()
    }
}

/// Two records are not of the same run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("two runs of one problem were recorded and differ in what was done: a mistake in this program")]
pub struct OtherRun;

impl Record {
    /// Seconds of all steps.
    pub fn seconds(&self) -> f64 {
        let seconds = |step: &Step| match step {
            Step::Alone(seconds) => *seconds,
            Step::Expect(_) | Step::Settle => 0.0,
            Step::Map(map) => map.seconds,
            Step::Batch(batch) => batch.seconds(),
        };
        self.steps.iter().map(seconds).sum()
    }

    /// The batches, in order.
    pub fn batches(&self) -> impl Iterator<Item = &Batch> {
        self.steps.iter().filter_map(|step| match step {
            Step::Batch(batch) => Some(batch),
            _ => None,
        })
    }

    /// Keeps of all seconds the lesser of two records of the same run, so that what disturbed one of them is left out.
    ///
    /// # Errors
    /// The other one is of another run.
    pub fn keep_least(&mut self, other: &Record) -> Result<(), OtherRun> {
        if self.steps.len() != other.steps.len() {
            return Err(OtherRun);
        }
        for (mine, theirs) in self.steps.iter_mut().zip(&other.steps) {
            match (mine, theirs) {
                (Step::Alone(mine), Step::Alone(theirs)) => *mine = mine.min(*theirs),
                (Step::Settle, Step::Settle) => {}
                (Step::Expect(mine), Step::Expect(theirs)) if mine == theirs => {}
                (Step::Map(mine), Step::Map(theirs)) if mine.items == theirs.items => {
                    mine.seconds = mine.seconds.min(theirs.seconds);
                    mine.longest_s = mine.longest_s.min(theirs.longest_s);
                }
                (Step::Batch(mine), Step::Batch(theirs)) => mine.keep_least(theirs)?,
                _ => return Err(OtherRun),
            }
        }
        Ok(())
    }

    /// Gives every task the seconds that its cost takes at its receiver's rate over the whole run: receivers differ in what an evaluation costs
    /// them, in what lies between, but that one task was interrupted by the system says nothing of the next run.
    pub fn smooth(&mut self) {
        let mut sums = vec![(0.0, 0.0); self.along_curve.len()];
        for task in self.batches().flat_map(|batch| &batch.tasks) {
            let (seconds, cost) = &mut sums[task.receiver as usize];
            *seconds += f64::from(task.seconds);
            *cost += f64::from(task.cost);
        }
        for step in &mut self.steps {
            let Step::Batch(batch) = step else { continue };
            for task in &mut batch.tasks {
                let (seconds, cost) = sums[task.receiver as usize];
                task.seconds = (f64::from(task.cost) * seconds / cost) as f32;
            }
        }
    }

    /// Multiplies all seconds.
    pub fn scale(&mut self, factor: f64) {
        for step in &mut self.steps {
            match step {
                Step::Alone(seconds) => *seconds *= factor,
                Step::Expect(_) | Step::Settle => {}
                Step::Map(map) => {
                    map.seconds *= factor;
                    map.longest_s *= factor;
                }
                Step::Batch(batch) => {
                    batch.small.seconds *= factor;
                    batch.tasks.iter_mut().for_each(|task| task.seconds *= factor as f32);
                }
            }
        }
    }
}

impl Batch {
    fn keep_least(&mut self, other: &Batch) -> Result<(), OtherRun> {
        if self.tasks.len() != other.tasks.len() || self.small.tasks != other.small.tasks {
            return Err(OtherRun);
        }
        self.small.seconds = self.small.seconds.min(other.small.seconds);
        for (mine, theirs) in self.tasks.iter_mut().zip(&other.tasks) {
            if (mine.receiver, mine.cost) != (theirs.receiver, theirs.cost) {
                return Err(OtherRun);
            }
            mine.seconds = mine.seconds.min(theirs.seconds);
        }
        Ok(())
    }
}

/// Keeps the record while a run goes on.
#[derive(Debug)]
pub(super) struct Recorder {
    record: Record,
    /// When the step before this one ended.
    since: Instant,
}

impl Recorder {
    /// Begins now; the field as in [`Record`].
    pub fn new(along_curve: Vec<u32>) -> Self {
        Self { record: Record { along_curve, steps: Vec::new() }, since: Instant::now() }
    }

    /// The record; what came after the last step was done alone.
    pub fn finish(mut self) -> Record {
        self.alone();
        self.record
    }

    /// Books what one thread did since the last step.
    fn alone(&mut self) {
        let now = Instant::now();
        self.record.steps.push(Step::Alone((now - self.since).as_secs_f64()));
        self.since = now;
    }

    /// Receivers are expected to cost this.
    pub fn expect(&mut self, costs: &[u64]) {
        self.record.steps.push(Step::Expect(costs.to_vec()));
    }

    /// A pass begins.
    pub fn settle(&mut self) {
        self.record.steps.push(Step::Settle);
    }

    /// Calls `each` on every item.
    pub fn map<T, R>(&mut self, items: impl Iterator<Item = T>, each: impl Fn(T) -> R) -> Vec<R> {
        self.alone();
        let mut map = Map { items: 0, seconds: 0.0, longest_s: 0.0 };
        let results = items.map(|item| {
            let result = each(item);
            let now = Instant::now();
            let seconds = (now - std::mem::replace(&mut self.since, now)).as_secs_f64();
            map.items += 1;
            map.seconds += seconds;
            map.longest_s = map.longest_s.max(seconds);
            result
        });
        let results = results.collect();
        self.record.steps.push(Step::Map(map));
        results
    }

    /// Runs a batch of tasks, each on its receiver, with helpers to offer it, elements in the arena; a task returns its cost and that of its
    /// longest chain.
    pub fn batch<T>(
        &mut self,
        arena: &Arena,
        receivers: impl Iterator<Item = T>,
        mut task: impl FnMut(T, &dyn Helpers) -> (u64, u64),
    ) {
        self.alone();
        let mut batch = Batch::default();
        let noting = Noting::new(arena);
        for (receiver, item) in receivers.enumerate() {
            let (cost, chain) = task(item, &noting);
            let now = Instant::now();
            let seconds = (now - std::mem::replace(&mut self.since, now)).as_secs_f64();
            let from = batch.parts.len();
            noting.finish(cost, &mut batch.parts);
            if cost < LEAST_TASK {
                batch.small.tasks += 1;
                batch.small.cost += cost;
                batch.small.seconds += seconds;
                continue;
            }
            let number = |cost| u32::try_from(cost).unwrap_or(u32::MAX);
            let (cost, chain, seconds) = (number(cost), number(chain), seconds as f32);
            let parts = (from as u32, (batch.parts.len() - from) as u32);
            batch.tasks.push(Task { receiver: receiver as u32, cost, chain, seconds, parts });
        }
        batch.tasks.shrink_to_fit();
        batch.parts.shrink_to_fit();
        self.record.steps.push(Step::Batch(batch));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recorded(costs: &[u64]) -> Record {
        let arena = Arena::new(ccnuma::arena::Backend::Malloc);
        let mut recorder = Recorder::new((0..costs.len() as u32).collect());
        recorder.settle();
        recorder.batch(&arena, costs.iter(), |cost, _| (*cost, cost / 2));
        assert_eq!(recorder.map(costs.iter(), |cost| cost + 1).len(), costs.len());
        recorder.finish()
    }

    #[test]
    fn costly_tasks_are_told_apart_and_the_others_counted() {
        let record = recorded(&[0, 1000, 5, 40]);
        let batch = record.batches().next().unwrap();
        let tasks: Vec<_> = batch.tasks.iter().map(|t| (t.receiver, t.cost, t.chain)).collect();
        assert_eq!(tasks, [(1, 1000, 500), (3, 40, 20)]);
        assert_eq!((batch.small.tasks, batch.small.cost, batch.cost()), (2, 5, 1045));
        assert!(record.seconds() > 0.0);
    }

    #[test]
    fn tasks_take_what_their_receiver_takes_for_their_cost() {
        let mut record = recorded(&[100, 300]);
        let again = recorded(&[200, 300]);
        record.steps.extend(again.steps);
        let before = record.seconds();
        record.smooth();
        let tasks: Vec<f64> = record.batches().map(|batch| f64::from(batch.tasks[0].seconds)).collect();
        assert!((tasks[1] / tasks[0] - 2.0).abs() < 1e-5, "twice the cost, twice the time");
        assert!((record.seconds() / before - 1.0).abs() < 1e-5, "in all it is the same");
    }

    #[test]
    fn the_least_of_several_runs_is_kept() {
        let (mut record, other) = (recorded(&[100, 200]), recorded(&[100, 200]));
        let least = |a: &Record, b: &Record, i: usize| {
            let of = |r: &Record| r.batches().next().unwrap().tasks[i].seconds;
            of(a).min(of(b))
        };
        let expected = [least(&record, &other, 0), least(&record, &other, 1)];
        record.keep_least(&other).unwrap();
        let found: Vec<f32> = record.batches().next().unwrap().tasks.iter().map(|t| t.seconds).collect();
        assert_eq!(found, expected);
        record.smooth();
        let before = record.seconds();
        record.scale(2.0);
        assert!((record.seconds() / before - 2.0).abs() < 1e-6);
        assert_eq!(record.keep_least(&recorded(&[100, 201])), Err(OtherRun));
        assert_eq!(record.keep_least(&recorded(&[100])), Err(OtherRun));
    }
}
