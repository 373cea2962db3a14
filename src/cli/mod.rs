//! The command `wrad`: arguments → validated plan → commands.
//!
//! [`Arguments`] is what was typed, [`Plan`] what will be done: nothing is computed before everything that can be refused has
//! been. Standard output carries the summary, standard error progress and problems. Exit codes: [`Status`] and [`Error`].

mod arguments;
mod bands;
mod choice;
mod counting;
mod error;
mod files;
mod generate;
mod info;
mod interrupt;
mod load;
mod memory;
mod method;
mod plan;
mod probes;
mod processor;
mod progress;
mod render;
mod report;
mod saved;
mod solve;
mod study;
mod topology;
mod workers;

use std::io::Write;

pub use arguments::Arguments;
pub use error::{Error, Status};
pub use plan::Plan;
pub use processor::check as check_processor;

/// Writes to standard output. A reader that has gone away is not an error of the run.
fn print(text: &str) {
    let _ = std::io::stdout().write_all(text.as_bytes());
}
