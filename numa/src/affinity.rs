//! Which CPUs a thread may run on: snapshot, pin, read back, restore.
//!
//! The mask of the process is read once, before the first pin, from the main thread: a thread that was pinned
//! meanwhile would report its one CPU, and a helper thread started by a pinned worker would inherit it.

use std::sync::OnceLock;

use crate::cpuset::CpuSet;
use crate::error::Error;

static PROCESS_MASK: OnceLock<CpuSet> = OnceLock::new();

/// The CPUs this process was given, read once at the first call; every entry point of this crate calls it before it
/// pins anything.
pub fn process_mask() -> &'static CpuSet {
    PROCESS_MASK.get_or_init(|| sys::mask_of_process().unwrap_or_default())
}

/// The CPUs the calling thread may run on now.
pub fn thread_mask() -> Result<CpuSet, Error> {
    sys::mask_of_thread().map_err(|reason| Error::Pin { cpu: 0, reason })
}

/// The CPU the calling thread runs on now, where the system tells.
pub fn current_cpu() -> Option<usize> {
    sys::current_cpu()
}

/// Pins the calling thread to one CPU and reads the pin back.
pub fn pin_to(cpu: usize) -> Result<(), Error> {
    process_mask();
    let only: CpuSet = [cpu].into_iter().collect();
    sys::set_mask_of_thread(&only).map_err(|reason| Error::Pin { cpu, reason })?;
    let found = thread_mask()?;
    if found == only {
        return Ok(());
    }
    Err(Error::Pin { cpu, reason: format!("asked for {only}, read back {found}") })
}

/// Gives the calling thread the whole process mask again; for helper threads started from a worker.
pub fn unpin() -> Result<(), Error> {
    let mask = process_mask();
    if mask.is_empty() {
        return Ok(());
    }
    let first = mask.iter().next().unwrap_or(0);
    sys::set_mask_of_thread(mask).map_err(|reason| Error::Pin { cpu: first, reason })
}

/// Starts a helper thread (progress, writers, signal handlers) that is free to run on the whole process mask.
pub fn spawn_helper<R: Send + 'static>(
    job: impl FnOnce() -> R + Send + 'static,
) -> std::io::Result<std::thread::JoinHandle<R>> {
    std::thread::Builder::new().name("helper".to_owned()).spawn(move || {
        // A helper that stays on its parent's CPU is slow, not wrong.
        let _ = unpin();
        job()
    })
}

#[cfg(target_os = "linux")]
mod sys {
    use crate::cpuset::CpuSet;

    /// Kernels are built for at most 8192 CPUs today; this bounds the search for the size they accept.
    const MAX_WORDS: usize = 1 << 14;

    /// The kernel refuses a mask shorter than its own, so it grows until accepted.
    fn get(pid: libc::pid_t) -> Result<CpuSet, String> {
        let mut length = 16;
        while length <= MAX_WORDS {
            let mut words = vec![0u64; length];
            // SAFETY: the kernel writes at most `size_of_val(words)` bytes to `words`, which lives through the call.
            // The raw system call is used because glibc's wrapper is typed for 1024 CPUs.
            let written = unsafe {
                libc::syscall(
                    libc::SYS_sched_getaffinity,
                    pid,
                    size_of_val(words.as_slice()),
                    words.as_mut_ptr(),
                )
            };
            if written >= 0 {
                return Ok(CpuSet::from_words(words));
            }
            let error = std::io::Error::last_os_error();
            if error.raw_os_error() != Some(libc::EINVAL) {
                return Err(error.to_string());
            }
            length *= 2;
        }
        Err("the kernel accepts no mask size".to_owned())
    }

    pub fn mask_of_process() -> Result<CpuSet, String> {
        // The main thread's id is the process's id.
        get(libc::pid_t::try_from(std::process::id()).unwrap_or(0))
    }

    pub fn mask_of_thread() -> Result<CpuSet, String> {
        get(0)
    }

    pub fn set_mask_of_thread(mask: &CpuSet) -> Result<(), String> {
        let words = mask.words();
        // SAFETY: the kernel reads `size_of_val(words)` bytes from `words`, which lives through the call.
        let result =
            unsafe { libc::syscall(libc::SYS_sched_setaffinity, 0, size_of_val(words), words.as_ptr()) };
        if result == 0 { Ok(()) } else { Err(std::io::Error::last_os_error().to_string()) }
    }

    pub fn current_cpu() -> Option<usize> {
        // SAFETY: takes no arguments and touches no memory of ours.
        usize::try_from(unsafe { libc::sched_getcpu() }).ok()
    }
}

#[cfg(not(target_os = "linux"))]
mod sys {
    //! `core_affinity` elsewhere; it tells masks only as lists of ids and cannot widen a pin again.
    use crate::cpuset::CpuSet;

    pub fn mask_of_process() -> Result<CpuSet, String> {
        mask_of_thread()
    }

    pub fn mask_of_thread() -> Result<CpuSet, String> {
        let ids = core_affinity::get_core_ids().ok_or("the system does not tell")?;
        Ok(ids.into_iter().map(|id| id.id).collect())
    }

    pub fn set_mask_of_thread(mask: &CpuSet) -> Result<(), String> {
        let mut cpus = mask.iter();
        match (cpus.next(), cpus.next()) {
            // core_affinity aborts above 1023.
            (Some(id), None) if id < 1024 && core_affinity::set_for_current(core_affinity::CoreId { id }) => {
                Ok(())
            }
            (Some(_), Some(_)) => Ok(()),
            _ => Err("the system refused".to_owned()),
        }
    }

    pub fn current_cpu() -> Option<usize> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pin_is_read_back_and_helpers_do_not_inherit_it() {
        std::thread::spawn(|| {
            let mask = process_mask();
            let cpu = mask.iter().last().unwrap();
            pin_to(cpu).unwrap();
            assert_eq!(thread_mask().unwrap().iter().collect::<Vec<_>>(), [cpu]);
            assert_eq!(current_cpu(), Some(cpu));
            assert_eq!(&spawn_helper(|| thread_mask().unwrap()).unwrap().join().unwrap(), mask);
            unpin().unwrap();
            assert_eq!(&thread_mask().unwrap(), mask);
        })
        .join()
        .unwrap();
    }

    #[test]
    fn a_cpu_that_is_not_there_is_refused_with_a_remedy() {
        std::thread::spawn(|| {
            let error = pin_to(100_000).unwrap_err().to_string();
            assert!(error.contains("100000") && error.contains("cpuset"), "{error}");
        })
        .join()
        .unwrap();
    }
}
