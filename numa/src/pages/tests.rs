//! Tests on this machine, whatever it has; what needs several nodes runs in `tests/on_numa.rs`.

use super::*;

fn node_here() -> usize {
    crate::topology::Machine::this_machine().unwrap().nodes[0].os
}

#[test]
fn bound_pages_are_where_they_were_asked_for() {
    let node = node_here();
    let mut nodes = CpuSet::new();
    nodes.insert(node);
    for placement in [
        Placement::Bind(node),
        Placement::Preferred(node),
        Placement::Interleave(nodes),
        Placement::FirstTouch,
    ] {
        let mut pages = Pages::map(3, &placement).unwrap();
        assert_eq!((pages.bytes(), pages.base().addr().get() % HUGE), (HUGE, 0));
        pages.populate();
        if *pages.applied() == Applied::AsAsked
            && crate::topology::Machine::this_machine().unwrap().nodes.len() == 1
        {
            let count = pages.count().unwrap();
            assert_eq!(count.share_on(node), Some(1.0), "{placement:?} {count:?}");
            assert_eq!(count.untouched, 0);
        }
    }
}

#[test]
fn untouched_pages_are_counted_as_such() {
    let pages = Pages::map(HUGE, &Placement::FirstTouch).unwrap();
    let count = pages.count().unwrap();
    assert_eq!((count.by_node.len(), count.untouched), (0, HUGE / sys::page_bytes()));
    assert_eq!(count.share_on(0), None);
}

#[test]
fn a_range_splits_into_owned_parts() {
    let mut rest = Pages::map(3 * HUGE, &Placement::FirstTouch).unwrap();
    let front = rest.split_front(HUGE).unwrap();
    assert_eq!(front.base().addr().get() + HUGE, rest.base().addr().get());
    assert_eq!((front.bytes(), rest.bytes()), (HUGE, 2 * HUGE));
    assert!(rest.split_front(3 * HUGE).is_none());
    drop(front);
    rest.populate();
}

#[test]
fn impossible_requests_are_errors() {
    let no_node = Pages::map(1, &Placement::Bind(900)).unwrap_err().to_string();
    assert!(no_node.contains("node 900"), "{no_node}");
    for bytes in [usize::MAX, 1 << 60] {
        let too_big = Pages::map(bytes, &Placement::FirstTouch).unwrap_err().to_string();
        assert!(too_big.contains("bytes"), "{too_big}");
    }
}

#[test]
fn a_full_node_is_refused_where_the_kernel_tells() {
    let node = node_here();
    let mapped = Pages::map(1 << 46, &Placement::Bind(node));
    match room_bytes(node) {
        Some(room) => {
            assert!(room > 1 << 20);
            let full = mapped.unwrap_err().to_string();
            assert!(full.contains("is full") && full.contains("Preferred"), "{full}");
        }
        None => assert!(mapped.is_ok_and(|pages| pages.bytes() == 1 << 46) || !nodes_add_up()),
    }
    assert_eq!(room_bytes(900), None);
}

#[test]
fn meminfo_is_read_by_whole_names() {
    let text = "Node 0 MemTotal: 10 kB\nNode 0 Inactive(file): 3 kB\nNode 0 Active(file): 2 kB\n";
    assert_eq!(field_bytes(text, "Active(file):"), Some(2048));
    assert_eq!(field_bytes(text, "MemFree:"), None);
    assert_eq!(field_bytes("MemTotal:\n", "MemTotal:"), None);
}

#[test]
fn pages_that_several_values_share_count_once() {
    let mut pages = Pages::map(HUGE, &Placement::FirstTouch).unwrap();
    pages.populate();
    // SAFETY: the range is mapped, zeroed, owned, and not written while the slice lives.
    let bytes = unsafe { std::slice::from_raw_parts(pages.base().as_ptr(), 3 * sys::page_bytes()) };
    let page = sys::page_bytes();
    let count = |set: &PageSet| set.clone().count().unwrap().by_node.values().sum::<usize>();
    let mut set = PageSet::default();
    set.add(&bytes[..0]);
    assert_eq!(count(&set), 0);
    set.add(&bytes[10..20]);
    set.add(&bytes[20..30]);
    assert_eq!(count(&set), 1);
    set.add(&bytes[page - 1..page + 1]);
    set.add(&bytes[2 * page..]);
    set.add(&bytes[..1]);
    assert_eq!(count(&set), 3);
}
