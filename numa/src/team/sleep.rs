//! Idle workers sleep, and are woken nearest first, without a lost wake-up.
//!
//! A worker that finds nothing to do **announces** that it will sleep, looks once more at everything that could wake
//! it, and then sleeps or **retracts**. Whoever makes something available (a task, a job, a finished latch) makes it
//! visible first and looks for sleepers second. Both sides put a `SeqCst` fence between their write and their read, so
//! one of them sees the other: no task waits while the worker it could wake sleeps for ever.
//!
//! `asleep` is taken by exactly one waker (`swap`), who then owes the sleeper one token; a worker that retracts but
//! finds its flag taken waits for that token, so that none is left over for its next sleep.

use crossbeam_utils::CachePadded;
use std::sync::atomic::Ordering::{AcqRel, Relaxed, SeqCst};

use crate::sync::{AtomicBool, AtomicUsize, Condvar, Mutex, fence, lock, wait};

#[derive(Debug)]
struct Bed {
    asleep: AtomicBool,
    token: Mutex<bool>,
    wake: Condvar,
}

/// The sleepers of one team; the last index is the thread that waits for the team.
#[derive(Debug)]
pub struct Sleep {
    beds: Box<[CachePadded<Bed>]>,
    sleeping: CachePadded<AtomicUsize>,
}

impl Sleep {
    pub fn new(sleepers: usize) -> Self {
        let bed = |_| {
            CachePadded::new(Bed {
                asleep: AtomicBool::new(false),
                token: Mutex::new(false),
                wake: Condvar::new(),
            })
        };
        Self { beds: (0..sleepers).map(bed).collect(), sleeping: CachePadded::new(AtomicUsize::new(0)) }
    }

    /// Says that `who` will sleep unless it finds a reason not to when it looks now.
    pub fn announce(&self, who: usize) {
        // Relaxed: the fence orders both before the look that follows.
        self.beds[who].asleep.store(true, Relaxed);
        self.sleeping.fetch_add(1, Relaxed);
        fence(SeqCst);
    }

    /// Takes the announcement back: there is something to do.
    pub fn retract(&self, who: usize) {
        if self.take(who) {
            self.sleeping.fetch_sub(1, Relaxed);
        } else {
            self.sleep(who)
        }
    }

    /// Sleeps until woken; returns at once when that happened since the announcement.
    pub fn sleep(&self, who: usize) {
        let bed = &self.beds[who];
        let mut token = lock(&bed.token);
        while !*token {
            token = wait(&bed.wake, token);
        }
        *token = false;
    }

    /// Wakes `who` if it sleeps or is about to. What it shall find must be written before; the caller's fence or
    /// [`Sleep::wake_after_write`] orders it.
    fn wake(&self, who: usize) -> bool {
        if !self.beds[who].asleep.load(Relaxed) || !self.take(who) {
            return false;
        }
        self.sleeping.fetch_sub(1, Relaxed);
        *lock(&self.beds[who].token) = true;
        self.beds[who].wake.notify_one();
        true
    }

    /// Wakes one certain sleeper after something was made visible to it.
    pub fn wake_after_write(&self, who: usize) {
        fence(SeqCst);
        self.wake(who);
    }

    /// Wakes the first of `order` that sleeps, after something was made visible.
    pub fn wake_first(&self, order: impl IntoIterator<Item = usize>) {
        fence(SeqCst);
        if self.sleeping.load(Relaxed) > 0 {
            order.into_iter().any(|who| self.wake(who));
        }
    }

    /// Whether somebody sleeps, as far as this thread has heard.
    pub fn anyone_asleep(&self) -> bool {
        self.sleeping.load(Relaxed) > 0
    }

    /// Wakes every sleeper in `order`, after something was made visible.
    pub fn wake_all(&self, order: impl IntoIterator<Item = usize>) {
        fence(SeqCst);
        for who in order {
            self.wake(who);
        }
    }

    /// Takes the flag; exactly one of a waker and the retracting owner gets it.
    fn take(&self, who: usize) -> bool {
        // AcqRel: the one who takes it comes after the announcement it answers.
        self.beds[who].asleep.swap(false, AcqRel)
    }
}

#[cfg(all(test, loom))]
mod models {
    use super::*;
    use loom::sync::Arc;
    use std::sync::atomic::Ordering::{Acquire, Release};

    /// Hand-over: a task made visible to a worker that is falling asleep is always run; the worker that waits for
    /// its end (termination) is always woken. Worker 0 takes tasks, sleeper 1 waits for both to be done.
    #[test]
    fn loom_hand_over_and_termination() {
        let mut model = loom::model::Builder::new();
        model.preemption_bound = Some(3);
        model.check(|| {
            let sleep = Arc::new(Sleep::new(2));
            let tasks = Arc::new(AtomicUsize::new(0));
            let pending = Arc::new(AtomicUsize::new(2));
            let worker = {
                let (sleep, tasks, pending) = (Arc::clone(&sleep), Arc::clone(&tasks), Arc::clone(&pending));
                loom::thread::spawn(move || {
                    let mut run = 0;
                    while run < 2 {
                        let found = tasks.swap(0, AcqRel);
                        if found == 0 {
                            sleep.announce(0);
                            if tasks.load(Acquire) > 0 { sleep.retract(0) } else { sleep.sleep(0) }
                        }
                        for _ in 0..found {
                            run += 1;
                            if pending.fetch_sub(1, AcqRel) == 1 {
                                sleep.wake_after_write(1);
                            }
                        }
                    }
                })
            };
            for _ in 0..2 {
                tasks.fetch_add(1, Release);
                sleep.wake_first([0]);
            }
            while pending.load(Acquire) > 0 {
                sleep.announce(1);
                if pending.load(Acquire) == 0 { sleep.retract(1) } else { sleep.sleep(1) }
            }
            worker.join().unwrap();
        });
    }

    /// Two wakers, one sleeper that retracts: the token never survives into the next sleep.
    #[test]
    fn loom_two_wakers_leave_no_token() {
        let mut model = loom::model::Builder::new();
        model.preemption_bound = Some(3);
        model.check(|| {
            let sleep = Arc::new(Sleep::new(1));
            let wakers = [0, 1].map(|_| {
                let sleep = Arc::clone(&sleep);
                loom::thread::spawn(move || sleep.wake_first([0]))
            });
            sleep.announce(0);
            sleep.retract(0);
            wakers.into_iter().for_each(|waker| waker.join().unwrap());
            assert!(!*lock(&sleep.beds[0].token));
            assert_eq!(sleep.sleeping.load(Relaxed), 0);
        });
    }
}
