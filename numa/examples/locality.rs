//! Counters on access patterns whose answer is known: in order, a line apart, at random, all in one line.
//!
//! Where the CPU has counters, the first-level hit rate is near 1 for the first and last, 0 for a line apart, and the
//! local share of memory is 1 because every worker reads what it bound to its own node.

use std::hint::black_box;

use ccnuma::arena::{Arena, ArenaBox};
use ccnuma::counters::{Counters, CpuId, Group};
use ccnuma::per_thread::PerWorker;
use ccnuma::{Machine, Plan, Policy, Team};

/// 64 MiB per worker: beyond any second-level cache.
const WORDS: usize = 8 << 20;
const READS: usize = 4 << 20;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let plan = Plan::new(Machine::this_machine()?.into(), Policy::Compact, None)?;
    let mut team = Team::new(&plan)?;
    let cpu = CpuId::this();
    let mut counters = Counters::open(Some(&mut team), Group::for_cpu(&cpu)?)?;
    let data: PerWorker<ArenaBox<[u64]>> = PerWorker::new(&mut team, |worker| {
        Arena::on_node(worker.node_os()).alloc_slice_with(WORDS, |i| i as u64)
    })?;
    team.run(|worker| {
        let words = data.local(worker);
        let sum = |index: &dyn Fn(usize) -> usize| {
            black_box((0..READS).map(|read| words[index(read) % WORDS]).fold(0u64, u64::wrapping_add))
        };
        counters.region(worker, "in order", || sum(&|read| read));
        counters.region(worker, "a line apart", || sum(&|read| 8 * read));
        counters.region(worker, "at random", || sum(&|read| read.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 20));
        counters.region(worker, "one line", || sum(&|read| read % 8));
    })?;
    println!("CPU {} family {} model {}", cpu.vendor, cpu.family, cpu.model);
    print!("{}", counters.report().text());
    Ok(())
}
