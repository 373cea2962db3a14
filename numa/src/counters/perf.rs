//! The CPU's events: batches opened by the thread they count, read with the time they really ran.

use std::collections::BTreeMap;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};

use perf_event::events::Software;
use perf_event::{Builder, Counter, Group as KernelGroup};

use super::group::{Event, Group};
use super::kernel;

/// A count, and for how long (ns) it was wanted and really counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Count {
    pub count: u64,
    pub enabled_ns: u64,
    pub running_ns: u64,
}

/// What every event has counted so far, or why it has not.
pub type Counts = BTreeMap<String, Result<Count, String>>;

struct Batch {
    group: KernelGroup,
    members: Vec<(String, Counter)>,
}

/// The events of one thread.
pub struct ThreadCounters {
    batches: Vec<Batch>,
    refused: BTreeMap<String, String>,
}

impl std::fmt::Debug for ThreadCounters {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ThreadCounters").field("refused", &self.refused).finish_non_exhaustive()
    }
}

impl ThreadCounters {
    /// Opens a group's events for the calling thread, and starts them. What the kernel refuses is remembered with its reason.
    pub fn open(group: &Group) -> Self {
        let mut counters = Self { batches: Vec::new(), refused: BTreeMap::new() };
        for events in &group.batches {
            match Batch::open(events) {
                Ok(batch) => counters.batches.push(batch),
                Err(error) => {
                    let reason = explain(&error);
                    let refused = events.iter().map(|event| (event.name.clone(), reason.clone()));
                    counters.refused.extend(refused);
                }
            }
        }
        counters
    }

    /// Events that were refused, with the reasons.
    pub fn refused(&self) -> &BTreeMap<String, String> {
        &self.refused
    }

    /// What was counted since the start.
    pub fn read(&mut self) -> Counts {
        let mut counts: Counts =
            self.refused.iter().map(|(name, reason)| (name.clone(), Err(reason.clone()))).collect();
        kernel::read(&mut counts);
        for batch in &mut self.batches {
            batch.read(&mut counts);
        }
        counts
    }
}

impl Batch {
    fn open(events: &[Event]) -> io::Result<Self> {
        // A group's placeholder is granted where no event is, and takes milliseconds if it is the system's first.
        if let Some(first) = events.first() {
            drop(builder(first).build()?);
        }
        let mut group = KernelGroup::new()?;
        let mut members = Vec::with_capacity(events.len());
        for event in events {
            members.push((event.name.clone(), builder(event).group(&mut group).build()?));
        }
        group.enable()?;
        Ok(Self { group, members })
    }

    fn read(&mut self, counts: &mut Counts) {
        // perf-event asserts that the kernel's numbers make sense; on some virtual machines they do not.
        let read = catch_unwind(AssertUnwindSafe(|| self.group.read()));
        let failed =
            |reason: String| self.members.iter().map(move |(name, _)| (name.clone(), Err(reason.clone())));
        match read {
            Ok(Ok(values)) => {
                let (enabled_ns, running_ns) = (values.time_enabled(), values.time_running());
                counts.extend(self.members.iter().map(|(name, member)| {
                    let count = values.get(member).copied();
                    let count = count.ok_or_else(|| "the kernel left the event out of its group".to_owned());
                    (name.clone(), count.map(|count| Count { count, enabled_ns, running_ns }))
                }));
            }
            Ok(Err(error)) => counts.extend(failed(explain(&error))),
            Err(_) => counts.extend(failed("the kernel reported more time running than enabled".to_owned())),
        }
    }
}

/// The event in user mode.
fn builder(event: &Event) -> Builder<'_> {
    // The kind is replaced at once: the builder knows no raw events.
    let mut builder = Builder::new().kind(Software::DUMMY);
    builder.attrs_mut().type_ = event.kind;
    builder.attrs_mut().config = event.config;
    builder.exclude_kernel(true);
    builder
}

/// A reason with its remedy.
fn explain(error: &io::Error) -> String {
    match error.raw_os_error() {
        Some(libc::ENOENT | libc::EOPNOTSUPP | libc::ENODEV) => {
            "this CPU has no such hardware counter, or the virtual machine hides it: ask for a PMU (vPMU, `-cpu host`)"
                .to_owned()
        }
        Some(libc::EACCES | libc::EPERM) => {
            let paranoid = std::fs::read_to_string("/proc/sys/kernel/perf_event_paranoid");
            format!(
                "not permitted: perf_event_paranoid is {}; set it to 1 (sysctl kernel.perf_event_paranoid=1), give the \
                 program CAP_PERFMON, and in a container allow the system call perf_event_open",
                paranoid.unwrap_or_default().trim()
            )
        }
        Some(libc::ENOSYS) => "this kernel, or the container's filter, has no perf_event_open".to_owned(),
        Some(libc::EINVAL) => "this CPU does not know the event: use the group for its family".to_owned(),
        Some(libc::EMFILE | libc::ENFILE) => "no file descriptors left: raise the limit (ulimit -n)".to_owned(),
        _ => error.to_string(),
    }
}

#[cfg(test)]
mod tests;
