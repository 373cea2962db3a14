//! The command `wrad`: arguments → plan → run.

use std::process::ExitCode;
use std::time::Instant;

use ccnuma::exhausted::{self, System};
use clap::Parser;
use wavelet_radiosity::cli::{Arguments, Plan, check_processor};

#[global_allocator]
static ALLOCATOR: System = System;

fn main() -> ExitCode {
    let start = Instant::now();
    exhausted::advise(
        "wrad",
        "What is not written yet is lost: ask for a larger --error, or give the run more memory",
    );
    // Before any thread is pinned: what this process may use.
    ccnuma::affinity::process_mask();
    if let Err(problem) = check_processor() {
        eprintln!("wrad: {problem}");
        return ExitCode::FAILURE;
    }
    match Plan::new(Arguments::parse()).and_then(|plan| plan.run(start)) {
        Ok(status) => status.into(),
        Err(error) => {
            eprintln!("wrad: {error}");
            error.exit_code()
        }
    }
}
