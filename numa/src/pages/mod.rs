//! Ranges of pages on chosen nodes, and the question where pages are.
//!
//! The policy is set before the first touch, ranges are aligned to [`HUGE`] and advised to use huge pages, and what
//! the kernel refuses (binding in a container, huge pages switched off) falls back to first touch and small pages:
//! [`Pages::applied`] and [`crate::warnings`] say so. Node numbers here are the operating system's.

#[cfg(all(target_os = "linux", not(miri)))]
mod linux;
#[cfg(not(all(target_os = "linux", not(miri))))]
mod portable;

use std::collections::BTreeMap;
use std::ptr::NonNull;

use serde::Serialize;

use crate::cpuset::CpuSet;
use crate::error::Error;
#[cfg(all(target_os = "linux", not(miri)))]
use linux as sys;
#[cfg(not(all(target_os = "linux", not(miri))))]
use portable as sys;

/// Size and alignment of a huge page, and of every range: 2 MiB.
pub const HUGE: usize = 2 << 20;

/// Where the pages of a range shall land.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Placement {
    /// On this node and nowhere else.
    Bind(usize),
    /// On this node while it has room, then on the nearest.
    Preferred(usize),
    /// Page by page round these nodes.
    Interleave(CpuSet),
    /// On the node of the thread that touches a page first.
    FirstTouch,
}

/// Whether a placement was applied.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Applied {
    /// As asked.
    AsAsked,
    /// The kernel does not let this process place memory; pages land by first touch.
    FirstTouch(String),
}

/// Pages per node, as the kernel reports them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct PageCount {
    /// Small pages by the operating system's node number.
    pub by_node: BTreeMap<usize, usize>,
    /// Pages that were never touched.
    pub untouched: usize,
}

impl PageCount {
    /// Adds another count.
    pub fn add(&mut self, other: &Self) {
        other.by_node.iter().for_each(|(&node, pages)| *self.by_node.entry(node).or_default() += pages);
        self.untouched += other.untouched;
    }

    /// Share of the touched pages that are on `node`; `None` where none is touched.
    pub fn share_on(&self, node: usize) -> Option<f64> {
        let touched: usize = self.by_node.values().sum();
        (touched > 0).then(|| self.by_node.get(&node).copied().unwrap_or(0) as f64 / touched as f64)
    }
}

/// An owned range of zeroed pages, a multiple of [`HUGE`] long and aligned to it.
#[derive(Debug)]
pub struct Pages {
    base: NonNull<u8>,
    bytes: usize,
    applied: Applied,
    huge: bool,
}

// SAFETY: `Pages` owns its range as a `Box<[u8]>` would; nothing in it is tied to a thread.
unsafe impl Send for Pages {}
// SAFETY: shared access gives out only the address and size.
unsafe impl Sync for Pages {}

impl Pages {
    /// Maps at least `bytes` bytes (rounded up to [`HUGE`]) placed as asked. Nothing is touched yet.
    pub fn map(bytes: usize, placement: &Placement) -> Result<Self, Error> {
        let mut pages = Self::map_unadvised(bytes, placement)?;
        pages.huge = sys::advise_huge(pages.base, pages.bytes);
        if !pages.huge {
            crate::warnings::note("huge pages are not available: small pages are used".to_owned());
        }
        Ok(pages)
    }

    /// As [`Pages::map`] on small pages, wherever the kernel's habit is: what is not touched costs nothing.
    pub fn map_small(bytes: usize, placement: &Placement) -> Result<Self, Error> {
        let pages = Self::map_unadvised(bytes, placement)?;
        sys::advise_small(pages.base, pages.bytes);
        Ok(pages)
    }

    fn map_unadvised(bytes: usize, placement: &Placement) -> Result<Self, Error> {
        let too_big = || Error::Map { bytes, reason: "more than the address space".to_owned() };
        let bytes = bytes.max(1).checked_next_multiple_of(HUGE).ok_or_else(too_big)?;
        if let Placement::Bind(node) = *placement {
            check_room(node, bytes)?;
        }
        let base = sys::map(bytes).map_err(|reason| Error::Map { bytes, reason })?;
        let mut pages = Self { base, bytes, applied: Applied::AsAsked, huge: false };
        // Before the first touch: a policy does not move pages that are there already.
        if let Err(refusal) = sys::place(base, bytes, placement) {
            pages.applied = refusal.into_applied(placement)?;
        }
        Ok(pages)
    }

    /// First byte.
    pub fn base(&self) -> NonNull<u8> {
        self.base
    }

    /// Length, a multiple of [`HUGE`].
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Whether the placement was applied.
    pub fn applied(&self) -> &Applied {
        &self.applied
    }

    /// Whether the kernel took the advice to use huge pages.
    pub fn huge(&self) -> bool {
        self.huge
    }

    /// Touches every page from the calling thread, keeping what is in it.
    pub fn populate(&mut self) {
        sys::populate(self.base, self.bytes);
    }

    /// Which nodes the pages are on.
    pub fn count(&self) -> Result<PageCount, Error> {
        count(self.base.as_ptr(), self.bytes)
    }

    /// Cuts off the first `bytes` bytes, a multiple of [`HUGE`]; `None` where there are not so many.
    pub(crate) fn split_front(&mut self, bytes: usize) -> Option<Self> {
        debug_assert!(bytes.is_multiple_of(HUGE));
        let rest = self.bytes.checked_sub(bytes)?;
        let front = Self { base: self.base, bytes, applied: self.applied.clone(), huge: self.huge };
        // SAFETY: `bytes <= self.bytes`, so the result is inside the range or one past its end.
        self.base = unsafe { self.base.add(bytes) };
        self.bytes = rest;
        Some(front)
    }

    /// Gives up ownership; [`Pages::from_parts`] takes it back.
    pub(crate) fn into_parts(self) -> (NonNull<u8>, usize) {
        let pages = std::mem::ManuallyDrop::new(self);
        (pages.base, pages.bytes)
    }

    /// Takes back what [`Pages::into_parts`] gave up.
    ///
    /// # Safety
    /// `base` and `bytes` must come from `into_parts`, and nothing may use the range but through the result.
    pub(crate) unsafe fn from_parts(base: NonNull<u8>, bytes: usize) -> Self {
        Self { base, bytes, applied: Applied::AsAsked, huge: false }
    }
}

impl Drop for Pages {
    fn drop(&mut self) {
        if self.bytes > 0 {
            // SAFETY: the range is owned by `self` (type invariant) and not used after this.
            unsafe { sys::unmap(self.base, self.bytes) };
        }
    }
}

/// Why a placement was not applied.
pub(crate) enum Refusal {
    /// The process may not place memory at all (EPERM, ENOSYS).
    Forbidden(String),
    /// The node does not exist or is not allowed (EINVAL).
    BadNode(String),
}

impl Refusal {
    fn into_applied(self, placement: &Placement) -> Result<Applied, Error> {
        match self {
            Self::Forbidden(reason) => {
                crate::warnings::note(format!(
                    "memory cannot be placed on nodes ({reason}): pages land by first touch; in a container, allow \
                     the system call mbind (docker: --cap-add SYS_NICE)"
                ));
                Ok(Applied::FirstTouch(reason))
            }
            Self::BadNode(reason) => {
                let node = match placement {
                    Placement::Bind(node) | Placement::Preferred(node) => *node,
                    Placement::Interleave(nodes) => nodes.iter().next().unwrap_or(0),
                    Placement::FirstTouch => 0,
                };
                Err(Error::Node { node, reason })
            }
        }
    }
}

/// Refuses a strict binding to a node without room: the kernel would answer with its out-of-memory killer.
fn check_room(node: usize, bytes: usize) -> Result<(), Error> {
    match room_bytes(node) {
        Some(free_bytes) if free_bytes < bytes as u64 => {
            Err(Error::NodeFull { node, free_bytes, asked_bytes: bytes as u64 })
        }
        _ => Ok(()),
    }
}

/// Bytes of a node that are free or hold clean file pages; `None` where the kernel does not tell, or tells nonsense.
pub fn room_bytes(node: usize) -> Option<u64> {
    if !nodes_add_up() {
        return None;
    }
    let text = node_meminfo(node)?;
    let files = ["Active(file):", "Inactive(file):"].map(|name| field_bytes(&text, name).unwrap_or(0));
    Some(field_bytes(&text, "MemFree:")? + files[0] + files[1])
}

fn node_meminfo(node: usize) -> Option<String> {
    std::fs::read_to_string(format!("/sys/devices/system/node/node{node}/meminfo")).ok()
}

/// A field of a meminfo text, which counts in KiB.
fn field_bytes(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find(|line| line.split_whitespace().any(|word| word == name))?;
    line.split_whitespace().rev().nth(1)?.parse::<u64>().ok().map(|kib| kib << 10)
}

/// Whether the nodes' memory adds up to the machine's. On virtual machines with memory plugged in later it may not,
/// and then a node's figures mean nothing. Read once.
fn nodes_add_up() -> bool {
    static ADD_UP: std::sync::OnceLock<bool> = std::sync::OnceLock::new();
    *ADD_UP.get_or_init(|| {
        let nodes: CpuSet = std::fs::read_to_string("/sys/devices/system/node/online")
            .ok()
            .and_then(|list| list.parse().ok())
            .unwrap_or_default();
        let total = |text: String| field_bytes(&text, "MemTotal:");
        let sum: u64 = nodes.iter().filter_map(node_meminfo).filter_map(total).sum();
        let machine = std::fs::read_to_string("/proc/meminfo").ok().and_then(total).unwrap_or(0);
        sum.abs_diff(machine) <= machine / 16
    })
}

/// Calls `make` with the calling thread's fresh pages going round these nodes, as `numactl --interleave` does for a process: for what is
/// allocated by others, such as large vectors. Pages that the allocator has already stay where they are.
pub fn interleaving<R>(nodes: &CpuSet, make: impl FnOnce() -> R) -> R {
    struct Reset;
    impl Drop for Reset {
        fn drop(&mut self) {
            // What could be set can be reset.
            let _ = sys::interleave_thread(None);
        }
    }
    let _reset = match sys::interleave_thread(Some(nodes)) {
        Ok(()) => Some(Reset),
        Err(reason) => {
            crate::warnings::note(format!(
                "pages cannot be interleaved ({reason}): they land by first touch"
            ));
            None
        }
    };
    make()
}

/// Which nodes the pages that hold these items are on.
pub fn count_of<T>(items: &[T]) -> Result<PageCount, Error> {
    count(items.as_ptr().cast(), size_of_val(items))
}

/// The pages that hold some values, by number.
#[derive(Clone, Debug, Default)]
pub struct PageSet(Vec<usize>);

impl PageSet {
    /// Adds the pages that hold these items.
    pub fn add<T>(&mut self, items: &[T]) {
        if size_of_val(items) > 0 {
            let (page, first) = (sys::page_bytes(), items.as_ptr().addr());
            let pages = first / page..=(first + size_of_val(items) - 1) / page;
            // Neighbours share pages.
            let last = self.0.last().copied();
            self.0.extend(pages.filter(|number| Some(*number) != last));
        }
    }

    /// Which nodes they are on; each counts once.
    pub fn count(mut self) -> Result<PageCount, Error> {
        self.0.sort_unstable();
        self.0.dedup();
        let page = sys::page_bytes();
        count_at(&self.0.iter().map(|number| number * page).collect::<Vec<_>>())
    }
}

/// Which nodes the pages of an address range are on. The kernel only looks up the addresses, nothing is read.
pub(crate) fn count(base: *const u8, bytes: usize) -> Result<PageCount, Error> {
    let page = sys::page_bytes();
    let first = base.addr() / page * page;
    count_at(&(first..base.addr() + bytes).step_by(page).collect::<Vec<_>>())
}

/// Which nodes the pages at these addresses are on.
fn count_at(addresses: &[usize]) -> Result<PageCount, Error> {
    let mut count = PageCount::default();
    for batch in addresses.chunks(4096) {
        for status in sys::nodes_of(batch).map_err(|reason| Error::PageQuery { reason })? {
            match status {
                Some(node) => *count.by_node.entry(node).or_default() += 1,
                None => count.untouched += 1,
            }
        }
    }
    Ok(count)
}

#[cfg(test)]
mod tests;
