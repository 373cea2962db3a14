//! Where each worker's time goes, without a clock read per task: the clock is read only when the state changes.
//!
//! Owner-only counters in atomics: written with plain load and store by the worker, read by anyone at any time.

use std::cell::Cell;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

use serde::Serialize;

/// What a worker is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum State {
    Idle,
    Busy,
    StealNear,
    StealFar,
    Barrier,
    Lock,
}

const STATES: usize = 6;

/// A worker's time and events since the team started, or since [`super::Team::reset_times`]; seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Times {
    /// Running the program's code.
    pub busy_s: f64,
    /// The rest of the time in which jobs ran: looking for work without finding any, or asleep.
    pub idle_s: f64,
    /// Looks that ended with a task of another worker of the node.
    pub steal_near_s: f64,
    /// Looks that ended with a task of another node.
    pub steal_far_s: f64,
    /// Waiting in [`super::Worker::barrier`].
    pub barrier_s: f64,
    /// Waiting in [`super::Worker::lock`] and [`super::Worker::lock_deferred`].
    pub lock_s: f64,
    /// How often it waited there.
    pub lock_waits: u64,
    /// How often it left a contribution instead: [`super::Worker::defer`].
    pub deferrals: u64,
    /// Tasks run that came through a queue.
    pub tasks: u64,
    /// Of these, taken from another worker of the node.
    pub steals_near: u64,
    /// Of these, taken from another node.
    pub steals_far: u64,
}

/// The shared side of one worker's account.
#[derive(Debug, Default)]
pub struct Account {
    nanos: [AtomicU64; STATES],
    lock_waits: AtomicU64,
    deferrals: AtomicU64,
    tasks: AtomicU64,
    steals_near: AtomicU64,
    steals_far: AtomicU64,
}

/// Adds to a counter that only one thread writes.
fn add(counter: &AtomicU64, amount: u64) {
    counter.store(counter.load(Relaxed) + amount, Relaxed);
}

impl Account {
    /// The account of a worker in a team whose jobs took `running` in all; only between jobs.
    pub fn read(&self, running: Duration) -> Times {
        let seconds =
            |state: State| Duration::from_nanos(self.nanos[state as usize].load(Relaxed)).as_secs_f64();
        let at_work = [State::Busy, State::StealNear, State::StealFar, State::Barrier, State::Lock];
        let at_work_s: f64 = at_work.into_iter().map(seconds).sum();
        Times {
            busy_s: seconds(State::Busy),
            idle_s: (running.as_secs_f64() - at_work_s).max(0.0),
            steal_near_s: seconds(State::StealNear),
            steal_far_s: seconds(State::StealFar),
            barrier_s: seconds(State::Barrier),
            lock_s: seconds(State::Lock),
            lock_waits: self.lock_waits.load(Relaxed),
            deferrals: self.deferrals.load(Relaxed),
            tasks: self.tasks.load(Relaxed),
            steals_near: self.steals_near.load(Relaxed),
            steals_far: self.steals_far.load(Relaxed),
        }
    }

    /// Starts again from zero; only between jobs, when the owner does not write.
    pub fn reset(&self) {
        let locks = [&self.lock_waits, &self.deferrals];
        let events = [&self.tasks, &self.steals_near, &self.steals_far];
        self.nanos.iter().chain(locks).chain(events).for_each(|counter| counter.store(0, Relaxed));
    }

    pub fn count_lock_wait(&self) {
        add(&self.lock_waits, 1);
    }

    pub fn count_deferral(&self) {
        add(&self.deferrals, 1);
    }

    pub fn count_task(&self) {
        add(&self.tasks, 1);
    }

    pub fn count_steal(&self, far: bool) {
        add(if far { &self.steals_far } else { &self.steals_near }, 1);
    }
}

/// The owner's side: its state, and since when.
#[derive(Debug)]
pub struct Clock {
    state: Cell<State>,
    since: Cell<Instant>,
}

impl Clock {
    pub fn new() -> Self {
        Self { state: Cell::new(State::Idle), since: Cell::new(Instant::now()) }
    }

    pub fn state(&self) -> State {
        self.state.get()
    }

    /// Books the time since the last change to the old state and enters the new one.
    pub fn switch(&self, account: &Account, state: State) -> State {
        self.switch_at(account, state, Instant::now())
    }

    /// As [`Clock::switch`], for a change that happened at `when`.
    pub fn switch_at(&self, account: &Account, state: State, when: Instant) -> State {
        let old = self.state.replace(state);
        let nanos = when.saturating_duration_since(self.since.replace(when)).as_nanos();
        add(&account.nanos[old as usize], u64::try_from(nanos).unwrap_or(0));
        old
    }
}
