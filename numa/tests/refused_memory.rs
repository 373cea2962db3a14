//! A kernel that refuses to place memory or to tell where it is, as default containers do.
//!
//! The refusal is real: a seccomp filter on the test's own thread makes the system calls fail with EPERM. Alone in
//! its file because warnings are the process's.
#![cfg(target_os = "linux")]

use ccnuma::arena::Arena;
use ccnuma::pages::{Applied, Pages, Placement};

/// Makes the given system calls fail with EPERM on the calling thread, for good.
fn forbid(calls: &[libc::c_long]) {
    let op = |code: u32, jt: u8, jf: u8, k: u32| libc::sock_filter { code: code as u16, jt, jf, k };
    let (load, equal, give) = (
        libc::BPF_LD | libc::BPF_W | libc::BPF_ABS,
        libc::BPF_JMP | libc::BPF_JEQ | libc::BPF_K,
        libc::BPF_RET | libc::BPF_K,
    );
    let mut program = vec![op(load, 0, 0, 0)];
    for &call in calls {
        program.push(op(equal, 0, 1, call as u32));
        program.push(op(give, 0, 0, libc::SECCOMP_RET_ERRNO | libc::EPERM as u32));
    }
    program.push(op(give, 0, 0, libc::SECCOMP_RET_ALLOW));
    let filter = libc::sock_fprog { len: program.len() as u16, filter: program.as_mut_ptr() };
    // SAFETY: both calls only restrict the calling thread; the filter lives through the call that copies it.
    unsafe {
        assert_eq!(libc::prctl(libc::PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0), 0);
        assert_eq!(libc::prctl(libc::PR_SET_SECCOMP, libc::SECCOMP_MODE_FILTER, &raw const filter), 0);
    }
}

#[test]
fn without_mbind_memory_lands_by_first_touch_and_says_so() {
    std::thread::spawn(|| {
        forbid(&[libc::SYS_mbind]);
        for placement in [Placement::Bind(0), Placement::Preferred(0), Placement::FirstTouch] {
            let mut pages = Pages::map(1, &placement).expect("falls back");
            assert!(
                matches!(pages.applied(), Applied::FirstTouch(reason) if reason.contains("not permitted"))
            );
            pages.populate();
        }
        let arena = Arena::on_node(0);
        let values: Vec<_> = (0..100_000u64).map(|value| arena.alloc(value)).collect();
        assert!(values.iter().zip(0..).all(|(value, expected)| **value == expected));
    })
    .join()
    .expect("the arena works without mbind");
    let said = ccnuma::warnings::all();
    assert_eq!(said.iter().filter(|text| text.contains("mbind")).count(), 1, "said once: {said:?}");
}

#[test]
fn without_move_pages_the_question_is_an_error_not_a_guess() {
    std::thread::spawn(|| {
        forbid(&[libc::SYS_move_pages]);
        let pages = Pages::map(1, &Placement::FirstTouch).expect("maps");
        let error = pages.count().expect_err("cannot be known").to_string();
        assert!(error.contains("where pages are"), "{error}");
    })
    .join()
    .expect("no panic");
}

#[test]
fn without_affinity_calls_a_pin_is_an_error_with_a_remedy() {
    std::thread::spawn(|| {
        forbid(&[libc::SYS_sched_setaffinity]);
        let error = ccnuma::affinity::pin_to(0).expect_err("refused").to_string();
        assert!(error.contains("cannot pin") && error.contains("`none`"), "{error}");
    })
    .join()
    .expect("no panic");
}
