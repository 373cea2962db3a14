//! Hardware counters: one set per worker, opened on it, read by named regions, turned into metrics by the formulas of
//! a group file. What cannot be counted is [`Reading::Unavailable`] with its reason and remedy, never 0.
//!
//! The kernel may count a batch only part of the time when there are more events than counters; values are then
//! scaled by enabled over running time, over the same interval. Software events are always tried.

pub mod cpu;
pub mod formula;
pub mod group;
#[cfg_attr(not(target_os = "linux"), path = "perf_none.rs")]
mod perf;
mod text;

use std::cell::RefCell;
use std::collections::BTreeMap;

use serde::Serialize;

use crate::per_thread::PerWorker;
use crate::team::{Team, Worker, WorkerPanic};
pub use cpu::CpuId;
pub use group::{Group, GroupError};
use perf::{Count, Counts, ThreadCounters};

/// A value, or why there is none.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reading {
    /// The value.
    Value(f64),
    /// The reason, with a remedy.
    Unavailable(String),
}

impl Reading {
    /// The value, if there is one.
    pub fn value(&self) -> Option<f64> {
        match self {
            Self::Value(value) => Some(*value),
            Self::Unavailable(_) => None,
        }
    }
}

impl std::fmt::Display for Reading {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Value(value) => std::fmt::Display::fmt(value, f),
            Self::Unavailable(reason) => write!(f, "unavailable ({reason})"),
        }
    }
}

/// One region on one worker, or summed over workers.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RegionReport {
    /// How often it was entered.
    pub entered: u64,
    /// Events, scaled.
    pub events: BTreeMap<String, Reading>,
    /// The group's metrics.
    pub metrics: BTreeMap<String, Reading>,
}

/// Everything that was counted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CounterReport {
    /// Group file used.
    pub group: String,
    /// Its one-line description.
    pub description: String,
    /// Regions by name, summed over the workers.
    pub total: BTreeMap<String, RegionReport>,
    /// Regions by name, by worker.
    pub workers: Vec<BTreeMap<String, RegionReport>>,
}

/// What one worker counted in one region.
#[derive(Clone, Debug, Default)]
struct Region {
    entered: u64,
    events: BTreeMap<String, Reading>,
}

#[derive(Debug)]
struct WorkerCounters {
    open: RefCell<ThreadCounters>,
    regions: RefCell<BTreeMap<&'static str, Region>>,
    /// What stood on the counters when a span began.
    begun: RefCell<Counts>,
}

/// The counters of a team.
#[derive(Debug)]
pub struct Counters {
    group: Group,
    workers: PerWorker<WorkerCounters>,
}

impl Counters {
    /// Has every worker open the group's events for itself.
    pub fn open(team: &mut Team, group: Group) -> Result<Self, WorkerPanic> {
        let workers = PerWorker::new(team, |_| WorkerCounters {
            open: RefCell::new(ThreadCounters::open(&group)),
            regions: RefCell::default(),
            begun: RefCell::default(),
        })?;
        Ok(Self { group, workers })
    }

    /// Counts what the calling worker does in `body`, including tasks it helps with while it waits there. Regions may
    /// nest; the inner one's counts are part of the outer one's too.
    pub fn region<R>(&self, worker: &Worker, name: &'static str, body: impl FnOnce() -> R) -> R {
        let counters = self.workers.local(worker);
        let before = counters.open.borrow_mut().read();
        let result = body();
        let after = counters.open.borrow_mut().read();
        counters.regions.borrow_mut().entry(name).or_default().add(&before, &after);
        result
    }

    /// Counts what all workers do in `body`, which has the team to itself: the waits of its jobs included.
    pub fn span<R>(
        &self,
        team: &mut Team,
        name: &'static str,
        body: impl FnOnce(&mut Team) -> R,
    ) -> Result<R, WorkerPanic> {
        team.run(|worker| {
            let counters = self.workers.local(worker);
            *counters.begun.borrow_mut() = counters.open.borrow_mut().read();
        })?;
        let result = body(team);
        team.run(|worker| {
            let counters = self.workers.local(worker);
            let after = counters.open.borrow_mut().read();
            counters.regions.borrow_mut().entry(name).or_default().add(&counters.begun.borrow(), &after);
        })?;
        Ok(result)
    }

    /// What was counted so far, by region and worker.
    pub fn report(&mut self) -> CounterReport {
        let mut workers = Vec::new();
        let mut sums: BTreeMap<&'static str, Region> = BTreeMap::new();
        for counters in self.workers.iter_mut() {
            let regions = counters.regions.get_mut();
            for (&name, region) in regions.iter() {
                sums.entry(name).or_default().merge(region);
            }
            workers.push(report_regions(&self.group, regions));
        }
        CounterReport {
            group: self.group.name.clone(),
            description: self.group.short.clone(),
            total: report_regions(&self.group, &sums),
            workers,
        }
    }
}

fn report_regions(group: &Group, regions: &BTreeMap<&'static str, Region>) -> BTreeMap<String, RegionReport> {
    regions.iter().map(|(&name, region)| (name.to_owned(), region.report(group))).collect()
}

impl Region {
    fn add(&mut self, before: &Counts, after: &Counts) {
        self.entered += 1;
        for (name, after) in after {
            let reading = match (before.get(name), after) {
                (Some(Ok(before)), Ok(after)) => scaled(before, after),
                (_, Err(reason)) => Reading::Unavailable(reason.clone()),
                _ => Reading::Unavailable("it could not be read when the region began".to_owned()),
            };
            self.add_event(name, &reading);
        }
    }

    fn merge(&mut self, other: &Self) {
        self.entered += other.entered;
        other.events.iter().for_each(|(name, reading)| self.add_event(name, reading));
    }

    /// Adds to an event's sum; a part that is unavailable makes the sum so, for a sum of some is not the sum.
    fn add_event(&mut self, name: &str, reading: &Reading) {
        let sum = self.events.entry(name.to_owned()).or_insert(Reading::Value(0.0));
        *sum = match (&*sum, reading) {
            (Reading::Value(sum), Reading::Value(value)) => Reading::Value(sum + value),
            (Reading::Unavailable(reason), _) | (_, Reading::Unavailable(reason)) => {
                Reading::Unavailable(reason.clone())
            }
        };
    }

    fn report(&self, group: &Group) -> RegionReport {
        let value_of = |name: &str| {
            let missing = || Reading::Unavailable(format!("{name} was not counted"));
            self.events.get(name).cloned().unwrap_or_else(missing)
        };
        let metric = |metric: &group::Metric| (metric.name.clone(), metric.formula.evaluate(&value_of));
        RegionReport {
            entered: self.entered,
            events: self.events.clone(),
            metrics: group.metrics.iter().map(metric).collect(),
        }
    }
}

/// The count of an interval, scaled up where the event ran only part of it.
fn scaled(before: &Count, after: &Count) -> Reading {
    let count = after.count.saturating_sub(before.count) as f64;
    let enabled = after.enabled_ns.saturating_sub(before.enabled_ns);
    let running = after.running_ns.saturating_sub(before.running_ns);
    match running {
        0 if enabled > 0 => Reading::Unavailable(
            "the CPU never got to count it: other programs or the watchdog hold its counters, or the region is too \
             short"
                .to_owned(),
        ),
        0 => Reading::Value(count),
        _ => Reading::Value(count * enabled as f64 / running as f64),
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use crate::pinning::{Plan, Policy};
    use crate::topology::Machine;

    #[test]
    fn scaling_uses_the_interval() {
        let count = |count, enabled_ns, running_ns| Count { count, enabled_ns, running_ns };
        assert_eq!(scaled(&count(10, 100, 100), &count(30, 200, 150)), Reading::Value(40.0));
        assert_eq!(scaled(&count(10, 100, 100), &count(10, 100, 100)), Reading::Value(0.0));
        assert!(matches!(scaled(&count(0, 0, 0), &count(0, 50, 0)), Reading::Unavailable(_)));
    }

    #[test]
    fn a_team_counts_its_regions() {
        let plan = Plan::new(Machine::this_machine().unwrap().into(), Policy::Compact, None).unwrap();
        let mut team = Team::new(&plan).unwrap();
        let mut counters = Counters::open(&mut team, Group::for_cpu(&CpuId::this()).unwrap()).unwrap();
        team.run(|worker| {
            for _ in 0..3 {
                counters.region(worker, "fill", || std::hint::black_box(vec![1u8; 8 << 20]).len());
            }
        })
        .unwrap();
        let length =
            counters.span(&mut team, "span", |team| team.run(|worker| worker.index()).unwrap().len());
        assert_eq!(length.unwrap(), team.len());
        let report = counters.report();
        assert_eq!(report.workers.len(), team.len());
        assert_eq!(report.total["span"].entered, team.len() as u64);
        let total = &report.total["fill"];
        assert_eq!(total.entered, 3 * team.len() as u64);
        for (name, reading) in total.events.iter().chain(&total.metrics) {
            if let Reading::Unavailable(reason) = reading {
                assert!(reason.len() > 10, "{name} gives no reason");
            }
        }
        if let Reading::Value(nanos) = total.events["task_clock_ns"] {
            assert!(nanos > 1000.0);
        }
        serde_json::to_string(&report).unwrap();
    }
}
