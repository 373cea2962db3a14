//! Random programs of operations against a plain model, and the races between arenas and handles.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use proptest::prelude::*;

use super::*;

fn backends() -> [Backend; 2] {
    [Backend::Pages(Placement::FirstTouch), Backend::Malloc]
}

/// Counts its drops, and holds a pattern that a foreign write would destroy.
struct Token {
    pattern: u64,
    drops: Arc<AtomicUsize>,
}

impl Drop for Token {
    fn drop(&mut self) {
        self.drops.fetch_add(1, Ordering::Relaxed);
    }
}

#[test]
fn a_handle_is_one_pointer_with_a_niche() {
    assert_eq!(size_of::<Option<ArenaBox<[u64; 4]>>>(), size_of::<usize>());
}

#[test]
fn sizes_and_alignments() {
    #[repr(align(64))]
    struct Line(u8);
    #[repr(align(4096))]
    struct Page(u8);
    for backend in backends() {
        let arena = Arena::new(backend);
        for round in 0..if cfg!(miri) { 300 } else { 2000u64 } {
            let handles = (
                arena.alloc(round as u8),
                arena.alloc([round; 3]),
                arena.alloc(Line(round as u8)),
                arena.alloc(Page(round as u8)),
                arena.alloc(()),
                arena.alloc_slice_with(round as usize % 7, |index| index as u16),
            );
            assert_eq!(*handles.0, round as u8);
            assert_eq!(*handles.1, [round; 3]);
            assert_eq!((handles.2.0, handles.3.0), (round as u8, round as u8));
            assert!((&raw const *handles.2).addr().is_multiple_of(64));
            assert!((&raw const *handles.3).addr().is_multiple_of(4096));
            assert!(handles.5.iter().enumerate().all(|(index, &value)| index == usize::from(value)));
        }
    }
}

#[test]
#[cfg_attr(miri, ignore = "the random programs make such values too, in less time")]
fn values_larger_than_a_chunk() {
    for backend in backends() {
        let arena = Arena::new(backend);
        let mut big = arena.alloc_slice_with(CHUNK, |index| index as u32);
        big[CHUNK - 1] = 7;
        assert_eq!((big[1], big[CHUNK - 1], big.len()), (1, 7, CHUNK));
        let small = arena.alloc(5u8);
        drop(arena);
        assert_eq!((*small, big[2]), (5, 2));
    }
}

#[test]
fn handles_outlive_the_arena_and_cross_threads() {
    let count = if cfg!(miri) { 500 } else { 50_000 };
    for backend in backends() {
        let drops = Arc::new(AtomicUsize::new(0));
        let arena = Arena::new(backend);
        let make = |pattern| arena.alloc(Token { pattern, drops: Arc::clone(&drops) });
        let handles: Vec<_> = (0..count as u64).map(make).collect();
        drop(arena);
        std::thread::spawn(move || {
            assert!(handles.iter().enumerate().all(|(index, token)| token.pattern == index as u64));
        })
        .join()
        .unwrap();
        assert_eq!(drops.load(Ordering::Relaxed), count);
    }
}

#[test]
fn reset_reuses_only_what_has_no_handles() {
    let arena = Arena::new(Backend::Pages(Placement::FirstTouch));
    let fill =
        |first: u64| (0..).map(|index| arena.alloc([first + index; 64])).take(8000).collect::<Vec<_>>();
    let kept = fill(0);
    drop(fill(1 << 32));
    let before = arena.stats();
    let found = arena.reset();
    assert!(found.in_use >= 2 && found.reclaimed >= 2, "{found:?}");
    let again = fill(2 << 32);
    assert_eq!(arena.stats().mapped_bytes, before.mapped_bytes, "nothing new is mapped");
    assert!(kept.iter().enumerate().all(|(index, value)| **value == [index as u64; 64]));
    assert!(again.iter().enumerate().all(|(index, value)| **value == [(2 << 32) + index as u64; 64]));
    assert_eq!(arena.stats().allocations, 24_000);
    assert_eq!(arena.stats().value_bytes, 24_000 * 512);
}

#[test]
fn a_panic_while_making_a_slice_drops_what_was_made() {
    for backend in backends() {
        let arena = Arena::new(backend);
        let drops = Arc::new(AtomicUsize::new(0));
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            arena.alloc_slice_with(10, |index| {
                assert!(index < 6, "on purpose");
                Token { pattern: 0, drops: Arc::clone(&drops) }
            })
        }));
        assert!(result.is_err());
        assert_eq!(drops.load(Ordering::Relaxed), 6);
        assert_eq!(arena.reset().in_use, 0);
    }
}

#[test]
fn moving_a_value_out_gives_its_memory_back() {
    let arena = Arena::new(Backend::Pages(Placement::FirstTouch));
    let text = arena.alloc("moved".to_owned()).into_inner();
    assert_eq!((text.as_str(), arena.reset().in_use), ("moved", 0));
}

#[test]
#[cfg_attr(miri, ignore = "asks hwloc and the kernel")]
fn pages_are_counted_on_their_node() {
    let machine = crate::topology::Machine::this_machine().unwrap();
    let arena = Arena::on_node(machine.nodes[0].os);
    let _values: Vec<_> = (0..100_000u64).map(|index| arena.alloc([index; 4])).collect();
    let count = arena.count_pages().unwrap();
    assert!(machine.nodes.len() > 1 || count.share_on(machine.nodes[0].os) == Some(1.0), "{count:?}");
    arena.reserve(3 * CHUNK).unwrap();
    assert_eq!(arena.stats().free_chunks, 4);
}

/// A quadtree as a solver keeps it.
struct Element {
    value: u64,
    children: Option<ArenaBox<[Element; 4]>>,
}

fn grow(arena: &Arena, depth: u32, value: u64) -> Element {
    let children =
        (depth > 0).then(|| arena.alloc([0, 1, 2, 3].map(|child| grow(arena, depth - 1, 4 * value + child))));
    Element { value, children }
}

fn sum(element: &Element) -> u64 {
    element.value + element.children.iter().flat_map(|children| children.iter()).map(sum).sum::<u64>()
}

#[test]
fn a_tree_grown_by_several_arenas_is_one_tree() {
    for backend in backends() {
        let reference = sum(&grow(&Arena::new(Backend::Malloc), 6, 1));
        let children = std::thread::scope(|scope| {
            let branch = |child: u64| {
                let backend = backend.clone();
                scope.spawn(move || grow(&Arena::new(backend), 5, 4 + child))
            };
            [0, 1, 2, 3].map(branch).map(|thread| thread.join().unwrap())
        });
        let root = Element { value: 1, children: Some(Arena::new(backend.clone()).alloc(children)) };
        assert_eq!(sum(&root), reference);
    }
}

#[derive(Clone, Debug)]
enum Step {
    Make { words: usize },
    Drop { which: usize },
    Send { which: usize },
    Reset,
    NewArena,
}

/// Words that a program's values are made of at a time: Miri interprets every call that makes one.
const BLOCK: usize = if cfg!(miri) { 256 } else { 1 };

/// Small values, and large ones on both sides of what a chunk holds.
fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        6 => (0usize..4000).prop_map(|words| Step::Make { words }),
        1 => (250_000usize..600_000).prop_map(|words| Step::Make { words }),
        4 => any::<usize>().prop_map(|which| Step::Drop { which }),
        1 => any::<usize>().prop_map(|which| Step::Send { which }),
        2 => Just(Step::Reset),
        1 => Just(Step::NewArena),
    ];
    proptest::collection::vec(step, 1..150)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(if cfg!(miri) { 3 } else { 48 }))]
    #[test]
    fn random_programs_keep_every_value(program in steps(), malloc: bool) {
        let backend = backends()[usize::from(malloc)].clone();
        let mut arena = Arena::new(backend.clone());
        let mut held: Vec<(u64, ArenaBox<[[u64; BLOCK]]>)> = Vec::new();
        for (stamp, step) in (1u64..).zip(program) {
            match step {
                Step::Make { words } => {
                    held.push((stamp, arena.alloc_slice_with(words / BLOCK, |_| [stamp; BLOCK])));
                }
                Step::Drop { which } if !held.is_empty() => drop(held.swap_remove(which % held.len())),
                Step::Send { which } if !held.is_empty() => {
                    let (stamp, handle) = held.swap_remove(which % held.len());
                    let intact = move || handle.iter().all(|block| *block == [stamp; BLOCK]);
                    prop_assert!(std::thread::spawn(intact).join().unwrap());
                }
                Step::Reset => { arena.reset(); }
                Step::NewArena => arena = Arena::new(backend.clone()),
                Step::Drop { .. } | Step::Send { .. } => {}
            }
        }
        for (stamp, handle) in &held {
            prop_assert!(handle.iter().all(|block| *block == [*stamp; BLOCK]));
        }
        // A permutation of overlapping ranges would have been seen above only if written later; so look directly.
        let mut ranges: Vec<_> = held.iter().filter(|(_, handle)| !handle.is_empty())
            .map(|(_, handle)| handle.as_ptr_range()).collect();
        ranges.sort_by_key(|range| range.start);
        prop_assert!(ranges.windows(2).all(|pair| pair[0].end <= pair[1].start));
    }
}
