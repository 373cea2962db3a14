//! Typed bump arenas on pages of a chosen node, with handles that own what they point to.
//!
//! An [`Arena`] belongs to one worker and hands out [`ArenaBox`]es, which move freely between threads and are one
//! pointer wide. Memory is cut into chunks of [`CHUNK`] bytes, aligned to their size, so a handle finds its chunk's
//! header by masking its address; the header counts the handles. The protocol:
//!
//! * While a chunk is **open** (its arena still allocates from it) the header's `live` is `BIAS − dropped`, and the
//!   arena counts the handles it `issued` in a plain cell: allocation needs no atomic operation.
//! * When it is **sealed**, the arena subtracts `BIAS − 1 − issued`, so that `live` becomes the handles still alive
//!   plus one share of the arena's. From then on it only falls.
//! * The arena gives its share back when it is dropped. Whoever brings `live` to 0 unmaps the chunk: the arena, or
//!   the last handle, on any thread. A handle therefore never outlives its memory, whichever goes first.
//! * A sealed chunk with `live == 1` has no handle left, and no way to get one: [`Arena::reset`] may reuse it.
//!
//! Every decrement is `Release` and whoever acts on the last one is `Acquire`, as in `Arc`: the drop of a value
//! happens before its memory is reused or unmapped. Decrements are read-modify-writes, so the relaxed one at sealing
//! continues their release sequence.
//!
//! With [`Backend::Malloc`] each value is a heap allocation of its own, freed by its handle, so that studies can
//! compare. The handle tells the two apart without a tag: with `A = max(align, 8)`, arena addresses are multiples of
//! `2 A`, heap addresses are odd multiples of `A`.

mod by_node;
mod chunk;
mod handle;
mod shares;

use std::alloc::Layout;
use std::cell::{Cell, RefCell};
use std::ptr::NonNull;

use serde::Serialize;

pub use by_node::{Memory, NodeArenas, UnknownMemory};
pub use handle::ArenaBox;

use crate::error::Error;
use crate::pages::{HUGE, PageCount, Pages, Placement};
use chunk::Chunk;

/// Size and alignment of a chunk: one huge page.
pub const CHUNK: usize = HUGE;
/// The most that is mapped at once; mapping grows up to it so that small arenas stay small.
const MAX_SLAB: usize = 64 << 20;
/// The largest alignment a value may have.
const MAX_ALIGN: usize = 4096;

/// Where an arena's memory comes from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Backend {
    /// Bump allocation on pages placed so.
    Pages(Placement),
    /// One heap allocation per value, by the program's allocator.
    Malloc,
}

/// What an arena has handed out.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Stats {
    /// Values allocated since the start.
    pub allocations: u64,
    /// Bytes of these values.
    pub value_bytes: u64,
    /// Bytes mapped now, spare ones included; 0 with [`Backend::Malloc`], whose allocator does not tell.
    pub mapped_bytes: usize,
    /// Bytes of the chunks in use and kept for reuse; what is mapped beyond that was never touched.
    pub chunk_bytes: usize,
    /// Bytes lost to alignment and at the ends of chunks since the start.
    pub waste_bytes: u64,
    /// Chunks in use.
    pub chunks: usize,
    /// Chunks kept for reuse.
    pub free_chunks: usize,
    /// Mappings that could not be bound as asked because the node was full, and were placed nearby.
    pub placed_elsewhere: usize,
}

/// What [`Arena::reset`] found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reset {
    /// Chunks that can be used again.
    pub reclaimed: usize,
    /// Chunks that hold at least one living handle's value, and stay.
    pub in_use: usize,
}

/// A bump arena for one thread at a time; see the module's text.
#[derive(Debug)]
pub struct Arena {
    backend: Backend,
    huge: bool,
    cursor: Cell<usize>,
    end: Cell<usize>,
    issued: Cell<usize>,
    open: Cell<Option<Chunk>>,
    sealed: RefCell<Vec<Chunk>>,
    free: RefCell<Vec<Chunk>>,
    spare: RefCell<Option<Pages>>,
    next_slab: Cell<usize>,
    stats: RefCell<Stats>,
    value_bytes: Cell<u64>,
    used_bytes: Cell<u64>,
    issued_before: Cell<u64>,
}

// SAFETY: an arena owns its chunks and may move to another thread; handles share with it only the atomic count in
// each header. It is not `Sync`: `Cell` sees to that.
unsafe impl Send for Arena {}

/// `2 A` of the module's text: what arena addresses are multiples of.
const fn arena_align(layout: Layout) -> usize {
    2 * heap_offset(layout)
}

/// `A` of the module's text.
const fn heap_offset(layout: Layout) -> usize {
    if layout.align() > 8 { layout.align() } else { 8 }
}

impl Arena {
    /// An empty arena; nothing is mapped until the first value.
    pub fn new(backend: Backend) -> Self {
        Self {
            backend,
            huge: true,
            cursor: Cell::new(0),
            end: Cell::new(0),
            issued: Cell::new(0),
            open: Cell::new(None),
            sealed: RefCell::default(),
            free: RefCell::default(),
            spare: RefCell::default(),
            next_slab: Cell::new(CHUNK),
            stats: RefCell::default(),
            value_bytes: Cell::new(0),
            used_bytes: Cell::new(0),
            issued_before: Cell::new(0),
        }
    }

    /// An arena on pages of one node (operating-system number).
    pub fn on_node(node: usize) -> Self {
        Self::new(Backend::Pages(Placement::Bind(node)))
    }

    /// As [`Arena::on_node`] on small pages, for so little that a huge page would be wasted.
    pub(crate) fn small_on_node(node: usize) -> Self {
        Self::on_node(node).on_small_pages()
    }

    /// The same, before anything is mapped, on small pages: what is not touched costs nothing.
    pub(crate) fn on_small_pages(mut self) -> Self {
        self.huge = false;
        self
    }

    /// Moves a value into the arena. Aborts, as `Box` does, when the machine has no memory left.
    #[inline]
    pub fn alloc<T>(&self, value: T) -> ArenaBox<T> {
        const { assert!(align_of::<T>() <= MAX_ALIGN, "values in arenas are aligned to at most 4096 bytes") };
        let place = self.raw(Layout::new::<T>()).cast::<T>();
        // SAFETY: `raw` returns memory for this layout that nobody else uses, counted for one handle.
        unsafe {
            place.write(value);
            ArenaBox::from_raw(place)
        }
    }

    /// Allocates a slice of `len` values, made in order by `make`, which may use the arena itself.
    pub fn alloc_slice_with<T>(&self, len: usize, mut make: impl FnMut(usize) -> T) -> ArenaBox<[T]> {
        const { assert!(align_of::<T>() <= MAX_ALIGN, "values in arenas are aligned to at most 4096 bytes") };
        let layout = Layout::array::<T>(len).unwrap_or_else(|_| {
            panic!("a slice of {len} values of {} bytes is more than the address space", size_of::<T>())
        });
        // SAFETY: memory for this layout, counted for one handle, which the guard owns until it is complete.
        let mut guard = unsafe { handle::SliceGuard::new(self.raw(layout).cast::<T>(), len) };
        for index in 0..len {
            guard.push(make(index));
        }
        guard.finish()
    }

    /// Maps and touches enough for `bytes` more bytes, so that later allocation meets no page fault.
    pub fn reserve(&self, bytes: usize) -> Result<(), Error> {
        let Backend::Pages(placement) = &self.backend else { return Ok(()) };
        for _ in 0..bytes.div_ceil(CHUNK - chunk::HEADER) {
            let mut pages = Pages::map(CHUNK, placement)?;
            pages.populate();
            self.stats.borrow_mut().mapped_bytes += CHUNK;
            self.free.borrow_mut().push(Chunk::new(pages));
        }
        Ok(())
    }

    /// Makes every chunk without living handles available again; memory is kept, nothing is returned or touched.
    pub fn reset(&self) -> Reset {
        self.seal();
        let mut sealed = self.sealed.borrow_mut();
        let (in_use, unused): (Vec<_>, Vec<_>) = sealed.drain(..).partition(Chunk::has_handles);
        let found = Reset { reclaimed: unused.len(), in_use: in_use.len() };
        *sealed = in_use;
        self.free.borrow_mut().extend(unused);
        found
    }

    /// What was handed out so far.
    pub fn stats(&self) -> Stats {
        let allocations = self.issued_before.get() + self.issued.get() as u64;
        let value_bytes = self.value_bytes.get();
        let used = self.used_bytes.get() + self.cursor.get().saturating_sub(self.open_start()) as u64;
        let (sealed, free, open) = (self.sealed.borrow(), self.free.borrow(), self.open.get());
        Stats {
            allocations,
            value_bytes,
            waste_bytes: used.saturating_sub(value_bytes),
            chunk_bytes: sealed.iter().chain(free.iter()).chain(&open).map(Chunk::bytes).sum(),
            chunks: sealed.len() + usize::from(open.is_some()),
            free_chunks: free.len(),
            ..self.stats.borrow().clone()
        }
    }

    /// Which nodes the arena's pages are on, asked from the kernel; nothing with [`Backend::Malloc`].
    pub fn count_pages(&self) -> Result<PageCount, Error> {
        let mut count = PageCount::default();
        for chunk in self.sealed.borrow().iter().chain(&self.open.get()) {
            count.add(&crate::pages::count(chunk.base().as_ptr(), chunk.bytes())?);
        }
        Ok(count)
    }

    /// Memory for one value, counted for one handle that is not made yet.
    #[inline]
    fn raw(&self, layout: Layout) -> NonNull<u8> {
        if layout.size() == 0 {
            return handle::dangling(layout);
        }
        let align = arena_align(layout);
        let start = (self.cursor.get() + (align - 1)) & !(align - 1);
        // `end` is 0 until the first chunk is open, and always with malloc. No overflow: a size is at most isize::MAX
        // and addresses of user space are too.
        if start + layout.size() > self.end.get() {
            return self.raw_slow(layout);
        }
        self.cursor.set(start + layout.size());
        self.issued.set(self.issued.get() + 1);
        self.value_bytes.set(self.value_bytes.get() + layout.size() as u64);
        match self.open.get() {
            Some(chunk) => chunk.at(start),
            None => unreachable!("an arena without open chunk has end = 0, so no value fits"),
        }
    }

    #[cold]
    #[inline(never)]
    fn raw_slow(&self, layout: Layout) -> NonNull<u8> {
        let Backend::Pages(placement) = &self.backend else {
            self.issued_before.set(self.issued_before.get() + 1);
            self.value_bytes.set(self.value_bytes.get() + layout.size() as u64);
            return handle::heap_alloc(layout);
        };
        let needed = chunk::HEADER + arena_align(layout) + layout.size();
        if needed > CHUNK {
            return self.raw_large(layout, needed.next_multiple_of(CHUNK), placement);
        }
        self.seal();
        let free = self.free.borrow_mut().pop_if_chunk();
        let chunk = match free.map_or_else(|| self.map_chunk(placement), Ok) {
            Ok(chunk) => chunk,
            Err(_) => crate::exhausted::fail(layout),
        };
        chunk.open();
        self.cursor.set(chunk.base().addr().get() + chunk::HEADER);
        self.end.set(chunk.base().addr().get() + chunk.bytes());
        self.open.set(Some(chunk));
        self.raw(layout)
    }

    /// A value larger than a chunk gets a chunk of its own, sealed from the start.
    fn raw_large(&self, layout: Layout, bytes: usize, placement: &Placement) -> NonNull<u8> {
        let free = self.free.borrow_mut().take_large(bytes);
        let chunk = match free.map_or_else(|| self.map_pages(bytes, placement).map(Chunk::new), Ok) {
            Ok(chunk) => chunk,
            Err(_) => crate::exhausted::fail(layout),
        };
        chunk.open();
        chunk.seal(1);
        self.sealed.borrow_mut().push(chunk);
        let start = (chunk.base().addr().get() + chunk::HEADER).next_multiple_of(arena_align(layout));
        self.issued_before.set(self.issued_before.get() + 1);
        self.value_bytes.set(self.value_bytes.get() + layout.size() as u64);
        self.used_bytes.set(self.used_bytes.get() + chunk.bytes() as u64);
        chunk.at(start)
    }

    fn open_start(&self) -> usize {
        self.open.get().map_or(0, |chunk| chunk.base().addr().get())
    }

    fn seal(&self) {
        let Some(chunk) = self.open.take() else { return };
        let issued = self.issued.replace(0);
        chunk.seal(issued);
        self.issued_before.set(self.issued_before.get() + issued as u64);
        self.used_bytes.set(self.used_bytes.get() + chunk.bytes() as u64);
        self.cursor.set(0);
        self.end.set(0);
        self.sealed.borrow_mut().push(chunk);
    }

    /// Cuts a chunk from the spare pages, mapping more when they are used up.
    fn map_chunk(&self, placement: &Placement) -> Result<Chunk, Error> {
        let mut spare = self.spare.borrow_mut();
        if let Some(pages) = spare.as_mut().and_then(|pages| pages.split_front(CHUNK)) {
            return Ok(Chunk::new(pages));
        }
        let slab = if cfg!(all(target_os = "linux", not(miri))) { self.next_slab.get() } else { CHUNK };
        let mut pages = self.map_pages(slab, placement).or_else(|_| self.map_pages(CHUNK, placement))?;
        self.next_slab.set((2 * slab).min(MAX_SLAB));
        let first = pages.split_front(CHUNK);
        *spare = Some(pages).filter(|pages| pages.bytes() > 0);
        first.map(Chunk::new).ok_or(Error::Map { bytes: CHUNK, reason: "a short mapping".to_owned() })
    }

    /// Maps pages as asked; where the node is full or not here, nearby, which the statistics tell.
    fn map_pages(&self, bytes: usize, placement: &Placement) -> Result<Pages, Error> {
        let map = if self.huge { Pages::map } else { Pages::map_small };
        let elsewhere = |error: Error, nearby: Placement| {
            crate::warnings::note(format!("{error}; the arena goes on nearby"));
            self.stats.borrow_mut().placed_elsewhere += 1;
            map(bytes, &nearby)
        };
        let mapped = map(bytes, placement).or_else(|error| match (&error, placement) {
            (Error::NodeFull { node, .. }, _) => {
                let node = *node;
                elsewhere(error, Placement::Preferred(node))
            }
            (Error::Node { .. }, _) => elsewhere(error, Placement::FirstTouch),
            _ => Err(error),
        })?;
        self.stats.borrow_mut().mapped_bytes += mapped.bytes();
        Ok(mapped)
    }
}

impl Drop for Arena {
    fn drop(&mut self) {
        self.seal();
        let chunks = self.sealed.get_mut().drain(..).chain(self.free.get_mut().drain(..));
        chunks.for_each(Chunk::give_back_share);
    }
}

/// The list of chunks kept for reuse.
trait FreeList {
    /// One of the usual size.
    fn pop_if_chunk(&mut self) -> Option<Chunk>;
    /// A large one that is not much too large.
    fn take_large(&mut self, bytes: usize) -> Option<Chunk>;
}

impl FreeList for Vec<Chunk> {
    fn pop_if_chunk(&mut self) -> Option<Chunk> {
        let usual = self.iter().rposition(|chunk| chunk.bytes() == CHUNK)?;
        Some(self.swap_remove(usual))
    }

    fn take_large(&mut self, bytes: usize) -> Option<Chunk> {
        let fits = |chunk: &Chunk| chunk.bytes() >= bytes && chunk.bytes() <= 2 * bytes;
        let index = self.iter().position(fits)?;
        Some(self.swap_remove(index))
    }
}

#[cfg(all(test, not(loom)))]
mod tests;
