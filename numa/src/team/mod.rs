//! A team: a fixed set of pinned workers, started once, that run jobs together.
//!
//! * [`Team::run`]: the same function on every worker, as the paper's processes run; [`Worker::barrier`] inside.
//! * [`Team::for_each_mut`]: items on their home nodes, stolen nearest first.
//! * [`Team::enter`]: one function on one worker, which splits itself with [`Worker::join`]; the others steal.
//!
//! Workers wait in one loop, for a job, for tasks, for the end: they look around for some tens of microseconds, then
//! sleep (the `sleep` module's protocol), so an idle team costs nothing. The thread outside owns the team mutably
//! while a job runs, so there is one job at a time, and data that jobs borrow is alive until they end: every entry
//! waits for a latch that each participant counts down as its last act.
//!
//! A panic in a job reaches the caller as [`WorkerPanic`], which names the worker; the team can go on.

mod items;
mod join;
mod latch;
mod panic;
mod sleep;
mod start;
mod times;
mod worker;

use std::cell::UnsafeCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::Ordering::{Relaxed, Release};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam_utils::CachePadded;

pub use items::Home;
pub use panic::WorkerPanic;
pub(crate) use start::MAX_WORKERS;
pub use start::Seat;
pub use times::Times;
pub use worker::{NotAWorker, Worker};

use crate::barrier::Barrier;
use crate::pinning::Plan;
use crate::queue::{Queues, Reach};
use join::StackJob;
use latch::Latch;
use sleep::Sleep;
use times::Account;

/// A job as two words: what to call, and with what.
///
/// Invariant: `data` is what `run` expects, alive until `run` has counted down the job's latch, and may be used from
/// any worker (the constructors demand `Send` or `Sync`). A queued task is run once; a broadcast one once per worker.
#[derive(Clone, Copy, Debug)]
struct Task {
    data: *const (),
    run: unsafe fn(*const (), &Worker),
}

// SAFETY: by the invariant, what `data` points to may be used from any worker.
unsafe impl Send for Task {}

impl Task {
    /// # Safety
    /// The invariant's last sentence.
    unsafe fn run(self, worker: &Worker) {
        // SAFETY: `data` is what `run` expects and alive, by the invariant.
        unsafe { (self.run)(self.data, worker) }
    }
}

/// Others of a worker, nearest first; the first `near` are on its node.
#[derive(Debug)]
struct WakeOrder {
    workers: Vec<usize>,
    near: usize,
}

/// What the workers and the thread outside share.
#[derive(Debug)]
struct Shared {
    /// Distinguishes teams.
    id: usize,
    plan: Plan,
    workers_by_node: Vec<Vec<usize>>,
    /// For every node, the nearest node with workers.
    staffed: Vec<usize>,
    queues: Queues<Task>,
    wake_order: Vec<WakeOrder>,
    sleep: Sleep,
    barrier: Barrier,
    /// Barrier group by worker.
    groups: Vec<usize>,
    accounts: Vec<CachePadded<Account>>,
    rounds: u32,
    far_limit: AtomicU64,
    shutdown: AtomicBool,
    epoch: CachePadded<AtomicUsize>,
    job: UnsafeCell<Option<Task>>,
}

// SAFETY: all fields are `Sync` but `job`, which is written only by the thread that owns the team mutably, while no
// broadcast is running, and read only by workers that have seen the epoch written after it.
unsafe impl Sync for Shared {}

impl Shared {
    fn reach(&self, weight: u64) -> Reach {
        if weight < self.far_limit.load(Relaxed) { Reach::Node } else { Reach::Machine }
    }

    /// Whom to wake for a task in a node's inbox.
    fn wake_order_of_node(&self, node: usize, reach: Reach) -> impl Iterator<Item = usize> {
        let own = &self.workers_by_node[node];
        let others = own.first().filter(|_| reach == Reach::Machine).map(|&worker| &self.wake_order[worker]);
        own.iter()
            .copied()
            .chain(others.into_iter().flat_map(|order| order.workers[order.near..].iter().copied()))
    }

    /// Waits on the thread outside, asleep: its CPU may be a worker's.
    fn wait_outside(&self, latch: &Latch) {
        let me = self.plan.slots.len();
        while !latch.is_set() {
            self.sleep.announce(me);
            if latch.is_set() { self.sleep.retract(me) } else { self.sleep.sleep(me) }
        }
    }
}

/// A fixed set of pinned workers; see the module's text. Dropping it ends and joins them.
#[derive(Debug)]
pub struct Team {
    shared: Arc<Shared>,
    seats: Vec<Seat>,
    threads: Vec<JoinHandle<()>>,
    ids: start::Ids,
    running: Duration,
}

/// A job for all workers, on the stack of `Team::run`.
struct Broadcast<'a, F, R> {
    body: &'a F,
    results: Vec<Mutex<Option<R>>>,
    panic: Mutex<Option<Box<WorkerPanic>>>,
    latch: Latch,
}

impl<F: Fn(&Worker) -> R + Sync, R: Send> Broadcast<'_, F, R> {
    /// # Safety
    /// `data` must be a live broadcast that this worker has not run.
    unsafe fn run(data: *const (), worker: &Worker) {
        // SAFETY: alive until the latch below is counted down by every worker.
        let this = unsafe { &*data.cast::<Self>() };
        match catch_unwind(AssertUnwindSafe(|| (this.body)(worker))) {
            Ok(result) => *whole(&this.results[worker.index()]) = Some(result),
            Err(payload) => {
                WorkerPanic::keep_first(&mut whole(&this.panic), WorkerPanic::caught(payload, worker));
                worker.shared.barrier.poison();
            }
        }
        worker.switch(times::State::Idle);
        // SAFETY: alive until its last count-down, which this may be; nothing here is used after it.
        unsafe { Latch::count_down(&raw const this.latch, &worker.shared.sleep) };
    }
}

/// Locks a value that is whole at any time, whatever happened to an earlier holder.
fn whole<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Team {
    /// Number of workers.
    #[allow(clippy::len_without_is_empty, reason = "a team is never empty")]
    pub fn len(&self) -> usize {
        self.shared.plan.slots.len()
    }

    /// The plan the team was started from.
    pub fn plan(&self) -> &Plan {
        &self.shared.plan
    }

    /// Where each worker really is: its pin as read back.
    pub fn seats(&self) -> &[Seat] {
        &self.seats
    }

    /// The other workers in the order in which `worker` looks for work: nearest first; equals of a node by index.
    pub fn steal_order(&self, worker: usize) -> &[usize] {
        &self.shared.wake_order[worker].workers
    }

    /// Numbers of the workers among all workers of the process.
    pub(crate) fn ids(&self) -> &[usize] {
        &self.ids.0
    }

    pub(crate) fn id(&self) -> usize {
        self.shared.id
    }

    /// Pieces of less work than this stay on their node; the unit is the program's own. At first 0: all may travel.
    pub fn set_far_limit(&mut self, weight: u64) {
        self.shared.far_limit.store(weight, Relaxed);
    }

    /// Runs `body` on every worker and returns the results by worker.
    pub fn run<R: Send>(&mut self, body: impl Fn(&Worker) -> R + Sync) -> Result<Vec<R>, WorkerPanic> {
        let started = Instant::now();
        let workers = self.len();
        let broadcast = Broadcast {
            body: &body,
            results: (0..workers).map(|_| Mutex::new(None)).collect(),
            panic: Mutex::new(None),
            latch: Latch::new(workers, workers),
        };
        let task = Self::broadcast_task(&broadcast);
        // SAFETY: no broadcast is running (`&mut self`), so no worker reads `job` before the new epoch.
        unsafe { *self.shared.job.get() = Some(task) };
        // Release: publishes the job; the waking fence comes after it.
        self.shared.epoch.store(self.shared.epoch.load(Relaxed).wrapping_add(1), Release);
        self.shared.sleep.wake_all(0..workers);
        self.shared.wait_outside(&broadcast.latch);
        self.running += started.elapsed();
        let panic = broadcast.panic.into_inner().unwrap_or_else(PoisonError::into_inner);
        if let Some(panic) = panic {
            // All workers are out of the job, hence of the barrier.
            self.shared.barrier.reset();
            return Err(*panic);
        }
        let result = |slot: Mutex<Option<R>>| slot.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(broadcast.results.into_iter().filter_map(result).collect())
    }

    fn broadcast_task<F: Fn(&Worker) -> R + Sync, R: Send>(broadcast: &Broadcast<'_, F, R>) -> Task {
        Task { data: std::ptr::from_ref(broadcast).cast(), run: Broadcast::<F, R>::run }
    }

    /// Runs `each` on every item, on its home node while that node's workers have time. After a panic the items that
    /// were not started are skipped.
    pub fn for_each_mut<T, H, F>(&mut self, items: &mut [T], home: H, each: F) -> Result<(), WorkerPanic>
    where
        T: Send,
        H: Fn(&T) -> Home,
        F: Fn(&Worker, &mut T) + Sync,
    {
        let started = Instant::now();
        let wait = |latch: &Latch| self.shared.wait_outside(latch);
        let outcome = items::for_each_mut(&self.shared, items, home, &each, self.len(), wait);
        self.running += started.elapsed();
        outcome.map_err(|panic| *panic)
    }

    /// Runs `body` on one worker of the first worker's node; it splits its work with [`Worker::join`] and
    /// [`Worker::for_each_mut`], which the others help with.
    pub fn enter<R: Send>(&mut self, body: impl FnOnce(&Worker) -> R + Send) -> Result<R, WorkerPanic> {
        let started = Instant::now();
        let job = StackJob::new(body, self.len());
        let node = self.shared.plan.slots[0].node;
        // SAFETY: this frame waits for the latch, and nothing before that unwinds.
        self.shared.queues.send(node, unsafe { job.task() }, Reach::Machine);
        self.shared.sleep.wake_first(self.shared.wake_order_of_node(node, Reach::Machine));
        self.shared.wait_outside(&job.latch);
        self.running += started.elapsed();
        job.into_result().map_err(|panic| *panic)
    }

    /// Where each worker's time went since the start or the last reset.
    pub fn times(&mut self) -> Vec<Times> {
        let running = self.running;
        self.settle();
        self.running = running;
        self.shared.accounts.iter().map(|account| account.read(running)).collect()
    }

    /// Starts counting time from zero.
    pub fn reset_times(&mut self) {
        self.settle();
        self.running = Duration::ZERO;
        self.shared.accounts.iter().for_each(|account| account.reset());
    }

    /// Lets every worker book its last task: an empty job does not end before.
    fn settle(&mut self) {
        // An empty job cannot panic.
        let _ = self.run(|_| ());
    }
}

impl Drop for Team {
    fn drop(&mut self) {
        self.shared.shutdown.store(true, Release);
        self.shared.sleep.wake_all(0..self.len());
        for thread in self.threads.drain(..) {
            // A worker's thread ends without unwinding: jobs are caught.
            let _ = thread.join();
        }
    }
}

#[cfg(all(test, not(loom)))]
mod tests;
