//! Work and span: what no schedule with the same batches can beat, whatever the machine.

use serde::Serialize;

use crate::schedule::record::{Batch, Record, Step, Task};

/// Seconds, summed over the steps of a run, for one worker and for as many as can be used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Bound {
    /// All work: the time of one worker.
    pub work_s: f64,
    /// What one thread does alone.
    pub alone_s: f64,
    /// The longest item of each loop over receivers.
    pub loops_s: f64,
    /// The longest task of each batch: the least time of batches whose receivers stay whole.
    pub tasks_s: f64,
    /// The longest chain of parts of each batch: their least time when receivers are divided.
    pub chains_s: f64,
}

impl Bound {
    /// The least time on so many workers when receivers are divided.
    pub fn least_s(&self, workers: usize) -> f64 {
        let span = self.alone_s + self.loops_s + self.chains_s;
        (self.work_s / workers as f64).max(span)
    }
}

/// Work and span of a record.
pub fn bound(record: &Record) -> Bound {
    let mut bound = Bound { work_s: record.seconds(), ..Bound::default() };
    for step in &record.steps {
        match step {
            Step::Alone(seconds) => bound.alone_s += seconds,
            Step::Expect(_) | Step::Settle => {}
            Step::Map(map) => bound.loops_s += map.longest_s,
            Step::Batch(batch) => {
                bound.tasks_s += longest(batch, |task| f64::from(task.seconds));
                let chain = |task: &Task| {
                    f64::from(task.seconds) * f64::from(task.chain) / f64::from(task.cost.max(1))
                };
                bound.chains_s += longest(batch, chain);
            }
        }
    }
    bound
}

fn longest(batch: &Batch, seconds: impl Fn(&Task) -> f64) -> f64 {
    batch.tasks.iter().map(seconds).fold(0.0, f64::max)
}
