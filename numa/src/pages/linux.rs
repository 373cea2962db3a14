//! `mmap`, `mbind`, `madvise` and `move_pages` behind safe-to-read names.

use std::ffi::c_void;
use std::io::Error as IoError;
use std::ptr::NonNull;

use super::{HUGE, Placement, Refusal};
use crate::cpuset::CpuSet;

/// `MPOL_LOCAL` of `linux/mempolicy.h`, which libc does not name.
const MPOL_LOCAL: i32 = 4;
/// `MADV_POPULATE_WRITE`, Linux 5.14.
const MADV_POPULATE_WRITE: i32 = 23;

pub fn page_bytes() -> usize {
    // SAFETY: takes a constant and touches no memory.
    usize::try_from(unsafe { libc::sysconf(libc::_SC_PAGESIZE) }).unwrap_or(4096)
}

/// Maps `bytes` (a multiple of `HUGE`) aligned to `HUGE`: maps one `HUGE` more and trims both ends.
pub fn map(bytes: usize) -> Result<NonNull<u8>, String> {
    let padded = bytes.checked_add(HUGE).ok_or("more than the address space")?;
    // SAFETY: a new anonymous private mapping at an address of the kernel's choice; no existing memory is touched.
    let start = unsafe {
        libc::mmap(
            std::ptr::null_mut(),
            padded,
            libc::PROT_READ | libc::PROT_WRITE,
            libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_NORESERVE,
            -1,
            0,
        )
    };
    if start == libc::MAP_FAILED {
        return Err(IoError::last_os_error().to_string());
    }
    let start = start.cast::<u8>();
    let front = start.align_offset(HUGE);
    let back = HUGE - front;
    // SAFETY: `front < HUGE`, so `[start, start + front)`, the middle of `bytes` and the last `back` bytes partition
    // the fresh mapping; the trimmed ends are page multiples and nobody uses them.
    unsafe {
        let base = start.add(front);
        if front > 0 {
            libc::munmap(start.cast(), front);
        }
        libc::munmap(base.add(bytes).cast(), back);
        NonNull::new(base).ok_or_else(|| "mapped at address 0".to_owned())
    }
}

/// # Safety
/// `[base, base + bytes)` must be mapped by [`map`], owned by the caller, and not used again.
pub unsafe fn unmap(base: NonNull<u8>, bytes: usize) {
    // SAFETY: by the contract.
    unsafe { libc::munmap(base.as_ptr().cast(), bytes) };
}

/// Sets the placement of a range that is mapped and not yet touched.
pub fn place(base: NonNull<u8>, bytes: usize, placement: &Placement) -> Result<(), Refusal> {
    let (mode, nodes): (i32, CpuSet) = match placement {
        Placement::Bind(node) => (libc::MPOL_BIND, [*node].into_iter().collect()),
        Placement::Preferred(node) => (libc::MPOL_PREFERRED, [*node].into_iter().collect()),
        Placement::Interleave(nodes) => (libc::MPOL_INTERLEAVE, nodes.clone()),
        // Said explicitly, so that a policy set by numactl around the process does not apply.
        Placement::FirstTouch => (MPOL_LOCAL, CpuSet::new()),
    };
    let words = nodes.words();
    // The kernel reads one bit less than it is told.
    let bits = if words.is_empty() { 0 } else { words.len() * 64 + 1 };
    let mask = if words.is_empty() { std::ptr::null() } else { words.as_ptr() };
    // SAFETY: the kernel reads `bits - 1` bits of `words`, which lives through the call, and only notes a policy for
    // a range that the caller owns; contents do not change.
    let result = unsafe { libc::syscall(libc::SYS_mbind, base.as_ptr(), bytes, mode, mask, bits, 0) };
    if result == 0 {
        return Ok(());
    }
    let error = IoError::last_os_error();
    match error.raw_os_error() {
        Some(libc::EINVAL) if *placement != Placement::FirstTouch => Err(Refusal::BadNode(error.to_string())),
        _ => Err(Refusal::Forbidden(error.to_string())),
    }
}

/// Sets the calling thread's policy for pages that have none of their own: round these nodes, or the default.
pub fn interleave_thread(nodes: Option<&CpuSet>) -> Result<(), String> {
    let words = nodes.map_or(&[][..], CpuSet::words);
    let (mode, mask) = match nodes {
        Some(_) => (libc::MPOL_INTERLEAVE, words.as_ptr()),
        None => (libc::MPOL_DEFAULT, std::ptr::null()),
    };
    // The kernel reads one bit less than it is told.
    let bits = if words.is_empty() { 0 } else { words.len() * 64 + 1 };
    // SAFETY: the kernel reads `bits - 1` bits of `words`, which lives through the call; only where later pages land changes.
    match unsafe { libc::syscall(libc::SYS_set_mempolicy, mode, mask, bits) } {
        0 => Ok(()),
        _ => Err(IoError::last_os_error().to_string()),
    }
}

/// Asks for huge pages; `false` where the kernel has none or has them switched off.
pub fn advise_huge(base: NonNull<u8>, bytes: usize) -> bool {
    // SAFETY: advice on an owned range; contents do not change.
    let advised = unsafe { libc::madvise(base.as_ptr().cast(), bytes, libc::MADV_HUGEPAGE) } == 0;
    advised && !huge_pages_off()
}

/// Asks for small pages; a kernel without huge ones refuses, which is as well.
pub fn advise_small(base: NonNull<u8>, bytes: usize) {
    // SAFETY: advice on an owned range; contents do not change.
    unsafe { libc::madvise(base.as_ptr().cast(), bytes, libc::MADV_NOHUGEPAGE) };
}

/// Whether transparent huge pages are set to `never`; read once.
fn huge_pages_off() -> bool {
    static OFF: std::sync::OnceLock<bool> = std::sync::OnceLock::new();
    *OFF.get_or_init(|| {
        let setting = std::fs::read_to_string("/sys/kernel/mm/transparent_hugepage/enabled");
        setting.map_or(true, |text| text.contains("[never]"))
    })
}

/// Touches every page for writing from the calling thread, keeping contents.
pub fn populate(base: NonNull<u8>, bytes: usize) {
    // SAFETY: populating an owned range keeps its contents.
    if unsafe { libc::madvise(base.as_ptr().cast(), bytes, MADV_POPULATE_WRITE) } == 0 {
        return;
    }
    for offset in (0..bytes).step_by(page_bytes()) {
        // SAFETY: `offset < bytes`, the range is mapped for reading and writing and owned by the caller.
        unsafe {
            let byte = base.as_ptr().add(offset);
            byte.write_volatile(byte.read_volatile());
        }
    }
}

/// The node of each page, `None` where the page was never touched.
pub fn nodes_of(addresses: &[usize]) -> Result<Vec<Option<usize>>, String> {
    let mut status = vec![-1i32; addresses.len()];
    // SAFETY: without target nodes the call moves nothing; it reads `addresses` (plain numbers the kernel looks up)
    // and writes as many `status` entries, both of which live through the call.
    let result = unsafe {
        libc::syscall(
            libc::SYS_move_pages,
            0,
            addresses.len(),
            addresses.as_ptr().cast::<*const c_void>(),
            std::ptr::null::<i32>(),
            status.as_mut_ptr(),
            0,
        )
    };
    if result < 0 {
        return Err(IoError::last_os_error().to_string());
    }
    Ok(status.into_iter().map(|node| usize::try_from(node).ok()).collect())
}
