//! A worker's panic, carried to the caller with the worker's identity.

use std::any::Any;
use std::fmt;

use super::Worker;

/// What a worker panicked with, and which worker it was.
///
/// Inside a job it travels as the payload of the unwinding, through joins on other workers, so it names the worker
/// on which the code really failed.
pub struct WorkerPanic {
    /// Index of the worker.
    pub worker: usize,
    /// The CPU it is pinned to.
    pub cpu: Option<usize>,
    /// The panic's text; "a payload that is not text" where it has none.
    pub message: String,
    /// The payload itself.
    pub payload: Box<dyn Any + Send>,
}

/// The payload of those who were waiting in a barrier that another worker's panic broke.
pub(super) struct BrokenBarrier;

impl WorkerPanic {
    /// Wraps a caught payload; one that comes from another worker keeps that worker's name.
    pub(super) fn caught(payload: Box<dyn Any + Send>, worker: &Worker) -> Box<Self> {
        payload.downcast::<Self>().unwrap_or_else(|payload| {
            let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
            let message = text
                .or_else(|| payload.downcast_ref::<String>().cloned())
                .unwrap_or_else(|| "a payload that is not text".to_owned());
            Box::new(Self { worker: worker.index(), cpu: worker.slot().cpu, message, payload })
        })
    }

    /// Goes on unwinding on the worker that waits for the failed work, without a second message.
    pub(super) fn relay(self: Box<Self>) -> ! {
        std::panic::resume_unwind(self)
    }

    fn is_consequence(&self) -> bool {
        self.payload.is::<BrokenBarrier>()
    }

    /// Keeps the first panic, but prefers a cause to its consequences.
    pub(super) fn keep_first(kept: &mut Option<Box<Self>>, new: Box<Self>) {
        if kept.as_ref().is_none_or(|kept| kept.is_consequence() && !new.is_consequence()) {
            *kept = Some(new);
        }
    }
}

impl fmt::Display for WorkerPanic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.cpu {
            Some(cpu) => write!(f, "worker {} on CPU {cpu} panicked: {}", self.worker, self.message),
            None => write!(f, "worker {} panicked: {}", self.worker, self.message),
        }
    }
}

impl fmt::Debug for WorkerPanic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl std::error::Error for WorkerPanic {}
