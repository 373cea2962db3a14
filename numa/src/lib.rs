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
//! | [`warnings`] | what had to be replaced by something weaker, and why |

pub mod affinity;
pub mod arena;
pub mod cpuset;
pub mod error;
pub mod pages;
pub mod pinning;
pub mod topology;
pub mod warnings;

pub use error::Error;
