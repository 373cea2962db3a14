//! Who does the work of a batch: the thread at hand alone, in the order of the receivers, which is the specification; or a team.
//!
//! With a team a task is one receiver and the whole batch. It starts on its receiver's home node, the costliest first by what the last batch
//! cost, and idle workers steal tasks, then subtrees of a receiver at work ([`Helpers`]), nearest first. A task owns its receiver, so there is
//! no lock; and all that a task leaves behind belongs to its receiver, so the result is the same whoever ran it, bit by bit. What a task makes
//! lies in the worker's own arena for the receiver's home, so there is no lock there either.

use std::cell::RefCell;

use ccnuma::arena::{Backend, Memory, NodeArenas};
use ccnuma::per_thread::PerWorker;
use ccnuma::{Arena, Home, Team, Worker, WorkerPanic};

use crate::math::Basis;
use crate::radiosity::Tree;
use crate::scene::Surface;
use crate::transport::{Alone, Half, Helpers, Scratch};

use super::homes::{along_the_curve, homes, imbalance};
use super::record::{Record, Recorder};
use super::walks::Walked;

/// Homes are given anew where the busiest node's workers would have that much less work after it. What is gained is small below, and
/// trees that move are copied.
const LOPSIDED: f64 = 1.1;

/// As many items are dropped before a team is through with having been asked to.
const FEW: usize = 1000;

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
    pub hands: Hands<'t>,
    /// How the trees' memory is placed.
    pub memory: Memory,
    /// Home node by tree, by position in the machine's table.
    pub homes: Vec<usize>,
    /// Trees that have moved to another home so far.
    pub moved: u64,
    /// Trees in the order of a curve through space.
    order: Vec<usize>,
    /// What each tree cost in the last batch.
    costs: Vec<u64>,
    /// What each tree cost since homes were looked at.
    work: Vec<u64>,
}

pub(super) enum Hands<'t> {
    Alone(Box<(Scratch, Arena)>),
    /// One thread that keeps a record.
    Recording(Box<(Scratch, Arena, Recorder)>),
    Team(&'t mut Team, PerWorker<Kit>),
}

/// What a worker has of its own.
pub(super) struct Kit {
    /// Working memory: as much as the tasks it has on its stack, since one that waits helps others.
    scratches: RefCell<Vec<Scratch>>,
    /// Where the elements live that it makes.
    pub arenas: NodeArenas,
}

/// The worker that runs a task, as one whom others help, and the home of the task's receiver.
struct Here<'a> {
    worker: &'a Worker,
    kits: &'a PerWorker<Kit>,
    home: usize,
}

impl Here<'_> {
    /// Runs `task` with working memory of its own.
    fn with_scratch<R>(&self, task: impl FnOnce(&Self, &mut Scratch) -> R) -> R {
        let free = &self.kits.local(self.worker).scratches;
        let mut scratch = free.borrow_mut().pop().unwrap_or_default();
        let result = task(self, &mut scratch);
        free.borrow_mut().push(scratch);
        result
    }
}

/// What workers need of the crew who share no tasks.
pub(super) struct Room<'a> {
    kits: &'a PerWorker<Kit>,
    homes: &'a [usize],
}

impl Room<'_> {
    /// Runs `task` with working memory of the worker's own.
    pub fn with_scratch(&self, worker: &Worker, task: impl FnOnce(&mut Scratch)) {
        let here = Here { worker, kits: self.kits, home: 0 };
        here.with_scratch(|_, scratch| task(scratch));
    }

    /// Where a receiver's elements live that the worker makes.
    pub fn arena<'w>(&'w self, worker: &'w Worker, receiver: usize) -> &'w Arena {
        self.kits.local(worker).arenas.on_node(self.homes[receiver])
    }
}

impl Helpers for Here<'_> {
    fn arena(&self) -> &Arena {
        self.kits.local(self.worker).arenas.on_node(self.home)
    }

    fn wanted(&self) -> bool {
        self.worker.plan().slots.len() > 1
    }

    fn both(&self, scratch: &mut Scratch, first: Half<'_>, second: Half<'_>) {
        let (kits, home, mine) = (self.kits, self.home, &mut *scratch);
        let ((), work) = self.worker.join(
            |worker| first(&Here { worker, kits, home }, mine),
            |worker| {
                Here { worker, kits, home }.with_scratch(|here, scratch| {
                    second(here, scratch);
                    std::mem::take(&mut scratch.work)
                })
            },
        );
        scratch.work += work;
    }
}

impl<'t> Crew<'t> {
    /// The team, or nobody else, to light these surfaces. Expected work gives them their homes, by area to begin with. Whoever works alone
    /// has no home: its memory is placed by first touch if that is asked for, else by the program's allocator.
    pub fn new(
        team: Option<&'t mut Team>,
        memory: Memory,
        surfaces: &[Surface],
    ) -> Result<Self, WorkerPanic> {
        let area_m2: f64 = surfaces.iter().map(|surface| surface.area_m2).sum();
        let by_area = |surface: &Surface| (1e6 * surface.area_m2 / area_m2.max(f64::MIN_POSITIVE)) as u64;
        let work: Vec<u64> = surfaces.iter().map(by_area).collect();
        let order = along_the_curve(surfaces);
        let (hands, memory, homes) = match team {
            None => {
                let (memory, backend) = match memory {
                    Memory::FirstTouch => (memory, Backend::Pages(ccnuma::pages::Placement::FirstTouch)),
                    _ => (Memory::Malloc, Backend::Malloc),
                };
                let own = Box::new((Scratch::default(), Arena::new(backend)));
                (Hands::Alone(own), memory, vec![0; surfaces.len()])
            }
            Some(team) => {
                let kits = PerWorker::new(team, |worker| Kit {
                    scratches: RefCell::default(),
                    arenas: NodeArenas::of_worker(worker, memory),
                })?;
                let homes = homes(&order, &work, &staff(team));
                (Hands::Team(team, kits), memory, homes)
            }
        };
        Ok(Self { hands, memory, homes, moved: 0, order, costs: work.clone(), work })
    }

    /// One thread that lights these surfaces and keeps a record.
    pub fn recording(surfaces: &[Surface]) -> Self {
        let order = along_the_curve(surfaces);
        let along = order.iter().map(|surface| *surface as u32).collect();
        let recorder = Recorder::new(along);
        let own = Box::new((Scratch::default(), Arena::new(Backend::Malloc), recorder));
        let none = vec![0; surfaces.len()];
        Self {
            hands: Hands::Recording(own),
            memory: Memory::Malloc,
            homes: vec![0; surfaces.len()],
            moved: 0,
            order,
            costs: none.clone(),
            work: none,
        }
    }

    /// The record of the run that is now over, where one was kept.
    pub fn into_record(self) -> Option<Record> {
        match self.hands {
            Hands::Recording(own) => Some(own.2.finish()),
            Hands::Alone(_) | Hands::Team(..) => None,
        }
    }

    /// Makes every surface's tree, dark, at its home.
    pub fn grow<const N: usize>(
        &mut self,
        surfaces: &[Surface],
        basis: Basis,
    ) -> Result<Vec<Tree<N>>, WorkerPanic> {
        let index: Vec<usize> = (0..surfaces.len()).collect();
        self.at_home(index, |i| *i, |i, arena| Tree::new(*i as u32, &surfaces[*i], basis, arena))
    }

    /// Takes from the trees all that they own, each at its home, after a last look at it; returns the looks in the trees' order.
    pub fn fell<const N: usize, R: Send>(
        &mut self,
        trees: &mut [Tree<N>],
        last: impl Fn(&Tree<N>) -> R + Sync,
    ) -> Result<Vec<R>, WorkerPanic> {
        let fell = |tree: &mut &mut Tree<N>, arena: &Arena| {
            let look = last(tree);
            tree.fell(arena);
            look
        };
        self.at_home(trees.iter_mut().collect(), |tree| tree.patch.surface as usize, fell)
    }

    /// Drops items of which there is at most one for each surface, shared out among the workers: what is many pieces takes long to drop.
    pub fn discard<T: Send>(&mut self, items: Vec<T>) -> Result<(), WorkerPanic> {
        if items.len() > FEW {
            let items = items.into_iter().map(Some).enumerate().collect();
            self.at_home(items, |(index, _)| *index, |(_, item), _| drop(item.take()))?;
        }
        Ok(())
    }

    /// Whether it matters what trees are expected to cost.
    pub fn plans(&self) -> bool {
        !matches!(self.hands, Hands::Alone(_))
    }

    /// Takes note of what trees are expected to cost where nothing is known yet: their order follows from it, and their homes if they are
    /// given next.
    pub fn expect(&mut self, costs: Vec<u64>) {
        if let Hands::Recording(own) = &mut self.hands {
            own.2.expect(&costs);
        }
        self.work.clone_from(&costs);
        self.costs = costs;
    }

    /// Gives every tree a home by the work since the last time, where that leaves nodes much less unequal, and moves trees to theirs.
    pub fn settle<const N: usize>(&mut self, trees: &mut [Tree<N>]) -> Result<(), WorkerPanic> {
        let work = std::mem::replace(&mut self.work, vec![0; trees.len()]);
        if let Hands::Recording(own) = &mut self.hands {
            own.2.settle();
        }
        let Hands::Team(team, _) = &self.hands else { return Ok(()) };
        let staff = staff(team);
        let new = homes(&self.order, &work, &staff);
        if imbalance(&self.homes, &work, &staff) <= LOPSIDED * imbalance(&new, &work, &staff) {
            return Ok(());
        }
        let old = std::mem::replace(&mut self.homes, new);
        if self.memory == Memory::Node {
            let moves = |i: usize| old[i] != self.homes[i];
            let moving: Vec<&mut Tree<N>> =
                trees.iter_mut().filter(|tree| moves(tree.patch.surface as usize)).collect();
            self.moved += moving.len() as u64;
            self.at_home(moving, |tree| tree.patch.surface as usize, |tree, arena| tree.move_to(arena))?;
            self.reclaim()?;
        }
        Ok(())
    }

    /// Makes chunks of arenas that hold nothing any more available again.
    fn reclaim(&mut self) -> Result<(), WorkerPanic> {
        if let Hands::Team(team, kits) = &mut self.hands {
            team.run(|worker| {
                for arena in kits.local(worker).arenas.in_use() {
                    arena.reset();
                }
            })?;
        }
        Ok(())
    }

    /// Has every tree lit by `task`, which counts what it does in the tree's account; it is told the node that it runs on.
    pub fn light<const N: usize>(
        &mut self,
        trees: &mut [Tree<N>],
        task: impl Fn(&mut Tree<N>, &mut Scratch, &dyn Helpers, usize) + Sync,
    ) -> Result<Longest, WorkerPanic> {
        let before = accounts(trees);
        match &mut self.hands {
            Hands::Alone(own) => {
                let (scratch, arena) = &mut **own;
                trees.iter_mut().for_each(|tree| task(tree, scratch, &Alone(arena), 0));
            }
            Hands::Recording(own) => {
                let (scratch, arena, recorder) = &mut **own;
                recorder.batch(arena, trees.iter_mut(), |tree, helpers| {
                    let before = (tree.work.cost(), tree.span);
                    task(tree, scratch, helpers, 0);
                    (tree.work.cost() - before.0, tree.span - before.1)
                });
            }
            Hands::Team(team, kits) => {
                let (homes, costs, kits) = (&self.homes, &self.costs, &*kits);
                let index = |tree: &Tree<N>| tree.patch.surface as usize;
                let mut costliest_first: Vec<&mut Tree<N>> = trees.iter_mut().collect();
                costliest_first.sort_by_key(|tree| std::cmp::Reverse(costs[index(tree)]));
                let home =
                    |tree: &&mut Tree<N>| Home { node: homes[index(tree)], weight: 1 + costs[index(tree)] };
                team.for_each_mut(&mut costliest_first, home, |worker, tree| {
                    let here = Here { worker, kits, home: homes[index(tree)] };
                    here.with_scratch(|here, scratch| task(tree, scratch, here, worker.node()));
                })?;
            }
        }
        Ok(self.book(trees, &before))
    }

    /// Whether there is a team.
    pub fn is_team(&self) -> bool {
        matches!(self.hands, Hands::Team(..))
    }

    /// Has all workers walk; `None` where there is no team.
    pub fn walk<const N: usize>(
        &mut self,
        trees: &mut [Tree<N>],
        walk: impl FnOnce(&mut [Tree<N>], &mut Team, &Room<'_>) -> Result<Walked<N>, WorkerPanic>,
    ) -> Result<Option<(Walked<N>, Longest)>, WorkerPanic> {
        let Hands::Team(team, kits) = &mut self.hands else { return Ok(None) };
        let before = accounts(trees);
        let walked = walk(trees, team, &Room { kits, homes: &self.homes })?;
        Ok(Some((walked, self.book(trees, &before))))
    }

    /// Notes what each tree cost since `before`.
    fn book<const N: usize>(&mut self, trees: &[Tree<N>], before: &[(u64, u64)]) -> Longest {
        let mut longest = Longest::default();
        for (i, tree) in trees.iter().enumerate() {
            self.costs[i] = tree.work.cost() - before[i].0;
            self.work[i] += self.costs[i];
            longest.receiver = longest.receiver.max(self.costs[i]);
            longest.chain = longest.chain.max(tree.span - before[i].1);
        }
        longest
    }

    /// Calls `each` on those of the trees for which `chosen` holds, on their home nodes, and returns the results in the trees' order.
    pub fn map<const N: usize, R: Send>(
        &mut self,
        trees: &mut [Tree<N>],
        chosen: impl Fn(&Tree<N>) -> bool,
        each: impl Fn(&mut Tree<N>) -> R + Sync,
    ) -> Result<Vec<R>, WorkerPanic> {
        let chosen = trees.iter_mut().filter(|tree| chosen(tree)).collect();
        self.at_home(chosen, |tree: &&mut Tree<N>| tree.patch.surface as usize, |tree, _| each(tree))
    }

    /// Calls `each` on the items, which belong to surfaces, on their home nodes, with an arena there; results in the items' order.
    fn at_home<T: Send, R: Send>(
        &mut self,
        items: Vec<T>,
        surface: impl Fn(&T) -> usize,
        each: impl Fn(&mut T, &Arena) -> R + Sync,
    ) -> Result<Vec<R>, WorkerPanic> {
        match &mut self.hands {
            Hands::Alone(own) => Ok(items.into_iter().map(|mut item| each(&mut item, &own.1)).collect()),
            Hands::Recording(own) => {
                let (_, arena, recorder) = &mut **own;
                Ok(recorder.map(items.into_iter(), |mut item| each(&mut item, arena)))
            }
            Hands::Team(team, kits) => {
                let kits = &*kits;
                let with_home = |item: T| (self.homes[surface(&item)], item, None);
                let mut items: Vec<(usize, T, Option<R>)> = items.into_iter().map(with_home).collect();
                let home = |item: &(usize, T, Option<R>)| Home { node: item.0, weight: 1 };
                team.for_each_mut(&mut items, home, |worker, (home, item, result)| {
                    *result = Some(each(item, kits.local(worker).arenas.on_node(*home)));
                })?;
                Ok(items.into_iter().filter_map(|(_, _, result)| result).collect())
            }
        }
    }
}

/// Number of workers by node.
fn staff(team: &Team) -> Vec<usize> {
    team.plan().workers_by_node().iter().map(Vec::len).collect()
}

/// What each tree cost so far, and its span.
fn accounts<const N: usize>(trees: &[Tree<N>]) -> Vec<(u64, u64)> {
    trees.iter().map(|tree| (tree.work.cost(), tree.span)).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use ccnuma::{Machine, Plan, Policy};

    use super::*;
    use crate::math::Split;
    use crate::scene::{read::read_file, surfaces};
    use crate::transport::{Receiver, Shape};

    #[test]
    fn trees_move_only_when_it_pays_and_memory_does_not_grow() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/furnished-room.iv");
        let surfaces = surfaces(&read_file(&path).unwrap());
        let machine = Machine::synthetic("numa:2 core:2 pu:1").unwrap();
        let mut team = Team::new(&Plan::new(machine.into(), Policy::None, Some(4)).unwrap()).unwrap();
        let mut crew = Crew::new(Some(&mut team), Memory::Node, &surfaces).unwrap();
        let mut trees = crew.grow::<3>(&surfaces, Basis::M3).unwrap();
        let shapes = [const { Shape::Whole }; 4];
        let divide = |tree: &mut Tree<3>, arena: &Arena| {
            tree.root.subdivide(Split::Both, &shapes, arena);
            for child in tree.root.children_mut() {
                child.subdivide(Split::Both, &shapes, arena);
                child.deposit(&[[1.5; 3]; 9]);
            }
        };
        crew.at_home(
            trees.iter_mut().collect(),
            |tree| tree.patch.surface as usize,
            |tree, arena| divide(tree, arena),
        )
        .unwrap();
        let fields: Vec<_> = trees.iter().map(Tree::field).collect();
        crew.settle(&mut trees).unwrap();
        assert_eq!(crew.moved, 0, "homes were given by area, and nothing else is known");
        let (first, last) = (crew.order[0], crew.order[surfaces.len() - 1]);
        for round in 0..40 {
            let before = crew.moved;
            crew.work.fill(1);
            crew.work[if round % 2 == 0 { first } else { last }] = surfaces.len() as u64;
            crew.settle(&mut trees).unwrap();
            assert!(
                crew.moved > before,
                "round {round}: half of the work is one tree's, and the others go away"
            );
            let footprint = crew.footprint(&mut trees, [("a", 0), ("b", 0), ("c", 0), ("d", 0)]).unwrap();
            let bytes: u64 = footprint.arena_bytes_per_node.unwrap().values().sum();
            // What never moved, what is there now, and what was there before.
            let most = 3 * 4 * 2 * ccnuma::arena::CHUNK as u64;
            assert!(bytes <= most, "round {round}: {bytes} bytes");
        }
        assert!(fields == trees.iter().map(Tree::field).collect::<Vec<_>>(), "what moves stays the same");
        let moved = crew.moved;
        crew.work.fill(1);
        crew.settle(&mut trees).unwrap();
        assert!(crew.moved > moved);
        crew.work.fill(1);
        crew.settle(&mut trees).unwrap();
        let moved = crew.moved;
        crew.work.fill(1);
        crew.work[first] += 1;
        crew.settle(&mut trees).unwrap();
        assert_eq!(crew.moved, moved, "a little more work in one place moves nothing");
    }
}
