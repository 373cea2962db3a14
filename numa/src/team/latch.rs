//! Latches: a worker (or the thread outside) waits until so many things are done.
//!
//! Setting a latch may free the memory it is in: the owner that sees it set returns from the frame that holds it. So
//! the setter reads everything it needs before the write, and touches only the team's own state afterwards.

use std::sync::atomic::Ordering::{AcqRel, Acquire, Relaxed};

use super::sleep::Sleep;
use crate::sync::AtomicUsize;

/// Counts down to 0; then its owner, by index in [`Sleep`], goes on.
#[derive(Debug)]
pub struct Latch {
    pending: AtomicUsize,
    owner: usize,
}

impl Latch {
    pub fn new(pending: usize, owner: usize) -> Self {
        Self { pending: AtomicUsize::new(pending), owner }
    }

    /// Whether all is done. Acquire: what was done happens before what the owner does next.
    #[inline]
    pub fn is_set(&self) -> bool {
        self.pending.load(Acquire) == 0
    }

    /// One more thing is to be done; for who does one of them.
    pub fn add(&self) {
        // Relaxed: the caller's own count-down, which comes later, is what orders it.
        self.pending.fetch_add(1, Relaxed);
    }

    /// One thing is done.
    ///
    /// # Safety
    /// The latch must be alive until this call's own decrement; it is not touched after it.
    pub unsafe fn count_down(this: *const Self, sleep: &Sleep) {
        // SAFETY: alive by the contract: the owner returns only when `pending` is 0, and ours is still counted.
        let owner = unsafe { (*this).owner };
        // SAFETY: as above. AcqRel: the chain of decrements carries everybody's work to the owner.
        let was_last = unsafe { (*this).pending.fetch_sub(1, AcqRel) } == 1;
        if was_last {
            sleep.wake_after_write(owner);
        }
    }
}
