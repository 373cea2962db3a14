//! What a program needs to use a cache-coherent NUMA machine well, in safe Rust: the machine as a table, pinned
//! teams of workers, memory on chosen nodes, per-thread statics, replicas, and hardware counters.
//!
//! | module | what lives there |
//! |---|---|
//! | [`cpuset`] | sets of CPU numbers of any size |
//! | [`error`] | every refusal, with its remedy |
//! | [`affinity`] | the process's mask, pins, and helper threads that do not inherit them |
//! | [`topology`] | nodes, CPUs, caches, distances: this machine, a synthetic one, or one from a file |
//! | [`pinning`] | policies that lay workers over a machine |
//! | [`pages`] | ranges of pages on chosen nodes, and where pages are |
//! | [`arena`] | typed bump arenas on them, with handles that own what they point to |
//! | [`barrier`] | a two-level barrier that spins, then parks |
//! | [`deferred`] | a lock that nobody has to wait for: contributions are left for the next holder |
//! | [`team`] | pinned workers: run on all, items on home nodes, fork-join, NUMA-ordered stealing |
//! | [`mod@per_thread`] | statics with one slot per worker, and values with one per worker of a team |
//! | [`exhausted`] | the end of memory: a message instead of an abort |
//! | [`replicate`] | read-mostly data, one copy per node |
//! | [`counters`] | hardware counters per worker and region, with groups of events as data |
//! | [`report`] | the machine, the plan, and a live check, as text and JSON |
//! | [`warnings`] | what had to be replaced by something weaker, and why |

pub mod affinity;
pub mod arena;
pub mod barrier;
pub mod counters;
pub mod cpuset;
pub mod deferred;
pub mod error;
pub mod exhausted;
pub mod pages;
pub mod per_thread;
pub mod pinning;
mod queue;
pub mod replicate;
pub mod report;
mod sync;
pub mod team;
pub mod topology;
pub mod warnings;

pub use arena::{Arena, ArenaBox};
pub use deferred::Deferred;
pub use error::Error;
pub use pinning::{Plan, Policy};
pub use team::{Home, Team, Worker, WorkerPanic};
pub use topology::Machine;

/// The README's example is compiled as a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
