//! `wrad solve`: load → solve → probes and results → report and summary.

use std::time::Instant;

use crate::output::report::{Counters, Known, Worker};
use crate::output::{self, ImageOptions, OutputKind, units};
use crate::radiosity::probe::read_probes;
use crate::schedule::{self, Options, Outcome, Schedule};
use crate::visibility::{Occluder, Unoccluded, nothing_between};

use super::bands::Collapsed;
use super::counting::{self, Counting};
use super::load::{Loaded, caster};
use super::memory::Memory;
use super::plan::{SolvePlan, Visibility};
use super::probes::Probes;
use super::progress::Watch;
use super::workers::{self, Workers};
use super::{Error, Status, interrupt, print, report};

/// A solved scene, and what the report needs to know besides.
pub(super) struct Solved {
    pub outcome: Outcome,
    /// Whether no ray was cast because nothing could be in between.
    pub unoccluded: bool,
    /// Bands computed; the others are these, so many times as bright.
    pub bands_computed: usize,
    pub direct_s: f64,
    pub interreflection_s: f64,
    pub workers: Vec<Worker>,
    pub counters: Known<Counters>,
    /// Why the run was stopped for want of memory.
    pub out_of_memory: Option<String>,
}

/// Runs the plan; `start` is when the program started.
pub(super) fn run(plan: &SolvePlan, start: Instant) -> Result<Status, Error> {
    let probes = plan.probes.as_ref().map(|(input, _)| Probes::read(input)).transpose()?;
    let loaded = Loaded::read(&plan.scene, plan.visibility)?;
    check(plan, probes.as_ref(), &loaded)?;
    let solved = solve(&loaded, &plan.options, &plan.workers, plan.visibility, plan.counters, plan.quiet)?;
    if !plan.quiet {
        warnings(plan, &solved.outcome).iter().for_each(|warning| eprintln!("wrad: warning: {warning}"));
    }
    let writing = Instant::now();
    let mut failures = write_results(plan, probes.as_ref(), &loaded, &solved);
    let output_s = writing.elapsed().as_secs_f64();
    let report = report::of_run(plan, &loaded, &solved, output_s, start);
    if let Some(path) = &plan.report {
        failures.extend(report.write(path).err());
    }
    if !plan.quiet {
        print(&output::summary(&report));
    }
    match failures.is_empty() {
        false => Err(Error::Output(failures)),
        true if solved.out_of_memory.is_some() => {
            Err(Error::Failed(solved.out_of_memory.unwrap_or_default()))
        }
        true if solved.outcome.solution.incomplete => Ok(Status::Interrupted),
        true => Ok(Status::Done),
    }
}

/// What did not come out as it was asked for.
fn warnings(plan: &SolvePlan, outcome: &Outcome) -> Vec<String> {
    let (statistics, solution) = (&outcome.statistics, &outcome.solution);
    let mut warnings = Vec::new();
    if plan.warns_of_links && statistics.links_refused {
        warnings.push(format!(
            "--links store: {} of links are all that may be stored; others were recomputed. Allow more with --link-memory",
            units::bytes(statistics.link_bytes)
        ));
    }
    if !solution.incomplete && solution.error_estimate > plan.options.error {
        let [estimate, asked, cut_short] =
            [solution.error_estimate, plan.options.error, outcome.unresolved_errors.cut_short]
                .map(units::percent);
        let why = match outcome.unresolved_errors.cut_short > 0.0 {
            true => format!("{cut_short} by links to elements as small as elements get"),
            false => format!("after {} passes, the most there are", outcome.passes),
        };
        warnings.push(format!("--error: the solution is estimated to err by {estimate}, not {asked}: {why}"));
    }
    warnings
}

/// Refuses what would fail after the work is done.
fn check(plan: &SolvePlan, probes: Option<&Probes>, loaded: &Loaded) -> Result<(), Error> {
    if let (Some(probes), Some((path, _))) = (probes, &plan.probes) {
        probes.check(path, &loaded.scene.bands)?;
    }
    if plan.out.iter().any(|path| OutputKind::from_path(path).is_ok_and(OutputKind::is_image)) {
        ImageOptions::default().check(&loaded.scene).map_err(|error| Error::Input(error.to_string()))?;
    }
    Ok(())
}

/// Solves a scene, watched: progress on a terminal, Ctrl-C stops it.
///
/// # Errors
/// [`Error::Failed`]: there is too little memory to begin, no team could be started, one of its workers panicked, or what must be
/// counted cannot be.
pub(super) fn solve(
    loaded: &Loaded,
    options: &Options,
    workers: &Workers,
    visibility: Visibility,
    counting: Counting,
    quiet: bool,
) -> Result<Solved, Error> {
    if !quiet {
        loaded.warnings().iter().for_each(|warning| eprintln!("wrad: warning: {warning}"));
    }
    if let Some(why) = Memory::of_this_process().too_little() {
        return Err(Error::Failed(why));
    }
    interrupt::install(quiet);
    let unoccluded = match visibility {
        Visibility::Auto => nothing_between(&loaded.scene),
        Visibility::Bvh | Visibility::Bsp => false,
        Visibility::None => true,
    };
    let nothing = Unoccluded(&*loaded.occluder);
    let occluder: &dyn Occluder = if unoccluded { &nothing } else { &*loaded.occluder };
    let mut team = workers.team()?;
    let mut counters = counting.open(team.as_mut())?;
    let mut watch = Watch::new(quiet);
    let collapsed = Collapsed::new(&loaded.scene, &loaded.surfaces);
    let few = collapsed.as_ref().map(|collapsed| collapsed.apply(&loaded.scene, &loaded.surfaces));
    let (scene, surfaces) = match &few {
        Some((scene, surfaces)) => (scene, surfaces),
        None => (&loaded.scene, &loaded.surfaces),
    };
    let schedule = Schedule {
        team: team.as_mut(),
        batches: workers.batches,
        memory: workers.memory,
        counters: counters.as_ref(),
    };
    let outcome = schedule::solve_by(schedule, scene, surfaces, occluder, options, &mut watch);
    watch.finish();
    // Where there is one node only, nothing is lost.
    if !quiet && team.as_ref().is_some_and(|team| team.plan().machine.nodes.len() > 1) {
        ccnuma::warnings::all().iter().for_each(|warning| eprintln!("wrad: note: {warning}"));
    }
    let mut outcome =
        outcome.map_err(|panic| Error::Failed(format!("a mistake in this program: {panic}")))?;
    if let Some(collapsed) = collapsed {
        collapsed.undo(&mut outcome.solution, &loaded.scene, &loaded.surfaces);
    }
    Ok(Solved {
        outcome,
        unoccluded,
        bands_computed: scene.bands.len(),
        direct_s: watch.direct_s,
        interreflection_s: watch.interreflection_s,
        out_of_memory: watch.out_of_memory,
        counters: counting::told(counters.as_mut()),
        workers: workers::account(team.as_mut(), watch.direct_s + watch.interreflection_s),
    })
}

/// Writes everything but the report; one failure does not cost the other results.
fn write_results(
    plan: &SolvePlan,
    probes: Option<&Probes>,
    loaded: &Loaded,
    solved: &Solved,
) -> Vec<output::Error> {
    let solution = &solved.outcome.solution;
    let mut failures = Vec::new();
    if let (Some(probes), Some((_, path))) = (probes, &plan.probes) {
        // Sensors may stand where surfaces do not: outside a convex scene, behind its faces.
        let nothing = Unoccluded(&*loaded.occluder);
        let occluder: &dyn Occluder =
            if plan.visibility == Visibility::None { &nothing } else { &*loaded.occluder };
        let readings = read_probes(solution, occluder, &probes.points);
        failures.extend(probes.write(&readings, &solution.scene.bands, path).err());
    }
    let cast = caster(&solution.surfaces, &*loaded.occluder);
    for path in &plan.out {
        failures.extend(output::write(solution, path, &ImageOptions::default(), &cast).err());
    }
    failures
}
