//! Read-mostly data near its readers: with [`Memory::Node`], one copy for each node that has workers; with [`Memory::Interleave`] one copy
//! round all nodes of what is made once; else all read the original.
//!
//! Workers of a node make its copy, so that it is touched there first. Where a node has too little room left, nothing is copied. A worker that
//! took a part of another's task ([`crate::transport::Helpers`]) goes on reading what that one reads.

use std::sync::Arc;

use ccnuma::arena::Memory;
use ccnuma::pages::{interleaving, room_bytes};
use ccnuma::{Home, Team, WorkerPanic};

use super::crew::{Crew, Hands};

/// What is larger than this is copied only to nodes that have room for it so many times over.
const LARGE_BYTES: usize = 16 << 20;
const TIMES_OVER: u64 = 4;

/// Copies, each for the workers of some nodes.
pub(super) struct Copies<T> {
    copies: Vec<T>,
    /// Index into the copies by node, by position in the machine's table.
    of_node: Vec<Option<usize>>,
}

impl<T> Copies<T> {
    /// All read the original.
    pub fn none() -> Self {
        Self { copies: Vec::new(), of_node: Vec::new() }
    }

    /// The copy for a node's workers; `None` where they read the original.
    pub fn on(&self, node: usize) -> Option<&T> {
        let copy = self.of_node.get(node).copied().flatten()?;
        self.copies.get(copy)
    }

    /// All of them.
    pub fn each(&self) -> impl Iterator<Item = &T> {
        self.copies.iter()
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.copies.len()
    }
}

impl Crew<'_> {
    /// Has a worker of each node make that node's copy of `bytes` bytes, if it makes any; with [`Memory::Interleave`] one worker makes
    /// one for all.
    pub fn copy<T: Send>(
        &mut self,
        bytes: usize,
        make: impl Fn() -> Option<T> + Sync,
    ) -> Result<Copies<T>, WorkerPanic> {
        let interleaved = self.memory == Memory::Interleave;
        let Some((team, mut nodes)) = self.copying(bytes) else { return Ok(Copies::none()) };
        let machine = Arc::clone(&team.plan().machine);
        let staffed = nodes.clone();
        let all = nodes.iter().map(|node| machine.nodes[*node].os).collect();
        nodes.truncate(if interleaved { 1 } else { nodes.len() });
        let mut copies: Vec<(usize, Option<T>)> = nodes.iter().map(|node| (*node, None)).collect();
        let make = || if interleaved { interleaving(&all, &make) } else { make() };
        at_home(team, &mut copies, |copy| copy.0, |copy| copy.1 = make())?;
        let copies: Vec<T> = copies.into_iter().filter_map(|(_, copy)| copy).collect();
        let mut of_node = vec![None; machine.nodes.len()];
        for (index, node) in staffed.into_iter().enumerate() {
            of_node[node] = Some(index % nodes.len());
        }
        Ok(Copies { copies, of_node })
    }

    /// Copies the items, of `bytes` bytes in all, each node's by all of its workers. Those made on many nodes need no interleaving.
    pub fn copy_all<T: Clone + Send + Sync>(
        &mut self,
        items: &[T],
        bytes: usize,
    ) -> Result<Copies<Vec<T>>, WorkerPanic> {
        let wanted = self.memory == Memory::Node;
        let Some((team, nodes)) = self.copying(bytes).filter(|_| wanted) else { return Ok(Copies::none()) };
        let of_node = |node: &usize| items.iter().map(|item| (*node, item, None)).collect::<Vec<_>>();
        let mut copies: Vec<(usize, &T, Option<T>)> = nodes.iter().flat_map(of_node).collect();
        at_home(team, &mut copies, |copy| copy.0, |(_, item, copy)| *copy = Some(item.clone()))?;
        let mut made = copies.into_iter().filter_map(|(_, _, copy)| copy);
        let copies = nodes.iter().map(|_| made.by_ref().take(items.len()).collect()).collect();
        let mut of_node = vec![None; team.plan().machine.nodes.len()];
        for (index, node) in nodes.into_iter().enumerate() {
            of_node[node] = Some(index);
        }
        Ok(Copies { copies, of_node })
    }

    /// The team, and the nodes that have workers; `None` where one copy is enough or there is no room for more.
    fn copying(&mut self, bytes: usize) -> Option<(&mut Team, Vec<usize>)> {
        let Hands::Team(team, _) = &mut self.hands else { return None };
        let plan = team.plan();
        let workers = plan.workers_by_node();
        let nodes: Vec<usize> = (0..workers.len()).filter(|node| !workers[*node].is_empty()).collect();
        let has_room = |node: &usize| {
            bytes <= LARGE_BYTES
                || room_bytes(plan.machine.nodes[*node].os)
                    .is_none_or(|room| room >= TIMES_OVER * bytes as u64)
        };
        let placed = matches!(self.memory, Memory::Node | Memory::Interleave);
        let pays = placed && nodes.len() > 1 && nodes.iter().all(has_room);
        pays.then_some((&mut **team, nodes))
    }
}

/// Calls `each` on every item, on its home node by that node's workers alone.
fn at_home<T: Send>(
    team: &mut Team,
    items: &mut [T],
    node: impl Fn(&T) -> usize,
    each: impl Fn(&mut T) + Sync,
) -> Result<(), WorkerPanic> {
    team.set_far_limit(u64::MAX);
    let done = team.for_each_mut(items, |item| Home { node: node(item), weight: 1 }, |_, item| each(item));
    team.set_far_limit(0);
    done
}
