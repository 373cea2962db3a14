//! `wrad study error`: load → solve and compare → results and tables.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use serde_json::{Value, json};

use super::lists::{distinct, errors, number};
use super::ready::Ready;
use super::{command, free_directory, print, reference, stem, watched};
use crate::cli::arguments::ErrorArguments;
use crate::cli::choice::positive;
use crate::cli::plan::basis;
use crate::cli::{Error, Status};
use crate::output::machine::Machine;
use crate::output::report::Program;
use crate::output::study::{ErrorReport, curves, write_error};
use crate::schedule::Options;
use crate::study::{ErrorStudy, Problem, Subject};
use crate::transport::Oracle;

/// A day, in seconds: longer runs are a slip of the keyboard.
const LONGEST_S: f64 = 86_400.0;

/// A study that can be run.
#[derive(Clone, Debug)]
pub struct ErrorPlan {
    scenes: Vec<PathBuf>,
    study: ErrorStudy,
    out: PathBuf,
    quiet: bool,
}

impl ErrorPlan {
    /// Checks and resolves the arguments.
    pub(super) fn new(arguments: &ErrorArguments) -> Result<ErrorPlan, Error> {
        let scenes = distinct("SCENE", arguments.scenes.clone(), |scene| stem(scene))?;
        let named = |name: &str| Ok((name.to_owned(), basis("--bases", name)?));
        let bases = arguments.bases.split(',').map(|name| named(name.trim()));
        let bases = distinct("--bases", bases.collect::<Result<Vec<_>, Error>>()?, |(name, _)| name.clone())?;
        let study = ErrorStudy {
            errors: errors("--errors", &arguments.errors)?,
            bases,
            repeat: number("--repeat", &arguments.repeat)?,
            longest: Duration::from_secs_f64(positive("--longest", &arguments.longest, LONGEST_S)?),
        };
        let name = match &scenes[..] {
            [first, others @ ..] if !others.is_empty() => {
                format!("error-{}-and-{}-more", stem(first), others.len())
            }
            _ => format!("error-{}", stem(&scenes[0])),
        };
        let out = free_directory(&arguments.out, &name)?;
        Ok(ErrorPlan { scenes, study, out, quiet: arguments.quiet })
    }

    /// Runs the study, writes its results and prints its tables.
    pub(super) fn run(&self) -> Result<Status, Error> {
        let ready = self.scenes.iter().map(|scene| Ready::read(scene, self.quiet));
        let ready = ready.collect::<Result<Vec<_>, _>>()?;
        let occluders: Vec<_> = ready.iter().map(Ready::occluder).collect();
        // Error and basis are the study's.
        let (error, basis) = (self.study.errors[0], self.study.bases[0].1);
        let options = Options { error, basis, oracle: Oracle::Energy, direct_only: false };
        let mut subjects = Vec::new();
        for ((path, ready), occluder) in self.scenes.iter().zip(&ready).zip(&occluders) {
            let (scene, surfaces) = ready.in_its_bands();
            subjects.push(Subject {
                name: stem(path),
                problem: Problem { scene, surfaces, occluder: &**occluder, options: &options },
                reference: reference::beside(path, &scene.bands)?,
            });
        }
        let Some(result) = watched(self.quiet, |watch| self.study.run(&subjects, watch))? else {
            return Ok(Status::Interrupted);
        };
        let report = ErrorReport {
            program: Program::this(),
            machine: Machine::this(),
            scenes: ready.iter().map(Ready::facts).collect(),
            options: self.options_by_name(),
            result,
        };
        write_error(&report, &self.out).map_err(|problem| Error::Output(vec![problem]))?;
        if !self.quiet {
            print(&curves::tables(&report.result), &self.out);
        }
        Ok(Status::Done)
    }

    fn options_by_name(&self) -> BTreeMap<String, Value> {
        let study = &self.study;
        let bases: Vec<&str> = study.bases.iter().map(|(name, _)| name.as_str()).collect();
        let scenes: Vec<_> = self.scenes.iter().map(|scene| scene.to_string_lossy()).collect();
        let pairs = [
            ("command", json!(command())),
            ("scenes", json!(scenes)),
            ("errors", json!(study.errors)),
            ("bases", json!(bases)),
            ("repeat", json!(study.repeat)),
            ("longest", json!(study.longest.as_secs_f64())),
        ];
        pairs.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
    }
}
