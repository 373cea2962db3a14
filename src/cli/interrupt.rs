//! Ctrl-C: the first asks the run to stop and write what is done, the second ends the program at once.

use std::sync::atomic::{AtomicBool, Ordering};

/// The exit code of interrupted runs: 128 and the number of SIGINT.
pub(super) const EXIT_CODE: u8 = 130;

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Takes over Ctrl-C; `quiet` keeps the handler silent.
pub(super) fn install(quiet: bool) {
    let installed = ctrlc::set_handler(move || {
        // Relaxed: the flag carries no data with it, and a swap is one step for both presses.
        if REQUESTED.swap(true, Ordering::Relaxed) {
            std::process::exit(i32::from(EXIT_CODE));
        }
        if !quiet {
            eprintln!("\nwrad: stopping and writing what is done; Ctrl-C again ends at once");
        }
    });
    if let Err(error) = installed {
        eprintln!("wrad: warning: Ctrl-C will end the program at once: {error}");
    }
}

/// Whether the user asked to stop.
pub(super) fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}
