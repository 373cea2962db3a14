//! Every way this crate can refuse, each with its place and its remedy.

use crate::cpuset::CpuSet;

/// A refusal. The text names what was asked, what was found, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// hwloc could not read the machine or the description of one.
    #[error("cannot read the topology of {what}: {reason}")]
    Topology {
        /// What was read: this machine, a synthetic string, or an XML file.
        what: String,
        /// hwloc's reason.
        reason: String,
    },
    /// The machine has no CPU that this process may use.
    #[error(
        "no CPU of {what} may be used (allowed: {allowed}); widen the process's mask (taskset, cgroup cpuset)"
    )]
    NoCpu {
        /// Which machine.
        what: String,
        /// The mask that left nothing.
        allowed: CpuSet,
    },
    /// A list of CPUs, such as `0-3,8`, that cannot be read.
    #[error("CPU list {text:?}: expected numbers and ranges such as 0-3,8, found {found:?}")]
    CpuList {
        /// The whole text.
        text: String,
        /// The piece that is not a number or a range.
        found: String,
    },
    /// More workers were asked for than the policy has CPUs.
    #[error(
        "{asked} workers asked for, but policy `{policy}` has {available} CPUs; ask for at most {available}, \
         widen the process's mask (taskset, cgroup cpuset), or use policy `none` to oversubscribe"
    )]
    TooManyWorkers {
        /// Workers asked for.
        asked: usize,
        /// CPUs the policy can give.
        available: usize,
        /// The policy's name.
        policy: String,
    },
    /// A team of no workers.
    #[error("a team needs at least one worker; ask for 1 or more, or leave the number out")]
    NoWorker,
    /// An explicit list names a CPU twice.
    #[error("CPU {cpu} is listed twice; list each CPU once, or use policy `none` to oversubscribe")]
    DuplicateCpu {
        /// The CPU's number in the operating system.
        cpu: usize,
    },
    /// An explicit list names a CPU that this machine does not have.
    #[error("CPU {cpu} is not on this machine or not in its cpuset; choose among {usable}")]
    UnknownCpu {
        /// The CPU's number in the operating system.
        cpu: usize,
        /// The CPUs there are.
        usable: CpuSet,
    },
    /// The kernel refused a pin, or did not apply it.
    #[error(
        "cannot pin to CPU {cpu}: {reason}; choose CPUs inside the cgroup's cpuset, or use policy `none`"
    )]
    Pin {
        /// The CPU asked for.
        cpu: usize,
        /// What the kernel said, or what was read back.
        reason: String,
    },
    /// A plan made for a synthetic machine or an XML file cannot be run here.
    #[error("the plan is for {what}, not for this machine: it can be shown, not run")]
    ForeignMachine {
        /// Which machine.
        what: String,
    },
    /// The kernel could not give memory.
    #[error("cannot map {bytes} bytes: {reason}")]
    Map {
        /// Bytes asked for.
        bytes: usize,
        /// What the kernel said.
        reason: String,
    },
    /// A node that does not exist, or whose memory this process may not use.
    #[error("node {node} has no memory for this process: {reason}; choose another node")]
    Node {
        /// The node's number in the operating system.
        node: usize,
        /// What the kernel said.
        reason: String,
    },
    /// A node without room for a strict binding.
    #[error(
        "node {node} is full: {free_bytes} bytes free or reclaimable, {asked_bytes} asked for; use \
         `Placement::Preferred` or another node"
    )]
    NodeFull {
        /// The node's number in the operating system.
        node: usize,
        /// Bytes free or easily reclaimed.
        free_bytes: u64,
        /// Bytes asked for.
        asked_bytes: u64,
    },
    /// The kernel would not say where pages are.
    #[error("cannot ask where pages are: {reason}")]
    PageQuery {
        /// What the kernel said (EPERM in containers that block `move_pages`).
        reason: String,
    },
    /// Too many workers at once in one process, over all teams.
    #[error("{asked} workers at once in this process; at most {most} can have per-thread statics")]
    WorkerIds {
        /// Workers that would exist.
        asked: usize,
        /// The bound.
        most: usize,
    },
    /// The operating system would not start a thread.
    #[error("cannot start worker {worker}: {reason}")]
    Spawn {
        /// Worker index.
        worker: usize,
        /// What the operating system said.
        reason: String,
    },
}
