//! Cache and memory behaviour of the solve in the report, by the definitions of the design's section 6. What could not be counted says why.

use std::collections::BTreeMap;

use ccnuma::counters::{METRICS, Reading, RegionReport};
use serde::{Deserialize, Serialize};

use super::Known;

/// What was counted while the scene was solved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Counters {
    /// Where the figures come from.
    pub source: CounterSource,
    /// The group of events, named after the CPU family that it is for.
    pub group: String,
    /// All workers together; not the mean of their metrics, but the metrics of their sums.
    #[serde(flatten)]
    pub total: Counted,
    /// Each worker, in the order of the report's workers.
    pub workers: Vec<Counted>,
    /// The thread that leads the team; no part of the total. None where one thread does all of it, which is the worker then.
    pub leader: Option<Counted>,
}

/// What one thread counted, or several.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Counted {
    /// Derived figures by name: all of [`METRICS`], and what else the group offers.
    pub metrics: BTreeMap<String, Known<f64>>,
    /// Events by name: the group's, and the kernel's `page_faults`, `context_switches`, `cpu_migrations`, `task_clock_ns`.
    pub events: BTreeMap<String, Known<u64>>,
}

/// Where counters come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CounterSource {
    /// The processor's counters, and the kernel's.
    Hardware,
    /// The kernel's alone.
    Software,
    /// A simulated cache.
    Simulated,
}

impl Counted {
    /// Whether anything was.
    pub fn anything(&self) -> bool {
        self.events.values().any(|event| event.as_result().is_ok())
    }
}

impl From<&RegionReport> for Counted {
    fn from(region: &RegionReport) -> Counted {
        let names = METRICS.into_iter().chain(region.metrics.keys().map(String::as_str));
        let event = |(name, count): (&String, &Reading)| {
            let count = Known::from(count.clone());
            (name.clone(), Known::from(count.as_result().map(|n| n.round() as u64).map_err(str::to_owned)))
        };
        Counted {
            metrics: names.map(|name| (name.to_owned(), region.metric(name).into())).collect(),
            events: region.events.iter().map(event).collect(),
        }
    }
}

impl From<Reading> for Known<f64> {
    fn from(reading: Reading) -> Known<f64> {
        match reading {
            Reading::Value(value) => Known::Value(value),
            Reading::Unavailable(unavailable) => Known::Unavailable { unavailable },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_metric_is_named_and_events_are_whole() {
        let region = RegionReport {
            entered: 1,
            events: BTreeMap::from([
                ("L1_MISS".to_owned(), Reading::Value(41.7)),
                ("L2_MISS".to_owned(), Reading::Unavailable("no PMU".to_owned())),
            ]),
            metrics: BTreeMap::from([("l1_hit_rate".to_owned(), Reading::Value(0.9))]),
        };
        let counted = Counted::from(&region);
        assert_eq!(counted.metrics.keys().count(), METRICS.len());
        assert_eq!(counted.metrics["l1_hit_rate"], Known::Value(0.9));
        assert!(counted.metrics["dram_local_share"].as_result().unwrap_err().contains("does not offer"));
        assert_eq!(counted.events["L1_MISS"], Known::Value(42));
        assert_eq!(counted.events["L2_MISS"], Known::unavailable("no PMU"));
        assert!(counted.anything());
    }
}
