//! `wrad render`: a picture of a saved solution, or of a scene, which is solved first.

use crate::output::{self, solution_file};
use crate::visibility::{Bvh, Occluder, OpaqueFaces};

use super::counting::Counting;
use super::load::{Loaded, caster};
use super::plan::{RenderPlan, RenderSource, Visibility};
use super::solve::solve;
use super::{Error, Status};

/// Runs the plan.
pub(super) fn run(plan: &RenderPlan) -> Result<Status, Error> {
    let input = |error: output::Error| Error::Input(error.to_string());
    let mut out_of_memory = None;
    let (solution, occluder): (_, Box<dyn Occluder + Send>) = match &plan.source {
        RenderSource::Saved(path) => {
            let solution = solution_file::load(path).map_err(input)?;
            plan.image.check(&solution.scene).map_err(input)?;
            let bvh = Bvh::new(OpaqueFaces::new(&solution.scene));
            (solution, Box::new(bvh))
        }
        RenderSource::Scene(path, options, workers) => {
            let loaded = Loaded::read(path, Visibility::Auto)?;
            plan.image.check(&loaded.scene).map_err(input)?;
            let solved = solve(&loaded, options, workers, Visibility::Auto, Counting::Off, plan.quiet)?;
            out_of_memory = solved.out_of_memory;
            (solved.outcome.solution, loaded.occluder)
        }
    };
    if solution.incomplete && !plan.quiet {
        eprintln!("wrad: warning: the solution is incomplete: its run was cut short");
    }
    let cast = caster(&solution.surfaces, &*occluder);
    output::write(&solution, &plan.out, &plan.image, &cast).map_err(|error| Error::Output(vec![error]))?;
    if let Some(why) = out_of_memory {
        return Err(Error::Failed(why));
    }
    match (&plan.source, solution.incomplete) {
        (RenderSource::Scene(..), true) => Ok(Status::Interrupted),
        _ => Ok(Status::Done),
    }
}
