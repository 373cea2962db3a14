//! What the kernel accounts for every thread anyway, read without opening an event: no permission is needed, no counter of the
//! CPU, and no time to begin. (The first event of a thread that is opened on an idle system takes milliseconds.)

use std::mem::MaybeUninit;

use super::perf::{Count, Counts};

/// What is read, by the names in reports.
pub const EVENTS: [&str; 4] = ["task_clock_ns", "page_faults", "context_switches", "cpu_migrations"];

/// Adds what the calling thread has used so far: time on CPUs (ns, the kernel's for it included), page faults, switches to
/// other threads, moves from CPU to CPU.
pub fn read(counts: &mut Counts) {
    let usage = usage();
    let [clock, faults, switches, migrations] = EVENTS;
    let add = |counts: &mut Counts, name: &str, count: Result<u64, String>| {
        counts.insert(name.to_owned(), count.map(|count| Count { count, ..Count::default() }));
    };
    add(counts, clock, thread_clock_ns());
    add(counts, faults, usage.clone().map(|usage| (usage.ru_minflt + usage.ru_majflt) as u64));
    add(counts, switches, usage.map(|usage| (usage.ru_nvcsw + usage.ru_nivcsw) as u64));
    add(counts, migrations, migrations_so_far());
}

fn thread_clock_ns() -> Result<u64, String> {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the pointer is to a value of the type that the call writes.
    match unsafe { libc::clock_gettime(libc::CLOCK_THREAD_CPUTIME_ID, &raw mut time) } {
        0 => Ok(time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64),
        _ => Err(refused("the clock of threads")),
    }
}

fn usage() -> Result<libc::rusage, String> {
    let mut usage = MaybeUninit::<libc::rusage>::uninit();
    // SAFETY: the pointer is to room for what the call writes.
    match unsafe { libc::getrusage(libc::RUSAGE_THREAD, usage.as_mut_ptr()) } {
        // SAFETY: the call succeeded, so it has written all of it.
        0 => Ok(unsafe { usage.assume_init() }),
        _ => Err(refused("the accounts of threads (getrusage)")),
    }
}

fn migrations_so_far() -> Result<u64, String> {
    const FILE: &str = "/proc/thread-self/sched";
    let text = std::fs::read_to_string(FILE)
        .map_err(|error| format!("{FILE}: {error}: the kernel was built without CONFIG_SCHED_DEBUG"))?;
    let mut fields = text.lines().filter_map(|line| line.split_once(':'));
    let found = fields.find(|(name, _)| name.trim() == "se.nr_migrations");
    let number = found.and_then(|(_, value)| value.trim().parse().ok());
    number.ok_or_else(|| format!("{FILE} has no number for se.nr_migrations"))
}

fn refused(what: &str) -> String {
    format!("{what} cannot be read: {}", std::io::Error::last_os_error())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn touching_memory_takes_time_and_faults_and_is_the_threads_own() {
        let so_far = || {
            let mut counts = Counts::new();
            read(&mut counts);
            EVENTS.map(|name| counts[name].clone().map(|count| count.count))
        };
        let before = so_far();
        let other = std::thread::spawn(move || {
            assert!(std::hint::black_box(vec![1u8; 32 << 20]).iter().all(|byte| *byte == 1));
            so_far()
        });
        let other = other.join().unwrap();
        let after = so_far();
        let [clock, faults, ..] = &other;
        assert!(*clock.as_ref().unwrap() > 1000 && *faults.as_ref().unwrap() > 10, "{other:?}");
        assert!(after[1].as_ref().unwrap() - before[1].as_ref().unwrap() < *faults.as_ref().unwrap());
        assert!(before[2] <= after[2]);
        assert!(after[3].as_ref().is_ok() || after[3].as_ref().is_err_and(|reason| reason.len() > 10));
    }
}
