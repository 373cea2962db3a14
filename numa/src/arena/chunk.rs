//! A chunk: a header that counts handles, then values; freed by whoever brings the count to 0.

use std::ptr::NonNull;

use super::CHUNK;
use super::shares::Shares;
use crate::pages::Pages;

/// Bytes before the first value: a cache line, so that counting does not disturb it.
pub const HEADER: usize = 64;

#[repr(C)]
#[derive(Debug)]
struct Header {
    shares: Shares,
    bytes: usize,
}

/// A chunk that is known to be mapped: its arena's share is part of the count.
#[derive(Clone, Copy, Debug)]
pub struct Chunk(NonNull<Header>);

impl Chunk {
    /// Takes over pages; the arena's share is the only one.
    pub fn new(pages: Pages) -> Self {
        let (base, bytes) = pages.into_parts();
        let header = base.cast::<Header>();
        // SAFETY: the pages are owned, writable, at least `CHUNK` long, and aligned far beyond `Header`'s need.
        unsafe { header.write(Header { shares: Shares::new(), bytes }) };
        Self(header)
    }

    /// The chunk that holds a value which starts at `address`.
    ///
    /// # Safety
    /// The value must live in a chunk and hold a share of it: values start in the first `CHUNK` bytes, so masking
    /// finds the header.
    pub unsafe fn of(address: NonNull<u8>) -> Self {
        let offset = address.addr().get() % CHUNK;
        // SAFETY: the chunk starts `offset` bytes before the value, in the same mapping.
        Self(unsafe { address.sub(offset) }.cast())
    }

    fn header(&self) -> &Header {
        // SAFETY: a `Chunk` in an arena's hands, or made by `of`, is mapped as long as its share is held, and the
        // header is only changed through atomics after `new`.
        unsafe { self.0.as_ref() }
    }

    /// First byte, the header's.
    pub fn base(&self) -> NonNull<u8> {
        self.0.cast()
    }

    /// Length.
    pub fn bytes(&self) -> usize {
        self.header().bytes
    }

    /// A pointer with this chunk's provenance to an address inside it.
    pub fn at(&self, address: usize) -> NonNull<u8> {
        debug_assert!(address - self.base().addr().get() < self.bytes());
        // SAFETY: callers pass an address inside the chunk, whose mapping this pointer spans.
        unsafe { self.base().add(address - self.base().addr().get()) }
    }

    /// See [`Shares::open`].
    pub fn open(&self) {
        self.header().shares.open();
    }

    /// See [`Shares::seal`].
    pub fn seal(&self, issued: usize) {
        self.header().shares.seal(issued);
    }

    /// Whether any handle to a sealed chunk is alive.
    pub fn has_handles(&self) -> bool {
        self.header().shares.has_handles()
    }

    /// Ends the arena's interest in a sealed chunk.
    pub fn give_back_share(self) {
        // SAFETY: the arena holds one share of every sealed chunk and forgets the chunk here.
        unsafe { self.drop_share() };
    }

    /// Gives back one share, unmapping the chunk with the last.
    ///
    /// # Safety
    /// The caller must own a share and not use the chunk afterwards.
    pub unsafe fn drop_share(self) {
        let bytes = self.bytes();
        // SAFETY: the caller's share keeps the header alive until it is given back.
        if unsafe { Shares::drop_one(&raw const (*self.0.as_ptr()).shares) } {
            // SAFETY: nobody holds a share any more, so nobody can reach the chunk; `bytes` is its whole mapping.
            drop(unsafe { Pages::from_parts(self.base(), bytes) });
        }
    }
}
