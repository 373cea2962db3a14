//! Idle workers sleep, and are woken nearest first, without a lost wake-up.
//!
//! A worker that finds nothing to do **announces** that it will sleep, looks once more at everything that could wake
//! it, and then sleeps or **retracts**. Whoever makes something available (a task, a job, a finished latch) makes it
//! visible first and looks for sleepers second. Both sides put a `SeqCst` fence between their write and their read, so
//! one of them sees the other: no task waits while the worker it could wake sleeps for ever.
//!
//! `state` is taken back to [`AWAKE`] by exactly one waker, who then owes the sleeper one token; a worker that retracts
//! but finds its state taken waits for that token, so that none is left over for its next sleep.
//!
//! Who waits for one certain thing sleeps **deaf**: new tasks wake others, but for those of one worker that it may help to get there.

use crossbeam_utils::CachePadded;
use std::sync::atomic::Ordering::{AcqRel, Relaxed, Release, SeqCst};

use crate::sync::{AtomicUsize, Condvar, Mutex, fence, lock, wait};

/// Not asleep, nor about to be.
const AWAKE: usize = 0;
/// Asleep until there is something to do.
const ASLEEP: usize = 1;
/// Asleep until what it waits for is there, or who works at it offers a part.
const DEAF: usize = 2;

/// No worker.
pub(super) const NOBODY: usize = usize::MAX;

#[derive(Debug)]
struct Bed {
    state: AtomicUsize,
    /// Whose offers wake it all the same while it is deaf; written before the state.
    hears: AtomicUsize,
    /// How many deaf sleepers hear its owner's offers.
    heard: AtomicUsize,
    token: Mutex<bool>,
    wake: Condvar,
}

/// The sleepers of one team; the last index is the thread that waits for the team.
#[derive(Debug)]
pub struct Sleep {
    beds: Box<[CachePadded<Bed>]>,
    /// How many sleep and are not deaf.
    sleeping: CachePadded<AtomicUsize>,
}

impl Sleep {
    pub fn new(sleepers: usize) -> Self {
        let bed = |_| {
            CachePadded::new(Bed {
                state: AtomicUsize::new(AWAKE),
                hears: AtomicUsize::new(NOBODY),
                heard: AtomicUsize::new(0),
                token: Mutex::new(false),
                wake: Condvar::new(),
            })
        };
        Self { beds: (0..sleepers).map(bed).collect(), sleeping: CachePadded::new(AtomicUsize::new(0)) }
    }

    /// Says that `who` will sleep unless it finds a reason not to when it looks now.
    pub fn announce(&self, who: usize) {
        // Relaxed: the fence orders both before the look that follows.
        self.beds[who].state.store(ASLEEP, Relaxed);
        self.sleeping.fetch_add(1, Relaxed);
        fence(SeqCst);
    }

    /// As [`Sleep::announce`], for who is to be woken by [`Sleep::wake_after_write`], and by what worker `hears` offers, if that is one.
    pub fn announce_deaf(&self, who: usize, hears: usize) {
        let bed = &self.beds[who];
        bed.hears.store(hears, Relaxed);
        if let Some(heard) = self.beds.get(hears) {
            heard.heard.fetch_add(1, Relaxed);
        }
        // Release: who takes the state reads whom it hears. The fence orders it before the look that follows.
        bed.state.store(DEAF, Release);
        fence(SeqCst);
    }

    /// Takes the announcement back: there is something to do.
    pub fn retract(&self, who: usize) {
        if !self.take(who, &[ASLEEP, DEAF]) {
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

    /// Wakes `who` if it sleeps, in one of these states, or is about to. What it shall find must be written before; the
    /// caller's fence or [`Sleep::wake_after_write`] orders it.
    fn wake(&self, who: usize, states: &[usize]) -> bool {
        if !states.contains(&self.beds[who].state.load(Relaxed)) || !self.take(who, states) {
            return false;
        }
        *lock(&self.beds[who].token) = true;
        self.beds[who].wake.notify_one();
        true
    }

    /// Wakes one certain sleeper after something was made visible to it.
    pub fn wake_after_write(&self, who: usize) {
        fence(SeqCst);
        self.wake(who, &[ASLEEP, DEAF]);
    }

    /// Wakes the first of `order` that sleeps, after something was made visible; says whether there was one.
    pub fn wake_first(&self, order: impl IntoIterator<Item = usize>) -> bool {
        fence(SeqCst);
        self.anyone_asleep() && order.into_iter().any(|who| self.wake(who, &[ASLEEP]))
    }

    /// Whether a deaf sleeper hears `who`, as far as this thread has heard.
    pub fn is_heard(&self, who: usize) -> bool {
        self.beds[who].heard.load(Relaxed) > 0
    }

    /// Wakes the first of `order` that is deaf but for `who`, after `who` made something visible.
    pub fn wake_listener(&self, who: usize, order: impl IntoIterator<Item = usize>) {
        let hears = |other: usize| self.beds[other].hears.load(Relaxed) == who;
        order.into_iter().any(|other| hears(other) && self.wake(other, &[DEAF]));
    }

    /// Whether somebody sleeps, as far as this thread has heard.
    pub fn anyone_asleep(&self) -> bool {
        self.sleeping.load(Relaxed) > 0
    }

    /// Wakes every sleeper in `order`, after something was made visible.
    pub fn wake_all(&self, order: impl IntoIterator<Item = usize>) {
        fence(SeqCst);
        for who in order {
            self.wake(who, &[ASLEEP, DEAF]);
        }
    }

    /// Takes the state if it is one of these; exactly one of a waker and the retracting owner gets it.
    fn take(&self, who: usize, states: &[usize]) -> bool {
        // AcqRel: the one who takes it comes after the announcement it answers.
        let take =
            |state: &&usize| self.beds[who].state.compare_exchange(**state, AWAKE, AcqRel, Relaxed).is_ok();
        let taken = states.iter().find(take);
        match taken {
            Some(&ASLEEP) => _ = self.sleeping.fetch_sub(1, Relaxed),
            Some(_) => {
                if let Some(heard) = self.beds.get(self.beds[who].hears.load(Relaxed)) {
                    heard.heard.fetch_sub(1, Relaxed);
                }
            }
            None => {}
        }
        taken.is_some()
    }
}

#[cfg(all(test, loom))]
mod models {
    use super::*;
    use loom::sync::Arc;
    use std::sync::atomic::Ordering::Acquire;

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

    /// A deaf sleeper is woken by what it waits for and leaves new tasks to the other one, which is woken for them.
    #[test]
    fn loom_the_deaf_hear_only_what_they_wait_for() {
        let mut model = loom::model::Builder::new();
        model.preemption_bound = Some(3);
        model.check(|| {
            let sleep = Arc::new(Sleep::new(2));
            let (task, latch) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
            let worker = {
                let (sleep, task) = (Arc::clone(&sleep), Arc::clone(&task));
                loom::thread::spawn(move || {
                    while task.load(Acquire) == 0 {
                        sleep.announce(0);
                        if task.load(Acquire) > 0 { sleep.retract(0) } else { sleep.sleep(0) }
                    }
                })
            };
            let waker = {
                let (sleep, task, latch) = (Arc::clone(&sleep), Arc::clone(&task), Arc::clone(&latch));
                loom::thread::spawn(move || {
                    task.store(1, Release);
                    sleep.wake_first([1, 0]);
                    latch.store(1, Release);
                    sleep.wake_after_write(1);
                })
            };
            while latch.load(Acquire) == 0 {
                sleep.announce_deaf(1, NOBODY);
                if latch.load(Acquire) > 0 { sleep.retract(1) } else { sleep.sleep(1) }
            }
            worker.join().unwrap();
            waker.join().unwrap();
            assert_eq!(sleep.sleeping.load(Relaxed), 0);
        });
    }

    /// A deaf sleeper hears the offers of the one whom it waits for. An offer that it misses does not keep it from what it waits for.
    #[test]
    fn loom_the_deaf_hear_whom_they_wait_for() {
        let mut model = loom::model::Builder::new();
        model.preemption_bound = Some(3);
        model.check(|| {
            let sleep = Arc::new(Sleep::new(2));
            let (offer, latch) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
            let thief = {
                let (sleep, offer, latch) = (Arc::clone(&sleep), Arc::clone(&offer), Arc::clone(&latch));
                loom::thread::spawn(move || {
                    offer.store(1, Release);
                    if sleep.is_heard(0) {
                        sleep.wake_listener(0, [1]);
                    }
                    latch.store(1, Release);
                    sleep.wake_after_write(1);
                })
            };
            while latch.load(Acquire) == 0 {
                sleep.announce_deaf(1, 0);
                let found = offer.swap(0, AcqRel) > 0;
                if found || latch.load(Acquire) > 0 { sleep.retract(1) } else { sleep.sleep(1) }
            }
            thief.join().unwrap();
            assert_eq!((sleep.beds[0].heard.load(Relaxed), *lock(&sleep.beds[1].token)), (0, false));
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
                loom::thread::spawn(move || _ = sleep.wake_first([0]))
            });
            sleep.announce(0);
            sleep.retract(0);
            wakers.into_iter().for_each(|waker| waker.join().unwrap());
            assert!(!*lock(&sleep.beds[0].token));
            assert_eq!(sleep.sleeping.load(Relaxed), 0);
        });
    }
}
