//! The desk: hands out walks, each one emitter's way past all receivers, and knows when the last has ended.
//!
//! *Termination.* A worker without a walk asks here, under one lock. While there is an emitter to choose it gets a walk; where there is none
//! but others still walk, their deposits may make one, so it waits until one of them returns; where nobody walks any more it is over, for all
//! deposits are in the ledger by then. Whoever leaves, by a panic too, counts itself out and wakes those who wait.

use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use ccnuma::Worker;

use crate::schedule::batch::Batch;
use crate::schedule::watch::Watch;
use crate::transport::{Lamp, Packet};

use super::receivers::{Claim, Receivers};

/// Where emitters come from.
pub(in crate::schedule) enum Supply<'a, const N: usize> {
    /// These, in order.
    Given(Batch<'a, N>),
    /// The surface with the most unshot power that nobody shoots at the moment, while more than `stop_w` is left on such.
    Brightest {
        /// Power in W that may stay unshot.
        stop_w: f64,
        /// Detail of packets below this is averaged, in W/m².
        prune_w_m2: f64,
        /// Told how much is left, in W.
        left: &'a (dyn Fn(f64) + Sync),
    },
}

/// One emitter's way past all receivers.
pub(super) struct Walk<'a, const N: usize> {
    pub emitter: Emitter<'a, N>,
    /// Pairs handed out.
    next: AtomicUsize,
    receivers: usize,
    /// Where it starts.
    first: usize,
}

/// Who is shot.
pub(super) enum Emitter<'a, const N: usize> {
    /// A light without area.
    Lamp(&'a Lamp<N>),
    /// A packet made before.
    Packet(&'a Packet<N>),
    /// A surface whose packet the first to walk takes.
    Surface(Claim, Mutex<Option<Arc<Packet<N>>>>),
}

impl<const N: usize> Walk<'_, N> {
    /// The next receiver, if any is left. Relaxed: the number is all there is to it.
    pub fn step(&self) -> Option<usize> {
        let step = self.next.fetch_add(1, Relaxed);
        (step < self.receivers).then(|| (self.first + step) % self.receivers)
    }

    fn has_more(&self) -> bool {
        self.next.load(Relaxed) < self.receivers
    }

    fn surface(&self) -> Option<usize> {
        match &self.emitter {
            Emitter::Surface(claim, _) => Some(claim.surface),
            _ => None,
        }
    }
}

/// The desk of one stage.
pub(super) struct Desk<'a, 't, const N: usize> {
    supply: &'a Supply<'a, N>,
    receivers: &'a Receivers<'t, N>,
    watch: &'a Watch,
    /// Whether all workers walk the same way.
    together: bool,
    state: Mutex<State<'a, N>>,
    returned: Condvar,
}

struct State<'a, const N: usize> {
    /// Those that somebody walks, the youngest last.
    walks: Vec<Arc<Walk<'a, N>>>,
    begun: usize,
    walking: usize,
    over: bool,
}

/// A worker at the desk, with the walk it is on.
pub(super) struct Visitor<'d, 'a, 't, const N: usize> {
    desk: &'d Desk<'a, 't, N>,
    worker: &'d Worker,
    walk: Option<Arc<Walk<'a, N>>>,
}

impl<'a, 't, const N: usize> Desk<'a, 't, N> {
    pub fn new(
        supply: &'a Supply<'a, N>,
        receivers: &'a Receivers<'t, N>,
        together: bool,
        watch: &'a Watch,
    ) -> Self {
        let state = Mutex::new(State { walks: Vec::new(), begun: 0, walking: 0, over: false });
        Self { supply, receivers, watch, together, state, returned: Condvar::new() }
    }

    pub fn visit<'d>(&'d self, worker: &'d Worker) -> Visitor<'d, 'a, 't, N> {
        Visitor { desk: self, worker, walk: None }
    }

    /// Number of emitters that were handed out.
    pub fn begun(self) -> usize {
        self.state.into_inner().unwrap_or_else(PoisonError::into_inner).begun
    }

    /// A walk to join or to begin, if there is one at the moment.
    fn find(&self, worker: &Worker, state: &mut State<'a, N>) -> Option<Arc<Walk<'a, N>>> {
        // The list holds one handle of each; the others are those of its walkers.
        let before = state.walks.len();
        state.walks.retain(|walk| Arc::strong_count(walk) > 1);
        (state.walks.len()..before).for_each(|_| self.watch.part_done());
        if let Some(walk) = state.walks.last().filter(|walk| self.together && walk.has_more()) {
            return Some(Arc::clone(walk));
        }
        let emitter = match self.supply {
            Supply::Given(batch) => match batch.lamps.get(state.begun) {
                Some(lamp) => Emitter::Lamp(lamp),
                None => Emitter::Packet(batch.packets.get(state.begun - batch.lamps.len())?),
            },
            Supply::Brightest { stop_w, prune_w_m2, left } => {
                // Those shot at the moment are left out of the bound too, lest the others are shot again and again for next to nothing
                // while one walk takes long.
                let mut shot_now: Vec<usize> = state.walks.iter().filter_map(|walk| walk.surface()).collect();
                shot_now.sort_unstable();
                let (unshot_w, brightest) = self.receivers.survey(&shot_now);
                if unshot_w <= *stop_w {
                    return None;
                }
                left(unshot_w);
                Emitter::Surface(self.receivers.claim(brightest?, *prune_w_m2), Mutex::new(None))
            }
        };
        state.begun += 1;
        let receivers = self.receivers.len();
        // Workers that walk apart start apart, not to queue up before the same receivers.
        let first = if self.together { 0 } else { worker.index() * receivers / worker.plan().slots.len() };
        let walk = Arc::new(Walk { emitter, next: AtomicUsize::new(0), receivers, first });
        state.walks.push(Arc::clone(&walk));
        Some(walk)
    }

    fn state(&self) -> MutexGuard<'_, State<'a, N>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<'a, const N: usize> Visitor<'_, 'a, '_, N> {
    /// Returns from the walk at hand and gets another; `None` once it is over for all.
    pub fn next(&mut self) -> Option<Arc<Walk<'a, N>>> {
        let mut state = self.worker.lock(&self.desk.state);
        self.leave(&mut state);
        loop {
            if state.over || self.desk.watch.stopped() {
                return None;
            }
            self.walk = self.desk.find(self.worker, &mut state);
            if self.walk.is_some() {
                state.walking += 1;
                return self.walk.clone();
            }
            if state.walking == 0 {
                state.over = true;
                self.desk.returned.notify_all();
                return None;
            }
            state = self.worker.wait(&self.desk.returned, state);
        }
    }

    fn leave(&mut self, state: &mut State<'a, N>) {
        if self.walk.take().is_some() {
            state.walking -= 1;
            self.desk.returned.notify_all();
        }
    }
}

impl<const N: usize> Drop for Visitor<'_, '_, '_, N> {
    /// Whoever leaves in the middle of a walk was stopped or panics: it is over for all.
    fn drop(&mut self) {
        if self.walk.is_some() {
            let mut state = self.desk.state();
            state.over = true;
            self.leave(&mut state);
        }
    }
}
