//! One batch as a stealing team runs it, replayed event by event (`schedule::crew` and `ccnuma`'s team): items go to the inboxes of their home
//! nodes, the costliest first, one range per worker; a range offers half of itself whenever its worker has nothing else on offer or an item to
//! run that is a good part of it, a task at each of its forks; who has nothing to do takes the oldest offer of the nearest, who waits for a
//! half that was stolen only what its thief offers, then and later.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

use crate::schedule::Part;

use super::site::{Look, Site};
use super::{Account, Nanos};

/// An item of at least this share of its range's weight is run after the rest has been offered, as in `ccnuma`.
const GOOD_PART: u64 = 8;

/// Something to do, owned by nobody yet.
pub(super) struct Item<'r> {
    /// The node its receiver is at home on.
    pub home: usize,
    /// What it is thought to cost.
    pub weight: u64,
    /// What it takes.
    pub work: Nanos,
    /// Its parts, in costs; none if it is in one piece.
    pub parts: &'r [Part],
    /// Nanoseconds per cost of its parts.
    pub scale: f64,
}

/// What lies on a worker's stack, or is on offer.
#[derive(Clone, Copy)]
enum Frame {
    /// Items from here to there, by rank.
    Range(usize, usize),
    /// Parts of an item from here to there.
    Parts(usize, usize, usize),
    /// Wait for a fork.
    Join(usize),
    /// A fork's second half was done elsewhere.
    Done(usize),
}

#[derive(Clone, Copy)]
struct Offer {
    frame: Frame,
    fork: Option<usize>,
}

struct Fork {
    done: bool,
    owner: usize,
    /// Who took the second half, if anybody did.
    thief: Option<usize>,
}

struct Replay<'a, 'r> {
    site: &'a Site,
    /// Items grouped by home.
    items: &'a [Item<'r>],
    /// Weight before each rank.
    before: Vec<u64>,
    inboxes: Vec<VecDeque<Offer>>,
    offers: Vec<VecDeque<Offer>>,
    stacks: Vec<Vec<Frame>>,
    forks: Vec<Fork>,
    /// Who waits for something to do.
    waiting: Vec<bool>,
    /// Who waits for a fork's second half and has nothing to help with.
    deaf: Vec<bool>,
    events: BinaryHeap<Reverse<(Nanos, usize)>>,
    account: &'a mut Account,
    end: Nanos,
}

/// Replays a batch and returns how long it takes; `items` are costliest first.
pub(super) fn replay(site: &Site, mut items: Vec<Item<'_>>, account: &mut Account) -> Nanos {
    items.sort_by_key(|item| item.home);
    let mut before = vec![0];
    for item in &items {
        before.push(before[before.len() - 1] + item.weight.max(1));
    }
    let workers = site.workers();
    let mut replay = Replay {
        site,
        items: &items,
        before,
        inboxes: vec![VecDeque::new(); site.staff.len()],
        offers: vec![VecDeque::new(); workers],
        stacks: vec![Vec::new(); workers],
        forks: Vec::new(),
        waiting: vec![false; workers],
        deaf: vec![false; workers],
        events: (0..workers).map(|worker| Reverse((site.start(worker), worker))).collect(),
        account,
        end: 0,
    };
    replay.send();
    while let Some(Reverse((now, worker))) = replay.events.pop() {
        replay.go_on(worker, now);
    }
    replay.end + site.end()
}

impl Replay<'_, '_> {
    /// Cuts each node's items into a range for each of its workers.
    fn send(&mut self) {
        let mut from = 0;
        for (node, workers) in self.site.staff.iter().enumerate() {
            let end = from + self.items[from..].partition_point(|item| item.home <= node);
            for left in (1..=*workers).rev() {
                let share = (self.before[end] - self.before[from]) / left as u64;
                let to = if left == 1 { end } else { self.split(from, end, share) };
                if to > from {
                    self.inboxes[node].push_back(Offer { frame: Frame::Range(from, to), fork: None });
                }
                from = to;
            }
        }
    }

    /// The first rank after `from` before which at least this share lies.
    fn split(&self, from: usize, end: usize, share: u64) -> usize {
        if from == end {
            return end;
        }
        let start = self.before[from];
        from + 1 + self.before[from + 1..end].partition_point(|weight| weight - start < share)
    }

    /// Lets a worker go on until it has something to do that takes time, or nothing at all.
    fn go_on(&mut self, worker: usize, now: Nanos) {
        while let Some(frame) = self.stacks[worker].pop() {
            match frame {
                Frame::Range(from, to) if from == to => {}
                Frame::Range(from, to) if to - from > 1 && self.offers_half(worker, from, to) => {
                    let half = (self.before[to] - self.before[from]) / 2;
                    let middle = self.split(from, to, half).min(to - 1);
                    self.offer(worker, now, Offer { frame: Frame::Range(middle, to), fork: None });
                    self.stacks[worker].push(Frame::Range(from, middle));
                }
                Frame::Range(from, to) => {
                    self.stacks[worker].push(Frame::Range(from + 1, to));
                    let item = &self.items[from];
                    if item.parts.is_empty() {
                        return self.work(worker, now, from, item.work);
                    }
                    self.stacks[worker].push(Frame::Parts(from, 0, item.parts.len()));
                }
                Frame::Parts(_, at, end) if at == end => {}
                Frame::Parts(item, at, end) => match self.items[item].parts[at] {
                    Part::Run(cost) => {
                        self.stacks[worker].push(Frame::Parts(item, at + 1, end));
                        let work = (f64::from(cost) * self.items[item].scale).round() as Nanos;
                        return self.work(worker, now, item, work);
                    }
                    Part::Fork { first, second } => {
                        let middle = at + 1 + first as usize;
                        let after = middle + second as usize;
                        self.stacks[worker].push(Frame::Parts(item, after, end));
                        let fork = self.forks.len();
                        self.forks.push(Fork { done: false, owner: worker, thief: None });
                        self.stacks[worker].push(Frame::Join(fork));
                        let second = Frame::Parts(item, middle, after);
                        self.offer(worker, now, Offer { frame: second, fork: Some(fork) });
                        self.stacks[worker].push(Frame::Parts(item, at + 1, middle));
                    }
                },
                Frame::Done(fork) => {
                    self.forks[fork].done = true;
                    let owner = self.forks[fork].owner;
                    if std::mem::take(&mut self.deaf[owner]) {
                        self.events.push(Reverse((now + self.site.wake(), owner)));
                    }
                }
                Frame::Join(fork) if self.forks[fork].done => {}
                Frame::Join(fork) => {
                    match self.offers[worker].pop_back_if(|offer| offer.fork == Some(fork)) {
                        Some(offer) => self.stacks[worker].push(offer.frame),
                        None => {
                            self.stacks[worker].push(Frame::Join(fork));
                            return self.help(worker, now, fork);
                        }
                    }
                }
            }
        }
        // What others may still take of its ranges is its own first.
        match self.offers[worker].pop_back() {
            Some(offer) => {
                self.stacks[worker].push(offer.frame);
                self.events.push(Reverse((now, worker)));
            }
            None => self.look(worker, now),
        }
    }

    /// Whether the next item waits until half of the range has been offered.
    fn offers_half(&self, worker: usize, from: usize, to: usize) -> bool {
        let (item, range) = (self.before[from + 1] - self.before[from], self.before[to] - self.before[from]);
        self.offers[worker].is_empty() || item * GOOD_PART >= range
    }

    fn offer(&mut self, worker: usize, now: Nanos, offer: Offer) {
        self.offers[worker].push_back(offer);
        self.account.forks += 1;
        let nearest = self.site.looks[worker].iter().find_map(|look| match look {
            Look::Workers(workers) => workers.iter().find(|other| self.waiting[**other]),
            Look::Inbox(_) => None,
        });
        match nearest {
            Some(&nearest) => self.wake(nearest, now),
            None => self.wake_listener(worker, now),
        }
    }

    /// Wakes a worker that waits for what the thief is at.
    fn wake_listener(&mut self, thief: usize, now: Nanos) {
        let waits = |worker: &usize| match self.stacks[*worker].last() {
            Some(Frame::Join(fork)) => self.deaf[*worker] && self.forks[*fork].thief == Some(thief),
            _ => false,
        };
        if let Some(listener) = (0..self.deaf.len()).find(waits) {
            self.deaf[listener] = false;
            self.events.push(Reverse((now + self.site.wake(), listener)));
        }
    }

    fn wake(&mut self, worker: usize, now: Nanos) {
        if std::mem::take(&mut self.waiting[worker]) {
            self.events.push(Reverse((now + self.site.wake(), worker)));
        }
    }

    /// The worker is busy for so long.
    fn work(&mut self, worker: usize, now: Nanos, item: usize, work: Nanos) {
        let remote = self.site.remote(worker, self.items[item].home, work);
        self.account.busy += work;
        self.account.remote += remote;
        let fork = self.site.fork();
        self.account.overhead += fork;
        let end = now + work + remote + fork;
        self.end = self.end.max(end);
        self.events.push(Reverse((end, worker)));
    }

    /// Looks for something to do, nearest first; waits where there is nothing.
    fn look(&mut self, worker: usize, now: Nanos) {
        let here = self.site.node[worker];
        let mut found = None;
        for look in &self.site.looks[worker] {
            found = match look {
                Look::Inbox(node) => {
                    self.inboxes[*node].pop_front().map(|offer| (offer, *node, *node != here))
                }
                Look::Workers(others) => others.iter().find_map(|other| {
                    self.offers[*other].pop_front().map(|offer| (offer, self.site.node[*other], true))
                }),
            };
            if found.is_some() {
                break;
            }
        }
        let Some((offer, node, stolen)) = found else {
            self.waiting[worker] = true;
            return;
        };
        if stolen { self.steal(worker, now, offer, node) } else { self.take(worker, now, offer) }
    }

    /// Takes what the thief of a fork's second half offers; waits where that is nothing.
    fn help(&mut self, worker: usize, now: Nanos, fork: usize) {
        let offered = self.forks[fork]
            .thief
            .and_then(|thief| self.offers[thief].pop_front().map(|offer| (offer, self.site.node[thief])));
        match offered {
            Some((offer, node)) => self.steal(worker, now, offer, node),
            None => self.deaf[worker] = true,
        }
    }

    fn steal(&mut self, worker: usize, now: Nanos, offer: Offer, node: usize) {
        let near = node == self.site.node[worker];
        *if near { &mut self.account.steals_near } else { &mut self.account.steals_far } += 1;
        let steal = self.site.steal(worker, node);
        self.account.overhead += steal;
        self.take(worker, now + steal, offer);
    }

    fn take(&mut self, worker: usize, now: Nanos, offer: Offer) {
        if let Some(fork) = offer.fork {
            self.forks[fork].thief = Some(worker);
            self.stacks[worker].push(Frame::Done(fork));
        }
        self.stacks[worker].push(offer.frame);
        self.events.push(Reverse((now, worker)));
    }
}
