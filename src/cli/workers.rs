//! Who will work: the schedule by its name, and for those that run on a team, which worker goes where.

use ccnuma::arena::Memory;
use ccnuma::{Machine, Policy, Team};

use crate::output::report::{Known, Worker};
use crate::schedule::{Batches, Walks};

use super::Error;
use super::choice::choose;

/// The schedule where none is named.
pub(super) const DEFAULT_SCHEDULE: &str = "stealing";

/// The schedules: their name, whether a team runs them, and how many surfaces shoot at once.
const SCHEDULES: [(&str, (&str, bool, Batches)); 7] = [
    ("sequential", ("sequential", false, Batches::Fitted)),
    ("inner-loop", ("inner-loop", true, Batches::Single)),
    ("single-queue", ("single-queue", true, walks(true, false))),
    ("single-queue+lure", ("single-queue+lure", true, walks(true, true))),
    ("outer-loop", ("outer-loop", true, walks(false, false))),
    ("outer-loop+lure", ("outer-loop+lure", true, walks(false, true))),
    ("stealing", ("stealing", true, Batches::Fitted)),
];

const fn walks(together: bool, lure: bool) -> Batches {
    Batches::None(Walks { together, lure })
}

/// Who will work, checked.
#[derive(Clone, Debug)]
pub struct Workers {
    /// The schedule's name.
    pub schedule: &'static str,
    /// How many surfaces shoot at once.
    pub batches: Batches,
    /// Where elements live.
    pub memory: Memory,
    /// Where each worker goes; `None` where the thread of the run does all of it.
    pub plan: Option<ccnuma::Plan>,
}

impl Workers {
    /// Lays the workers over this machine: without `threads` one per core, without `pin` compactly.
    ///
    /// # Errors
    /// [`Error::Input`]: an unknown name, more workers than CPUs to pin them to, or a worker for a schedule that has none.
    pub fn new(schedule: &str, threads: Option<&str>, pin: Option<&str>) -> Result<Self, Error> {
        let (schedule, on_team, batches) = self::schedule("--schedule", schedule)?;
        let plan = if on_team { Some(plan(threads, pin)?) } else { None };
        if !on_team {
            let needless = |option, given: Option<&str>, only| match given {
                Some(value) if value != only => Err(Error::Input(format!(
                    "{option} {value}: --schedule {schedule} runs on one thread, which is not pinned; \
                     leave {option} out or name another schedule"
                ))),
                _ => Ok(()),
            };
            needless("--threads", threads, "1")?;
            needless("--pin", pin, "none")?;
        }
        let memory = if on_team { Memory::Node } else { Memory::Malloc };
        Ok(Self { schedule, batches, memory, plan })
    }

    /// The same with elements where `name` says, if it is given.
    ///
    /// # Errors
    /// [`Error::Input`]: an unknown name, or nodes for a schedule that has none.
    pub fn with_memory(self, name: Option<&str>) -> Result<Self, Error> {
        let Some(name) = name else { return Ok(self) };
        let all = [Memory::Node, Memory::Interleave, Memory::FirstTouch, Memory::Malloc];
        let names = all.map(|memory| (memory.to_string(), memory));
        let available: Vec<(&str, Memory)> = names.iter().map(|(name, memory)| (&**name, *memory)).collect();
        let memory = choose("--memory", name, &available, &[])?;
        if self.plan.is_none() && !matches!(memory, Memory::Malloc | Memory::FirstTouch) {
            return Err(Error::Input(format!(
                "--memory {name}: --schedule {} runs on one thread, which is on no node; \
                 use malloc or first-touch, or name another schedule",
                self.schedule
            )));
        }
        Ok(Self { memory, ..self })
    }

    /// Starts and pins the team, if there is to be one.
    ///
    /// # Errors
    /// [`Error::Failed`]: the system refused a thread or a pin.
    pub fn team(&self) -> Result<Option<Team>, Error> {
        let team = self.plan.as_ref().map(Team::new).transpose();
        team.map_err(|problem| Error::Failed(problem.to_string()))
    }

    /// Number of workers.
    pub fn count(&self) -> usize {
        self.plan.as_ref().map_or(1, |plan| plan.slots.len())
    }

    /// The policy by which they are pinned.
    pub fn policy(&self) -> String {
        self.plan.as_ref().map_or(Policy::None, |plan| plan.policy.clone()).to_string()
    }
}

/// The schedule of this name: its name, whether a team runs it, and how many surfaces shoot at once.
///
/// # Errors
/// [`Error::Input`]: there is none of that name, or it locks nothing that a lure could spare waiting for.
pub(super) fn schedule(option: &str, name: &str) -> Result<(&'static str, bool, Batches), Error> {
    let known = |name: &str| SCHEDULES.iter().any(|(known, _)| *known == name);
    match name.strip_suffix("+lure") {
        Some(plain) if known(plain) && !known(name) => Err(Error::Input(format!(
            "{option} {name}: {plain} locks no receiver, so there is nothing to lure; \
             +lure goes with single-queue and outer-loop"
        ))),
        _ => choose(option, name, &SCHEDULES, &[]),
    }
}

fn plan(threads: Option<&str>, pin: Option<&str>) -> Result<ccnuma::Plan, Error> {
    let input = |problem: ccnuma::Error| Error::Input(problem.to_string());
    let number = |text: &str| match text.parse::<usize>() {
        Ok(number) if number > 0 => Ok(number),
        _ => Err(Error::Input(format!("--threads {text}: expected a number of workers, at least 1"))),
    };
    let threads = threads.map(number).transpose()?;
    let policy: Policy = pin.unwrap_or("compact").parse().map_err(input)?;
    let machine = Machine::this_machine().map_err(input)?;
    ccnuma::Plan::new(machine.into(), policy, threads).map_err(input)
}

/// Where each worker of a team was, and what it did in the `wall_s` seconds of a run; `team` is `None` for a run without one.
pub(super) fn account(team: Option<&mut Team>, wall_s: f64) -> Vec<Worker> {
    let free = || Known::unavailable("not pinned (--pin none)");
    let Some(team) = team else {
        let node = Known::unavailable("not pinned");
        return vec![Worker {
            cpu: Known::unavailable("not pinned"),
            node,
            busy_s: wall_s,
            ..Worker::default()
        }];
    };
    let times = team.times();
    let machine = &team.plan().machine;
    let workers = team.plan().slots.iter().zip(times).map(|(slot, times)| {
        let steal_s = times.steal_near_s + times.steal_far_s;
        let at_work_s = times.busy_s + steal_s + times.barrier_s + times.lock_s;
        Worker {
            cpu: slot.cpu.map_or_else(free, |cpu| Known::Value(cpu as u32)),
            node: slot.cpu.map_or_else(free, |_| Known::Value(machine.nodes[slot.node].os as u32)),
            busy_s: times.busy_s,
            idle_s: (wall_s - at_work_s).max(0.0),
            steal_s,
            barrier_s: times.barrier_s,
            lock_s: times.lock_s,
            lock_waits: times.lock_waits,
            lures: times.deferrals,
            tasks: times.tasks,
            steals_near: times.steals_near,
            steals_far: times.steals_far,
        }
    });
    workers.collect()
}
