//! Allocating tree nodes and walking them at random: the arena against malloc, mimalloc and bumpalo, on 1 and 2
//! threads, interleaved in one run; medians.
//!
//! `cargo bench -p ccnuma --bench alloc`, with `CCNUMA_BENCH_NODES` for another size than 2 million nodes of 192 bytes
//! (every variant keeps its memory: four times that must fit) and `CCNUMA_BENCH_ROUNDS` for another number than 5.
//!
//! Memory is recycled: every variant runs once unmeasured, and each later round reuses what the round before gave
//! back, because the first touch of new memory can be 30 times slower on a virtual machine that returns idle memory.

use std::alloc::{GlobalAlloc, Layout};
use std::hint::black_box;
use std::ptr::NonNull;
use std::time::Instant;

use ccnuma::arena::Backend;
use ccnuma::pages::Placement;
use ccnuma::{Arena, ArenaBox};

const STEPS: usize = 2_000_000;

/// What a solver's element is like: 192 bytes, of which a walk reads one line.
struct Node {
    children: [*const Node; 4],
    payload: [u64; 20],
}

fn node(index: usize) -> Node {
    Node { children: [std::ptr::null(); 4], payload: [index as u64; 20] }
}

/// A way to allocate nodes: keeps what it needs to recycle memory between rounds.
trait Source {
    /// Calls `use_nodes` with the time it took to allocate `count` nodes, and the nodes.
    fn round(&mut self, count: usize, use_nodes: &mut dyn FnMut(f64, &[NonNull<Node>]));
}

struct OfArena(Arena);

impl Source for OfArena {
    fn round(&mut self, count: usize, use_nodes: &mut dyn FnMut(f64, &[NonNull<Node>])) {
        self.0.reset();
        let mut boxes: Vec<ArenaBox<Node>> = Vec::with_capacity(count);
        let started = Instant::now();
        boxes.extend((0..count).map(|index| self.0.alloc(node(index))));
        let seconds = started.elapsed().as_secs_f64();
        let nodes: Vec<_> = boxes.iter_mut().map(|node| NonNull::from_mut(&mut **node)).collect();
        use_nodes(seconds, &nodes);
    }
}

struct OfGlobal<A>(A);

impl<A: GlobalAlloc> Source for OfGlobal<A> {
    fn round(&mut self, count: usize, use_nodes: &mut dyn FnMut(f64, &[NonNull<Node>])) {
        let layout = Layout::new::<Node>();
        let mut nodes: Vec<NonNull<Node>> = Vec::with_capacity(count);
        let started = Instant::now();
        nodes.extend((0..count).map(|index| {
            // SAFETY: the layout has a size; the block is written before use.
            unsafe {
                let place = NonNull::new(self.0.alloc(layout).cast::<Node>()).expect("memory");
                place.write(node(index));
                place
            }
        }));
        use_nodes(started.elapsed().as_secs_f64(), &nodes);
        for node in nodes {
            // SAFETY: allocated above with this layout, used no more.
            unsafe { self.0.dealloc(node.as_ptr().cast(), layout) };
        }
    }
}

struct OfBump(bumpalo::Bump);

impl Source for OfBump {
    fn round(&mut self, count: usize, use_nodes: &mut dyn FnMut(f64, &[NonNull<Node>])) {
        self.0.reset();
        let mut nodes: Vec<NonNull<Node>> = Vec::with_capacity(count);
        let started = Instant::now();
        nodes.extend((0..count).map(|index| NonNull::from_mut(self.0.alloc_with(|| node(index)))));
        use_nodes(started.elapsed().as_secs_f64(), &nodes);
    }
}

/// Makes the nodes a quadtree, level by level in the order of allocation.
fn link(nodes: &[NonNull<Node>]) {
    for (index, node) in nodes.iter().enumerate() {
        for child in 0..4 {
            let child_node =
                nodes.get(4 * index + child + 1).map_or(std::ptr::null_mut(), |node| node.as_ptr());
            // SAFETY: the nodes are alive and only reached through these pointers meanwhile.
            unsafe { (*node.as_ptr()).children[child] = child_node };
        }
    }
}

/// Seconds for `STEPS` steps down from the root to random children, again and again.
fn walk(nodes: &[NonNull<Node>]) -> f64 {
    let started = Instant::now();
    let root: *const Node = nodes[0].as_ptr();
    let mut node = root;
    let (mut sum, mut state) = (0u64, 0x9e37_79b9_7f4a_7c15u64);
    for _ in 0..STEPS {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        // SAFETY: `link` made a tree of nodes that are alive; null ends a branch.
        unsafe {
            sum = sum.wrapping_add((*node).payload[0]);
            node = (*node).children[(state >> 40) as usize % 4];
        }
        if node.is_null() {
            node = root;
        }
    }
    black_box(sum);
    started.elapsed().as_secs_f64()
}

/// Nanoseconds per node and per step, by round.
type Samples = Vec<(f64, f64)>;

fn one_thread(source: &mut dyn Source, count: usize, samples: &mut Samples) {
    source.round(count, &mut |seconds, nodes| {
        link(nodes);
        let walked = (0..3).map(|_| walk(nodes)).fold(f64::INFINITY, f64::min);
        samples.push((1e9 * seconds / count as f64, 1e9 * walked / STEPS as f64));
    });
}

fn sources() -> Vec<(&'static str, Box<dyn Source + Send>)> {
    vec![
        ("ccnuma arena", Box::new(OfArena(Arena::new(Backend::Pages(Placement::FirstTouch))))),
        ("malloc (glibc)", Box::new(OfGlobal(std::alloc::System))),
        ("mimalloc", Box::new(OfGlobal(mimalloc::MiMalloc))),
        ("bumpalo", Box::new(OfBump(bumpalo::Bump::new()))),
    ]
}

fn median(samples: impl Iterator<Item = f64>) -> f64 {
    let mut samples: Vec<f64> = samples.collect();
    samples.sort_by(f64::total_cmp);
    samples[samples.len() / 2]
}

fn main() {
    // Keeps freed memory in the process, so that malloc's rounds recycle as the others' do.
    #[cfg(target_os = "linux")]
    // SAFETY: sets three numbers before other threads exist.
    unsafe {
        libc::mallopt(libc::M_TRIM_THRESHOLD, -1);
        libc::mallopt(libc::M_MMAP_MAX, 0);
        libc::mallopt(libc::M_ARENA_MAX, 3);
    }
    let setting =
        |name, default| std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default);
    let (count, rounds): (usize, usize) =
        (setting("CCNUMA_BENCH_NODES", 2_000_000), setting("CCNUMA_BENCH_ROUNDS", 5));
    println!("{count} nodes of {} bytes, {rounds} interleaved rounds, medians", size_of::<Node>());
    for threads in [1, 2] {
        let mut all: Vec<Vec<_>> = (0..threads).map(|_| sources()).collect();
        let mut samples: Vec<Samples> = vec![Samples::new(); all[0].len()];
        for round in 0..=rounds {
            for (variant, samples) in samples.iter_mut().enumerate() {
                let run = |source: &mut Box<dyn Source + Send>| {
                    let mut mine = Samples::new();
                    one_thread(&mut **source, count / threads, &mut mine);
                    mine
                };
                // One thread is this one: glibc gives others arenas that return memory to the system when freed.
                let measured: Vec<Samples> = match &mut all[..] {
                    [only] => vec![run(&mut only[variant].1)],
                    several => std::thread::scope(|scope| {
                        let started: Vec<_> = several
                            .iter_mut()
                            .map(|sources| scope.spawn(|| run(&mut sources[variant].1)))
                            .collect();
                        started.into_iter().map(|thread| thread.join().expect("measures")).collect()
                    }),
                };
                if round > 0 {
                    samples.extend(measured.into_iter().flatten());
                }
            }
        }
        report(threads, &all[0].iter().map(|(name, _)| *name).collect::<Vec<_>>(), &samples);
    }
}

fn report(threads: usize, names: &[&str], samples: &[Samples]) {
    let least =
        |samples: &Samples, of: fn(&(f64, f64)) -> f64| samples.iter().map(of).fold(f64::INFINITY, f64::min);
    let medians: Vec<(f64, f64)> = samples
        .iter()
        .map(|samples| (median(samples.iter().map(|s| s.0)), median(samples.iter().map(|s| s.1))))
        .collect();
    println!("{threads} thread(s), medians (least in parentheses), and the ratio of medians to the arena's:");
    for ((name, samples), &(allocate, step)) in names.iter().zip(samples).zip(&medians) {
        println!(
            "  {name:<16} allocate {allocate:>7.1} ({:>6.1}) ns/node, {:>5.2} x   walk {step:>6.1} ({:>6.1}) ns/step, {:.2} x",
            least(samples, |s| s.0),
            allocate / medians[0].0,
            least(samples, |s| s.1),
            step / medians[0].1,
        );
    }
}
