//! `wrad study speedup`: load → run and replay → results and tables.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;

use ccnuma::{Machine, Plan, Policy};
use serde_json::{Value, json};

use crate::output::machine::Machine as MachineFacts;
use crate::output::report::{Program, SceneFacts};
use crate::output::study::{SpeedupStudy, directory, tables, write_speedup};
use crate::schedule::{Batches, Options};
use crate::study::replay::{Model, Site};
use crate::study::{Contestant, Problem, Study, StudyError};
use crate::transport::Oracle;
use crate::visibility::{Occluder, Unoccluded, nothing_between};

use super::arguments::{SpeedupArguments, StudyArguments, StudyCommand};
use super::choice::positive;
use super::load::Loaded;
use super::plan::{basis, basis_name};
use super::progress::Watch;
use super::{Error, Status, grey, interrupt, workers};

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

/// The most repetitions and workers: more are a slip of the keyboard.
const MOST: usize = 10_000;

/// A study that can be run.
#[derive(Clone, Debug)]
pub struct StudyPlan {
    scene: PathBuf,
    options: Options,
    study: Study,
    out: PathBuf,
    quiet: bool,
}

impl StudyPlan {
    /// Checks and resolves the arguments.
    pub(super) fn new(arguments: StudyArguments) -> Result<StudyPlan, Error> {
        let StudyCommand::Speedup(arguments) = arguments.command;
        let SpeedupArguments { scene, accuracy, out, quiet, direct_only, .. } = &arguments;
        let options = Options {
            error: positive("--error", &accuracy.error, 1.0)?,
            basis: basis(&accuracy.basis)?,
            oracle: Oracle::Energy,
            direct_only: *direct_only,
        };
        let plan = StudyPlan {
            scene: scene.clone(),
            options,
            study: study(&arguments)?,
            out: directory(out, &format!("speedup-{}", stem(scene))),
            quiet: *quiet,
        };
        if plan.out.exists() {
            return Err(Error::Input(format!(
                "{}: there are results of today and this commit; remove them or choose another place by --out",
                plan.out.display()
            )));
        }
        Ok(plan)
    }

    /// Runs the study, writes its results and prints its tables.
    pub(super) fn run(&self) -> Result<Status, Error> {
        let loaded = Loaded::read(&self.scene)?;
        if !self.quiet {
            loaded.warnings().iter().for_each(|warning| eprintln!("wrad: warning: {warning}"));
        }
        interrupt::install(self.quiet);
        let nothing = Unoccluded(&loaded.bvh);
        let occluder: &dyn Occluder = if nothing_between(&loaded.scene) { &nothing } else { &loaded.bvh };
        let grey = grey::one_band(&loaded.scene, &loaded.surfaces);
        let (scene, surfaces) = match &grey {
            Some((scene, surfaces)) => (scene, surfaces),
            None => (&loaded.scene, &loaded.surfaces),
        };
        let problem = Problem { scene, surfaces, occluder, options: &self.options };
        let mut watch = Watch::new(self.quiet);
        let result = self.study.run(problem, &mut watch);
        watch.finish();
        if let Some(why) = watch.out_of_memory {
            return Err(Error::Failed(why));
        }
        let result = match result {
            Err(StudyError::Interrupted) => {
                eprintln!("wrad: {}", StudyError::Interrupted);
                return Ok(Status::Interrupted);
            }
            other => other.map_err(|problem| Error::Failed(problem.to_string()))?,
        };
        let study = SpeedupStudy {
            program: Program::this(),
            machine: MachineFacts::this(),
            scene: SceneFacts::new(&loaded.scene, &loaded.surfaces),
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
        text += &format!("written to {}\n", self.out.display());
        // A reader that has gone away is not an error of the run.
        let _ = std::io::stdout().write_all(text.as_bytes());
    }

    fn options_by_name(&self) -> BTreeMap<String, Value> {
        let study = &self.study;
        let names: Vec<&str> = study.contestants.iter().map(|contestant| contestant.name).collect();
        let machines: Vec<&str> = study.machines.iter().map(|(name, _)| name.as_str()).collect();
        let command: Vec<String> = std::env::args().skip(1).collect();
        let pairs = [
            ("command", json!(format!("wrad {}", command.join(" ")))),
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

fn stem(scene: &std::path::Path) -> String {
    scene.file_stem().map_or_else(|| "scene".to_owned(), |stem| stem.to_string_lossy().into_owned())
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
    let repeat = numbers("--repeat", &arguments.repeat)?;
    let [repeat] = repeat[..] else {
        return Err(Error::Input(format!("--repeat {}: expected one number", arguments.repeat)));
    };
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

/// Whole numbers from 1, separated by commas, each once.
fn numbers(option: &str, text: &str) -> Result<Vec<usize>, Error> {
    let number = |part: &str| match part.trim().parse() {
        Ok(number) if (1..=MOST).contains(&number) => Ok(number),
        _ => Err(Error::Input(format!(
            "{option} {text}: expected whole numbers from 1 to {MOST}, separated by commas; found {part:?}"
        ))),
    };
    distinct(option, text.split(',').map(number).collect::<Result<Vec<usize>, _>>()?, |number| *number)
}

fn distinct<T, K: PartialEq + std::fmt::Display>(
    option: &str,
    items: Vec<T>,
    key: impl Fn(&T) -> K,
) -> Result<Vec<T>, Error> {
    for (i, item) in items.iter().enumerate() {
        if items[..i].iter().any(|before| key(before) == key(item)) {
            return Err(Error::Input(format!("{option}: {} is named twice", key(item))));
        }
    }
    Ok(items)
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
    fn lists_of_numbers_are_checked() {
        assert_eq!(numbers("--threads", "1, 2,64").unwrap(), [1, 2, 64]);
        for (text, found) in
            [("", "\"\""), ("0", "\"0\""), ("1,x", "\"x\""), ("1,,2", "\"\""), ("1,1", "1 is named")]
        {
            let error = numbers("--threads", text).unwrap_err().to_string();
            assert!(error.starts_with("--threads") && error.contains(found), "{error}");
        }
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
