//! The paper's schedules without batches (its sections 4.1 and 4.2): no barrier between emitters, so receivers are locked.
//!
//! A *walk* is one emitter's way past all receivers, a pair task each. `outer-loop` gives every worker a walk of its own; in `single-queue` all
//! workers walk the same way, so that the walk is the central queue of (emitter, receiver) pairs, and the next emitter's pairs follow while the
//! last ones of the emitter before are still at work. Lights, and what a first solution reflects, are walked in order; then each walk is that of
//! the brightest surface of the moment that nobody shoots. Its packet is taken under its lock; while it is shot, the surface may receive.
//!
//! With a *lure* (its section 5.2) a worker that finds a receiver locked shoots onto an empty copy, divided as the receiver was when it last
//! had lures or the stage began, and goes on; who holds the lock next merges it, or the end does.
//! So one receiver's pairs may be at work at the same time, and what the costliest receiver took bounds no team's time.
//!
//! Receivers stay whole, workers do not look for those at home, and emitters are neither clustered nor copied, as in the paper. On more than
//! one worker sources reach a receiver in the order of the moment, so the last bits differ from run to run, and with them who shoots; one
//! worker does bit by bit what shooting one at a time in sequence does.

mod desk;
mod receivers;

use std::slice::from_ref;
use std::sync::{Arc, Mutex, PoisonError};

use ccnuma::{Arena, Team, Worker, WorkerPanic};

use crate::radiosity::Tree;
use crate::transport::{Alone, Deposited, Packet, Patch, Receiver, Rules, Scratch, Source, Task};
use crate::visibility::Occluder;

use super::crew::Room;
use super::watch::Watch;
pub(super) use desk::Supply;
use desk::{Desk, Emitter, Walk};
use receivers::{Claim, Pair, Receivers};

/// How workers without barriers share the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Walks {
    /// Whether all take pairs of the same emitter (`single-queue`), or each has one of its own (`outer-loop`).
    pub together: bool,
    /// Whether a worker shoots onto a lure where a receiver is locked, instead of waiting.
    pub lure: bool,
}

/// What a node's workers ask what may stand between.
pub(super) type OccluderOn<'a> = &'a (dyn (Fn(usize) -> &'a dyn Occluder) + Sync);

/// What walks did.
pub(super) struct Walked<const N: usize> {
    /// Emitters shot.
    pub shots: usize,
    /// Power that the brightest surfaces sent, per band, in W.
    pub shot_w: [f64; N],
}

/// What all walks have in common.
struct Stage<'a, 'o, 't, const N: usize> {
    receivers: &'a Receivers<'t, N>,
    room: &'a Room<'a>,
    occluder: OccluderOn<'o>,
    rules: &'a Rules,
    watch: &'a Watch,
    shot_w: Mutex<[f64; N]>,
}

impl Walks {
    /// Has the team walk until nothing is left of `supply`; `shot_w` is what surfaces sent before.
    pub(super) fn run<const N: usize>(
        self,
        trees: &mut [Tree<N>],
        (supply, shot_w): (&Supply<'_, N>, [f64; N]),
        (occluder, rules): (OccluderOn<'_>, &Rules),
        watch: &Watch,
        team: &mut Team,
        room: &Room<'_>,
    ) -> Result<Walked<N>, WorkerPanic> {
        if let Supply::Given(batch) = supply {
            watch.parts(batch.len());
        }
        let receivers = Receivers::new(trees, self.lure);
        let shot_w = Mutex::new(shot_w);
        let stage = Stage { receivers: &receivers, room, occluder, rules, watch, shot_w };
        let desk = Desk::new(supply, &receivers, self.together, watch);
        let workers = team.len();
        team.run(|worker| {
            let mut visitor = desk.visit(worker);
            room.with_scratch(worker, |scratch| {
                while let Some(walk) = visitor.next() {
                    stage.walk(&walk, worker, scratch);
                }
            });
            if self.lure {
                worker.barrier();
                for index in (worker.index()..receivers.len()).step_by(workers) {
                    receivers.close(worker, index, room.arena(worker, index));
                }
            }
        })?;
        let shot_w = stage.shot_w.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(Walked { shots: desk.begun(), shot_w })
    }
}

impl<const N: usize> Stage<'_, '_, '_, N> {
    fn walk(&self, walk: &Walk<'_, N>, worker: &Worker, scratch: &mut Scratch) {
        match &walk.emitter {
            Emitter::Lamp(lamp) => self.shoot(walk, *lamp, worker, scratch),
            Emitter::Packet(packet) => self.shoot(walk, *packet, worker, scratch),
            Emitter::Surface(claim, packet) => {
                let mut taken = worker.lock(packet);
                let packet = taken.get_or_insert_with(|| Arc::new(self.take(claim, worker)));
                let packet = Arc::clone(packet);
                drop(taken);
                self.shoot(walk, &*packet, worker, scratch);
            }
        }
    }

    /// Takes the packet of a walk's surface.
    fn take(&self, claim: &Claim, worker: &Worker) -> Packet<N> {
        let arena = self.room.arena(worker, claim.surface);
        self.receivers.take_packet(worker, claim, arena, |tree| {
            let power_w = tree.unshot_by_band_w();
            let mut shot_w = worker.lock(&self.shot_w);
            for n in 0..N {
                shot_w[n] += power_w[n];
            }
        })
    }

    /// The pairs of a walk, until it ends or the run is told to stop.
    fn shoot(&self, walk: &Walk<'_, N>, source: &impl Source<N>, worker: &Worker, scratch: &mut Scratch) {
        let pair =
            Shot { source, occluder: (self.occluder)(worker.node()), rules: self.rules, watch: self.watch };
        while let Some(receiver) = walk.step() {
            if self.watch.stopped() {
                return;
            }
            let arena = self.room.arena(worker, receiver);
            self.receivers.light(worker, receiver, arena, scratch, &pair);
        }
    }
}

/// The pair task of a walk, whatever it shoots onto. Nobody helps: a receiver's holder must not take up other work.
struct Shot<'a, S> {
    source: &'a S,
    occluder: &'a dyn Occluder,
    rules: &'a Rules,
    watch: &'a Watch,
}

impl<S: Source<N>, const N: usize> Pair<N> for Shot<'_, S> {
    fn shoot<R: Receiver<N>>(
        &self,
        patch: &Patch<N>,
        receiver: &mut R,
        scratch: &mut Scratch,
        arena: &Arena,
    ) -> Deposited<N> {
        let go_on = &|| !self.watch.stopped();
        let task = Task { patch, occluder: self.occluder, rules: self.rules, go_on };
        task.shoot((from_ref(self.source), None), receiver, scratch, &Alone(arena))
    }
}
