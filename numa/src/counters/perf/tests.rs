//! A kernel made up at the level of its system calls: what it refuses, and what it counts.

use std::collections::VecDeque;
use std::io::Write;
use std::os::fd::IntoRawFd;

use perf_event::hooks::{Hooks, clear_thread_hooks, set_thread_hooks, sys};

use super::*;

/// Answers `perf_event_open` from a list. A leader's descriptor is a pipe with the answers to its reads in it.
struct FakeKernel {
    /// The next leaders: for each, what its reads return after the header (enabled, running, values by member).
    leaders: VecDeque<Vec<(u64, u64, Vec<u64>)>>,
    /// Errors for the events with this configuration.
    refuses: Vec<(u64, i32)>,
    next_id: u64,
}

impl FakeKernel {
    /// A pipe that holds the answers, in the layout of `PERF_FORMAT_GROUP | ID | TOTAL_TIME_*`.
    fn leader(&mut self, first_id: u64) -> i32 {
        let (read, mut write) = io::pipe().unwrap();
        for (enabled, running, values) in self.leaders.pop_front().unwrap_or_default() {
            let mut words = vec![values.len() as u64 + 1, enabled, running, 0, first_id];
            for (value, id) in values.into_iter().zip(first_id + 1..) {
                words.extend([value, id]);
            }
            let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_ne_bytes()).collect();
            write.write_all(&bytes).unwrap();
        }
        read.into_raw_fd()
    }
}

impl Hooks for FakeKernel {
    unsafe fn perf_event_open(
        &mut self,
        attrs: *mut sys::bindings::perf_event_attr,
        _: libc::pid_t,
        _: i32,
        group: i32,
        _: std::os::raw::c_ulong,
    ) -> i32 {
        // SAFETY: perf-event passes a valid structure.
        let config = unsafe { (*attrs).config };
        if let Some((_, errno)) = self.refuses.iter().find(|(refused, _)| *refused == config) {
            // SAFETY: errno is the thread's own.
            unsafe { *libc::__errno_location() = *errno };
            return -1;
        }
        // An event opened as a member of no group is a leader, if it is the crate's placeholder, or tried alone.
        if group == -1 && config == u64::from(sys::bindings::PERF_COUNT_SW_DUMMY) {
            return self.leader(self.next_id);
        }
        std::fs::File::open("/dev/null").unwrap().into_raw_fd()
    }

    unsafe fn ID(&mut self, _: i32, id: *mut u64) -> i32 {
        // SAFETY: perf-event passes a place for the id.
        unsafe { *id = self.next_id };
        self.next_id += 1;
        0
    }

    unsafe fn ENABLE(&mut self, _: i32, _: u32) -> i32 {
        0
    }
}

/// Runs `test` on a thread whose kernel is the fake one.
fn with_kernel(kernel: FakeKernel, test: impl FnOnce() + Send + 'static) {
    let run = move || {
        // SAFETY: no counter of this thread exists yet, and all are gone when the hooks are cleared.
        unsafe { set_thread_hooks(Box::new(kernel)) };
        test();
        // SAFETY: as above.
        unsafe { clear_thread_hooks() };
    };
    std::thread::spawn(run).join().unwrap();
}

fn group(text: &str) -> Group {
    Group::parse("test", &format!("CPUS\nany\nEVENTS\n{text}")).unwrap()
}

const TWO_BATCHES: &str = "A raw 0xa\nB raw 0xb\n\nC raw 0xc\nMETRICS\nratio = A / B";

#[test]
fn counts_come_with_the_time_they_ran() {
    let leaders = VecDeque::from([
        vec![(100, 100, vec![7, 8]), (300, 200, vec![17, 28])],
        vec![(100, 50, vec![1]), (300, 0, vec![1])],
    ]);
    with_kernel(FakeKernel { leaders, refuses: Vec::new(), next_id: 50 }, || {
        let mut counters = ThreadCounters::open(&group(TWO_BATCHES));
        let (first, second) = (counters.read(), counters.read());
        assert_eq!(first["A"], Ok(Count { count: 7, enabled_ns: 100, running_ns: 100 }));
        assert_eq!(second["B"], Ok(Count { count: 28, enabled_ns: 300, running_ns: 200 }));
        assert_eq!(second["C"], Ok(Count { count: 1, enabled_ns: 300, running_ns: 0 }));
    });
}

#[test]
fn each_refusal_names_its_remedy() {
    for (errno, word) in [
        (libc::ENOENT, "virtual machine"),
        (libc::EACCES, "perf_event_paranoid"),
        (libc::EPERM, "container"),
        (libc::ENOSYS, "no perf_event_open"),
        (libc::EINVAL, "family"),
        (libc::EMFILE, "ulimit"),
        (libc::EIO, "nput/output"),
    ] {
        let refuses = vec![(0xa, errno)];
        let leaders = VecDeque::from([vec![(10, 10, vec![5])]]);
        with_kernel(FakeKernel { leaders, refuses, next_id: 1 }, move || {
            let counts = ThreadCounters::open(&group(TWO_BATCHES)).read();
            for name in ["A", "B"] {
                let reason = counts[name].as_ref().unwrap_err();
                assert!(reason.contains(word), "{reason}");
            }
            assert_eq!(counts["C"].as_ref().unwrap().count, 5, "the other batch still counts");
        });
    }
}

#[test]
fn nonsense_from_the_kernel_is_unavailable() {
    let leaders = VecDeque::from([vec![(10, 20, vec![5, 6])], vec![]]);
    with_kernel(FakeKernel { leaders, refuses: Vec::new(), next_id: 1 }, || {
        let counts = ThreadCounters::open(&group(TWO_BATCHES)).read();
        assert!(counts["A"].as_ref().unwrap_err().contains("more time running"), "{counts:?}");
        assert!(counts["C"].is_err(), "an empty read");
    });
}

#[test]
fn what_the_kernel_accounts_comes_with_it() {
    let counts = ThreadCounters::open(&group("A raw 0xa")).read();
    assert!(kernel::EVENTS.iter().all(|name| counts.contains_key(*name)));
    assert!(counts["task_clock_ns"].as_ref().unwrap().count > 0);
}
