//! Statics with one slot per worker, as the paper's macros made of C's global variables, and values with one slot per
//! worker of a team.
//!
//! A slot is allocated and touched by its owner, on its owner's node, padded to cache lines of its own. It is read by
//! index, without a hash or a lock: the proof of being the owner is the `&Worker` that only jobs have.
//!
//! ```
//! use ccnuma::per_thread::Counter;
//! use ccnuma::{Machine, Plan, Policy, Team, per_thread};
//!
//! per_thread! {
//!     /// Rays cast.
//!     static RAYS: Counter = Counter::new();
//! }
//!
//! let plan = Plan::new(Machine::this_machine()?.into(), Policy::Compact, None)?;
//! let mut team = Team::new(&plan)?;
//! team.run(|worker| RAYS.local(worker).add(5))?;
//! assert_eq!(RAYS.fold(&mut team, 0, |sum, _, rays| sum + rays.get()), 5 * team.len() as u64);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Without a worker there is no slot:
//!
//! ```compile_fail,E0061
//! ccnuma::per_thread! { static RAYS: std::cell::Cell<u64> = std::cell::Cell::new(0); }
//! let rays = RAYS.local(); // not a worker
//! ```
//!
//! A worker cannot be taken to another thread, nor kept:
//!
//! ```compile_fail,E0277
//! # fn job(worker: &ccnuma::Worker) {
//! std::thread::scope(|scope| { scope.spawn(|| worker.index()); });
//! # }
//! ```
//!
//! ```compile_fail,E0277
//! # fn job(team: &mut ccnuma::Team) {
//! let mut kept = None;
//! let _ = team.run(|worker| { kept = Some(worker); });
//! # }
//! ```
//!
//! A slot's reference cannot outlive the job, and folding cannot happen during one:
//!
//! ```compile_fail
//! ccnuma::per_thread! { static RAYS: std::sync::atomic::AtomicU64 = std::sync::atomic::AtomicU64::new(0); }
//! fn job(worker: &ccnuma::Worker) -> &'static std::sync::atomic::AtomicU64 { RAYS.local(worker) }
//! ```
//!
//! ```compile_fail,E0501,E0596
//! ccnuma::per_thread! { static RAYS: ccnuma::per_thread::Counter = ccnuma::per_thread::Counter::new(); }
//! # fn job(team: &mut ccnuma::Team) {
//! let _ = team.run(|_| RAYS.fold(team, 0, |sum, _, rays| sum + rays.get()));
//! # }
//! ```
//!
//! What cannot move between threads cannot be folded by another:
//!
//! ```compile_fail,E0277
//! ccnuma::per_thread! { static SHARED: std::rc::Rc<u64> = std::rc::Rc::new(0); }
//! ```

use std::cell::Cell;
use std::fmt;
use std::sync::atomic::AtomicPtr;
use std::sync::atomic::Ordering::Relaxed;

use crossbeam_utils::CachePadded;

use crate::team::{MAX_WORKERS, Team, Worker, WorkerPanic};

/// Declares statics with one slot per worker; see [the module](self).
#[macro_export]
macro_rules! per_thread {
    ($($(#[$meta:meta])* $visibility:vis static $name:ident: $type:ty = $init:expr;)+) => {
        $($(#[$meta])* $visibility static $name: $crate::per_thread::PerThread<$type> =
            $crate::per_thread::PerThread::new(|| $init);)+
    };
}

/// A count that only its owner changes: a plain addition, no atomic operation.
#[derive(Debug, Default)]
pub struct Counter(Cell<u64>);

impl Counter {
    /// Zero.
    pub const fn new() -> Self {
        Self(Cell::new(0))
    }

    /// Adds.
    #[inline]
    pub fn add(&self, amount: u64) {
        self.0.set(self.0.get().wrapping_add(amount));
    }

    /// The count.
    pub fn get(&self) -> u64 {
        self.0.get()
    }

    /// Returns the count and starts again from zero.
    pub fn take(&self) -> u64 {
        self.0.take()
    }
}

/// A static with one slot per worker of the process; made by [`per_thread!`].
#[derive(Debug)]
pub struct PerThread<T: 'static> {
    /// By worker number in the process; null until the owner's first access.
    slots: [AtomicPtr<CachePadded<T>>; MAX_WORKERS],
    init: fn() -> T,
}

impl<T: Send> PerThread<T> {
    /// For the macro: slots start with what `init` returns on their owner's thread.
    pub const fn new(init: fn() -> T) -> Self {
        Self { slots: [const { AtomicPtr::new(std::ptr::null_mut()) }; MAX_WORKERS], init }
    }

    /// The calling worker's own slot.
    #[inline]
    pub fn local<'w>(&'static self, worker: &'w Worker) -> &'w T {
        // Relaxed: only the owner's thread writes its slot's pointer while it lives, and this is that thread; an
        // earlier owner of the number has cleared it and was joined before the number was given out again.
        let slot = self.slots[worker.id].load(Relaxed);
        if slot.is_null() {
            return self.create(worker);
        }
        // SAFETY: a non-null pointer is to a slot that `create` made on this thread and that lives until the worker
        // ends, which is after `'w`. Shared references are only given to this thread while jobs run, and `fold`
        // needs the team mutably, so no `&mut` exists.
        unsafe { &*slot }
    }

    #[cold]
    fn create<'w>(&'static self, worker: &'w Worker) -> &'w T {
        let mut slot = worker.statics.alloc(CachePadded::new((self.init)()));
        let pointer: *mut CachePadded<T> = &raw mut *slot;
        let id = worker.id;
        self.slots[id].store(pointer, Relaxed);
        worker.at_end(move || {
            self.slots[id].store(std::ptr::null_mut(), Relaxed);
            drop(slot);
        });
        // SAFETY: just made; alive until `at_end` runs, after every job.
        unsafe { &*pointer }
    }

    /// Folds over the slots of a team's workers, in their order, skipping workers that never used theirs; each may be
    /// changed, to start again.
    pub fn fold<A>(
        &'static self,
        team: &mut Team,
        start: A,
        mut step: impl FnMut(A, usize, &mut T) -> A,
    ) -> A {
        team.ids().iter().enumerate().fold(start, |folded, (worker, &id)| {
            // Relaxed: the end of the last job ordered the owner's writes before this.
            let slot = self.slots[id].load(Relaxed);
            // SAFETY: null, or alive as long as the team, whose workers are all between jobs because it is borrowed
            // mutably: nobody else refers to the slot. `T: Send` lets this thread have it meanwhile.
            match unsafe { slot.as_mut() } {
                Some(slot) => step(folded, worker, slot),
                None => folded,
            }
        })
    }
}

/// One value per worker of one team, made by each on its own node.
pub struct PerWorker<T> {
    team: usize,
    values: Vec<Box<CachePadded<T>>>,
}

/// Without the values: any thread may format a shared `PerWorker`, while their workers change them.
impl<T> fmt::Debug for PerWorker<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PerWorker").field("workers", &self.values.len()).finish_non_exhaustive()
    }
}

// SAFETY: through a shared `PerWorker` a worker reaches only its own value and other threads none (`Debug` shows none),
// so no value is shared between threads; `T: Send` lets values be made on one thread and dropped or changed on another.
unsafe impl<T: Send> Sync for PerWorker<T> {}

impl<T: Send> PerWorker<T> {
    /// Has every worker make its value.
    pub fn new(team: &mut Team, make: impl Fn(&Worker) -> T + Sync) -> Result<Self, WorkerPanic> {
        let values = team.run(|worker| Box::new(CachePadded::new(make(worker))))?;
        Ok(Self { team: team.id(), values })
    }

    /// The calling worker's value. Panics for a worker of another team.
    #[inline]
    pub fn local<'w>(&'w self, worker: &'w Worker) -> &'w T {
        assert_eq!(worker.team_id(), self.team, "a PerWorker was used by a worker of another team");
        &self.values[worker.index()]
    }

    /// All values by worker, between jobs.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.values.iter_mut().map(|value| &mut ***value)
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use crate::pinning::{Plan, Policy};
    use crate::topology::Machine;
    use std::sync::atomic::AtomicUsize;

    struct Noted(Cell<u64>);

    static DROPPED: AtomicUsize = AtomicUsize::new(0);

    impl Drop for Noted {
        fn drop(&mut self) {
            DROPPED.fetch_add(1, Relaxed);
        }
    }

    crate::per_thread! {
        static HITS: Counter = Counter::new();
        static NOTED: Noted = Noted(Cell::new(7));
        static BIG: [u64; 1 << 19] = [3; 1 << 19];
    }

    fn team(workers: usize) -> Team {
        let machine = Machine::synthetic("numa:2 core:2 pu:1").unwrap();
        Team::new(&Plan::new(machine.into(), Policy::None, Some(workers)).unwrap()).unwrap()
    }

    #[test]
    fn each_worker_counts_alone_and_teams_do_not_mix() {
        let (mut first, mut second) = (team(4), team(3));
        for round in 1..=10 {
            first.run(|worker| HITS.local(worker).add(worker.index() as u64)).unwrap();
            second.run(|worker| HITS.local(worker).add(100)).unwrap();
            assert_eq!(HITS.fold(&mut first, 0, |sum, _, hits| sum + hits.get()), 6 * round);
        }
        assert_eq!(HITS.fold(&mut second, 0, |sum, _, hits| sum + hits.take()), 3000);
        assert_eq!(HITS.fold(&mut second, 0, |sum, _, hits| sum + hits.get()), 0);
    }

    #[test]
    fn slots_are_far_apart_unused_ones_skipped_all_dropped() {
        let mut team = team(4);
        team.run(|worker| (worker.index() != 2).then(|| NOTED.local(worker).0.set(worker.index() as u64)))
            .unwrap();
        let mut found = Vec::new();
        NOTED.fold(&mut team, (), |(), worker, noted| {
            found.push((worker, noted.0.get(), (&raw const *noted).addr()))
        });
        assert_eq!(found.iter().map(|slot| (slot.0, slot.1)).collect::<Vec<_>>(), [(0, 0), (1, 1), (3, 3)]);
        assert!(found.windows(2).all(|pair| pair[0].2.abs_diff(pair[1].2) >= 64));
        let before = DROPPED.load(Relaxed);
        drop(team);
        assert_eq!(DROPPED.load(Relaxed) - before, 3);
    }

    struct Failing;

    impl Drop for Failing {
        fn drop(&mut self) {
            assert!(Worker::with_current(|_| ()).is_err(), "a worker that ends is nobody's");
            panic!("a slot's drop fails on purpose");
        }
    }

    crate::per_thread! {
        static FAILING: Failing = Failing;
        static AFTER: Counter = Counter::new();
    }

    #[test]
    fn a_drop_that_fails_leaves_no_slot_behind() {
        for _ in 0..2 {
            let mut team = team(2);
            team.run(|worker| {
                FAILING.local(worker);
                AFTER.local(worker).add(1);
            })
            .unwrap();
            assert_eq!(AFTER.fold(&mut team, 0, |sum, _, count| sum + count.get()), 2, "slots start afresh");
        }
    }

    #[test]
    fn slots_larger_than_a_chunk() {
        let mut team = team(2);
        assert_eq!(team.run(|worker| BIG.local(worker).iter().sum::<u64>()).unwrap(), [3 << 19; 2]);
    }

    #[test]
    fn only_workers_are_current() {
        assert!(Worker::with_current(Worker::index).is_err());
        let found = team(2).run(|_| Worker::with_current(Worker::index)).unwrap();
        assert_eq!(found, [Ok(0), Ok(1)]);
    }

    #[test]
    fn per_worker_values_belong_to_their_team() {
        let (mut mine, mut other) = (team(3), team(3));
        let mut values = PerWorker::new(&mut mine, |worker| Cell::new(worker.index())).unwrap();
        mine.run(|worker| values.local(worker).set(values.local(worker).get() + 10)).unwrap();
        assert_eq!(values.iter_mut().map(|value| value.get()).collect::<Vec<_>>(), [10, 11, 12]);
        assert_eq!(
            format!("{values:?}"),
            "PerWorker { workers: 3, .. }",
            "values are their workers' to read"
        );
        let misuse = other.run(|worker| values.local(worker).get()).unwrap_err();
        assert!(misuse.message.contains("another team"), "{misuse}");
    }
}
