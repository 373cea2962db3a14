//! Allocating tree nodes and walking them at random: the arena against malloc, mimalloc and bumpalo, on 1 and 2
//! threads, interleaved in one run; medians.
//!
//! `cargo bench -p ccnuma --bench alloc`, with `CCNUMA_BENCH_NODES` for another size than 2 million nodes of 192 bytes
//! and `CCNUMA_BENCH_ROUNDS` for another number than 5.
//!
//! Each measurement is a process of its own, so that the largest size is bounded by one variant's memory and not by
//! the sum, and no variant inherits another's heap. In it the variant runs once unmeasured and once measured, on the
//! memory that the first run gave back: the first touch of new memory can be 30 times slower on a virtual machine that
//! returns idle memory. The share of memory on huge pages is read while the nodes are alive: it is what sets the
//! walks apart.

use std::alloc::{GlobalAlloc, Layout};
use std::hint::black_box;
use std::process::Command;
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

/// Seconds for `STEPS` steps down from the root to random children, again and again. Another `seed` is another path,
/// so that the last walk's lines are not found in the cache.
fn walk(nodes: &[NonNull<Node>], seed: u64) -> f64 {
    let started = Instant::now();
    let root: *const Node = nodes[0].as_ptr();
    let mut node = root;
    let (mut sum, mut state) = (0u64, 0x9e37_79b9_7f4a_7c15u64 ^ seed);
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

/// What one thread measured in one process.
#[derive(Clone, Copy)]
struct Sample {
    allocate_ns: f64,
    step_ns: f64,
    /// Of the process's anonymous memory, in percent.
    huge_percent: f64,
}

fn measure(source: &mut dyn Source, count: usize) -> Sample {
    source.round(count, &mut |_, _| ());
    let mut sample = Sample { allocate_ns: 0.0, step_ns: 0.0, huge_percent: 0.0 };
    source.round(count, &mut |seconds, nodes| {
        link(nodes);
        let mut walks = [1, 2, 3].map(|seed| walk(nodes, seed));
        walks.sort_by(f64::total_cmp);
        sample = Sample {
            allocate_ns: 1e9 * seconds / count as f64,
            step_ns: 1e9 * walks[1] / STEPS as f64,
            huge_percent: huge_percent(),
        };
    });
    sample
}

/// How much of this process's anonymous memory is on huge pages; not a number where the kernel does not tell.
fn huge_percent() -> f64 {
    let text = std::fs::read_to_string("/proc/self/smaps_rollup").unwrap_or_default();
    let kib = |name| kib_of(&text, name).unwrap_or(f64::NAN);
    100.0 * kib("AnonHugePages:") / kib("Anonymous:")
}

/// A field of one of the kernel's memory tables.
fn kib_of(text: &str, name: &str) -> Option<f64> {
    text.lines().find_map(|line| line.strip_prefix(name)?.split_whitespace().next()?.parse().ok())
}

const VARIANTS: [&str; 4] = ["ccnuma arena", "malloc (glibc)", "mimalloc", "bumpalo"];

fn source(variant: &str) -> Box<dyn Source> {
    match variant {
        "ccnuma arena" => Box::new(OfArena(Arena::new(Backend::Pages(Placement::FirstTouch)))),
        "malloc (glibc)" => Box::new(OfGlobal(std::alloc::System)),
        "mimalloc" => Box::new(OfGlobal(mimalloc::MiMalloc)),
        _ => Box::new(OfBump(bumpalo::Bump::new())),
    }
}

/// A process that measures one variant and prints a line per thread.
fn child(variant: &str, threads: usize, count: usize) {
    // Keeps freed memory in the process, so that malloc's second run recycles as the others' do.
    #[cfg(target_os = "linux")]
    // SAFETY: sets two numbers before other threads exist.
    unsafe {
        libc::mallopt(libc::M_TRIM_THRESHOLD, -1);
        libc::mallopt(libc::M_MMAP_MAX, 0);
    }
    let run = || measure(&mut *source(variant), count / threads);
    // One thread is this one: glibc gives others heaps that return memory to the system when freed.
    let samples: Vec<Sample> = match threads {
        1 => vec![run()],
        _ => std::thread::scope(|scope| {
            let started: Vec<_> = (0..threads).map(|_| scope.spawn(run)).collect();
            started.into_iter().map(|thread| thread.join().expect("measures")).collect()
        }),
    };
    samples.iter().for_each(|sample| {
        println!("{} {} {}", sample.allocate_ns, sample.step_ns, sample.huge_percent);
    });
}

/// Measures one variant in a process of its own.
fn spawn(variant: &str, threads: usize) -> Vec<Sample> {
    let program = std::env::current_exe().expect("this program has a path");
    let output = Command::new(program)
        .env("CCNUMA_BENCH_VARIANT", variant)
        .env("CCNUMA_BENCH_THREADS", threads.to_string())
        .output()
        .expect("starts");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{variant}: {}", String::from_utf8_lossy(&output.stderr));
    let sample = |line: &str| {
        let numbers: Vec<f64> = line.split(' ').map(|word| word.parse().expect("a number")).collect();
        Sample { allocate_ns: numbers[0], step_ns: numbers[1], huge_percent: numbers[2] }
    };
    text.lines().map(sample).collect()
}

fn setting(name: &str, default: usize) -> usize {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

fn main() {
    let count = setting("CCNUMA_BENCH_NODES", 2_000_000);
    if let Ok(variant) = std::env::var("CCNUMA_BENCH_VARIANT") {
        return child(&variant, setting("CCNUMA_BENCH_THREADS", 1), count);
    }
    let rounds = setting("CCNUMA_BENCH_ROUNDS", 5);
    refuse_what_does_not_fit(count);
    println!("{count} nodes of {} bytes, {rounds} interleaved rounds, medians", size_of::<Node>());
    for threads in [1, 2] {
        let mut samples: Vec<Vec<Sample>> = vec![Vec::new(); VARIANTS.len()];
        for _ in 0..rounds {
            for (variant, samples) in VARIANTS.iter().zip(&mut samples) {
                samples.extend(spawn(variant, threads));
            }
        }
        report(threads, &samples);
    }
}

/// Where memory runs out the machine swaps or kills, and neither is a measurement.
fn refuse_what_does_not_fit(count: usize) {
    // The largest variant takes 225 bytes a node, and the lists of nodes 16.
    const BYTES: usize = 241;
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let most = kib_of(&text, "MemAvailable:").map_or(usize::MAX, |kib| (1024.0 * kib) as usize / BYTES);
    assert!(count <= most, "{count} nodes do not fit; at most {most} do now");
}

fn sorted(samples: &[Sample], of: fn(&Sample) -> f64) -> Vec<f64> {
    let mut numbers: Vec<f64> = samples.iter().map(of).collect();
    numbers.sort_by(f64::total_cmp);
    numbers
}

fn report(threads: usize, samples: &[Vec<Sample>]) {
    let median_and_least = |samples: &[Sample], of| {
        let numbers = sorted(samples, of);
        (numbers[numbers.len() / 2], numbers[0])
    };
    let figures: Vec<_> = samples
        .iter()
        .map(|samples| {
            let of = |of| median_and_least(samples, of);
            (of(|s| s.allocate_ns), of(|s| s.step_ns), of(|s| s.huge_percent))
        })
        .collect();
    println!("{threads} thread(s), medians (least in parentheses), and the ratio of medians to the arena's:");
    for (name, &(allocate, step, huge)) in VARIANTS.iter().zip(&figures) {
        println!(
            "  {name:<14} allocate {:>7.1} ({:>6.1}) ns/node, {:>5.2} x   walk {:>6.1} ({:>6.1}) ns/step, {:.2} x   \
             on huge pages {:>3.0} %",
            allocate.0,
            allocate.1,
            allocate.0 / figures[0].0.0,
            step.0,
            step.1,
            step.0 / figures[0].1.0,
            huge.0,
        );
    }
}
