//! The owned handle: one pointer, unique, movable between threads; it drops its value and gives back its share.

use std::alloc::{Layout, alloc, dealloc};
use std::fmt;
use std::marker::PhantomData;
use std::mem::ManuallyDrop;
use std::num::NonZeroUsize;
use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;

use super::chunk::Chunk;
use super::{arena_align, heap_offset};

/// Owns a value in an [`Arena`](super::Arena), as `Box` does on the heap; `Option` of it is one pointer too.
///
/// The memory lives at least as long as the handle, even when the arena is dropped first. Dropping a handle drops
/// the value; its memory is reused when the whole chunk is unused and the arena is reset.
pub struct ArenaBox<T: ?Sized> {
    value: NonNull<T>,
    owns: PhantomData<T>,
}

// SAFETY: the handle owns its value uniquely, as `Box` does; the chunk header it also reaches is atomic.
unsafe impl<T: ?Sized + Send> Send for ArenaBox<T> {}
// SAFETY: a shared handle gives only `&T`.
unsafe impl<T: ?Sized + Sync> Sync for ArenaBox<T> {}

/// A well-aligned address for values without size.
pub fn dangling(layout: Layout) -> NonNull<u8> {
    NonNull::without_provenance(NonZeroUsize::new(layout.align()).unwrap_or(NonZeroUsize::MIN))
}

/// The layout of the heap block behind a value: room to place it at an odd multiple of its `A`.
fn heap_layout(layout: Layout) -> Layout {
    let offset = heap_offset(layout);
    Layout::from_size_align(layout.size() + offset, arena_align(layout))
        .unwrap_or_else(|_| panic!("a value of {} bytes is more than the address space", layout.size()))
}

/// A heap block for one value, which starts `A` after the block does.
pub fn heap_alloc(layout: Layout) -> NonNull<u8> {
    // SAFETY: the layout's size is not 0; the value's place is inside the block.
    unsafe {
        match NonNull::new(alloc(heap_layout(layout))) {
            Some(block) => block.add(heap_offset(layout)),
            None => crate::exhausted::fail(layout),
        }
    }
}

/// Gives back the memory of a value that is dropped or moved out.
///
/// # Safety
/// `place` must be from the arena's `raw(layout)` with its share not yet given back, and not used afterwards.
unsafe fn release(place: NonNull<u8>, layout: Layout) {
    if layout.size() == 0 {
        return;
    }
    if place.addr().get() & heap_offset(layout) != 0 {
        // SAFETY: only heap places are odd multiples of `A`, and their block starts `A` before, with this layout.
        unsafe { dealloc(place.sub(heap_offset(layout)).as_ptr(), heap_layout(layout)) };
    } else {
        // SAFETY: an arena's place holds one share of its chunk, by the contract.
        unsafe { Chunk::of(place).drop_share() };
    }
}

impl<T: ?Sized> ArenaBox<T> {
    /// # Safety
    /// `value` must point to an initialised value in memory from the arena's `raw` for its layout, owned by nobody.
    pub(super) unsafe fn from_raw(value: NonNull<T>) -> Self {
        Self { value, owns: PhantomData }
    }
}

impl<T> ArenaBox<T> {
    /// Moves the value out.
    pub fn into_inner(self) -> T {
        let this = ManuallyDrop::new(self);
        // SAFETY: the value is read once and not dropped; the handle is not used again, so its share is given back
        // once.
        unsafe {
            let value = this.value.read();
            release(this.value.cast(), Layout::new::<T>());
            value
        }
    }
}

impl<T: ?Sized> Drop for ArenaBox<T> {
    #[inline]
    fn drop(&mut self) {
        // SAFETY: the value is initialised and owned by this handle (invariant of `from_raw`), dropped once here and
        // its memory released once after. The layout is taken before the drop.
        unsafe {
            let layout = Layout::for_value(self.value.as_ref());
            self.value.drop_in_place();
            release(self.value.cast(), layout);
        }
    }
}

impl<T: ?Sized> Deref for ArenaBox<T> {
    type Target = T;

    #[inline]
    fn deref(&self) -> &T {
        // SAFETY: initialised and owned (invariant of `from_raw`); borrowed with the handle.
        unsafe { self.value.as_ref() }
    }
}

impl<T: ?Sized> DerefMut for ArenaBox<T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: as in `deref`; unique because handles are not cloned.
        unsafe { self.value.as_mut() }
    }
}

impl<T: ?Sized + fmt::Debug> fmt::Debug for ArenaBox<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

/// A slice under construction: drops what is made so far, and gives the memory back, when making it panics.
pub struct SliceGuard<T> {
    place: NonNull<T>,
    len: usize,
    made: usize,
}

impl<T> SliceGuard<T> {
    /// # Safety
    /// `place` must be from the arena's `raw` for `[T; len]`, owned by nobody.
    pub unsafe fn new(place: NonNull<T>, len: usize) -> Self {
        Self { place, len, made: 0 }
    }

    /// Writes the next value.
    pub fn push(&mut self, value: T) {
        assert!(self.made < self.len, "a slice of {} values was given one more", self.len);
        // SAFETY: inside the place, which is not initialised here yet.
        unsafe { self.place.add(self.made).write(value) };
        self.made += 1;
    }

    /// Turns a full slice into its handle.
    pub fn finish(self) -> ArenaBox<[T]> {
        assert_eq!(self.made, self.len, "a slice was finished early");
        let this = ManuallyDrop::new(self);
        // SAFETY: all values are initialised and the guard does not own them any more.
        unsafe { ArenaBox::from_raw(NonNull::slice_from_raw_parts(this.place, this.len)) }
    }
}

impl<T> Drop for SliceGuard<T> {
    fn drop(&mut self) {
        // SAFETY: the first `made` values are initialised; the place is for `len` values and owned by the guard.
        unsafe {
            NonNull::slice_from_raw_parts(self.place, self.made).drop_in_place();
            let whole =
                NonNull::slice_from_raw_parts(self.place.cast::<std::mem::MaybeUninit<T>>(), self.len);
            release(self.place.cast(), Layout::for_value(whole.as_ref()));
        }
    }
}
