//! `--counters`: what is counted while a scene is solved. Opened before the solve, by each of its threads, and told after it.

use std::collections::BTreeMap;
use std::fmt::Display;

use ccnuma::Team;
use ccnuma::counters::{self, CpuId, Group};

use crate::output::report::{Counted, CounterSource, Counters, Known};
use crate::schedule::COUNTED;

use super::Error;
use super::choice::choose;

/// Whether to count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counting {
    /// What can be counted.
    Auto,
    /// The processor's events, or nothing at all is done.
    Hardware,
    /// Nothing.
    Off,
}

impl Counting {
    /// The source of this name.
    ///
    /// # Errors
    /// [`Error::Input`]: there is none, or none yet.
    pub fn new(name: &str) -> Result<Self, Error> {
        let available = [("auto", Self::Auto), ("hardware", Self::Hardware), ("off", Self::Off)];
        choose("--counters", name, &available, &["simulated"])
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Hardware => "hardware",
            Self::Off => "off",
        }
    }

    /// The counters of the team, or of one thread where there is none; none if nothing is to be counted.
    ///
    /// # Errors
    /// [`Error::Failed`]: the processor's events are demanded and cannot be had, or a worker panicked.
    pub(super) fn open(self, team: Option<&mut Team>) -> Result<Option<counters::Counters>, Error> {
        if self == Self::Off {
            return Ok(None);
        }
        let mistake = |problem: &dyn Display| Error::Failed(format!("a mistake in this program: {problem}"));
        let group = Group::for_cpu(&CpuId::this()).map_err(|problem| mistake(&problem))?;
        let mut counters = counters::Counters::open(team, group).map_err(|panic| mistake(&panic))?;
        if self == Self::Hardware {
            counters.hardware().map_err(|reason| {
                Error::Failed(format!(
                    "--counters hardware: {reason}. Or use --counters auto, which counts what can be counted"
                ))
            })?;
        }
        Ok(Some(counters))
    }
}

/// The report's words for what was counted.
pub(super) fn told(counters: Option<&mut counters::Counters>) -> Known<Counters> {
    let Some(counters) = counters else { return Known::unavailable("switched off by --counters off") };
    let hardware = counters.hardware();
    let mut report = counters.report();
    let counted = |regions: &mut BTreeMap<_, _>| Counted::from(&regions.remove(COUNTED).unwrap_or_default());
    let leader = counted(&mut report.leader);
    let mut workers: Vec<Counted> = report.workers.iter_mut().map(counted).collect();
    let alone = workers.is_empty();
    if alone {
        workers.push(leader.clone());
    }
    let total = counted(&mut report.total);
    match hardware {
        Err(reason) if !total.anything() => Known::unavailable(reason),
        _ => Known::Value(Counters {
            source: if hardware.is_ok() { CounterSource::Hardware } else { CounterSource::Software },
            group: report.group,
            total,
            workers,
            leader: (!alone).then_some(leader),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn off_opens_nothing_and_simulated_is_not_there_yet() {
        let mut opened = Counting::Off.open(None).unwrap();
        assert_eq!(told(opened.as_mut()), Known::unavailable("switched off by --counters off"));
        let refused = Counting::new("simulated").unwrap_err().to_string();
        assert!(refused.contains("not available in this version of wrad; available: auto, hardware, off"));
    }

    #[test]
    fn a_thread_without_a_team_is_the_one_worker() {
        let mut opened = Counting::Auto.open(None).unwrap();
        opened.as_ref().unwrap().span(None, COUNTED, |_| ()).unwrap();
        match told(opened.as_mut()) {
            Known::Value(counters) => {
                assert_eq!((counters.workers.len(), &counters.leader), (1, &None));
                assert_eq!(counters.workers[0], counters.total);
            }
            Known::Unavailable { unavailable } => assert!(unavailable.len() > 10),
        }
    }
}
