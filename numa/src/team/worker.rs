//! A worker: its identity, its queues, and the loop in which it waits for work.
//!
//! Code gets a `&Worker` only on the worker's own thread, for the length of a job: it is the proof of being there.
//! It is neither `Send` nor `Sync` (its deques are not), so the proof cannot leave the thread.

use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::{Acquire, Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Instant;

use super::latch::Latch;
use super::panic::BrokenBarrier;
use super::sleep::NOBODY;
use super::times::{Account, Clock, State};
use super::{Shared, Task};
use crate::arena::Arena;
use crate::deferred::{Deferred, Held};
use crate::pinning::{Plan, Slot};
use crate::queue::{Local, Origin, Reach};

thread_local! {
    static CURRENT: Cell<*const Worker> = const { Cell::new(std::ptr::null()) };
}

/// The calling thread is not a worker of a team.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("this thread is not a worker of a team; call from inside a job, such as `Team::run`")]
pub struct NotAWorker;

/// The worker whose code is running; see the module's text.
#[derive(Debug)]
pub struct Worker {
    pub(super) index: usize,
    pub(super) shared: Arc<Shared>,
    pub(super) queue: Local<Task>,
    pub(super) clock: Clock,
    /// Number among all workers of the process, for per-thread statics.
    pub(crate) id: usize,
    /// On its node: its slots of per-thread statics.
    pub(crate) statics: Arena,
    /// What to do when the worker ends: drop these slots.
    at_end: RefCell<Vec<AtEnd>>,
}

/// A deferred call, kept on its own thread.
struct AtEnd(Box<dyn FnOnce()>);

impl std::fmt::Debug for AtEnd {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("AtEnd")
    }
}

/// Looks around this often before sleeping, where the worker has a CPU of its own: tens of microseconds.
const ROUNDS: u32 = 60;
/// Of these, the first so many with pauses between; then the CPU is offered to others, such as the thread outside.
const BUSY_ROUNDS: u32 = 10;
/// Pauses between two looks.
const PAUSES: u32 = 16;

/// Whom a worker helps that waits.
#[derive(Clone, Copy)]
enum Help<'a> {
    /// Whoever offers something.
    Anybody,
    /// The worker with this index, if any yet.
    Thief(&'a AtomicUsize),
}

impl Worker {
    pub(super) fn new(index: usize, id: usize, shared: Arc<Shared>, queue: Local<Task>) -> Self {
        let plan = &shared.plan;
        let statics = Arena::small_on_node(plan.machine.nodes[plan.slots[index].node].os);
        Self { index, shared, queue, clock: Clock::new(), id, statics, at_end: RefCell::default() }
    }

    /// Index in the team, from 0.
    pub fn index(&self) -> usize {
        self.index
    }

    /// Where it sits.
    pub fn slot(&self) -> Slot {
        self.shared.plan.slots[self.index]
    }

    /// Its node, by position in the machine's table.
    pub fn node(&self) -> usize {
        self.slot().node
    }

    /// Its node's number in the operating system, as [`crate::pages`] wants it.
    pub fn node_os(&self) -> usize {
        self.shared.plan.machine.nodes[self.node()].os
    }

    /// The team's plan.
    pub fn plan(&self) -> &Plan {
        &self.shared.plan
    }

    pub(crate) fn team_id(&self) -> usize {
        self.shared.id
    }

    /// Calls `f` with the worker that the calling thread is, for code that is not handed one.
    pub fn with_current<R>(f: impl FnOnce(&Self) -> R) -> Result<R, NotAWorker> {
        let worker = CURRENT.get();
        // SAFETY: set by `enter` on this thread and cleared before the worker goes away, so it is null or alive; the
        // borrow ends with this call, on the same thread.
        unsafe { worker.as_ref() }.map(f).ok_or(NotAWorker)
    }

    /// Waits until every worker of the team is here. Only for the function given to [`super::Team::run`] itself, never
    /// for a task, and every worker must call it equally often; when one panics instead, the others' calls unwind too.
    pub fn barrier(&self) {
        let old = self.switch(State::Barrier);
        let outcome = self.shared.barrier.wait(self.shared.groups[self.index]);
        self.switch(old);
        if outcome.is_err() {
            std::panic::resume_unwind(Box::new(BrokenBarrier));
        }
    }

    /// Locks, counting the wait as lock time; a lock that is free costs no clock reading. A mutex whose holder
    /// panicked is locked all the same: the panic reaches the caller anyway.
    pub fn lock<'m, T>(&self, mutex: &'m Mutex<T>) -> MutexGuard<'m, T> {
        match mutex.try_lock() {
            Ok(guard) => guard,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => {
                self.waiting_for_lock(|| mutex.lock().unwrap_or_else(PoisonError::into_inner))
            }
        }
    }

    /// As [`Worker::lock`], for a value with contributions: `merge` is given them.
    pub fn lock_deferred<'m, T, D>(
        &self,
        deferred: &'m Deferred<T, D>,
        mut merge: impl FnMut(&mut T, D),
    ) -> Held<'m, T> {
        let free = deferred.try_lock(&mut merge);
        free.unwrap_or_else(|| self.waiting_for_lock(|| deferred.lock(merge)))
    }

    /// Leaves a contribution, and counts it.
    pub fn defer<T, D>(&self, deferred: &Deferred<T, D>, contribution: D) {
        self.account().count_deferral();
        deferred.defer(contribution);
    }

    fn waiting_for_lock<R>(&self, lock: impl FnOnce() -> R) -> R {
        self.account().count_lock_wait();
        let old = self.switch(State::Lock);
        let locked = lock();
        self.switch(old);
        locked
    }

    /// Waits for a notification as [`Condvar::wait`], as idle time. For jobs of [`super::Team::run`] whose workers depend
    /// on each other: it helps nobody meanwhile, and is not ended by a worker's panic; who notifies must see to that.
    pub fn wait<'m, T>(&self, condvar: &Condvar, guard: MutexGuard<'m, T>) -> MutexGuard<'m, T> {
        let old = self.switch(State::Idle);
        let guard = condvar.wait(guard).unwrap_or_else(PoisonError::into_inner);
        self.switch(old);
        guard
    }

    pub(crate) fn at_end(&self, call: impl FnOnce() + 'static) {
        self.at_end.borrow_mut().push(AtEnd(Box::new(call)));
    }

    pub(super) fn account(&self) -> &Account {
        &self.shared.accounts[self.index]
    }

    pub(super) fn switch(&self, state: State) -> State {
        self.clock.switch(self.account(), state)
    }

    /// What a piece of so much work is allowed.
    pub(super) fn reach(&self, weight: u64) -> Reach {
        self.shared.reach(weight)
    }

    /// Offers a task to others and wakes the nearest one that sleeps.
    ///
    /// The fence of the sleep protocol is left out where this worker's deques held something before and nobody is
    /// seen asleep. A worker that falls asleep in that very moment may miss this task; it does not stall, because its
    /// owner is awake and takes back what nobody took, and the next push wakes the sleeper.
    pub(super) fn push(&self, task: Task, reach: Reach) {
        let was_empty = self.queue.is_empty();
        self.queue.push(task, reach);
        let sleep = &self.shared.sleep;
        let woken = (was_empty || sleep.anyone_asleep()) && self.wake_nearest(reach);
        if !woken && sleep.is_heard(self.index) {
            sleep.wake_listener(self.index, self.shared.wake_order[self.index].workers.iter().copied());
        }
    }

    fn wake_nearest(&self, reach: Reach) -> bool {
        let order = &self.shared.wake_order[self.index];
        let near = match reach {
            Reach::Node => order.near,
            Reach::Machine => order.workers.len(),
        };
        self.shared.sleep.wake_first(order.workers[..near].iter().copied())
    }

    /// Runs a task that came through a queue.
    pub(super) fn execute(&self, task: Task) {
        self.account().count_task();
        // SAFETY: a task in a queue is alive and run once (see `Task`); this is the once.
        unsafe { task.run(self) };
    }

    /// Helps others until `done`; sleeps when there is nothing to help with. Keeps the state it is called in.
    pub(super) fn wait_until(&self, done: impl Fn() -> bool) {
        self.keeping_state(|| self.help_until(&done, Help::Anybody));
    }

    /// Helps who stole the job that the latch is of, with parts of it, until the latch is set.
    pub(super) fn wait_for_thief(&self, latch: &Latch, thief: &AtomicUsize) {
        self.keeping_state(|| self.help_until(&|| latch.is_set(), Help::Thief(thief)));
    }

    fn keeping_state(&self, wait: impl FnOnce()) {
        let state = self.clock.state();
        wait();
        if self.clock.state() != state {
            self.switch(state);
        }
    }

    fn help_until(&self, done: &dyn Fn() -> bool, help: Help<'_>) {
        let mut rounds = 0;
        while !done() {
            if self.help_once(help) {
                rounds = 0;
                continue;
            }
            rounds += 1;
            if rounds <= self.shared.rounds {
                match rounds {
                    ..=BUSY_ROUNDS => (0..PAUSES).for_each(|_| crate::sync::spin_loop()),
                    _ => std::thread::yield_now(),
                }
                continue;
            }
            rounds = 0;
            match help {
                Help::Anybody => self.shared.sleep.announce(self.index),
                Help::Thief(thief) => self.shared.sleep.announce_deaf(self.index, thief.load(Relaxed)),
            }
            // The announcement is out: whatever appears from now on wakes this worker, so look once more.
            if done() {
                self.shared.sleep.retract(self.index);
            } else if let Some((task, origin)) = self.find(help) {
                self.shared.sleep.retract(self.index);
                self.book(origin, Instant::now());
                self.execute(task);
            } else {
                self.shared.sleep.sleep(self.index);
            }
        }
    }

    fn find(&self, help: Help<'_>) -> Option<(Task, Origin)> {
        match help {
            Help::Anybody => self.queue.find(&self.shared.queues),
            Help::Thief(thief) => match thief.load(Relaxed) {
                NOBODY => None,
                thief => {
                    let near = self.shared.plan.slots[thief].node == self.node();
                    self.shared.queues.take_from(thief, near)
                }
            },
        }
    }

    /// Runs one task if there is any; its own ones without reading the clock.
    fn help_once(&self, help: Help<'_>) -> bool {
        if matches!(help, Help::Anybody)
            && let Some(task) = self.queue.pop(Reach::Node).or_else(|| self.queue.pop(Reach::Machine))
        {
            if self.clock.state() != State::Busy {
                self.switch(State::Busy);
            }
            self.execute(task);
            return true;
        }
        let started = Instant::now();
        if self.clock.state() == State::Busy {
            self.clock.switch_at(self.account(), State::Idle, started);
        }
        let Some((task, origin)) = self.find(help) else { return false };
        self.book(origin, started);
        self.execute(task);
        true
    }

    /// Books a look that started at `started` and found a task, and starts being busy.
    fn book(&self, origin: Origin, started: Instant) {
        let steal = match origin {
            Origin::Own => None,
            Origin::Near => Some((State::StealNear, false)),
            Origin::Far => Some((State::StealFar, true)),
        };
        if let Some((state, far)) = steal {
            self.clock.switch_at(self.account(), state, started);
            self.account().count_steal(far);
        }
        self.switch(State::Busy);
    }

    /// The life of a worker: every broadcast job once, helping in between, until the team ends.
    pub(super) fn live(&self) {
        CURRENT.set(self);
        let mut seen = 0;
        loop {
            let epoch = || self.shared.epoch.load(Acquire);
            self.help_until(&|| epoch() != seen || self.shared.shutdown.load(Acquire), Help::Anybody);
            if epoch() == seen {
                break;
            }
            seen += 1;
            self.switch(State::Busy);
            // SAFETY: the job was written before the epoch it belongs to, which was seen with Acquire; it is written
            // again only after this worker has counted it down, at the end of `run`.
            let job = unsafe { *self.shared.job.get() };
            if let Some(job) = job {
                // SAFETY: a broadcast job is alive until every worker has run it once; this is this worker's once.
                unsafe { job.run(self) };
            }
        }
        // First, so that nothing dropped below can reach the worker and make slots again.
        CURRENT.set(std::ptr::null());
        for AtEnd(call) in self.at_end.take() {
            // Each slot must be cleared, whatever another's drop does.
            let _ = catch_unwind(AssertUnwindSafe(call));
        }
    }
}

/// `ROUNDS` for workers with a CPU of their own; the others must not burn the time of those they share it with.
pub(super) fn rounds(own_cpu: bool) -> u32 {
    if own_cpu { ROUNDS } else { 1 }
}
