//! Where a record is replayed: workers on the nodes of a machine, real or synthetic, and what distance, waking and locking cost there.
//!
//! The constants are measured where this project's machines allow it, on two workers of one node (`cargo bench -p ccnuma --bench team`), and
//! assumed, with the reason, where they do not: what crosses nodes follows the machine's table of distances.

use ccnuma::{Error, Machine, Plan, Policy};

use super::Nanos;

/// A conductor wakes one worker: a system call on its side. Assumed, between the 1 µs that such a call takes at least and the 9 µs by which an
/// empty job on two workers costs more than two wake-ups, where three threads share two CPUs.
const SEND: Nanos = 2_000;
/// From there until the worker looks for work, and from the last worker's end until the conductor goes on. Measured: an empty task on one
/// worker, from outside and back, takes 6 to 7 µs.
const WAKE: Nanos = 3_300;
/// To offer a half to others and to take it back. Measured: an empty leaf of a fork-join tree.
const FORK: Nanos = 20;
/// To take a task from a worker of the same node: some cache lines from another core, and a thread that looks around. Measured: a barrier of
/// two workers, which is as many lines, takes 1.5 to 2.1 µs.
const STEAL: Nanos = 2_000;
/// To add to a counter that all share, or to take and leave a lock, when nobody else is at it: one cache line. Assumed.
const LINE: Nanos = 50;
/// Share of a task's time that goes into memory at its home, when that is near. Assumed: no counter here tells it.
const MEMORY_SHARE: f64 = 0.05;

/// Workers on a machine.
#[derive(Clone, Debug)]
pub struct Site {
    /// Node of every worker.
    pub(super) node: Vec<usize>,
    /// Number of workers of every node.
    pub(super) staff: Vec<usize>,
    /// Distance between nodes; 1 is local.
    distance: Vec<Vec<f64>>,
    /// Where a worker looks for tasks, nearest first; workers equally near together.
    pub(super) looks: Vec<Vec<Look>>,
}

/// A place where tasks may be found.
#[derive(Clone, Debug)]
pub(super) enum Look {
    /// What was sent to a node.
    Inbox(usize),
    /// What other workers offer.
    Workers(Vec<usize>),
}

impl Site {
    /// Lays workers over a machine, compactly.
    ///
    /// # Errors
    /// The machine has fewer CPUs.
    pub fn new(machine: &Machine, workers: usize) -> Result<Self, Error> {
        let plan = Plan::new(machine.clone().into(), Policy::Compact, Some(workers))?;
        let local = |node: usize| machine.distances[node][node].max(1) as f64;
        let row = |(node, row): (usize, &Vec<u64>)| row.iter().map(|d| *d as f64 / local(node)).collect();
        Ok(Self {
            node: plan.slots.iter().map(|slot| slot.node).collect(),
            staff: plan.workers_by_node().iter().map(Vec::len).collect(),
            distance: machine.distances.iter().enumerate().map(row).collect(),
            looks: (0..workers).map(|worker| looks(&plan, worker)).collect(),
        })
    }

    /// Number of workers.
    pub fn workers(&self) -> usize {
        self.node.len()
    }

    /// Number of nodes with workers.
    pub fn nodes(&self) -> usize {
        self.staff.iter().filter(|workers| **workers > 0).count()
    }

    /// When worker `index` looks for work after a job has begun.
    pub(super) fn start(&self, index: usize) -> Nanos {
        SEND * (index as Nanos + 1) + WAKE
    }

    /// From the end of a job until the conductor goes on.
    pub(super) fn end(&self) -> Nanos {
        WAKE
    }

    /// From an offer until a worker that waits looks at it.
    pub(super) fn wake(&self) -> Nanos {
        STEAL
    }

    /// To offer a half and take it back.
    pub(super) fn fork(&self) -> Nanos {
        FORK
    }

    /// To take a task across this distance.
    pub(super) fn steal(&self, worker: usize, from: usize) -> Nanos {
        (STEAL as f64 * self.distance[self.node[worker]][from]) as Nanos
    }

    /// To get hold of a line that all share: it comes from the other workers, near and far.
    pub(super) fn shared_line(&self, worker: usize) -> Nanos {
        let here = self.node[worker];
        let far: f64 = (0..self.staff.len()).map(|n| self.staff[n] as f64 * self.distance[here][n]).sum();
        (LINE as f64 * far / self.workers() as f64) as Nanos
    }

    /// What work of this length on data of a node's memory costs a worker on top.
    pub(super) fn remote(&self, worker: usize, home: usize, work: Nanos) -> Nanos {
        (work as f64 * MEMORY_SHARE * (self.distance[self.node[worker]][home] - 1.0)) as Nanos
    }
}

/// Own node first: its inbox, then its workers; the other nodes by distance, each likewise.
fn looks(plan: &Plan, worker: usize) -> Vec<Look> {
    let here = plan.slots[worker].node;
    let by_node = plan.workers_by_node();
    let mut looks = Vec::new();
    for node in plan.machine.nodes_by_distance(here) {
        let mut others: Vec<usize> = by_node[node].iter().copied().filter(|other| *other != worker).collect();
        // Thieves begin at different victims.
        let shift = worker % others.len().max(1);
        others.rotate_left(shift);
        looks.extend([Look::Inbox(node), Look::Workers(others)]);
    }
    looks
}
