//! Results of studies: a directory with the figures as CSV and JSON, plots, and a README that says where they come from.

pub mod curves;
mod loglog;
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
use crate::study::{ErrorCurves, Speedup};

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

/// Everything about a study of time against error.
#[derive(Clone, Debug, Serialize)]
pub struct ErrorReport {
    /// What ran.
    pub program: Program,
    /// Where it ran.
    pub machine: Machine,
    /// What was solved.
    pub scenes: Vec<SceneFacts>,
    /// All options, resolved, by their names on the command line.
    pub options: BTreeMap<String, Value>,
    /// What came out.
    pub result: ErrorCurves,
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

/// A directory that results go to; each file in it is whole or not there.
struct Place<'a>(&'a Path);

impl<'a> Place<'a> {
    fn make(directory: &'a Path) -> Result<Self, Error> {
        fs::create_dir_all(directory).map_err(|source| Error::io(directory, "make", source))?;
        Ok(Self(directory))
    }

    fn write(&self, name: &str, text: &str) -> Result<(), Error> {
        write_atomically(&self.0.join(name), |out| out.write_all(text.as_bytes()))
    }

    fn write_json(&self, name: &str, value: &impl Serialize) -> Result<(), Error> {
        let json = serde_json::to_string_pretty(value)
            .map_err(|problem| Error::io(&self.0.join(name), "write", std::io::Error::other(problem)))?;
        self.write(name, &(json + "\n"))
    }

    fn write_plot(&self, name: &str, svg: Result<String, String>) -> Result<(), Error> {
        let svg =
            svg.map_err(|problem| Error::io(&self.0.join(name), "draw", std::io::Error::other(problem)))?;
        self.write(name, &svg)
    }
}

/// Writes the study into `directory`, which it makes; each file is whole or not there. The README comes last: where it is, all is.
///
/// # Errors
/// [`Error::Io`] naming what could not be written.
pub fn write_speedup(study: &SpeedupStudy, directory: &Path) -> Result<(), Error> {
    let place = Place::make(directory)?;
    place.write_json("study.json", study)?;
    place.write("measured.csv", &tables::measured_csv(&study.result))?;
    place.write("predicted.csv", &tables::predicted_csv(&study.result))?;
    let mut plots = Vec::new();
    for (number, machine) in tables::machines(&study.result).iter().enumerate() {
        let name = format!("speedup-{}.svg", number + 1);
        place.write_plot(&name, plot::speedup(&study.result, machine))?;
        plots.push((name, machine.clone()));
    }
    place.write("README.md", &readme::speedup(study, &plots))
}

/// As [`write_speedup`], for a study of time against error.
///
/// # Errors
/// [`Error::Io`] naming what could not be written.
pub fn write_error(study: &ErrorReport, directory: &Path) -> Result<(), Error> {
    let place = Place::make(directory)?;
    place.write_json("study.json", study)?;
    place.write("solutions.csv", &curves::csv_of_all(&study.result))?;
    let mut plots = Vec::new();
    for (name, plot) in curves::plots(&study.result) {
        let name = format!("{}.svg", plain(&name));
        place.write_plot(&name, plot.svg())?;
        plots.push(name);
    }
    place.write("README.md", &readme::error(study, &plots))
}
