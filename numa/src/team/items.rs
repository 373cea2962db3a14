//! Items with home nodes: each gets its own `&mut`, on its home node if that node's workers have time.
//!
//! Items are ordered by home node and each node's share is cut, by weight, into one range per worker of the node,
//! sent to the node's inbox. A worker that runs a range offers half of it whenever it has nothing left that others
//! could take (lazy binary splitting: Tzannes, Caragea, Barua, Vishkin, PPoPP 2010), so an item costs a look at its
//! own deques while nobody is hungry, and there is always something to steal when somebody is; and before an item that
//! is a good part of the range, so that the rest does not wait for it. Nobody waits for a range but the caller.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;

use super::latch::Latch;
use super::panic::WorkerPanic;
use super::{Shared, Task, Worker, whole};

/// Where an item is at home, and how much work it is in the program's own unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Home {
    /// Node, by position in the machine's table.
    pub node: usize,
    /// Work, relative to the other items and to [`super::Team::set_far_limit`].
    pub weight: u64,
}

/// One call of `for_each_mut`, on the stack of whoever waits for it.
struct Spread<'a, T, F> {
    items: *mut T,
    /// Positions of the items, grouped by home node.
    order: Order,
    /// Weight of all items before this one in `order`; one longer than there are items.
    before: Vec<u64>,
    each: &'a F,
    /// Set after a panic: the remaining items are skipped.
    cancelled: AtomicBool,
    panic: Mutex<Option<Box<WorkerPanic>>>,
    latch: Latch,
}

// SAFETY: workers share a `Spread` by reference. `items` is only used for one `&mut T` per position of `order`, a
// permutation whose ranges are disjoint, and `T: Send`; the rest is `Sync` as `F` is.
unsafe impl<T: Send, F: Sync> Sync for Spread<'_, T, F> {}

/// An item of at least this share of its range's weight is run after the rest has been offered.
const GOOD_PART: u64 = 8;

/// A range of `order`, for whoever takes it.
struct Range<'s, 'a, T, F> {
    spread: &'s Spread<'a, T, F>,
    from: usize,
    to: usize,
}

/// Runs `each` on every item and waits by calling `wait` on the latch, which `owner` is woken for.
pub(super) fn for_each_mut<T, H, F>(
    shared: &Shared,
    items: &mut [T],
    home: H,
    each: &F,
    owner: usize,
    wait: impl FnOnce(&Latch),
) -> Result<(), Box<WorkerPanic>>
where
    T: Send,
    H: Fn(&T) -> Home,
    F: Fn(&Worker, &mut T) + Sync,
{
    let (order, starts, before) = order_by_node(shared, items, &home);
    let ranges = cut(shared, &starts, &before);
    let spread = Spread {
        items: items.as_mut_ptr(),
        order,
        before,
        each,
        cancelled: AtomicBool::new(false),
        panic: Mutex::new(None),
        latch: Latch::new(ranges.len(), owner),
    };
    for &(node, from, to) in &ranges {
        let reach = shared.reach(spread.weight(from, to));
        // `spread` is alive until the latch is set, which `wait` waits for; `wait` does not unwind.
        shared.queues.send(node, spread.task(from, to), reach);
        shared.sleep.wake_first(shared.wake_order_of_node(node, reach));
    }
    if !ranges.is_empty() {
        wait(&spread.latch);
    }
    match spread.panic.into_inner() {
        Ok(None) => Ok(()),
        Ok(Some(panic)) => Err(panic),
        Err(_) => unreachable!("nothing panics while it holds this lock"),
    }
}

/// A permutation of the items' positions.
enum Order {
    AsGiven,
    Permuted(Vec<usize>),
}

impl Order {
    fn position(&self, rank: usize) -> usize {
        match self {
            Self::AsGiven => rank,
            Self::Permuted(order) => order[rank],
        }
    }
}

/// Positions grouped by the staffed node they go to, where each node's group starts (one start more than nodes), and
/// the weight before each rank.
fn order_by_node<T>(
    shared: &Shared,
    items: &[T],
    home: &dyn Fn(&T) -> Home,
) -> (Order, Vec<usize>, Vec<u64>) {
    let node_of = |home: &Home| shared.staffed.get(home.node).copied().unwrap_or(shared.staffed[0]);
    let mut before = Vec::with_capacity(items.len() + 1);
    before.push(0u64);
    let mut total = 0u64;
    let mut add = |home: &Home| {
        total = total.saturating_add(home.weight.max(1));
        total
    };
    let mut starts = vec![0; shared.staffed.len() + 1];
    let only = shared.plan.slots[0].node;
    if shared.staffed.iter().all(|&node| node == only) {
        starts[only + 1..].fill(items.len());
        before.extend(items.iter().map(|item| add(&home(item))));
        return (Order::AsGiven, starts, before);
    }
    let homes: Vec<Home> = items.iter().map(home).collect();
    homes.iter().for_each(|home| starts[node_of(home) + 1] += 1);
    (1..starts.len()).for_each(|node| starts[node] += starts[node - 1]);
    let mut next = starts.clone();
    let mut order = vec![0; homes.len()];
    for (item, home) in homes.iter().enumerate() {
        let place = &mut next[node_of(home)];
        order[*place] = item;
        *place += 1;
    }
    before.extend(order.iter().map(|&item| add(&homes[item])));
    (Order::Permuted(order), starts, before)
}

/// Cuts each node's group into one range of about equal weight per worker of the node; empty ranges are left out.
fn cut(shared: &Shared, starts: &[usize], before: &[u64]) -> Vec<(usize, usize, usize)> {
    let mut ranges = Vec::new();
    for (node, bounds) in starts.windows(2).enumerate() {
        let (mut from, end) = (bounds[0], bounds[1]);
        let workers = shared.workers_by_node[node].len();
        for left in (1..=workers).rev() {
            let share = (before[end] - before[from]) / left as u64;
            let to = if left == 1 { end } else { split(before, from, end, share) };
            if to > from {
                ranges.push((node, from, to));
            }
            from = to;
        }
    }
    ranges
}

/// The first position after `from` at which at least `share` lies behind, and at most `end`.
fn split(before: &[u64], from: usize, end: usize, share: u64) -> usize {
    if from == end {
        return end;
    }
    from + 1 + before[from + 1..end].partition_point(|&weight| weight - before[from] < share)
}

impl<T: Send, F: Fn(&Worker, &mut T) + Sync> Range<'_, '_, T, F> {
    /// # Safety
    /// `data` must come from [`Spread::task`] and not have been run; its `Spread` must be alive, and counted this range.
    unsafe fn run(data: *const (), worker: &Worker) {
        // SAFETY: made by `Box::into_raw` in `Spread::task` and given up by this, its only run.
        let range = unsafe { Box::from_raw(data.cast_mut().cast::<Self>()) };
        let spread = range.spread;
        let outcome = catch_unwind(AssertUnwindSafe(|| spread.range(worker, range.from, range.to)));
        if let Err(payload) = outcome {
            WorkerPanic::keep_first(&mut whole(&spread.panic), WorkerPanic::caught(payload, worker));
        }
        // SAFETY: the latch is alive until its last count-down, which this may be; nothing here is used after it.
        unsafe { Latch::count_down(&raw const spread.latch, &worker.shared.sleep) };
    }
}

impl<T: Send, F: Fn(&Worker, &mut T) + Sync> Spread<'_, T, F> {
    fn weight(&self, from: usize, to: usize) -> u64 {
        self.before[to] - self.before[from]
    }

    /// The task that runs a range, which the latch must have counted; it must be run, once, while this is alive.
    fn task(&self, from: usize, to: usize) -> Task {
        let range = Box::new(Range { spread: self, from, to });
        Task { data: Box::into_raw(range).cast_const().cast(), run: Range::<T, F>::run }
    }

    fn range(&self, worker: &Worker, mut from: usize, mut to: usize) {
        while from < to && !self.cancelled.load(Relaxed) {
            while to - from > 1
                && (worker.queue.is_empty()
                    || self.weight(from, from + 1).saturating_mul(GOOD_PART) >= self.weight(from, to))
            {
                let middle = split(&self.before, from, to, self.weight(from, to) / 2).min(to - 1);
                self.latch.add();
                worker.push(self.task(middle, to), worker.reach(self.weight(middle, to)));
                to = middle;
            }
            self.item(worker, self.order.position(from));
            from += 1;
        }
    }

    fn item(&self, worker: &Worker, position: usize) {
        /// Tells the others to stop when the item's code unwinds.
        struct Cancel<'c>(&'c AtomicBool);
        impl Drop for Cancel<'_> {
            fn drop(&mut self) {
                self.0.store(true, Relaxed);
            }
        }
        let cancel = Cancel(&self.cancelled);
        // SAFETY: `position` is below the slice's length and occurs once in `order`; ranges are disjoint and each is
        // run once, so this is the only reference to the item while the slice is borrowed by the caller.
        (self.each)(worker, unsafe { &mut *self.items.add(position) });
        std::mem::forget(cancel);
    }
}

impl Worker {
    /// As [`super::Team::for_each_mut`], from inside a job; a panic unwinds here.
    pub fn for_each_mut<T, H, F>(&self, items: &mut [T], home: H, each: F)
    where
        T: Send,
        H: Fn(&T) -> Home,
        F: Fn(&Worker, &mut T) + Sync,
    {
        let wait = |latch: &Latch| self.wait_until(|| latch.is_set());
        for_each_mut(&self.shared, items, home, &each, self.index, wait)
            .unwrap_or_else(|panic| panic.relay());
    }
}
