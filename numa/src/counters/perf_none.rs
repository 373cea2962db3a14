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

/// The events asked for, all with this reason.
#[derive(Debug)]
pub struct ThreadCounters(BTreeMap<String, String>);

impl ThreadCounters {
    pub fn open(group: &Group) -> Self {
        let reason = || "counters need Linux (perf_event_open)".to_owned();
        Self(group.events().map(|event| (event.name.clone(), reason())).collect())
    }

    pub fn refused(&self) -> &BTreeMap<String, String> {
        &self.0
    }

    pub fn read(&mut self) -> Counts {
        self.0.iter().map(|(name, reason)| (name.clone(), Err(reason.clone()))).collect()
    }
}
