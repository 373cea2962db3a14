//! From a C program's static counters to per-thread statics: each worker counts alone, the end sums up.

use ccnuma::per_thread::Counter;
use ccnuma::{Home, Machine, Plan, Policy, Team, per_thread};

per_thread! {
    /// Numbers tested, by each worker.
    static TESTED: Counter = Counter::new();
    /// The largest prime each worker found.
    static LARGEST: std::cell::Cell<u64> = std::cell::Cell::new(0);
}

fn is_prime(n: u64) -> bool {
    n >= 2 && (2..).take_while(|d| d * d <= n).all(|d| !n.is_multiple_of(d))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let plan = Plan::new(Machine::this_machine()?.into(), Policy::Compact, None)?;
    let mut team = Team::new(&plan)?;
    let nodes = plan.machine.nodes.len();
    let mut numbers: Vec<u64> = (0..200_000).collect();
    // Numbers are dealt round the nodes; a larger one is more work.
    let home = |&n: &u64| Home { node: n as usize % nodes, weight: 1 + n.isqrt() };
    team.for_each_mut(&mut numbers, home, |worker, n| {
        TESTED.local(worker).add(1);
        let largest = LARGEST.local(worker);
        if *n > largest.get() && is_prime(*n) {
            largest.set(*n);
        }
    })?;
    TESTED.fold(&mut team, (), |(), worker, tested| println!("worker {worker} tested {}", tested.get()));
    let tested = TESTED.fold(&mut team, 0, |sum, _, tested| sum + tested.get());
    let largest = LARGEST.fold(&mut team, 0, |most, _, largest| most.max(largest.get()));
    println!("{tested} tested, the largest prime is {largest}");
    Ok(())
}
