//! Starting a team: threads, pins, and the proof that the pins hold.

use std::cell::UnsafeCell;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicU64, AtomicUsize};
use std::sync::{Arc, Mutex, mpsc};
use std::time::Duration;

use crossbeam_utils::CachePadded;
use serde::Serialize;

use super::sleep::Sleep;
use super::{Account, Shared, Task, Team, WakeOrder, Worker, whole};
use crate::affinity;
use crate::barrier::Barrier;
use crate::cpuset::CpuSet;
use crate::error::Error;
use crate::pinning::{Plan, Slot};
use crate::queue::{Local, Queues, victims_by_closeness};
use crate::topology::{Closeness, Source};

/// Looks of a waiting worker at the barrier before it parks, where it has a CPU of its own: tens of microseconds.
const BARRIER_SPINS: u32 = 4000;

/// Stack of a worker. A worker that waits for a stolen half runs other tasks on top of its stack, so depths add up;
/// pages that are not reached cost nothing.
const STACK_BYTES: usize = 64 << 20;

/// How many workers a process can have at once: the length of every per-thread static.
pub(crate) const MAX_WORKERS: usize = 4096;

/// Where a worker really is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Seat {
    /// What was planned.
    pub slot: Slot,
    /// The CPUs it may run on, read back from the kernel after pinning.
    pub mask: CpuSet,
    /// The CPU it was running on when it started.
    pub cpu: Option<usize>,
}

/// Numbers of a team's workers among all workers of the process; given back when the team ends.
#[derive(Debug)]
pub(crate) struct Ids(pub(crate) Vec<usize>);

static IDS: Mutex<CpuSet> = Mutex::new(CpuSet::new());
static TEAMS: AtomicUsize = AtomicUsize::new(1);

impl Ids {
    fn take(count: usize) -> Result<Self, Error> {
        let mut used = whole(&IDS);
        let free: Vec<usize> = (0..MAX_WORKERS).filter(|&id| !used.contains(id)).take(count).collect();
        if free.len() < count {
            return Err(Error::WorkerIds { asked: used.len() + count, most: MAX_WORKERS });
        }
        free.iter().for_each(|&id| used.insert(id));
        Ok(Self(free))
    }
}

impl Drop for Ids {
    fn drop(&mut self) {
        let mut used = whole(&IDS);
        *used = used.iter().filter(|id| !self.0.contains(id)).collect();
    }
}

impl Team {
    /// Starts the plan's workers, pins each, and reads every pin back.
    ///
    /// A plan for another machine can only be run without pins: to try out stealing and homes on simulated nodes.
    pub fn new(plan: &Plan) -> Result<Self, Error> {
        let process_mask = affinity::process_mask();
        let foreign = plan.machine.source != Source::ThisMachine;
        if foreign && plan.slots.iter().any(|slot| slot.cpu.is_some()) {
            return Err(Error::ForeignMachine { what: plan.machine.source.to_string() });
        }
        let pinned = plan.slots.iter().all(|slot| slot.cpu.is_some());
        let own_cpu = pinned || plan.slots.len() <= process_mask.len();
        let ids = Ids::take(plan.slots.len())?;
        let (shared, locals) = Shared::new(plan, own_cpu);
        let shared = Arc::new(shared);
        let mut team = Self { shared, seats: Vec::new(), threads: Vec::new(), ids, running: Duration::ZERO };
        let (ready, readies) = mpsc::channel();
        for (index, local) in locals.into_iter().enumerate() {
            team.spawn(index, local, ready.clone())?;
        }
        drop(ready);
        let mut seats: Vec<_> = readies.iter().collect();
        seats.sort_by_key(|&(index, _)| index);
        team.seats = seats.into_iter().map(|(_, seat)| seat).collect::<Result<_, _>>()?;
        Ok(team)
    }

    fn spawn(
        &mut self,
        index: usize,
        local: Local<Task>,
        ready: mpsc::Sender<(usize, Result<Seat, Error>)>,
    ) -> Result<(), Error> {
        let shared = Arc::clone(&self.shared);
        let id = self.ids.0[index];
        let live = move || {
            let seat = sit(shared.plan.slots[index]);
            // The receiver waits for every worker's word; it is gone only if another worker could not be started.
            let _ = ready.send((index, seat));
            drop(ready);
            Worker::new(index, id, shared, local).live();
        };
        let builder = std::thread::Builder::new().name(format!("worker {index}")).stack_size(STACK_BYTES);
        let thread = builder.spawn(live);
        self.threads.push(thread.map_err(|error| Error::Spawn { worker: index, reason: error.to_string() })?);
        Ok(())
    }
}

/// Pins the calling thread as planned; a free worker gets the whole process mask, whatever its parent had.
fn sit(slot: Slot) -> Result<Seat, Error> {
    match slot.cpu {
        Some(cpu) => affinity::pin_to(cpu)?,
        None => affinity::unpin()?,
    }
    Ok(Seat { slot, mask: affinity::thread_mask()?, cpu: affinity::current_cpu() })
}

impl Shared {
    fn new(plan: &Plan, own_cpu: bool) -> (Self, Vec<Local<Task>>) {
        let workers = plan.slots.len();
        let (queues, locals) = Queues::new(plan);
        let workers_by_node = plan.workers_by_node();
        let staffed_nodes: Vec<usize> =
            (0..workers_by_node.len()).filter(|&node| !workers_by_node[node].is_empty()).collect();
        let members: Vec<usize> = staffed_nodes.iter().map(|&node| workers_by_node[node].len()).collect();
        let group = |slot: &Slot| staffed_nodes.iter().position(|&node| node == slot.node).unwrap_or(0);
        let shared = Self {
            id: TEAMS.fetch_add(1, Relaxed),
            staffed: (0..plan.machine.nodes.len()).map(|node| plan.nearest_staffed_node(node)).collect(),
            queues,
            wake_order: (0..workers).map(|worker| wake_order(plan, worker)).collect(),
            // One more for the thread outside.
            sleep: Sleep::new(workers + 1),
            barrier: Barrier::new(&members, if own_cpu { BARRIER_SPINS } else { 0 }),
            groups: plan.slots.iter().map(group).collect(),
            accounts: (0..workers).map(|_| CachePadded::new(Account::default())).collect(),
            rounds: super::worker::rounds(own_cpu),
            far_limit: AtomicU64::new(0),
            shutdown: AtomicBool::new(false),
            epoch: CachePadded::new(AtomicUsize::new(0)),
            job: UnsafeCell::new(None),
            workers_by_node,
            plan: plan.clone(),
        };
        (shared, locals)
    }
}

fn wake_order(plan: &Plan, worker: usize) -> WakeOrder {
    let tiers = victims_by_closeness(plan, worker);
    let near =
        tiers.iter().filter(|(closeness, _)| *closeness <= Closeness::Node).map(|(_, tier)| tier.len()).sum();
    WakeOrder { workers: tiers.into_iter().flat_map(|(_, tier)| tier).collect(), near }
}
