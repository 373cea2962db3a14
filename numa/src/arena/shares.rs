//! The count of who keeps a chunk alive; see the parent module's text for the protocol.

use std::sync::atomic::Ordering::{Acquire, Relaxed, Release};

use crate::sync::{AtomicUsize, fence};

/// What an open chunk's count starts from: more than all the handles it can ever issue.
const BIAS: usize = 1 << 40;

/// Handles alive plus the arena's share; biased while the chunk is open.
#[derive(Debug)]
pub struct Shares(AtomicUsize);

impl Shares {
    /// The arena's share only.
    pub fn new() -> Self {
        Self(AtomicUsize::new(1))
    }

    /// Starts a life as the open chunk's count. Only the arena calls it, on a chunk without handles.
    pub fn open(&self) {
        // Relaxed: no handle exists; the first one reaches other threads through whatever sends it.
        self.0.store(BIAS, Relaxed);
    }

    /// Turns the biased count into handles alive plus the arena's share.
    pub fn seal(&self, issued: usize) {
        self.0.fetch_sub(BIAS - 1 - issued, Relaxed);
    }

    /// Whether any handle to a sealed chunk is alive.
    pub fn has_handles(&self) -> bool {
        // Acquire: pairs with `Release` in `drop_one`, so that reuse comes after the last value's drop.
        self.0.load(Acquire) != 1
    }

    /// Gives back one share; `true` for the last, who must free the chunk.
    ///
    /// # Safety
    /// `this` must be alive until this call's own decrement, which the share guarantees; it is not touched after a
    /// decrement that was not the last.
    pub unsafe fn drop_one(this: *const Self) -> bool {
        // SAFETY: alive by the contract.
        let was_last = unsafe { (*this).0.fetch_sub(1, Release) } == 1;
        if was_last {
            fence(Acquire);
        }
        was_last
    }
}

#[cfg(all(test, loom))]
mod models {
    use super::*;
    use loom::cell::UnsafeCell;
    use loom::sync::Arc;

    /// Two handles dropped on other threads while the arena seals and leaves: exactly one frees, after all accesses
    /// (loom's cell would report a race).
    #[test]
    fn loom_last_share_frees_after_every_use() {
        loom::model(|| {
            let shares = Arc::new(Shares::new());
            let memory = Arc::new(UnsafeCell::new(0u64));
            shares.open();
            let leave = |shares: &Shares, memory: &UnsafeCell<u64>| {
                // SAFETY: the share is this thread's; the cell outlives the model's threads.
                let last = unsafe { Shares::drop_one(shares) };
                if last {
                    memory.with_mut(|memory| {
                        // SAFETY: the last share's owner is alone; loom checks exactly this.
                        unsafe { *memory = u64::MAX }
                    });
                }
                last
            };
            let handles = [0, 1].map(|_| {
                let (shares, memory) = (Arc::clone(&shares), Arc::clone(&memory));
                loom::thread::spawn(move || {
                    memory.with(|memory| {
                        // SAFETY: a handle may read while it holds its share; loom checks it.
                        assert_eq!(unsafe { *memory }, 0);
                    });
                    leave(&shares, &memory)
                })
            });
            shares.seal(2);
            let arena_freed = leave(&shares, &memory);
            let freed = handles.map(|handle| handle.join().unwrap());
            assert_eq!(freed.into_iter().chain([arena_freed]).filter(|&freed| freed).count(), 1);
        });
    }

    /// A chunk that looks unused may be written at once: the handle's use happened before.
    #[test]
    fn loom_reuse_comes_after_the_last_drop() {
        loom::model(|| {
            let shares = Arc::new(Shares::new());
            let memory = Arc::new(UnsafeCell::new(0u64));
            shares.open();
            let handle = {
                let (shares, memory) = (Arc::clone(&shares), Arc::clone(&memory));
                loom::thread::spawn(move || {
                    memory.with_mut(|memory| {
                        // SAFETY: the handle's own value; loom checks it.
                        unsafe { *memory += 1 }
                    });
                    // SAFETY: the share is this thread's.
                    assert!(!unsafe { Shares::drop_one(&*shares) }, "the arena holds one");
                })
            };
            shares.seal(1);
            if !shares.has_handles() {
                memory.with_mut(|memory| {
                    // SAFETY: nobody else has a share but the arena; loom checks it.
                    unsafe { *memory += 1 }
                });
            }
            handle.join().unwrap();
        });
    }
}
