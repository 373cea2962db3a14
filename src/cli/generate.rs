//! `wrad generate`: a scene of the paper, drawn by rule.

use std::path::PathBuf;

use crate::output;
use crate::scene::procedural::{Options, Subject, draw};

use super::arguments::GenerateArguments;
use super::choice::choose;
use super::{Error, Status, files, print};

/// What the reader of scene files takes by default.
const MOST_SURFACES: usize = 2_000_000;

/// What to draw and where it goes.
#[derive(Clone, Debug)]
pub struct GeneratePlan {
    subject: Subject,
    options: Options,
    out: PathBuf,
}

impl GeneratePlan {
    /// Checks and resolves the arguments.
    pub(super) fn new(arguments: GenerateArguments) -> Result<GeneratePlan, Error> {
        let subject = choose("generate", &arguments.name, &Subject::ALL.map(|s| (s.name(), s)), &[])?;
        let surfaces = arguments.surfaces.map(|text| {
            let number = text.parse().ok().filter(|n| (1..=MOST_SURFACES).contains(n));
            number.ok_or_else(|| {
                Error::Input(format!("--surfaces {text}: expected a whole number from 1 to {MOST_SURFACES}"))
            })
        });
        let seed = arguments.seed.parse().map_err(|_| {
            Error::Input(format!("--seed {}: expected a whole number from 0 to {}", arguments.seed, u64::MAX))
        })?;
        let is_scene = arguments.out.extension().is_some_and(|extension| extension == "iv");
        if !is_scene && arguments.out.metadata().map_or(true, |found| found.is_file()) {
            let out = arguments.out.display();
            return Err(Error::Input(format!("{out}: wrad generate writes Open Inventor scenes: .iv")));
        }
        files::check(&[], &[&arguments.out])?;
        let options = Options { surfaces: surfaces.transpose()?, seed, shuffle: arguments.shuffle };
        Ok(GeneratePlan { subject, options, out: arguments.out })
    }

    /// Draws the scene and writes it.
    pub(super) fn run(&self) -> Result<Status, Error> {
        let drawing = draw(self.subject, &self.options).map_err(|error| {
            Error::Input(format!("{error}; ask for more by --surfaces, or leave the option out"))
        })?;
        output::write_atomically(&self.out, |out| drawing.write(out))
            .map_err(|error| Error::Output(vec![error]))?;
        let (surfaces, lights) = (drawing.surfaces(), drawing.lights());
        if self.out.metadata().is_ok_and(|found| found.is_file()) {
            print(&format!("{}: {surfaces} surfaces, {lights} lights\n", self.out.display()));
        }
        Ok(Status::Done)
    }
}
