//! The end of memory: the process leaves with a message and exit status 1. Without this, one allocation that fails aborts it, and reports
//! of that which allocate themselves may hang.

use std::alloc::{GlobalAlloc, Layout};
use std::fmt::Arguments;
use std::io::Write;
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

/// The program's name, and what to do.
static ADVICE: OnceLock<[&str; 2]> = OnceLock::new();

/// Whether a thread ends the process.
static LEAVING: AtomicBool = AtomicBool::new(false);

/// The system's allocator for a program that is [advised](advise): `#[global_allocator] static ALLOCATOR: System = System;`.
#[derive(Clone, Copy, Debug)]
pub struct System;

// SAFETY: every method passes its arguments on to the system's allocator, whose contract is the same, and returns what that returned or not at
// all; nothing unwinds.
unsafe impl GlobalAlloc for System {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps this method's contract.
        had(unsafe { std::alloc::System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        had(unsafe { std::alloc::System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as above.
        had(unsafe { std::alloc::System.realloc(block, layout, size) }, size)
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { std::alloc::System.dealloc(block, layout) }
    }
}

/// From now on the process ends with a message where memory is out: the program's name, what is missing, and what to do. Only a program's
/// `main` knows that leaving is right. The first call counts.
pub fn advise(program: &'static str, advice: &'static str) {
    ADVICE.get_or_init(|| [program, advice]);
}

/// Ends the process where `layout` cannot be had: by the message if one was agreed on, else as a failed allocation does.
pub(crate) fn fail(layout: Layout) -> ! {
    if let Some(advice) = ADVICE.get() {
        leave(format_args!("{} bytes more are not to be had", layout.size()), advice);
    }
    std::alloc::handle_alloc_error(layout)
}

/// Ends the process where a thread cannot be started, which takes memory for its stack: by the message if one was agreed on, else by a panic.
///
/// # Panics
/// No message was agreed on.
pub fn without_thread(error: &std::io::Error) -> ! {
    if let Some(advice) = ADVICE.get() {
        leave(format_args!("no thread more can be started: {error}"), advice);
    }
    panic!("a thread cannot be started: {error}")
}

fn had(block: *mut u8, bytes: usize) -> *mut u8 {
    if block.is_null()
        && let Some(advice) = ADVICE.get()
    {
        leave(format_args!("{bytes} bytes more are not to be had"), advice);
    }
    block
}

/// Allocates nothing and takes no lock.
#[cold]
fn leave(why: Arguments<'_>, [program, advice]: &[&str; 2]) -> ! {
    // Threads run out together: the first one speaks and ends the others.
    while LEAVING.swap(true, Relaxed) {
        std::thread::sleep(Duration::from_secs(1));
    }
    let mut text = [0; 512];
    let mut rest = &mut text[..];
    // What does not fit is cut off.
    let _ = write!(rest, "{program}: out of memory: {why}. {advice}");
    let _ = rest.write(b"\n");
    let left = rest.len();
    let length = text.len() - left;
    // SAFETY: `text` is readable for `length` bytes; `_exit` is called from any thread in any state.
    unsafe {
        libc::write(2, text.as_ptr().cast(), length as _);
        libc::_exit(1)
    }
}
