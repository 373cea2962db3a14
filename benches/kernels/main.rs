//! Kernel evaluations per second of the gathering of light at an element's sample points, beside the machine's peak:
//! `cargo bench --bench kernels -- [--looks N] [--repeat N] [--only PAIR]`
//!
//! Pairs take turns, so that a busy machine slows all alike; the median of their rates is printed. The peak is that of plain fused
//! multiply-adds on four lanes, measured in the same run; shares of it count a fused operation as two. Under callgrind, `--repeat 1
//! --only PAIR` counts instructions.

mod pairs;

use std::hint::black_box;
use std::time::Instant;

use pairs::{Pair, pairs};
use wavelet_radiosity::transport::Work;
use wide::f64x4;

/// Additions, multiplications, divisions and comparisons of one kernel evaluation, and of its three bands of light.
const OPERATIONS: f64 = 28.0 + 6.0;

struct Plan {
    looks: usize,
    repeat: usize,
    only: Option<String>,
}

fn main() {
    let plan = arguments();
    let pairs: Vec<Pair> = pairs()
        .into_iter()
        .filter(|pair| plan.only.as_deref().is_none_or(|only| only == pair.name))
        .collect();
    let mut peaks = Vec::new();
    let mut seconds = vec![Vec::new(); pairs.len()];
    let mut work = vec![Work::default(); pairs.len()];
    for _ in 0..plan.repeat {
        peaks.push(peak());
        for (i, pair) in pairs.iter().enumerate() {
            let start = Instant::now();
            work[i] = pair.look(plan.looks);
            seconds[i].push(start.elapsed().as_secs_f64());
        }
    }
    let peak = median(&mut peaks);
    println!("peak: {:.1} Gflop/s\n", peak / 1e9);
    println!(
        "| pair | kernels a look | closed forms | rays | M kernels/s | share of peak | M looks/s |\n\
         |---|---|---|---|---|---|---|"
    );
    for (i, pair) in pairs.iter().enumerate() {
        let second = median(&mut seconds[i]);
        let looks = plan.looks as f64;
        let a_look = |count: u64| count as f64 / looks;
        let rate = work[i].kernel_evaluations as f64 / second;
        println!(
            "| {} | {:.0} | {:.0} | {:.0} | {:.1} | {:.1} % | {:.3} |",
            pair.name,
            a_look(work[i].kernel_evaluations),
            a_look(work[i].lambert_evaluations),
            a_look(work[i].visibility_rays),
            rate / 1e6,
            100.0 * rate * OPERATIONS / peak,
            looks / second / 1e6,
        );
    }
}

fn arguments() -> Plan {
    let mut plan = Plan { looks: 20_000, repeat: 9, only: None };
    let mut given = std::env::args().skip(1);
    let usage = "[--looks N] [--repeat N] [--only PAIR]";
    let number = |text: Option<String>| -> usize { text.and_then(|t| t.parse().ok()).expect(usage) };
    while let Some(argument) = given.next() {
        match argument.as_str() {
            "--looks" => plan.looks = number(given.next()).max(1),
            "--repeat" => plan.repeat = number(given.next()).max(1),
            "--only" => plan.only = given.next(),
            // Cargo says so to every benchmark.
            "--bench" => {}
            other => panic!("{other}: {usage}"),
        }
    }
    plan
}

/// Floating-point operations per second of fused multiply-adds on four lanes, in twelve chains that do not wait for each other.
fn peak() -> f64 {
    const CHAINS: usize = 12;
    const STEPS: usize = 2_000_000;
    let (scale, shift) = (black_box(f64x4::splat(0.999_999)), black_box(f64x4::splat(1e-6)));
    let mut chains = [f64x4::ONE; CHAINS];
    let start = Instant::now();
    for _ in 0..STEPS {
        for chain in &mut chains {
            *chain = chain.mul_add(scale, shift);
        }
    }
    black_box(chains);
    (STEPS * CHAINS * 8) as f64 / start.elapsed().as_secs_f64()
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
