//! Read-mostly data, one copy per node that has workers, read through the local copy.

use std::ptr::NonNull;

use crate::error::Error;
use crate::pages::{PageCount, Pages, Placement};
use crate::team::{Team, Worker, WorkerPanic};

/// A slice of plain data on pages of every staffed node; where the nodes have no room for that, one interleaved copy.
///
/// Plain means `Copy`: nothing to drop, nothing that points elsewhere by ownership.
#[derive(Debug)]
pub struct ReplicatedSlice<T> {
    /// Index into `copies` by node position.
    copy_of_node: Vec<usize>,
    copies: Vec<Pages>,
    len: usize,
    plain: std::marker::PhantomData<T>,
}

/// Why a replica could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ReplicateError {
    /// No memory.
    #[error(transparent)]
    Memory(#[from] Error),
    /// A worker panicked while it copied.
    #[error(transparent)]
    Worker(#[from] WorkerPanic),
}

impl<T: Copy + Send + Sync> ReplicatedSlice<T> {
    /// Has a worker of each node copy `items` to pages of that node.
    pub fn copy_to_nodes(team: &mut Team, items: &[T]) -> Result<Self, ReplicateError> {
        let plan = team.plan().clone();
        let nodes = plan.machine.nodes.len();
        let bytes = size_of_val(items);
        let staffed: Vec<usize> =
            (0..nodes).filter(|&node| plan.nearest_staffed_node(node) == node).collect();
        let bound: Result<Vec<Pages>, Error> = staffed
            .iter()
            .map(|&node| Pages::map(bytes, &Placement::Bind(plan.machine.nodes[node].os)))
            .collect();
        let (copies, readers) = match bound {
            Ok(copies) => (copies, staffed),
            Err(Error::NodeFull { .. } | Error::Node { .. }) => {
                (vec![Self::interleaved(team, bytes)?], vec![staffed[0]])
            }
            Err(error) => return Err(error.into()),
        };
        let copy_index = |node: usize| {
            let node = plan.nearest_staffed_node(node);
            readers.iter().position(|&reader| reader == node).unwrap_or(0)
        };
        let copy_of_node = (0..nodes).map(copy_index).collect();
        let replicated = Self { copy_of_node, copies, len: items.len(), plain: std::marker::PhantomData };
        replicated.fill(team, items, &readers)?;
        Ok(replicated)
    }

    fn interleaved(team: &Team, bytes: usize) -> Result<Pages, Error> {
        let nodes =
            team.plan().machine.nodes.iter().filter(|node| node.has_cpus).map(|node| node.os).collect();
        crate::warnings::note("no room for a copy per node: replicated data is interleaved".to_owned());
        Pages::map(bytes, &Placement::Interleave(nodes))
            .or_else(|_| Pages::map(bytes, &Placement::FirstTouch))
    }

    fn fill(&self, team: &mut Team, items: &[T], readers: &[usize]) -> Result<(), WorkerPanic> {
        let workers = team.plan().workers_by_node();
        team.run(|worker| {
            let first_of_node = workers[worker.node()].first() == Some(&worker.index());
            let Some(copy) = readers.iter().position(|&node| node == worker.node()).filter(|_| first_of_node)
            else {
                return;
            };
            // SAFETY: the copy is at least `size_of_val(items)` long, aligned far beyond `T`'s need (checked below),
            // owned by `self`, not yet read, and written by this worker only: the first of the copy's only reader
            // node. `T: Copy` has no drop to run for what was there.
            unsafe { self.base(copy).copy_from_nonoverlapping(NonNull::from_ref(items).cast(), items.len()) };
        })
        .map(|_| ())
    }

    fn base(&self, copy: usize) -> NonNull<T> {
        const { assert!(align_of::<T>() <= crate::pages::HUGE) };
        self.copies[copy].base().cast()
    }

    fn slice(&self, copy: usize) -> &[T] {
        // SAFETY: `len` values were written by `fill`, which `copy_to_nodes` waited for, and nothing writes since.
        unsafe { NonNull::slice_from_raw_parts(self.base(copy), self.len).as_ref() }
    }

    /// The copy nearest to a worker.
    #[inline]
    pub fn local(&self, worker: &Worker) -> &[T] {
        self.slice(self.copy_of_node[worker.node()])
    }

    /// Some copy, for code outside the team.
    pub fn any(&self) -> &[T] {
        self.slice(0)
    }

    /// How many copies there are.
    pub fn copies(&self) -> usize {
        self.copies.len()
    }

    /// Where each copy's pages are.
    pub fn count_pages(&self) -> Result<Vec<PageCount>, Error> {
        (0..self.copies.len()).map(|copy| crate::pages::count_of(self.slice(copy))).collect()
    }
}

/// A value with one copy per staffed node, each made by a worker of its node: what it allocates is touched there
/// first. For big arrays use [`ReplicatedSlice`], whose placement is bound.
#[derive(Debug)]
pub struct Replicated<T> {
    copy_of_node: Vec<usize>,
    copies: Vec<T>,
}

impl<T: Send + Sync> Replicated<T> {
    /// Has the first worker of each node make that node's copy.
    pub fn make_on_nodes(team: &mut Team, make: impl Fn(&Worker) -> T + Sync) -> Result<Self, WorkerPanic> {
        let plan = team.plan().clone();
        let workers = plan.workers_by_node();
        let first = |worker: &Worker| workers[worker.node()].first() == Some(&worker.index());
        let made = team.run(|worker| first(worker).then(|| (worker.node(), make(worker))))?;
        let (nodes, copies): (Vec<usize>, Vec<T>) = made.into_iter().flatten().unzip();
        let copy_index = |node: usize| {
            let node = plan.nearest_staffed_node(node);
            nodes.iter().position(|&made| made == node).unwrap_or(0)
        };
        Ok(Self { copy_of_node: (0..workers.len()).map(copy_index).collect(), copies })
    }

    /// The copy nearest to a worker.
    #[inline]
    pub fn local(&self, worker: &Worker) -> &T {
        &self.copies[self.copy_of_node[worker.node()]]
    }

    /// Some copy, for code outside the team.
    pub fn any(&self) -> &T {
        &self.copies[0]
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use crate::pinning::{Plan, Policy};
    use crate::topology::Machine;

    #[test]
    fn one_node_keeps_one_copy_on_it() {
        let plan = Plan::new(Machine::this_machine().unwrap().into(), Policy::Compact, None).unwrap();
        let mut team = Team::new(&plan).unwrap();
        let items: Vec<u32> = (0..1_000_000).collect();
        let replicated = ReplicatedSlice::copy_to_nodes(&mut team, &items).unwrap();
        let same = team.run(|worker| replicated.local(worker) == items).unwrap();
        assert!(same.into_iter().all(|same| same) && replicated.any() == items);
        for (node, count) in replicated.count_pages().unwrap().into_iter().enumerate() {
            assert!(replicated.copies() > 1 || count.share_on(plan.machine.nodes[node].os) == Some(1.0));
        }
    }

    #[test]
    fn nodes_that_are_not_here_share_an_interleaved_copy() {
        let machine = Machine::synthetic("numa:4(indexes=700,701,702,703) core:1 pu:1").unwrap();
        let mut team = Team::new(&Plan::new(machine.into(), Policy::None, Some(4)).unwrap()).unwrap();
        let replicated = ReplicatedSlice::copy_to_nodes(&mut team, &[1u8, 2, 3]).unwrap();
        assert_eq!(replicated.copies(), 1);
        assert!(
            team.run(|worker| replicated.local(worker) == [1, 2, 3]).unwrap().into_iter().all(|same| same)
        );
        let empty = ReplicatedSlice::<u64>::copy_to_nodes(&mut team, &[]).unwrap();
        assert!(empty.any().is_empty());
    }

    #[test]
    fn values_are_made_once_per_node() {
        let machine = Machine::synthetic("pack:2 [numa] [numa] core:2 pu:1").unwrap();
        let mut team = Team::new(&Plan::new(machine.into(), Policy::None, Some(4)).unwrap()).unwrap();
        let replicated = Replicated::make_on_nodes(&mut team, |worker| vec![worker.node()]).unwrap();
        assert_eq!(team.run(|worker| replicated.local(worker) == &[worker.node()]).unwrap(), [true; 4]);
        assert_eq!(replicated.any(), &[0]);
    }
}
