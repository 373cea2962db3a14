//! Results of studies: a directory with the figures as CSV and JSON, plots, and a README that says where they come from.

mod plot;
mod readme;
pub mod tables;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde::Serialize;
use serde_json::Value;

use super::machine::Machine;
use super::report::{Program, SceneFacts};
use super::{Error, write_atomically};
use crate::study::Speedup;

/// Everything about a study of speed-up.
#[derive(Clone, Debug, Serialize)]
pub struct SpeedupStudy {
    /// What ran.
    pub program: Program,
    /// Where it ran.
    pub machine: Machine,
    /// What was solved.
    pub scene: SceneFacts,
    /// All options, resolved, by their names on the command line.
    pub options: BTreeMap<String, Value>,
    /// What came out.
    pub result: Speedup,
}

/// The directory of a study below `parent`: `<date>-<host>-<commit>/<name>`.
pub fn directory(parent: &Path, name: &str) -> PathBuf {
    let day = humantime::format_rfc3339_seconds(SystemTime::now()).to_string();
    let day = day.split('T').next().unwrap_or("undated");
    let (machine, program) = (Machine::this(), Program::this());
    let host = machine.host.as_result().map_or("unknown", String::as_str);
    let commit = program.commit.as_result().map_or("unknown", String::as_str);
    parent.join(format!("{day}-{}-{}", plain(host), plain(commit))).join(plain(name))
}

/// A name of a file from any text.
fn plain(text: &str) -> String {
    let keep = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '-' };
    text.chars().map(keep).collect()
}

/// Writes the study into `directory`, which it makes; each file is whole or not there. The README comes last: where it is, all is.
///
/// # Errors
/// [`Error::Io`] naming what could not be written.
pub fn write_speedup(study: &SpeedupStudy, directory: &Path) -> Result<(), Error> {
    fs::create_dir_all(directory).map_err(|source| Error::io(directory, "make", source))?;
    let write = |name: &str, text: &str| {
        write_atomically(&directory.join(name), |out| out.write_all(text.as_bytes()))
    };
    let json = serde_json::to_string_pretty(study).map_err(|problem| {
        Error::io(&directory.join("study.json"), "write", std::io::Error::other(problem))
    })?;
    write("study.json", &(json + "\n"))?;
    write("measured.csv", &tables::measured_csv(&study.result))?;
    write("predicted.csv", &tables::predicted_csv(&study.result))?;
    let mut plots = Vec::new();
    for (number, machine) in tables::machines(&study.result).iter().enumerate() {
        let name = format!("speedup-{}.svg", number + 1);
        let path = directory.join(&name);
        let svg = plot::speedup(&study.result, machine)
            .map_err(|problem| Error::io(&path, "draw", std::io::Error::other(problem)))?;
        write(&name, &svg)?;
        plots.push((name, machine.clone()));
    }
    write("README.md", &readme::speedup(study, &plots))
}
