//! Read-mostly data near its readers: with [`Memory::Node`], one copy for each node that has workers; else all read the original.
//!
//! Workers of a node make its copy, so that it is touched there first. Where a node has too little room left, nothing is copied. A worker that
//! took a part of another's task ([`crate::transport::Helpers`]) goes on reading what that one reads.

use ccnuma::arena::Memory;
use ccnuma::pages::room_bytes;
use ccnuma::{Home, Team, WorkerPanic};

use super::crew::{Crew, Hands};

/// What is larger than this is copied only to nodes that have room for it so many times over.
const LARGE_BYTES: usize = 16 << 20;
const TIMES_OVER: u64 = 4;

/// A copy for each node, by position in the machine's table, where there are any.
pub(super) struct Copies<T>(Vec<Option<T>>);

impl<T> Copies<T> {
    /// The copy for a node's workers; `None` where they read the original.
    pub fn on(&self, node: usize) -> Option<&T> {
        self.0.get(node)?.as_ref()
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.0.iter().flatten().count()
    }
}

impl Crew<'_> {
    /// Has a worker of each node make that node's copy of `bytes` bytes, if it makes any.
    pub fn copy<T: Send>(
        &mut self,
        bytes: usize,
        make: impl Fn() -> Option<T> + Sync,
    ) -> Result<Copies<T>, WorkerPanic> {
        let Some((team, nodes)) = self.copying(bytes) else { return Ok(Copies(Vec::new())) };
        let mut copies: Vec<(usize, Option<T>)> = nodes.into_iter().map(|node| (node, None)).collect();
        at_home(team, &mut copies, |copy| copy.0, |copy| copy.1 = make())?;
        Ok(by_node(team, copies))
    }

    /// Copies the items, of `bytes` bytes in all, each node's by all of its workers.
    pub fn copy_all<T: Clone + Send + Sync>(
        &mut self,
        items: &[T],
        bytes: usize,
    ) -> Result<Copies<Vec<T>>, WorkerPanic> {
        let Some((team, nodes)) = self.copying(bytes) else { return Ok(Copies(Vec::new())) };
        let of_node = |node: &usize| items.iter().map(|item| (*node, item, None)).collect::<Vec<_>>();
        let mut copies: Vec<(usize, &T, Option<T>)> = nodes.iter().flat_map(of_node).collect();
        at_home(team, &mut copies, |copy| copy.0, |(_, item, copy)| *copy = Some(item.clone()))?;
        let mut made = copies.into_iter().filter_map(|(_, _, copy)| copy);
        let copies = nodes.iter().map(|node| (*node, Some(made.by_ref().take(items.len()).collect())));
        let copies = copies.collect();
        Ok(by_node(team, copies))
    }

    /// The team, and the nodes that get copies; `None` where one is enough or there is no room for more.
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
        let pays = self.memory == Memory::Node && nodes.len() > 1 && nodes.iter().all(has_room);
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

fn by_node<T>(team: &Team, copies: Vec<(usize, Option<T>)>) -> Copies<T> {
    let mut by_node: Vec<Option<T>> = team.plan().machine.nodes.iter().map(|_| None).collect();
    copies.into_iter().for_each(|(node, copy)| by_node[node] = copy);
    Copies(by_node)
}
