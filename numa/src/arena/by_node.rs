//! One worker's arenas, one per node: what it makes for an item lands on the item's home node, also when the item was
//! stolen.

use std::cell::OnceCell;
use std::fmt;
use std::str::FromStr;

use serde::Serialize;

use super::{Arena, Backend, Stats};
use crate::cpuset::CpuSet;
use crate::error::Error;
use crate::pages::{PageCount, Placement};
use crate::team::Worker;
use crate::topology::Machine;

/// Where a program's data shall live, as a study selects it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Memory {
    /// On the node that is named with each allocation.
    #[default]
    Node,
    /// Page by page round all nodes with CPUs, on small pages.
    Interleave,
    /// On the node of the worker that writes a page first.
    FirstTouch,
    /// Wherever the program's allocator puts it.
    Malloc,
}

/// A text that names no way to place memory.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("memory placement {0:?}: expected node, interleave, first-touch or malloc")]
pub struct UnknownMemory(String);

impl FromStr for Memory {
    type Err = UnknownMemory;

    fn from_str(text: &str) -> Result<Self, UnknownMemory> {
        let all = [Self::Node, Self::Interleave, Self::FirstTouch, Self::Malloc];
        all.into_iter()
            .find(|memory| memory.to_string() == text)
            .ok_or_else(|| UnknownMemory(text.to_owned()))
    }
}

impl fmt::Display for Memory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Node => "node",
            Self::Interleave => "interleave",
            Self::FirstTouch => "first-touch",
            Self::Malloc => "malloc",
        })
    }
}

/// A worker's arenas; keep them in a [`crate::per_thread::PerWorker`].
#[derive(Debug)]
pub struct NodeArenas {
    memory: Memory,
    /// Operating-system numbers by position; arenas are made at first use.
    nodes: Vec<(usize, OnceCell<Arena>)>,
    interleaved: CpuSet,
    /// The owner's node, by position: elsewhere it makes little, which goes on small pages.
    near: Option<usize>,
}

impl NodeArenas {
    /// Arenas for the nodes of a machine; nothing is mapped yet.
    pub fn new(machine: &Machine, memory: Memory) -> Self {
        let nodes = machine.nodes.iter().map(|node| (node.os, OnceCell::new())).collect();
        let interleaved = machine.nodes.iter().filter(|node| node.has_cpus).map(|node| node.os).collect();
        Self { memory, nodes, interleaved, near: None }
    }

    /// The same for a worker, which makes most of its data on its own node: on the other nodes its arenas have small pages, of which
    /// only those in use take memory, so that many workers on many nodes do not fill them with chunks that are nearly empty.
    pub fn of_worker(worker: &Worker, memory: Memory) -> Self {
        Self { near: Some(worker.node()), ..Self::new(&worker.plan().machine, memory) }
    }

    /// The arena for data whose home is `node`, by position in the machine's table. Without [`Memory::Node`] there is
    /// one arena for all.
    pub fn on_node(&self, node: usize) -> &Arena {
        let (os, arena) = &self.nodes[if self.memory == Memory::Node { node } else { 0 }];
        let far = self.memory == Memory::Node && self.near.is_some_and(|near| near != node);
        arena.get_or_init(|| {
            let arena = Arena::new(match self.memory {
                Memory::Node => Backend::Pages(Placement::Bind(*os)),
                Memory::Interleave => Backend::Pages(Placement::Interleave(self.interleaved.clone())),
                Memory::FirstTouch => Backend::Pages(Placement::FirstTouch),
                Memory::Malloc => Backend::Malloc,
            });
            // Huge pages would go round the nodes in lumps.
            if far || self.memory == Memory::Interleave { arena.on_small_pages() } else { arena }
        })
    }

    /// The arenas that are in use.
    pub fn in_use(&self) -> impl Iterator<Item = &Arena> {
        self.nodes.iter().filter_map(|(_, arena)| arena.get())
    }

    /// How their memory is placed.
    pub fn memory(&self) -> Memory {
        self.memory
    }

    /// Those in use with the node they are for (operating-system number); none but with [`Memory::Node`], whose arenas alone are for
    /// a node.
    pub fn by_node(&self) -> impl Iterator<Item = (usize, &Arena)> {
        let nodes = self.nodes.iter().filter(|_| self.memory == Memory::Node);
        nodes.filter_map(|(os, arena)| Some((*os, arena.get()?)))
    }

    /// The sum of their statistics.
    pub fn stats(&self) -> Stats {
        self.in_use().map(Arena::stats).fold(Stats::default(), |sum, stats| Stats {
            allocations: sum.allocations + stats.allocations,
            value_bytes: sum.value_bytes + stats.value_bytes,
            mapped_bytes: sum.mapped_bytes + stats.mapped_bytes,
            chunk_bytes: sum.chunk_bytes + stats.chunk_bytes,
            waste_bytes: sum.waste_bytes + stats.waste_bytes,
            chunks: sum.chunks + stats.chunks,
            free_chunks: sum.free_chunks + stats.free_chunks,
            placed_elsewhere: sum.placed_elsewhere + stats.placed_elsewhere,
        })
    }

    /// Where their pages are, asked from the kernel.
    pub fn count_pages(&self) -> Result<PageCount, Error> {
        let mut sum = PageCount::default();
        for arena in self.in_use() {
            sum.add(&arena.count_pages()?);
        }
        Ok(sum)
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn placements_are_named() {
        for name in ["node", "interleave", "first-touch", "malloc"] {
            assert_eq!(name.parse::<Memory>().unwrap().to_string(), name);
        }
        assert!("numa".parse::<Memory>().unwrap_err().to_string().contains("first-touch"));
    }

    #[test]
    #[cfg_attr(miri, ignore = "asks hwloc and the kernel")]
    fn each_node_has_its_arena_only_where_nodes_are_asked_for() {
        let machine = Machine::this_machine().unwrap();
        for memory in [Memory::Node, Memory::Interleave, Memory::FirstTouch, Memory::Malloc] {
            let arenas = NodeArenas::new(&machine, memory);
            let values: Vec<_> =
                (0..machine.nodes.len()).map(|node| arenas.on_node(node).alloc([node; 100])).collect();
            assert!(values.iter().enumerate().all(|(node, value)| **value == [node; 100]));
            let expected = if memory == Memory::Node { machine.nodes.len() } else { 1 };
            assert_eq!(arenas.in_use().count(), expected);
            assert_eq!(arenas.stats().allocations, machine.nodes.len() as u64);
            assert_eq!(arenas.count_pages().unwrap().by_node.is_empty(), memory == Memory::Malloc);
        }
    }
}
