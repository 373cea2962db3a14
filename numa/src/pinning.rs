//! Policies that turn a machine into a list of workers: which worker goes on which CPU, near which memory.
//!
//! A plan is data: it can be made and shown for a machine that is not here. Only [`crate::team::Team`] applies it,
//! and reads every pin back.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use serde::{Serialize, Serializer};

use crate::cpuset::parse_list;
use crate::error::Error;
use crate::topology::{Cpu, Machine};

/// How workers are laid over CPUs.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub enum Policy {
    /// Fill the cores of a node, then the next node's; second hardware threads only when every core has a worker.
    #[default]
    Compact,
    /// One worker on each node in turn; second hardware threads only when every core has a worker.
    Scatter,
    /// No pin: the operating system places workers, and there may be more of them than CPUs.
    None,
    /// These CPUs (operating-system numbers), in this order; the only way to use `isolcpus` cores.
    List(Vec<usize>),
}

impl FromStr for Policy {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        match text.trim() {
            "compact" => Ok(Self::Compact),
            "scatter" => Ok(Self::Scatter),
            "none" => Ok(Self::None),
            list => match parse_list(list)? {
                cpus if cpus.is_empty() => {
                    Err(Error::CpuList { text: text.to_owned(), found: "nothing".to_owned() })
                }
                cpus => Ok(Self::List(cpus)),
            },
        }
    }
}

impl fmt::Display for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Compact => f.write_str("compact"),
            Self::Scatter => f.write_str("scatter"),
            Self::None => f.write_str("none"),
            Self::List(cpus) => f.write_str(&cpus.iter().map(usize::to_string).collect::<Vec<_>>().join(",")),
        }
    }
}

impl Serialize for Policy {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Where one worker goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Slot {
    /// The CPU it is pinned to (operating-system number); `None` leaves it free.
    pub cpu: Option<usize>,
    /// Its node, by position in [`Machine::nodes`]; for a free worker, the node it is counted to.
    pub node: usize,
}

/// A machine, a policy, and a slot for every worker.
#[derive(Clone, Debug, Serialize)]
pub struct Plan {
    /// The machine planned for.
    pub machine: Arc<Machine>,
    /// The policy.
    pub policy: Policy,
    /// Slots by worker index.
    pub slots: Vec<Slot>,
}

impl Plan {
    /// Lays `workers` over `machine`; by default one per physical core, or one per listed CPU.
    pub fn new(machine: Arc<Machine>, policy: Policy, workers: Option<usize>) -> Result<Self, Error> {
        let order = order(&machine, &policy)?;
        let default = if matches!(policy, Policy::List(_)) { order.len() } else { machine.cores() };
        let workers = workers.unwrap_or(default);
        if workers == 0 {
            return Err(Error::NoWorker);
        }
        let free = policy == Policy::None;
        if workers > order.len() && !free {
            return Err(Error::TooManyWorkers {
                asked: workers,
                available: order.len(),
                policy: policy.to_string(),
            });
        }
        let slot = |cpu: &&Cpu| Slot { cpu: (!free).then_some(cpu.os), node: cpu.node };
        let slots = order.iter().cycle().take(workers).map(slot).collect();
        Ok(Self { machine, policy, slots })
    }

    /// Workers by node position; empty for nodes without workers.
    pub fn workers_by_node(&self) -> Vec<Vec<usize>> {
        let mut nodes = vec![Vec::new(); self.machine.nodes.len()];
        for (worker, slot) in self.slots.iter().enumerate() {
            nodes[slot.node].push(worker);
        }
        nodes
    }

    /// The node with workers that is nearest to `node`: itself where it has any.
    pub fn nearest_staffed_node(&self, node: usize) -> usize {
        let staffed = |node: &usize| self.slots.iter().any(|slot| slot.node == *node);
        self.machine.nodes_by_distance(node).into_iter().find(staffed).unwrap_or(node)
    }
}

/// The CPUs in the order in which workers take them.
fn order<'m>(machine: &'m Machine, policy: &Policy) -> Result<Vec<&'m Cpu>, Error> {
    let mut cpus: Vec<&Cpu> = machine.cpus.iter().filter(|cpu| cpu.allowed).collect();
    // Stable sorts: ties keep hwloc's logical order, in which neighbours share caches.
    match policy {
        Policy::Compact => cpus.sort_by_key(|cpu| (cpu.smt, cpu.node)),
        Policy::Scatter | Policy::None => {
            cpus.sort_by_key(|cpu| (cpu.smt, cpu.node));
            let mut rank = 0;
            let mut previous = None;
            let mut ranked = Vec::with_capacity(cpus.len());
            for cpu in cpus {
                rank = if previous == Some((cpu.smt, cpu.node)) { rank + 1 } else { 0 };
                previous = Some((cpu.smt, cpu.node));
                ranked.push((cpu.smt, rank, cpu));
            }
            ranked.sort_by_key(|&(smt, rank, cpu)| (smt, rank, cpu.node));
            cpus = ranked.into_iter().map(|(.., cpu)| cpu).collect();
        }
        Policy::List(list) => {
            cpus.clear();
            for &os in list {
                let usable = || machine.cpus.iter().map(|cpu| cpu.os).collect();
                let cpu = machine.cpu(os).ok_or_else(|| Error::UnknownCpu { cpu: os, usable: usable() })?;
                if cpus.iter().any(|other| other.os == os) {
                    return Err(Error::DuplicateCpu { cpu: os });
                }
                cpus.push(cpu);
            }
        }
    }
    Ok(cpus)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(machine: &str, policy: &str, workers: Option<usize>) -> Result<Plan, Error> {
        Plan::new(Arc::new(Machine::synthetic(machine)?), policy.parse()?, workers)
    }

    fn cpus(plan: &Plan) -> Vec<usize> {
        plan.slots.iter().map(|slot| slot.cpu.unwrap()).collect()
    }

    const SMALL: &str = "numa:2 core:2 pu:2";
    const EPYC: &str = "pack:2 numa:4 l3:4 l2:4 l1d:1 core:1 pu:2";

    #[test]
    fn compact_fills_a_node_and_uses_second_threads_last() {
        assert_eq!(cpus(&plan(SMALL, "compact", Some(8)).unwrap()), [0, 2, 4, 6, 1, 3, 5, 7]);
        assert_eq!(plan(SMALL, "compact", None).unwrap().slots.len(), 4);
    }

    #[test]
    fn scatter_goes_round_the_nodes() {
        assert_eq!(cpus(&plan(SMALL, "scatter", Some(8)).unwrap()), [0, 4, 2, 6, 1, 5, 3, 7]);
        let nodes: Vec<_> =
            plan(EPYC, "scatter", Some(9)).unwrap().slots.iter().map(|slot| slot.node).collect();
        assert_eq!(nodes, [0, 1, 2, 3, 4, 5, 6, 7, 0]);
    }

    #[test]
    fn uneven_nodes_still_take_every_cpu_once() {
        for policy in ["compact", "scatter"] {
            let machine =
                Machine::synthetic(EPYC).unwrap().restricted_to(&"5-40,200".parse().unwrap()).unwrap();
            let allowed = machine.allowed.clone();
            let plan = Plan::new(Arc::new(machine), policy.parse().unwrap(), Some(37)).unwrap();
            assert_eq!(cpus(&plan).into_iter().collect::<crate::cpuset::CpuSet>(), allowed);
        }
    }

    #[test]
    fn the_paper_puts_two_processes_on_a_node() {
        let plan = plan("numa:32 core:2 pu:1", "compact", Some(64)).unwrap();
        assert!(
            plan.workers_by_node()
                .iter()
                .enumerate()
                .all(|(node, workers)| *workers == [2 * node, 2 * node + 1])
        );
    }

    #[test]
    fn lists_keep_their_order_and_may_leave_the_mask() {
        assert_eq!(cpus(&plan(SMALL, "6,0-1", None).unwrap()), [6, 0, 1]);
        let machine = Machine::synthetic(SMALL).unwrap().restricted_to(&"0-3".parse().unwrap()).unwrap();
        let plan = Plan::new(Arc::new(machine), Policy::List(vec![7]), None).unwrap();
        assert_eq!(plan.slots, [Slot { cpu: Some(7), node: 1 }], "an isolated CPU is only reached by a list");
    }

    #[test]
    fn refusals_name_a_remedy() {
        for (policy, workers, word) in [
            ("compact", Some(9), "`none`"),
            ("0-1", Some(3), "at most 2"),
            ("0,0", None, "twice"),
            ("0,99", None, "0-7"),
            ("compakt", None, "compakt"),
            ("", None, "nothing"),
            ("compact", Some(0), "at least one"),
        ] {
            let error = plan(SMALL, policy, workers).unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }

    #[test]
    fn none_may_oversubscribe() {
        let plan = plan(SMALL, "none", Some(100)).unwrap();
        assert!(plan.slots.iter().all(|slot| slot.cpu.is_none()));
        assert_eq!(plan.workers_by_node().iter().map(Vec::len).collect::<Vec<_>>(), [50, 50]);
    }

    #[test]
    fn work_for_a_memory_only_node_goes_to_the_nearest_workers() {
        let machine = "pack:2 [numa] [numa] core:2 pu:1";
        let plan = plan(machine, "compact", None).unwrap();
        assert_eq!((0..4).map(|node| plan.nearest_staffed_node(node)).collect::<Vec<_>>(), [0, 0, 2, 2]);
    }

    #[test]
    fn two_thousand_cpus() {
        let plan = plan("pack:16 numa:1 core:64 pu:2", "compact", Some(2048)).unwrap();
        assert_eq!(plan.slots[1024].cpu, Some(1));
        assert_eq!(plan.slots[2047].node, 15);
    }
}
