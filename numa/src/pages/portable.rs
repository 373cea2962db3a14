//! Where there is no `mbind`: aligned zeroed heap memory, placed by first touch. Also what Miri runs on.

use std::alloc::{Layout, alloc_zeroed, dealloc};
use std::ptr::NonNull;

use super::{HUGE, Placement, Refusal};

pub fn page_bytes() -> usize {
    4096
}

/// Ranges may be split and freed piece by piece, so every `HUGE` is an allocation of its own where possible; a longer
/// range is one allocation and must be freed whole.
pub fn map(bytes: usize) -> Result<NonNull<u8>, String> {
    let layout = Layout::from_size_align(bytes, HUGE).map_err(|error| error.to_string())?;
    // SAFETY: `bytes` is a positive multiple of `HUGE`.
    NonNull::new(unsafe { alloc_zeroed(layout) }).ok_or_else(|| "out of memory".to_owned())
}

/// # Safety
/// `base` and `bytes` must be exactly what [`map`] was asked for and returned.
pub unsafe fn unmap(base: NonNull<u8>, bytes: usize) {
    // SAFETY: the same layout as in `map`, by the contract.
    unsafe { dealloc(base.as_ptr(), Layout::from_size_align_unchecked(bytes, HUGE)) };
}

pub fn place(_: NonNull<u8>, _: usize, placement: &Placement) -> Result<(), Refusal> {
    match placement {
        Placement::FirstTouch => Ok(()),
        _ => Err(Refusal::Forbidden("this system has no mbind".to_owned())),
    }
}

pub fn interleave_thread(_: Option<&crate::cpuset::CpuSet>) -> Result<(), String> {
    Err("this system has no set_mempolicy".to_owned())
}

pub fn advise_huge(_: NonNull<u8>, _: usize) -> bool {
    false
}

pub fn advise_small(_: NonNull<u8>, _: usize) {}

pub fn populate(_: NonNull<u8>, _: usize) {}

pub fn nodes_of(_: &[usize]) -> Result<Vec<Option<usize>>, String> {
    Err("this system has no move_pages".to_owned())
}
