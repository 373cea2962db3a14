//! `wrad study …`: arguments → a study that can be run → results below a directory, and tables.

mod error;
mod lists;
mod ready;
mod reference;
mod speedup;

use std::path::{Path, PathBuf};

use crate::output::study::directory;
use crate::study::StudyError;

use super::arguments::{StudyArguments, StudyCommand};
use super::progress::Watch;
use super::{Error, Status, interrupt};
use error::ErrorPlan;
use speedup::SpeedupPlan;

/// A study that can be run.
#[derive(Clone, Debug)]
pub enum StudyPlan {
    /// `wrad study speedup`.
    Speedup(Box<SpeedupPlan>),
    /// `wrad study error`.
    Error(ErrorPlan),
}

impl StudyPlan {
    /// Checks and resolves the arguments.
    pub(super) fn new(arguments: StudyArguments) -> Result<StudyPlan, Error> {
        match &arguments.command {
            StudyCommand::Speedup(arguments) => {
                Ok(StudyPlan::Speedup(Box::new(SpeedupPlan::new(arguments)?)))
            }
            StudyCommand::Error(arguments) => Ok(StudyPlan::Error(ErrorPlan::new(arguments)?)),
        }
    }

    /// Runs the study, writes its results and prints its tables.
    pub(super) fn run(&self) -> Result<Status, Error> {
        match self {
            StudyPlan::Speedup(plan) => plan.run(),
            StudyPlan::Error(plan) => plan.run(),
        }
    }
}

/// The directory of a study below `parent`, if it is still free.
fn free_directory(parent: &Path, name: &str) -> Result<PathBuf, Error> {
    let place = directory(parent, name);
    if place.exists() {
        return Err(Error::Input(format!(
            "{}: there are results of today and this commit; remove them or choose another place by --out",
            place.display()
        )));
    }
    Ok(place)
}

/// A scene file's name without its extension.
fn stem(scene: &Path) -> String {
    scene.file_stem().map_or_else(|| "scene".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// What was typed.
fn command() -> String {
    let words: Vec<String> = std::env::args().skip(1).collect();
    format!("wrad {}", words.join(" "))
}

/// Runs a study, watched; `None` where it was interrupted.
fn watched<R>(
    quiet: bool,
    study: impl FnOnce(&mut Watch) -> Result<R, StudyError>,
) -> Result<Option<R>, Error> {
    interrupt::install(quiet);
    let mut watch = Watch::new(quiet);
    let result = study(&mut watch);
    watch.finish();
    if let Some(why) = watch.out_of_memory {
        return Err(Error::Failed(why));
    }
    match result {
        Ok(result) => Ok(Some(result)),
        Err(StudyError::Interrupted) => {
            eprintln!("wrad: {}", StudyError::Interrupted);
            Ok(None)
        }
        Err(problem) => Err(Error::Failed(problem.to_string())),
    }
}

/// Prints tables, and where the rest is.
fn print(tables: &str, place: &Path) {
    super::print(&format!("{tables}written to {}\n", place.display()));
}
