//! A lock that nobody has to wait for: who finds it taken leaves a contribution, which the next holder merges.
//!
//! Two locks: one for the value, one for the list of contributions, which is held only to push or to take the list. The
//! second is taken while the first is held, never the other way round, so there is no deadlock. Whoever gets the value
//! first takes the whole list and merges it, so
//!
//! * nothing is merged twice: taking the list empties it under its lock;
//! * nothing is lost: what is left on the list is there for the next holder, at the latest for [`Deferred::into_inner`];
//! * a holder sees all contributions left before it took the list, in the order in which they were left.
//!
//! A contribution left while the value is held stays on the list after its release: its giver has gone on to other
//! work, so it matters only to the next holder.

use crate::sync::{Mutex, MutexGuard, lock};
use std::sync::{PoisonError, TryLockError};

/// The right to a value: it is free again when this is dropped.
pub type Held<'a, T> = MutexGuard<'a, T>;

/// A value under a lock, and contributions of type `D` for its next holder; see the module's text. A holder's panic
/// leaves it usable: the panic reaches the team's caller anyway.
///
/// ```
/// let add = |sum: &mut i32, more: i32| *sum += more;
/// let sum = ccnuma::Deferred::new(1);
/// let held = sum.try_lock(add).expect("nobody else holds it");
/// assert!(sum.try_lock(add).is_none());
/// sum.defer(10);
/// drop(held);
/// assert_eq!(*sum.lock(add), 11);
/// ```
#[derive(Debug)]
// A cache line of its own: values of one array are locked by different workers.
#[repr(align(64))]
pub struct Deferred<T, D> {
    value: Mutex<T>,
    left: Mutex<Vec<D>>,
}

impl<T, D> Deferred<T, D> {
    /// A value with nothing left for it.
    pub fn new(value: T) -> Self {
        Self { value: Mutex::new(value), left: Mutex::new(Vec::new()) }
    }

    /// The value, if nobody holds it; `merge` is given what was left for it.
    pub fn try_lock(&self, merge: impl FnMut(&mut T, D)) -> Option<Held<'_, T>> {
        match self.value.try_lock() {
            Ok(value) => Some(self.merged(value, merge)),
            Err(TryLockError::Poisoned(poisoned)) => Some(self.merged(poisoned.into_inner(), merge)),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    /// The value; `merge` is given what was left for it. Waits for its holder; [`crate::Worker::lock_deferred`] counts the wait.
    pub fn lock(&self, merge: impl FnMut(&mut T, D)) -> Held<'_, T> {
        self.merged(lock(&self.value), merge)
    }

    /// Leaves a contribution for the next holder; never waits for the value's holder.
    pub fn defer(&self, contribution: D) {
        lock(&self.left).push(contribution);
    }

    /// The value; `merge` is given what was left for it.
    pub fn into_inner(self, mut merge: impl FnMut(&mut T, D)) -> T {
        let mut value = self.value.into_inner().unwrap_or_else(PoisonError::into_inner);
        for contribution in self.left.into_inner().unwrap_or_else(PoisonError::into_inner) {
            merge(&mut value, contribution);
        }
        value
    }

    fn merged<'a>(&'a self, mut value: Held<'a, T>, mut merge: impl FnMut(&mut T, D)) -> Held<'a, T> {
        let left = std::mem::take(&mut *lock(&self.left));
        for contribution in left {
            merge(&mut value, contribution);
        }
        value
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    fn add(sum: &mut u64, more: u64) {
        *sum += more;
    }

    #[test]
    fn contributions_are_merged_in_order_by_the_next_holder() {
        let push = |list: &mut Vec<u32>, more| list.push(more);
        let list = Deferred::new(vec![0]);
        let held = list.lock(push);
        assert!(list.try_lock(push).is_none());
        list.defer(1);
        list.defer(2);
        assert_eq!(*held, [0], "the holder at work sees nothing of it");
        drop(held);
        assert_eq!(*list.try_lock(push).unwrap(), [0, 1, 2]);
        list.defer(3);
        assert_eq!(list.into_inner(push), [0, 1, 2, 3]);
    }

    #[test]
    fn threads_lose_nothing_and_merge_nothing_twice() {
        let sum = &Deferred::new(0);
        let deferred = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..4)
                .map(|_| {
                    scope.spawn(move || {
                        let give = |n| match sum.try_lock(add) {
                            Some(mut sum) => {
                                *sum += n;
                                0
                            }
                            None => {
                                sum.defer(n);
                                1
                            }
                        };
                        (1..=20_000).map(give).sum::<u64>()
                    })
                })
                .collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).sum::<u64>()
        });
        assert_eq!(*sum.lock(add), 4 * 20_000 * 20_001 / 2, "{deferred} were deferred");
    }

    #[test]
    fn a_holder_that_panics_leaves_it_usable() {
        let sum = Deferred::new(1);
        std::thread::scope(|scope| {
            let failing = scope.spawn(|| {
                let _held = sum.lock(add);
                panic!("on purpose");
            });
            assert!(failing.join().is_err());
        });
        sum.defer(2);
        assert_eq!(*sum.try_lock(add).unwrap(), 3);
        assert_eq!(*sum.lock(add), 3);
        assert_eq!(sum.into_inner(add), 3);
    }
}

#[cfg(all(test, loom))]
mod models {
    use super::*;
    use loom::sync::Arc;

    fn add(sum: &mut u32, more: u32) {
        *sum += more;
    }

    /// What a worker does that will not wait: digits tell contributions apart.
    fn give(sum: &Deferred<u32, u32>, n: u32) {
        match sum.try_lock(add) {
            Some(mut sum) => *sum += n,
            None => sum.defer(n),
        }
    }

    fn spawn(sum: &Arc<Deferred<u32, u32>>, act: fn(&Deferred<u32, u32>)) -> loom::thread::JoinHandle<()> {
        let sum = Arc::clone(sum);
        loom::thread::spawn(move || act(&sum))
    }

    /// Three givers: whoever holds, defers or merges, the end holds each contribution once.
    #[test]
    fn loom_lures_are_merged_once() {
        let mut model = loom::model::Builder::new();
        model.preemption_bound = Some(3);
        model.check(|| {
            let sum = Arc::new(Deferred::new(0));
            let others = [spawn(&sum, |sum| give(sum, 1)), spawn(&sum, |sum| give(sum, 10))];
            give(&sum, 100);
            others.into_iter().for_each(|other| other.join().unwrap());
            let sum = Arc::try_unwrap(sum).expect("the others have ended");
            assert_eq!(sum.into_inner(add), 111);
        });
    }

    /// One who takes all out, as an emitter's packet is taken, while others give: what it takes and what stays add up.
    #[test]
    fn loom_taking_out_loses_nothing() {
        let mut model = loom::model::Builder::new();
        model.preemption_bound = Some(3);
        model.check(|| {
            let sum = Arc::new(Deferred::new(0));
            let others = [spawn(&sum, |sum| give(sum, 1)), spawn(&sum, |sum| give(sum, 10))];
            let taken = std::mem::take(&mut *sum.lock(add));
            others.into_iter().for_each(|other| other.join().unwrap());
            assert_eq!(taken + *sum.lock(add), 11);
        });
    }

    /// What was left before a lock is seen by its holder.
    #[test]
    fn loom_the_next_holder_sees_what_was_left() {
        loom::model(|| {
            let sum = Arc::new(Deferred::new(0));
            let other = spawn(&sum, |sum| give(sum, 1));
            sum.defer(10);
            assert!(*sum.lock(add) >= 10);
            other.join().unwrap();
            assert_eq!(*sum.lock(add), 11);
        });
    }
}
