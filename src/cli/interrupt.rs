//! Ctrl-C: the first asks the run to stop and write what is done, a later one ends the program at once.
//!
//! One press may come twice: `timeout` and batch systems signal the program, and then the group that it is in.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// The exit code of interrupted runs: 128 and the number of SIGINT.
pub(super) const EXIT_CODE: u8 = 130;

/// What comes this soon after the first is the same press.
const SAME_PRESS: Duration = Duration::from_secs(1);

static FIRST: OnceLock<Instant> = OnceLock::new();

/// Takes over Ctrl-C; `quiet` keeps the handler silent.
pub(super) fn install(quiet: bool) {
    let installed = ctrlc::set_handler(move || {
        let now = Instant::now();
        let first = *FIRST.get_or_init(|| now);
        if now.duration_since(first) > SAME_PRESS {
            std::process::exit(i32::from(EXIT_CODE));
        }
        if first == now && !quiet {
            eprintln!("\nwrad: stopping and writing what is done; Ctrl-C again ends at once");
        }
    });
    if let Err(error) = installed {
        eprintln!("wrad: warning: Ctrl-C will end the program at once: {error}");
    }
}

/// Whether the user asked to stop.
pub(super) fn requested() -> bool {
    FIRST.get().is_some()
}
