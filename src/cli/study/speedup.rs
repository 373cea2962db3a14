//! `wrad study speedup`: load → run and replay → results and tables.

use std::collections::BTreeMap;
use std::path::PathBuf;

use ccnuma::{Machine, Plan, Policy};
use serde_json::{Value, json};

use super::lists::{distinct, number, numbers};
use super::ready::Ready;
use super::{command, free_directory, print, stem, watched};
use crate::cli::arguments::SpeedupArguments;
use crate::cli::choice::positive;
use crate::cli::plan::{basis, basis_name};
use crate::cli::{Error, Status, workers};
use crate::output::machine::Machine as MachineFacts;
use crate::output::report::Program;
use crate::output::study::{SpeedupStudy, tables, write_speedup};
use crate::schedule::{Batches, Options};
use crate::study::replay::{Model, Site};
use crate::study::{Contestant, Problem, Study};
use crate::transport::Oracle;

/// Schedules that can be replayed, how, and from a record of which batches.
const MODELS: [(&str, Model, Batches); 7] = [
    ("stealing", Model::Stealing, Batches::Fitted),
    ("inner-loop", Model::Stealing, Batches::Single),
    (WHOLE, Model::WholeReceivers, Batches::Single),
    ("single-queue", Model::SingleQueue { lure: false }, Batches::Single),
    ("single-queue+lure", Model::SingleQueue { lure: true }, Batches::Single),
    ("outer-loop", Model::OuterLoop { lure: false }, Batches::Single),
    ("outer-loop+lure", Model::OuterLoop { lure: true }, Batches::Single),
];

/// The paper's inner loop, which shares out whole receivers; only predicted.
const WHOLE: &str = "inner-loop-whole";

/// A study that can be run.
#[derive(Clone, Debug)]
pub struct SpeedupPlan {
    scene: PathBuf,
    options: Options,
    study: Study,
    out: PathBuf,
    quiet: bool,
}

impl SpeedupPlan {
    /// Checks and resolves the arguments.
    pub(super) fn new(arguments: &SpeedupArguments) -> Result<SpeedupPlan, Error> {
        let SpeedupArguments { scene, accuracy, out, quiet, direct_only, .. } = arguments;
        let options = Options {
            error: positive("--error", &accuracy.error, 1.0)?,
            basis: basis("--basis", &accuracy.basis)?,
            oracle: Oracle::Energy,
            direct_only: *direct_only,
        };
        Ok(SpeedupPlan {
            scene: scene.clone(),
            options,
            study: study(arguments)?,
            out: free_directory(out, &format!("speedup-{}", stem(scene)))?,
            quiet: *quiet,
        })
    }

    /// Runs the study, writes its results and prints its tables.
    pub(super) fn run(&self) -> Result<Status, Error> {
        let ready = Ready::read(&self.scene, self.quiet)?;
        let occluder = ready.occluder();
        let (scene, surfaces) = ready.in_its_bands();
        let problem = Problem { scene, surfaces, occluder: &*occluder, options: &self.options };
        let Some(result) = watched(self.quiet, |watch| self.study.run(problem, watch))? else {
            return Ok(Status::Interrupted);
        };
        let study = SpeedupStudy {
            program: Program::this(),
            machine: MachineFacts::this(),
            scene: ready.facts(),
            options: self.options_by_name(),
            result,
        };
        write_speedup(&study, &self.out).map_err(|problem| Error::Output(vec![problem]))?;
        if !self.quiet {
            self.print(&study);
        }
        Ok(Status::Done)
    }

    fn print(&self, study: &SpeedupStudy) {
        let result = &study.result;
        let mut text = format!("{}\n{}\n", tables::measured(result), tables::records(result));
        for machine in tables::machines(result) {
            text += &format!("predicted for {machine}\n\n{}\n", tables::predicted(result, &machine));
            text += &format!(
                "where the time goes, in percent\n\n{}\n",
                tables::where_time_goes(result, &machine)
            );
        }
        print(&text, &self.out);
    }

    fn options_by_name(&self) -> BTreeMap<String, Value> {
        let study = &self.study;
        let names: Vec<&str> = study.contestants.iter().map(|contestant| contestant.name).collect();
        let machines: Vec<&str> = study.machines.iter().map(|(name, _)| name.as_str()).collect();
        let pairs = [
            ("command", json!(command())),
            ("scene", json!(self.scene.to_string_lossy())),
            ("error", json!(self.options.error)),
            ("basis", json!(basis_name(self.options.basis))),
            ("direct_only", json!(self.options.direct_only)),
            ("threads", json!(study.threads)),
            ("schedules", json!(names)),
            ("repeat", json!(study.repeat)),
            ("predict", json!(study.predict)),
            ("machine", json!(machines)),
            ("pin", json!(study.pin.to_string())),
        ];
        pairs.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
    }
}

fn study(arguments: &SpeedupArguments) -> Result<Study, Error> {
    let input = |problem: ccnuma::Error| Error::Input(problem.to_string());
    let here = Machine::this_machine().map_err(input)?;
    let pin: Policy = arguments.pin.parse().map_err(input)?;
    let threads = match &arguments.threads {
        Some(text) => numbers("--threads", text)?,
        None => powers_of_two(here.cores()),
    };
    for threads in &threads {
        Plan::new(here.clone().into(), pin.clone(), Some(*threads)).map_err(input)?;
    }
    let predict = numbers("--predict", &arguments.predict)?;
    let mut machines = Vec::new();
    for description in &arguments.machine {
        let machine = Machine::synthetic(description).map_err(input)?;
        if !predict.iter().any(|workers| Site::new(&machine, *workers).is_ok()) {
            let cores = machine.cores();
            return Err(Error::Input(format!(
                "--machine {description}: it has {cores} cores, and --predict asks for more only"
            )));
        }
        machines.push((description.clone(), machine));
    }
    let repeat = number("--repeat", &arguments.repeat)?;
    let contestants = arguments.schedules.split(',').map(|name| contestant(name.trim()));
    let contestants = distinct("--schedules", contestants.collect::<Result<Vec<_>, _>>()?, |c| c.name)?;
    Ok(Study { contestants, threads, repeat, pin, here, predict, machines })
}

/// A schedule by its name: measured if this version has it, predicted if it can be replayed.
fn contestant(name: &str) -> Result<Contestant, Error> {
    let model = MODELS.iter().find(|(known, ..)| *known == name);
    let measured = match (workers::schedule("--schedules", name), model) {
        (Ok((name, on_team, batches)), _) => Some((name, (on_team, batches))),
        (Err(_), Some(_)) => None,
        (Err(problem), None) => return Err(problem),
    };
    Ok(Contestant {
        name: measured.map(|(name, _)| name).or(model.map(|(name, ..)| *name)).unwrap_or_default(),
        measured: measured.map(|(_, how)| how),
        model: model.map(|(_, model, batches)| (*model, *batches)),
    })
}

/// 1, 2, 4 … and the number of cores.
fn powers_of_two(cores: usize) -> Vec<usize> {
    let mut numbers: Vec<usize> = (0..).map(|i| 1 << i).take_while(|n| *n < cores).collect();
    numbers.push(cores);
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_cores_are_tried_by_powers_of_two() {
        assert_eq!(powers_of_two(6), [1, 2, 4, 6]);
        assert_eq!(powers_of_two(1), [1]);
    }

    #[test]
    fn schedules_are_measured_where_they_exist_and_predicted_where_they_can_be() {
        let stealing = contestant("stealing").unwrap();
        assert!(stealing.measured.is_some() && stealing.model.is_some());
        let whole = contestant(WHOLE).unwrap();
        assert!(whole.name == WHOLE && whole.measured.is_none() && whole.model.is_some());
        assert!(contestant("sequential").unwrap().model.is_none());
        assert!(
            contestant("guided")
                .unwrap_err()
                .to_string()
                .contains("--schedules guided: there is no such value")
        );
    }
}
