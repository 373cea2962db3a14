//! Who does the work of a batch: the thread at hand alone, in the order of the receivers, which is the specification; or a team.
//!
//! With a team a task is one receiver and the whole batch. It starts on its receiver's home node, the costliest first by what the last batch
//! cost, and idle workers steal tasks, then subtrees of a receiver at work ([`Helpers`]), nearest first. A task owns its receiver, so there is
//! no lock; and all that a task leaves behind belongs to its receiver, so the result is the same whoever ran it, bit by bit.

use std::cell::RefCell;

use ccnuma::per_thread::PerWorker;
use ccnuma::{Home, Team, Worker, WorkerPanic};

use crate::radiosity::Tree;
use crate::transport::{Half, Helpers, Scratch};

use super::homes::{along_the_curve, homes};
use super::record::{Record, Recorder};

/// What no number of workers can be faster than, as costs ([`crate::transport::Work::cost`]); summed over batches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Longest {
    /// The costliest receiver, if receivers are not divided.
    pub receiver: u64,
    /// The longest chain of parts that wait for each other, if they are.
    pub chain: u64,
}

/// Who works, and where receivers are at home.
pub(super) struct Crew<'t> {
    hands: Hands<'t>,
    /// Home node by tree.
    homes: Vec<usize>,
    /// What each tree cost in the last batch.
    costs: Vec<u64>,
    /// What each tree cost since homes were given.
    work: Vec<u64>,
}

enum Hands<'t> {
    Alone(Box<Scratch>),
    /// One thread that keeps a record.
    Recording(Box<(Scratch, Recorder)>),
    Team(&'t mut Team, Scratches),
}

/// Working memory by worker: as many as the tasks it has on its stack, since one that waits helps others.
type Scratches = PerWorker<RefCell<Vec<Scratch>>>;

/// The worker that runs a task, as one whom others help.
struct Here<'a> {
    worker: &'a Worker,
    scratches: &'a Scratches,
}

impl<'a> Here<'a> {
    /// Runs `task` with working memory of its own.
    fn with_scratch<R>(
        worker: &'a Worker,
        scratches: &'a Scratches,
        task: impl FnOnce(&Self, &mut Scratch) -> R,
    ) -> R {
        let free = scratches.local(worker);
        let mut scratch = free.borrow_mut().pop().unwrap_or_default();
        let result = task(&Here { worker, scratches }, &mut scratch);
        free.borrow_mut().push(scratch);
        result
    }
}

impl Helpers for Here<'_> {
    fn wanted(&self) -> bool {
        self.worker.has_no_offers()
    }

    fn both(&self, scratch: &mut Scratch, first: Half<'_>, second: Half<'_>) {
        let (scratches, mine) = (self.scratches, &mut *scratch);
        let ((), work) = self.worker.join(
            |worker| first(&Here { worker, scratches }, mine),
            |worker| {
                Here::with_scratch(worker, scratches, |here, scratch| {
                    second(here, scratch);
                    std::mem::take(&mut scratch.work)
                })
            },
        );
        scratch.work += work;
    }
}

impl<'t> Crew<'t> {
    /// The team, or nobody else.
    pub fn new(team: Option<&'t mut Team>) -> Result<Self, WorkerPanic> {
        let hands = match team {
            None => Hands::Alone(Box::default()),
            Some(team) => {
                let scratches = PerWorker::new(team, |_| RefCell::default())?;
                Hands::Team(team, scratches)
            }
        };
        Ok(Self { hands, homes: Vec::new(), costs: Vec::new(), work: Vec::new() })
    }

    /// One thread that keeps a record.
    pub fn recording() -> Self {
        let hands = Hands::Recording(Box::new((Scratch::default(), Recorder::new())));
        Self { hands, homes: Vec::new(), costs: Vec::new(), work: Vec::new() }
    }

    /// The record of the run that is now over, where one was kept.
    pub fn into_record(self) -> Option<Record> {
        match self.hands {
            Hands::Recording(recording) => Some(recording.1.finish()),
            Hands::Alone(_) | Hands::Team(..) => None,
        }
    }

    /// Gives every tree a home, by the work since the last time, at first by area.
    pub fn settle<const N: usize>(&mut self, trees: &[Tree<N>]) {
        if self.costs.len() != trees.len() {
            let total: f64 = trees.iter().map(|tree| tree.area_m2).sum();
            let by_area = |tree: &Tree<N>| (1e6 * tree.area_m2 / total.max(f64::MIN_POSITIVE)) as u64;
            self.work = trees.iter().map(by_area).collect();
            self.costs = self.work.clone();
        }
        self.homes = match &mut self.hands {
            Hands::Alone(_) => vec![0; trees.len()],
            Hands::Recording(recording) => {
                recording.1.settle(|| {
                    let along = along_the_curve(trees).into_iter().map(|tree| tree as u32).collect();
                    (along, trees.iter().map(|tree| tree.area_m2).collect())
                });
                vec![0; trees.len()]
            }
            Hands::Team(team, _) => {
                let workers: Vec<usize> = team.plan().workers_by_node().iter().map(Vec::len).collect();
                homes(trees, &self.work, &workers)
            }
        };
        self.work.fill(0);
    }

    /// Has every tree lit by `task`, which counts what it does in the tree's account.
    pub fn light<const N: usize>(
        &mut self,
        trees: &mut [Tree<N>],
        task: impl Fn(&mut Tree<N>, &mut Scratch, Option<&dyn Helpers>) + Sync,
    ) -> Result<Longest, WorkerPanic> {
        let before: Vec<(u64, u64)> = trees.iter().map(|tree| (tree.work.cost(), tree.span)).collect();
        match &mut self.hands {
            Hands::Alone(scratch) => trees.iter_mut().for_each(|tree| task(tree, scratch, None)),
            Hands::Recording(recording) => {
                let (scratch, recorder) = &mut **recording;
                recorder.batch(trees.iter_mut(), |tree, helpers| {
                    let before = (tree.work.cost(), tree.span);
                    task(tree, scratch, Some(helpers));
                    (tree.work.cost() - before.0, tree.span - before.1)
                });
            }
            Hands::Team(team, scratches) => {
                let (homes, costs, scratches) = (&self.homes, &self.costs, &*scratches);
                let index = |tree: &Tree<N>| tree.patch.surface as usize;
                let mut costliest_first: Vec<&mut Tree<N>> = trees.iter_mut().collect();
                costliest_first.sort_by_key(|tree| std::cmp::Reverse(costs[index(tree)]));
                let home =
                    |tree: &&mut Tree<N>| Home { node: homes[index(tree)], weight: 1 + costs[index(tree)] };
                team.for_each_mut(&mut costliest_first, home, |worker, tree| {
                    Here::with_scratch(worker, scratches, |here, scratch| task(tree, scratch, Some(here)));
                })?;
            }
        }
        let mut longest = Longest::default();
        for (i, tree) in trees.iter().enumerate() {
            self.costs[i] = tree.work.cost() - before[i].0;
            self.work[i] += self.costs[i];
            longest.receiver = longest.receiver.max(self.costs[i]);
            longest.chain = longest.chain.max(tree.span - before[i].1);
        }
        Ok(longest)
    }

    /// Calls `each` on those of the trees for which `chosen` holds, on their home nodes, and returns the results in the trees' order.
    pub fn map<const N: usize, R: Send>(
        &mut self,
        trees: &mut [Tree<N>],
        chosen: impl Fn(&Tree<N>) -> bool,
        each: impl Fn(&mut Tree<N>) -> R + Sync,
    ) -> Result<Vec<R>, WorkerPanic> {
        let chosen = trees.iter_mut().filter(|tree| chosen(tree));
        match &mut self.hands {
            Hands::Alone(_) => Ok(chosen.map(each).collect()),
            Hands::Recording(recording) => Ok(recording.1.map(chosen, each)),
            Hands::Team(team, _) => {
                let homes = &self.homes;
                let mut items: Vec<(&mut Tree<N>, Option<R>)> = chosen.map(|tree| (tree, None)).collect();
                let home = |item: &(&mut Tree<N>, Option<R>)| Home {
                    node: homes[item.0.patch.surface as usize],
                    weight: 1,
                };
                team.for_each_mut(&mut items, home, |_, (tree, result)| *result = Some(each(tree)))?;
                Ok(items.into_iter().filter_map(|(_, result)| result).collect())
            }
        }
    }
}
