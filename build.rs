//! Tells the program the commit it is built from, where git knows it: `WRAD_COMMIT`, set from outside or by git.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-env-changed=WRAD_COMMIT");
    if std::env::var_os("WRAD_COMMIT").is_some() {
        return;
    }
    // What the program is made of, so that "dirty" is told rightly, and where git keeps the commit.
    for part in ["src", "build.rs", "Cargo.toml", "Cargo.lock"] {
        println!("cargo::rerun-if-changed={part}");
    }
    for file in ["HEAD", "logs/HEAD"] {
        if let Some(path) = git(&["rev-parse", "--git-path", file]).filter(|path| Path::new(path).exists()) {
            println!("cargo::rerun-if-changed={path}");
        }
    }
    if let Some(commit) = git(&["describe", "--always", "--exclude=*", "--abbrev=12", "--dirty"]) {
        println!("cargo::rustc-env=WRAD_COMMIT={commit}");
    }
}

/// What git prints; nothing without git or outside a repository.
fn git(arguments: &[&str]) -> Option<String> {
    let output =
        Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}
