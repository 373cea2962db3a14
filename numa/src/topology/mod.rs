//! A machine as a plain table: CPUs, cores, caches, packages, nodes, distances, and what this process may use.
//!
//! The table is filled by `read` from the real machine, an hwloc synthetic string, or an hwloc XML file, and is
//! then only data: planning for another machine is planning for this one.
//!
//! Invariants: `cpus` are in hwloc's logical order (neighbours share caches); `nodes` ascend by operating-system
//! number, which may have gaps; every CPU has a home node; a CPU that is `allowed` is in its node's `cpus`.

mod read;

use serde::Serialize;

use crate::cpuset::CpuSet;
use crate::error::Error;

/// Distance of a node to itself, as firmware tables and the kernel count it.
const LOCAL_DISTANCE: u64 = 10;
/// Assumed distance between nodes of one package, where no table exists (an EPYC's, four nodes per package).
const PACKAGE_DISTANCE: u64 = 12;
/// Assumed distance between nodes of different packages.
const REMOTE_DISTANCE: u64 = 32;

/// Where a table comes from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// The machine this process runs on: plans can be run.
    ThisMachine,
    /// An hwloc synthetic description.
    Synthetic(String),
    /// An hwloc XML file.
    Xml(String),
    /// `HWLOC_SYNTHETIC` or `HWLOC_XMLFILE` in the environment replaced the machine behind our back.
    Environment,
}

impl std::fmt::Display for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::ThisMachine => f.write_str("this machine"),
            Self::Synthetic(description) => write!(f, "the synthetic machine {description:?}"),
            Self::Xml(path) => write!(f, "the machine in {path}"),
            Self::Environment => f.write_str("the machine that HWLOC_SYNTHETIC or HWLOC_XMLFILE names"),
        }
    }
}

/// A logical processor: what a worker is pinned to.
#[derive(Clone, Debug, Serialize)]
pub struct Cpu {
    /// Number in the operating system.
    pub os: usize,
    /// Physical core, numbered over the machine.
    pub core: usize,
    /// Rank among the allowed CPUs of its core: 0 is the one to use first.
    pub smt: usize,
    /// Package (socket), by position.
    pub package: usize,
    /// Home node, by position in [`Machine::nodes`].
    pub node: usize,
    /// Data caches that serve it, nearest first, by position in [`Machine::caches`].
    pub caches: Vec<usize>,
    /// Whether this process may run here.
    pub allowed: bool,
}

/// A NUMA node: memory, and perhaps CPUs.
#[derive(Clone, Debug, Serialize)]
pub struct Node {
    /// Number in the operating system.
    pub os: usize,
    /// Allowed CPUs whose home this is.
    pub cpus: CpuSet,
    /// Whether it has CPUs at all, allowed or not; a memory-only node has none.
    pub has_cpus: bool,
    /// Packages it is near to, by position.
    pub packages: CpuSet,
    /// Its memory as reported; never size anything from it.
    pub memory_bytes: u64,
}

/// A data or unified cache.
#[derive(Clone, Debug, Serialize)]
pub struct Cache {
    /// 1, 2, 3 …
    pub level: usize,
    /// Capacity in bytes; 0 where not reported.
    pub size_bytes: u64,
    /// Line size in bytes; 0 where not reported.
    pub line_bytes: usize,
    /// CPUs that share it.
    pub cpus: CpuSet,
}

/// The whole table.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// Where it comes from.
    pub source: Source,
    /// CPUs, in logical order.
    pub cpus: Vec<Cpu>,
    /// Nodes, ascending by operating-system number.
    pub nodes: Vec<Node>,
    /// Caches, by level, then in logical order.
    pub caches: Vec<Cache>,
    /// Number of packages.
    pub packages: usize,
    /// `distances[from][to]` between nodes by position; 10 is local.
    pub distances: Vec<Vec<u64>>,
    /// Whether the distances were assumed because the machine reports none.
    pub distances_assumed: bool,
    /// CPUs this process may use.
    pub allowed: CpuSet,
}

impl Machine {
    /// The machine this process runs on, restricted to the mask the process was started with.
    pub fn this_machine() -> Result<Self, Error> {
        read::this_machine()
    }

    /// A machine from an hwloc synthetic description, such as `pack:2 numa:4 l3:4 l2:4 core:1 pu:2`.
    pub fn synthetic(description: &str) -> Result<Self, Error> {
        read::synthetic(description)
    }

    /// A machine from a file that `lstopo FILE.xml` wrote.
    pub fn from_xml(path: &std::path::Path) -> Result<Self, Error> {
        read::xml(path)
    }

    /// The same machine for a process that may use only `mask`.
    pub fn restricted_to(mut self, mask: &CpuSet) -> Result<Self, Error> {
        let mut used = std::collections::HashMap::new();
        for cpu in &mut self.cpus {
            cpu.allowed = mask.contains(cpu.os);
            cpu.smt = 0;
            if cpu.allowed {
                let rank: &mut usize = used.entry(cpu.core).or_default();
                cpu.smt = std::mem::replace(rank, *rank + 1);
            }
        }
        self.allowed = self.cpus.iter().filter(|cpu| cpu.allowed).map(|cpu| cpu.os).collect();
        if self.allowed.is_empty() {
            return Err(Error::NoCpu { what: self.source.to_string(), allowed: mask.clone() });
        }
        for (index, node) in self.nodes.iter_mut().enumerate() {
            let own = self.cpus.iter().filter(|cpu| cpu.allowed && cpu.node == index);
            node.cpus = own.map(|cpu| cpu.os).collect();
        }
        Ok(self)
    }

    /// The CPU with this operating-system number.
    pub fn cpu(&self, os: usize) -> Option<&Cpu> {
        self.cpus.iter().find(|cpu| cpu.os == os)
    }

    /// Position of the node with this operating-system number.
    pub fn node_position(&self, os: usize) -> Option<usize> {
        self.nodes.iter().position(|node| node.os == os)
    }

    /// Physical cores with at least one allowed CPU.
    pub fn cores(&self) -> usize {
        self.cpus.iter().filter(|cpu| cpu.allowed && cpu.smt == 0).count()
    }

    /// Node positions from nearest to farthest as seen from `node`, itself first. Equals follow by how far their numbers lie apart, round
    /// the machine: each node begins with others, and those whose data lie side by side begin with each other.
    pub fn nodes_by_distance(&self, node: usize) -> Vec<usize> {
        let count = self.nodes.len();
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by_key(|&other| {
            let after = (other + count - node) % count;
            (other != node, self.distances[node][other], after.min(count - after), after)
        });
        order
    }

    /// How far apart two CPUs are: the level of the nearest cache they share, else the distance of their nodes.
    pub fn closeness(&self, a: &Cpu, b: &Cpu) -> Closeness {
        let shared = a.caches.iter().find(|cache| b.caches.contains(cache));
        match shared {
            Some(&cache) if a.node == b.node => Closeness::Cache(self.caches[cache].level),
            _ if a.node == b.node => Closeness::Node,
            _ => Closeness::Remote(self.distances[a.node][b.node]),
        }
    }

    /// Fills in distances where the machine reports none.
    fn assume_distances(&mut self) {
        let near = |a: &Node, b: &Node| !a.packages.intersection(&b.packages).is_empty();
        let row = |from: usize| {
            let to = self.nodes.iter().enumerate().map(|(to, node)| match () {
                () if from == to => LOCAL_DISTANCE,
                () if near(&self.nodes[from], node) => PACKAGE_DISTANCE,
                () => REMOTE_DISTANCE,
            });
            to.collect()
        };
        self.distances = (0..self.nodes.len()).map(row).collect();
        self.distances_assumed = true;
    }
}

/// What two CPUs share, nearest first in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Closeness {
    /// A cache of this level, on one node.
    Cache(usize),
    /// A node.
    Node,
    /// Nothing but the interconnect; the distance of the nodes.
    Remote(u64),
}

#[cfg(test)]
mod tests;
