//! Systems without `perf_event_open`: everything is unavailable, with this reason.

use std::collections::BTreeMap;

use super::group::Group;

/// As on Linux.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Count {
    pub count: u64,
    pub enabled_ns: u64,
    pub running_ns: u64,
}

/// As on Linux.
pub type Counts = BTreeMap<String, Result<Count, String>>;

/// The names of the events asked for.
#[derive(Debug)]
pub struct ThreadCounters(Vec<String>);

impl ThreadCounters {
    pub fn open(group: &Group) -> Self {
        Self(group.events().map(|event| event.name.clone()).collect())
    }

    pub fn read(&mut self) -> Counts {
        let reason = || Err("counters need Linux (perf_event_open)".to_owned());
        self.0.iter().map(|name| (name.clone(), reason())).collect()
    }
}
