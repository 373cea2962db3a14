//! The paper's schedules, replayed: whole pairs of an emitter and a receiver, handed out by a shared counter or by emitter, receivers locked.
//!
//! What several emitters have in common is known from a record of single shooters: their order, and what each pair costs. That a schedule
//! which does not wait for all shots chooses its shooters a little worse is not modelled.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use super::site::Site;
use super::{Account, Nanos};

/// What merging the light of a private copy costs, as a share of the pair it came from: each new coefficient is written once and added
/// once, against tens of evaluations each took. Assumed.
const MERGE_SHARE: f64 = 0.02;

/// What one emitter does to the receivers.
pub(super) struct Shot {
    /// Time in which it is chosen and made ready, by one worker at a time.
    pub prepare: Nanos,
    /// Pairs that cost something: receiver, its home, time.
    pub pairs: Vec<(u32, usize, Nanos)>,
    /// Time of the others.
    pub small: Nanos,
}

impl Shot {
    /// Its pairs, the first with what is to be done before.
    fn queued(&self) -> impl Iterator<Item = (Nanos, &(u32, usize, Nanos))> {
        let before = std::iter::once(self.prepare).chain(std::iter::repeat(0));
        before.zip(&self.pairs)
    }
}

/// What happens at a receiver somebody else is at work on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Receivers {
    /// Nobody else is: one emitter at a time.
    Free,
    /// Wait.
    Wait,
    /// Shoot to a private copy and merge later.
    Lure,
}

/// Receivers at work: until when.
struct Locks<'a> {
    site: &'a Site,
    rule: Receivers,
    free_at: HashMap<u32, Nanos>,
}

impl Locks<'_> {
    /// A worker comes to a pair at `now`; returns when it goes on.
    fn pair(&mut self, worker: usize, now: Nanos, pair: (u32, usize, Nanos), account: &mut Account) -> Nanos {
        let (receiver, home, work) = pair;
        let remote = self.site.remote(worker, home, work);
        account.busy += work;
        account.remote += remote;
        if self.rule == Receivers::Free {
            return now + work + remote;
        }
        let line = self.site.shared_line(worker);
        account.overhead += line;
        let free_at = self.free_at.entry(receiver).or_default();
        let end = if *free_at <= now || self.rule == Receivers::Wait {
            let begin = now.max(*free_at);
            account.lock += begin - now;
            begin + line + work + remote
        } else {
            let merge = (work as f64 * MERGE_SHARE) as Nanos + line;
            account.merge += merge;
            now + work + remote + merge
        };
        *free_at = (*free_at).max(end);
        end
    }
}

/// A central queue of the pairs of these shots, in order; whoever needs the first pair of a shot makes it ready. Returns how long it takes.
pub(super) fn central_queue(site: &Site, shots: &[Shot], rule: Receivers, account: &mut Account) -> Nanos {
    let workers = site.workers();
    let mut locks = Locks { site, rule, free_at: HashMap::new() };
    let mut ready: BinaryHeap<_> = (0..workers).map(|worker| Reverse((site.start(worker), worker))).collect();
    let (mut queue_free, mut end) = (0, 0);
    for (prepare, pair) in shots.iter().flat_map(Shot::queued) {
        let Some(Reverse((now, worker))) = ready.pop() else { break };
        let taken = now.max(queue_free) + site.shared_line(worker) + prepare;
        account.overhead += taken - now;
        queue_free = taken;
        let done = locks.pair(worker, taken, *pair, account);
        end = end.max(done);
        ready.push(Reverse((done, worker)));
    }
    // Small pairs fill what gaps there are.
    let small: Nanos = shots.iter().map(|shot| shot.small).sum();
    account.busy += small;
    let idle: Nanos = ready.iter().map(|Reverse((since, _))| end.saturating_sub(*since)).sum();
    end + small.saturating_sub(idle).div_ceil(workers as Nanos) + site.end()
}

/// One emitter per worker, the next in order for whoever is done; workers start at different ones of so many receivers. Returns how long it
/// takes.
pub(super) fn by_emitter(
    site: &Site,
    shots: &[Shot],
    receivers: usize,
    rule: Receivers,
    account: &mut Account,
) -> Nanos {
    let workers = site.workers();
    let mut locks = Locks { site, rule, free_at: HashMap::new() };
    let mut events: BinaryHeap<_> =
        (0..workers).map(|worker| Reverse((site.start(worker), worker))).collect();
    // The shot of each worker, where it starts among its pairs, and how many it has done.
    let mut at = vec![(usize::MAX, 0, 0); workers];
    let (mut next, mut choice_free, mut end) = (0, 0, 0);
    while let Some(Reverse((now, worker))) = events.pop() {
        let (shot, start, done) = at[worker];
        let then = match shots.get(shot).filter(|shot| done < shot.pairs.len()) {
            Some(shot) => {
                at[worker].2 += 1;
                locks.pair(worker, now, shot.pairs[(start + done) % shot.pairs.len()], account)
            }
            None => {
                let Some(shot) = shots.get(next) else { continue };
                let first = worker * receivers / workers;
                at[worker] = (next, shot.pairs.partition_point(|pair| (pair.0 as usize) < first), 0);
                next += 1;
                let chosen = now.max(choice_free) + shot.prepare;
                choice_free = chosen;
                account.overhead += chosen - now;
                account.busy += shot.small;
                chosen + shot.small
            }
        };
        end = end.max(then);
        events.push(Reverse((then, worker)));
    }
    end + site.end()
}
