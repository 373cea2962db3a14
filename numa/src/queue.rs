//! Queues of tasks with NUMA-ordered stealing.
//!
//! The deques are Chase and Lev's (*Dynamic Circular Work-Stealing Deque*, SPAA 2005, as in crossbeam-deque): the
//! owner pushes and pops at one end, thieves take the oldest, usually largest, task at the other. Around them:
//!
//! * A worker looks in its own deques, its node's inbox, then at victims by closeness: those that share its nearest
//!   cache, its larger caches, its node, then node after node by distance (for each, its inbox and its workers).
//! * Every worker has **two** deques and every node two inboxes. Small pieces go where only their own node looks, so
//!   that work too small to pay for its journey never travels ([`Reach::Node`]); the rest anyone may take.

use std::cell::Cell;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;

use crossbeam_deque::{Injector, Steal, Stealer, Worker as Deque};
use crossbeam_utils::CachePadded;

use crate::pinning::Plan;
use crate::topology::Closeness;

/// How far a piece of work may travel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// Only workers of the node it was put on may take it.
    Node,
    /// Anyone may take it.
    Machine,
}

/// Where a task was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// The worker's own deques, or its node's inbox.
    Own,
    /// Another worker of its node.
    Near,
    /// Another node.
    Far,
}

/// One look in a worker's search order.
#[derive(Debug)]
enum Look {
    Inbox { node: usize, local: bool },
    Victims { workers: Vec<usize>, local: bool },
}

/// A pair indexed by reach.
#[derive(Debug)]
struct ByReach<Q> {
    node: Q,
    machine: Q,
}

impl<Q> ByReach<Q> {
    fn get(&self, reach: Reach) -> &Q {
        match reach {
            Reach::Node => &self.node,
            Reach::Machine => &self.machine,
        }
    }
}

/// What all workers of a team share of their queues.
#[derive(Debug)]
pub struct Queues<T> {
    stealers: Vec<CachePadded<ByReach<Stealer<T>>>>,
    inboxes: Vec<CachePadded<Inbox<T>>>,
}

/// A node's inbox; the count spares searchers the look into an empty one.
#[derive(Debug)]
struct Inbox<T> {
    tasks: ByReach<Injector<T>>,
    count: AtomicUsize,
}

/// A worker's own end of its queues, and its search order.
#[derive(Debug)]
pub struct Local<T> {
    deques: ByReach<Deque<T>>,
    looks: Vec<Look>,
    /// State of a xorshift generator: where to start among equals.
    random: Cell<u64>,
}

impl<T> Queues<T> {
    /// Queues for every worker and node of a plan.
    pub fn new(plan: &Plan) -> (Self, Vec<Local<T>>) {
        let locals: Vec<Local<T>> = (0..plan.slots.len()).map(|worker| Local::new(plan, worker)).collect();
        let stealers = locals.iter().map(|local| {
            let deques = &local.deques;
            CachePadded::new(ByReach { node: deques.node.stealer(), machine: deques.machine.stealer() })
        });
        let inbox = |_| {
            let tasks = ByReach { node: Injector::new(), machine: Injector::new() };
            CachePadded::new(Inbox { tasks, count: AtomicUsize::new(0) })
        };
        let inboxes = plan.machine.nodes.iter().map(inbox).collect();
        (Self { stealers: stealers.collect(), inboxes }, locals)
    }

    /// Puts a task into a node's inbox, from any thread.
    pub fn send(&self, node: usize, task: T, reach: Reach) {
        // Relaxed: whoever wakes a worker for this task fences after it; until then a missed look costs only time.
        self.inboxes[node].count.fetch_add(1, Relaxed);
        self.inboxes[node].tasks.get(reach).push(task);
    }

    /// Takes the oldest task of a worker, on the same node as the caller or not.
    pub fn take_from(&self, victim: usize, near: bool) -> Option<(T, Origin)> {
        let (reaches, origin) = if near { (LOCAL, Origin::Near) } else { (TRAVELLING, Origin::Far) };
        self.steal_from(victim, reaches).map(|task| (task, origin))
    }

    fn take_from_inbox(&self, node: usize, reaches: &[Reach]) -> Option<T> {
        let inbox = &self.inboxes[node];
        if inbox.count.load(Relaxed) == 0 {
            return None;
        }
        let task = reaches.iter().find_map(|&reach| insist(|| inbox.tasks.get(reach).steal()))?;
        inbox.count.fetch_sub(1, Relaxed);
        Some(task)
    }

    fn steal_from(&self, victim: usize, reaches: &[Reach]) -> Option<T> {
        reaches.iter().find_map(|&reach| insist(|| self.stealers[victim].get(reach).steal()))
    }
}

/// Repeats a steal that lost a race: the winner made progress, so this ends.
fn insist<T>(steal: impl Fn() -> Steal<T>) -> Option<T> {
    loop {
        match steal() {
            Steal::Success(task) => return Some(task),
            Steal::Empty => return None,
            Steal::Retry => crate::sync::spin_loop(),
        }
    }
}

/// Large pieces first: they are worth the most to a thief.
const LOCAL: &[Reach] = &[Reach::Machine, Reach::Node];
/// What may leave its node.
const TRAVELLING: &[Reach] = &[Reach::Machine];

impl<T> Local<T> {
    fn new(plan: &Plan, worker: usize) -> Self {
        Self {
            deques: ByReach { node: Deque::new_lifo(), machine: Deque::new_lifo() },
            looks: looks(plan, worker),
            random: Cell::new(0x9e37_79b9_7f4a_7c15 ^ (worker as u64 + 1)),
        }
    }

    /// Puts a task on the worker's own deque.
    #[inline]
    pub fn push(&self, task: T, reach: Reach) {
        self.deques.get(reach).push(task);
    }

    /// Takes the youngest task of one own deque.
    #[inline]
    pub fn pop(&self, reach: Reach) -> Option<T> {
        self.deques.get(reach).pop()
    }

    /// Whether the worker has nothing that others could take.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.deques.machine.is_empty() && self.deques.node.is_empty()
    }

    /// Looks everywhere once, nearest first.
    pub fn find(&self, queues: &Queues<T>) -> Option<(T, Origin)> {
        if let Some(task) = self.pop(Reach::Node).or_else(|| self.pop(Reach::Machine)) {
            return Some((task, Origin::Own));
        }
        self.looks.iter().find_map(|look| match look {
            Look::Inbox { node, local: true } => {
                queues.take_from_inbox(*node, LOCAL).map(|task| (task, Origin::Own))
            }
            Look::Inbox { node, local: false } => {
                queues.take_from_inbox(*node, TRAVELLING).map(|task| (task, Origin::Far))
            }
            Look::Victims { workers, local } => {
                let start = self.next_random() % workers.len();
                let order = workers[start..].iter().chain(&workers[..start]);
                order.copied().find_map(|victim| queues.take_from(victim, *local))
            }
        })
    }

    /// Marsaglia's xorshift64.
    fn next_random(&self) -> usize {
        let mut x = self.random.get();
        x ^= x << 13;
        x ^= x >> 7;
        x ^= x << 17;
        self.random.set(x);
        x as usize
    }
}

/// Other workers, nearest first, those equally near together.
pub fn victims_by_closeness(plan: &Plan, worker: usize) -> Vec<(Closeness, Vec<usize>)> {
    let cpu_of = |worker: usize| plan.slots[worker].cpu.and_then(|os| plan.machine.cpu(os));
    let closeness = |other: usize| {
        let (mine, theirs) = (plan.slots[worker].node, plan.slots[other].node);
        match (cpu_of(worker), cpu_of(other)) {
            (Some(a), Some(b)) => plan.machine.closeness(a, b),
            _ if mine == theirs => Closeness::Node,
            _ => Closeness::Remote(plan.machine.distances[mine][theirs]),
        }
    };
    let nodes = plan.machine.nodes_by_distance(plan.slots[worker].node);
    let place = |other: usize| nodes.iter().position(|node| *node == plan.slots[other].node);
    let mut tiers = std::collections::BTreeMap::<_, Vec<usize>>::new();
    for other in (0..plan.slots.len()).filter(|&other| other != worker) {
        // Nodes at the same distance are told apart, so that an inbox is looked into just before its own workers.
        tiers.entry((closeness(other), place(other))).or_default().push(other);
    }
    tiers.into_iter().map(|((closeness, _), workers)| (closeness, workers)).collect()
}

fn looks(plan: &Plan, worker: usize) -> Vec<Look> {
    let mut looks = vec![Look::Inbox { node: plan.slots[worker].node, local: true }];
    for (closeness, workers) in victims_by_closeness(plan, worker) {
        let local = closeness <= Closeness::Node;
        if !local {
            looks.push(Look::Inbox { node: plan.slots[workers[0]].node, local });
        }
        looks.push(Look::Victims { workers, local });
    }
    looks
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use crate::pinning::Policy;
    use crate::topology::Machine;
    use std::sync::Arc;

    fn plan(machine: &str, workers: usize) -> Plan {
        Plan::new(Arc::new(Machine::synthetic(machine).unwrap()), Policy::Compact, Some(workers)).unwrap()
    }

    #[test]
    fn tasks_are_found_nearest_first() {
        // Two packages of two nodes, two third-level caches a node, two cores a cache: workers 0-3 on node 0.
        let plan = plan("pack:2 numa:2 l3:2 core:2 pu:1", 16);
        let (queues, locals) = Queues::new(&plan);
        for (worker, name) in [(8, "far package"), (4, "near node"), (2, "node"), (1, "cache"), (0, "own")] {
            locals[worker].push(name, Reach::Machine);
        }
        queues.send(2, "far inbox", Reach::Machine);
        queues.send(1, "near inbox", Reach::Machine);
        queues.send(0, "own inbox", Reach::Node);
        let found: Vec<_> = std::iter::from_fn(|| locals[0].find(&queues)).collect();
        assert_eq!(
            found,
            [
                ("own", Origin::Own),
                ("own inbox", Origin::Own),
                ("cache", Origin::Near),
                ("node", Origin::Near),
                ("near inbox", Origin::Far),
                ("near node", Origin::Far),
                ("far inbox", Origin::Far),
                ("far package", Origin::Far),
            ]
        );
    }

    #[test]
    fn small_pieces_stay_on_their_node() {
        let plan = plan("numa:2 core:2 pu:1", 4);
        let (queues, locals) = Queues::new(&plan);
        locals[2].push("small", Reach::Node);
        queues.send(1, "small inbox", Reach::Node);
        assert_eq!(locals[0].find(&queues), None);
        assert_eq!(locals[3].find(&queues), Some(("small inbox", Origin::Own)));
        assert_eq!(locals[3].find(&queues), Some(("small", Origin::Near)));
        assert!(locals[2].is_empty());
    }

    #[test]
    fn every_other_worker_is_a_victim_once() {
        for (machine, workers) in
            [("pack:2 numa:4 l3:4 l2:4 l1d:1 core:1 pu:2", 256), ("numa:1 core:1 pu:1", 1)]
        {
            let plan = plan(machine, workers);
            for worker in [0, workers / 2, workers - 1] {
                let mut victims: Vec<_> =
                    victims_by_closeness(&plan, worker).into_iter().flat_map(|(_, tier)| tier).collect();
                victims.push(worker);
                victims.sort_unstable();
                assert_eq!(victims, (0..workers).collect::<Vec<_>>());
            }
        }
    }
}
