//! Fork-join inside a task, after rayon and Cilk: `b` is offered to others while `a` runs, and taken back if nobody
//! wanted it. Waiting for a stolen `b` means helping the thief with it, as far as it offers parts of it, and sleeping in between
//! (leapfrogging: Wagner, Calder, PPoPP 1993). Anything else would keep whoever waits for this join waiting longer.

use std::cell::UnsafeCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;

use super::latch::Latch;
use super::panic::WorkerPanic;
use super::sleep::NOBODY;
use super::{Task, Worker};

/// A job on the stack of the frame that waits for it.
pub(super) struct StackJob<F, R> {
    pub(super) latch: Latch,
    /// Who runs it, once somebody stole it; until then [`NOBODY`].
    thief: AtomicUsize,
    call: UnsafeCell<Option<F>>,
    result: UnsafeCell<Option<Result<R, Box<WorkerPanic>>>>,
}

impl<F, R> StackJob<F, R>
where
    F: FnOnce(&Worker) -> R + Send,
    R: Send,
{
    pub(super) fn new(call: F, owner: usize) -> Self {
        Self {
            latch: Latch::new(1, owner),
            thief: AtomicUsize::new(NOBODY),
            call: UnsafeCell::new(Some(call)),
            result: UnsafeCell::new(None),
        }
    }

    /// # Safety
    /// The job must outlive the task's run: its frame must wait for the latch or take the task back.
    pub(super) unsafe fn task(&self) -> Task {
        Task { data: std::ptr::from_ref(self).cast(), run: Self::run }
    }

    /// # Safety
    /// `data` must be a live `StackJob<F, R>` that nobody runs or ran.
    unsafe fn run(data: *const (), worker: &Worker) {
        let this = data.cast::<Self>();
        // SAFETY: alive, and until the latch is set this thread is the only one to touch `call` and `result`.
        unsafe {
            // Relaxed: whoever reads it only learns where to look.
            (*this).thief.store(worker.index, Relaxed);
            let call = (*(*this).call.get()).take();
            let outcome = call.map(|call| {
                catch_unwind(AssertUnwindSafe(|| call(worker)))
                    .map_err(|payload| WorkerPanic::caught(payload, worker))
            });
            *(*this).result.get() = outcome;
            Latch::count_down(&raw const (*this).latch, &worker.shared.sleep);
        }
    }

    /// The result of a job whose latch is set.
    pub(super) fn into_result(self) -> Result<R, Box<WorkerPanic>> {
        match self.result.into_inner() {
            Some(result) => result,
            None => unreachable!("a job was waited for and never run"),
        }
    }
}

impl Worker {
    /// Runs both, `b` perhaps on another worker; a panic in either unwinds here, after both ended.
    pub fn join<A, B, RA, RB>(&self, a: A, b: B) -> (RA, RB)
    where
        A: FnOnce(&Worker) -> RA + Send,
        B: FnOnce(&Worker) -> RB + Send,
        RA: Send,
        RB: Send,
    {
        self.join_weighted(u64::MAX, a, b)
    }

    /// As [`Worker::join`], telling how much work `b` is, in the program's own unit: below the team's limit
    /// ([`super::Team::set_far_limit`]) it stays on its node.
    pub fn join_weighted<A, B, RA, RB>(&self, weight: u64, a: A, b: B) -> (RA, RB)
    where
        A: FnOnce(&Worker) -> RA + Send,
        B: FnOnce(&Worker) -> RB + Send,
        RA: Send,
        RB: Send,
    {
        let reach = self.reach(weight);
        let job = StackJob::new(b, self.index);
        // SAFETY: below, this frame does not end, by return or unwinding, before the task is taken back or its latch
        // is set.
        self.push(unsafe { job.task() }, reach);
        let first = catch_unwind(AssertUnwindSafe(|| a(self)));
        // Whatever `a` pushed it took back, so `b` is on top, or stolen, and with it, as a rule, all that is older.
        if let Some(task) = self.queue.pop(reach) {
            if std::ptr::eq(task.data, std::ptr::from_ref(&job).cast()) {
                return self.both(first, || job.call.into_inner().map(|call| call(self)));
            }
            self.queue.push(task, reach);
        }
        self.wait_for_thief(&job.latch, &job.thief);
        self.both(first, || Some(job.into_result().unwrap_or_else(|panic| panic.relay())))
    }

    /// Unwinds with the first's panic, if any; else gets the second's result.
    fn both<RA, RB>(&self, first: std::thread::Result<RA>, second: impl FnOnce() -> Option<RB>) -> (RA, RB) {
        let first = first.unwrap_or_else(|payload| WorkerPanic::caught(payload, self).relay());
        match second() {
            Some(second) => (first, second),
            None => unreachable!("a job that was taken back had run"),
        }
    }
}
