//! Hardware counters: one set per worker, opened on it, and one of the thread that leads the team or has none; read by
//! named regions, turned into metrics by the formulas of a group file. What cannot be counted is
//! [`Reading::Unavailable`] with its reason and remedy, never 0.
//!
//! The kernel may count a batch only part of the time when there are more events than counters; values are then
//! scaled by enabled over running time, over the same interval. What the kernel accounts for each thread is always read.

pub mod cpu;
pub mod formula;
pub mod group;
#[cfg(target_os = "linux")]
mod kernel;
#[cfg_attr(not(target_os = "linux"), path = "perf_none.rs")]
mod perf;
mod text;

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

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

/// What a group's metrics are called, as far as its CPU allows them; hit rates, overheads and shares, in this order.
pub const METRICS: [&str; 5] =
    ["l1_hit_rate", "l2_hit_rate", "memory_overhead_stalls", "memory_overhead_perfex", "dram_local_share"];

/// One region on one thread, or summed over threads.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RegionReport {
    /// How often it was entered.
    pub entered: u64,
    /// Events, scaled.
    pub events: BTreeMap<String, Reading>,
    /// The group's metrics.
    pub metrics: BTreeMap<String, Reading>,
}

impl RegionReport {
    /// The metric of this name, of [`METRICS`] or the group's own; unavailable where the group does not offer it.
    pub fn metric(&self, name: &str) -> Reading {
        let missing = || Reading::Unavailable("this CPU's group of events does not offer it".to_owned());
        self.metrics.get(name).cloned().unwrap_or_else(missing)
    }
}

/// Everything that was counted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CounterReport {
    /// Group file used.
    pub group: String,
    /// Its one-line description.
    pub description: String,
    /// Regions by name, summed over the workers; of the leader where there is no team.
    pub total: BTreeMap<String, RegionReport>,
    /// Regions by name, by worker.
    pub workers: Vec<BTreeMap<String, RegionReport>>,
    /// Regions by name, of the thread that called [`Counters::span`]: it leads the team, or does all where there is none. A leader
    /// mostly sleeps, too short awake for its CPU to count every batch of events, so its figures are no part of the sums.
    pub leader: BTreeMap<String, RegionReport>,
}

/// What one thread counted in one region.
#[derive(Clone, Debug, Default)]
struct Region {
    entered: u64,
    events: BTreeMap<String, Reading>,
}

type Regions = BTreeMap<&'static str, Region>;

/// The counters of one worker, and what they counted.
#[derive(Debug)]
struct Counted {
    open: RefCell<ThreadCounters>,
    regions: RefCell<Regions>,
    /// What stood on the counters when a span began.
    begun: RefCell<Counts>,
}

impl Counted {
    fn read(&self) -> Counts {
        self.open.borrow_mut().read()
    }

    fn book(&self, name: &'static str, before: &Counts) {
        let after = self.read();
        self.regions.borrow_mut().entry(name).or_default().add(before, &after);
    }
}

/// The counters of a team and the thread that leads it, or of one thread.
#[derive(Debug)]
pub struct Counters {
    group: Group,
    workers: Option<PerWorker<Counted>>,
    /// What the threads that called [`Self::span`] counted, one at a time.
    leader: Mutex<Regions>,
}

impl Counters {
    /// Has every worker of the team, if there is one, open the group's events for itself.
    pub fn open(team: Option<&mut Team>, group: Group) -> Result<Self, WorkerPanic> {
        let open = |_: &Worker| Counted {
            open: RefCell::new(ThreadCounters::open(&group)),
            regions: RefCell::default(),
            begun: RefCell::default(),
        };
        let workers = team.map(|team| PerWorker::new(team, open)).transpose()?;
        Ok(Self { group, workers, leader: Mutex::default() })
    }

    /// Whether some event of the group, which are the CPU's, can be counted; if not, why the first is refused.
    pub fn hardware(&mut self) -> Result<(), String> {
        let worker = self.workers.iter_mut().flat_map(PerWorker::iter_mut).next();
        let refused = match worker {
            Some(counted) => counted.open.get_mut().refused().clone(),
            None => ThreadCounters::open(&self.group).refused().clone(),
        };
        if self.group.events().any(|event| !refused.contains_key(&event.name)) {
            return Ok(());
        }
        Err(refused
            .into_values()
            .next()
            .unwrap_or_else(|| format!("the group {} has no events", self.group.name)))
    }

    /// Counts what the calling worker does in `body`, including tasks it helps with while it waits there. Regions may
    /// nest; the inner one's counts are part of the outer one's too. Without its team a worker is not counted.
    pub fn region<R>(&self, worker: &Worker, name: &'static str, body: impl FnOnce() -> R) -> R {
        let Some(workers) = &self.workers else { return body() };
        let counted = workers.local(worker);
        let before = counted.read();
        let result = body();
        counted.book(name, &before);
        result
    }

    /// Counts what the calling thread and all workers do in `body`, which has the team to itself: the waits of its jobs
    /// included. The team is that of the counters, if they have one.
    pub fn span<R>(
        &self,
        mut team: Option<&mut Team>,
        name: &'static str,
        body: impl FnOnce(Option<&mut Team>) -> R,
    ) -> Result<R, WorkerPanic> {
        let mut own = ThreadCounters::open(&self.group);
        self.on_workers(team.as_deref_mut(), |counted| *counted.begun.borrow_mut() = counted.read())?;
        let before = own.read();
        let result = body(team.as_deref_mut());
        let after = own.read();
        self.on_workers(team, |counted| counted.book(name, &counted.begun.borrow()))?;
        let mut leader = self.leader.lock().unwrap_or_else(PoisonError::into_inner);
        leader.entry(name).or_default().add(&before, &after);
        Ok(result)
    }

    fn on_workers(&self, team: Option<&mut Team>, each: impl Fn(&Counted) + Sync) -> Result<(), WorkerPanic> {
        if let (Some(team), Some(workers)) = (team, &self.workers) {
            team.run(|worker| each(workers.local(worker)))?;
        }
        Ok(())
    }

    /// What was counted so far, by region and thread.
    pub fn report(&mut self) -> CounterReport {
        let leader = self.leader.get_mut().unwrap_or_else(PoisonError::into_inner);
        let mut sums = Regions::new();
        let mut workers = Vec::new();
        for counted in self.workers.iter_mut().flat_map(PerWorker::iter_mut) {
            let regions = counted.regions.get_mut();
            for (&name, region) in regions.iter() {
                sums.entry(name).or_default().merge(region);
            }
            workers.push(report_regions(&self.group, regions));
        }
        let leader = report_regions(&self.group, leader);
        let total = if workers.is_empty() { leader.clone() } else { report_regions(&self.group, &sums) };
        CounterReport {
            group: self.group.name.clone(),
            description: self.group.short.clone(),
            total,
            workers,
            leader,
        }
    }
}

fn report_regions(group: &Group, regions: &Regions) -> BTreeMap<String, RegionReport> {
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
        let mut counters = Counters::open(Some(&mut team), Group::for_cpu(&CpuId::this()).unwrap()).unwrap();
        team.run(|worker| {
            for _ in 0..3 {
                counters.region(worker, "fill", || std::hint::black_box(vec![1u8; 8 << 20]).len());
            }
        })
        .unwrap();
        let length = counters.span(Some(&mut team), "span", |team| {
            team.map_or(0, |team| team.run(|worker| worker.index()).unwrap().len())
        });
        assert_eq!(length.unwrap(), team.len());
        let report = counters.report();
        assert_eq!(report.workers.len(), team.len());
        assert_eq!(report.total["span"].entered, team.len() as u64);
        assert_eq!((report.leader["span"].entered, report.leader.contains_key("fill")), (1, false));
        let total = &report.total["fill"];
        assert_eq!(total.entered, 3 * team.len() as u64);
        for (name, reading) in total.events.iter().chain(&total.metrics) {
            if let Reading::Unavailable(reason) = reading {
                assert!(reason.len() > 10, "{name} gives no reason");
            }
        }
        assert!(total.events["task_clock_ns"].value().is_some_and(|nanos| nanos > 1000.0));
        serde_json::to_string(&report).unwrap();
    }

    #[test]
    fn a_thread_without_a_team_counts_itself() {
        let group = Group::for_cpu(&CpuId::default()).unwrap();
        let mut counters = Counters::open(None, group).unwrap();
        let sum = counters.span(None, "solve", |team| {
            assert!(team.is_none());
            std::hint::black_box(vec![1u8; 8 << 20]).iter().map(|byte| u64::from(*byte)).sum::<u64>()
        });
        assert_eq!(sum.unwrap(), 8 << 20);
        let hardware = counters.hardware();
        let report = counters.report();
        assert!(report.workers.is_empty());
        assert_eq!(report.leader, report.total);
        let solve = &report.total["solve"];
        for name in METRICS {
            if let Err(reason) = &hardware {
                assert!(solve.metric(name).value().is_none() && reason.len() > 10, "{name}");
            }
        }
        assert!(solve.metric("l2_hit_rate").to_string().contains("does not offer it"), "the generic group");
    }
}
