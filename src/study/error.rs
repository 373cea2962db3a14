//! Time against error: scenes solved in several bases to several errors, each solution compared with what is true.
//!
//! Runs are sequential. All runs of a repetition follow each other before the next begins, so that a slow quarter of an hour falls on all alike;
//! the first repetition warms up, its solutions, the same as all later ones, are compared, and its times do not count. True is a solution in M3,
//! [`FINER`] times finer than the least error asked for, and where there is one, the reference. The reference is independent, but carries noise;
//! the finer solution carries none, but shares what all solutions may have in common.

use std::time::{Duration, Instant};

use serde::Serialize;

use super::run::{Problem, StudyError, timed, whole};
use super::statistics::{Spread, interpolate};
use super::truth::{Deviation, Point, Reference, irradiance, reflected, spread};
use crate::math::Basis;
use crate::schedule::{Observer, Options, Outcome, Stage, solve};

/// The finer solution's error is the least error asked for over this: in squares it adds 6 % to what is measured at that error.
pub const FINER: f64 = 3.0;

/// Points at which solutions are compared.
pub const POINTS: usize = 10_000;

/// A scene of a study.
pub struct Subject<'a> {
    /// Its name.
    pub name: String,
    /// What is to be solved; of its options, error and basis are the study's.
    pub problem: Problem<'a>,
    /// What others have computed.
    pub reference: Option<Reference>,
}

/// What is to be run.
#[derive(Clone, Debug)]
pub struct ErrorStudy {
    /// Errors to ask for, from the greatest down.
    pub errors: Vec<f64>,
    /// Bases by name.
    pub bases: Vec<(String, Basis)>,
    /// Repetitions that count.
    pub repeat: usize,
    /// After this a run is given up, with all finer ones of its basis.
    pub longest: Duration,
}

/// What came out, a curve for each scene and basis.
#[derive(Clone, Debug, Serialize)]
pub struct ErrorCurves {
    /// Points at which solutions are compared with the finer one.
    pub points: usize,
    /// The scenes.
    pub scenes: Vec<SceneCurves>,
}

/// A scene's curves.
#[derive(Clone, Debug, Serialize)]
pub struct SceneCurves {
    /// Its name.
    pub scene: String,
    /// The finer solution.
    pub truth: Finer,
    /// A curve for each basis.
    pub curves: Vec<Curve>,
}

/// The finer solution that is taken for true.
#[derive(Clone, Debug, Serialize)]
pub struct Finer {
    /// Its basis.
    pub basis: String,
    /// Its error asked for.
    pub error: f64,
    /// What it believes to have reached.
    pub estimate: f64,
    /// Seconds that it took.
    pub seconds: f64,
    /// Leaf elements.
    pub elements: u64,
    /// How far its irradiance is from the reference.
    pub at_probes: Option<Deviation>,
    /// Noise of the reference, as a share of its RMS.
    pub noise: Option<f64>,
}

/// Solutions in one basis.
#[derive(Clone, Debug, Serialize)]
pub struct Curve {
    /// The basis.
    pub basis: String,
    /// Solutions from the coarsest to the finest.
    pub cases: Vec<Case>,
    /// The error that took too long, and with which this curve ends.
    pub too_long: Option<f64>,
}

/// One solution.
#[derive(Clone, Debug, Serialize)]
pub struct Case {
    /// The error asked for.
    pub error: f64,
    /// What the solver believes to have reached, of reflected radiosity.
    pub estimate: f64,
    /// Seconds of solving.
    pub seconds: Spread,
    /// Leaf elements.
    pub elements: u64,
    /// Passes, the pilot included.
    pub passes: usize,
    /// Segments tested for visibility.
    pub rays: u64,
    /// Evaluations of the kernel at a pair of points.
    pub kernel_evaluations: u64,
    /// Evaluations of Lambert's closed form.
    pub lambert_evaluations: u64,
    /// Bytes of elements, packets, the visibility structure and the solution.
    pub memory_bytes: u64,
    /// How far reflected radiosity is from the finer solution: the error that was asked for and estimated.
    pub reflected: Deviation,
    /// How far irradiance is from the finer solution.
    pub irradiance: Deviation,
    /// How far irradiance is from the reference.
    pub at_probes: Option<Deviation>,
}

impl Curve {
    /// Seconds to an RMS error of irradiance, as `judged` says it, between the two solutions around it; `None` where it is not among them.
    pub fn seconds_to(&self, rms: f64, judged: fn(&Case) -> Option<Deviation>) -> Option<f64> {
        interpolate(self.cases.iter().filter_map(|case| Some((judged(case)?.rms, case.seconds.median))), rms)
    }
}

impl Case {
    /// The estimate over the true error.
    pub fn honesty(&self) -> f64 {
        self.estimate / self.reflected.rms
    }
}

/// A scene with what is true of it.
struct Judge<'a> {
    subject: &'a Subject<'a>,
    points: Vec<Point>,
    irradiance: Vec<f64>,
    reflected: Vec<f64>,
    finer: Finer,
}

/// A curve in the making.
struct Entry<'a> {
    judge: &'a Judge<'a>,
    name: &'a str,
    basis: Basis,
    /// Cases, and the seconds of each so far.
    runs: Vec<(Case, Vec<f64>)>,
    too_long: Option<f64>,
}

impl ErrorStudy {
    /// Runs all of it; `watch` is asked whether to stop.
    ///
    /// # Errors
    /// See [`StudyError`].
    pub fn run(&self, subjects: &[Subject<'_>], watch: &mut dyn Observer) -> Result<ErrorCurves, StudyError> {
        let least = self.errors.iter().copied().fold(f64::INFINITY, f64::min);
        let judges = subjects.iter().map(|subject| Judge::new(subject, least / FINER, watch));
        let judges = judges.collect::<Result<Vec<_>, _>>()?;
        let mut scenes: Vec<Vec<Entry<'_>>> = judges
            .iter()
            .map(|judge| self.bases.iter().map(|basis| Entry::new(judge, basis)).collect())
            .collect();
        for entry in scenes.iter_mut().flatten() {
            entry.warm_up(self, watch)?;
        }
        for _ in 0..self.repeat {
            for entry in scenes.iter_mut().flatten() {
                entry.repeat(watch)?;
            }
        }
        let finish = |(judge, entries): (&Judge<'_>, Vec<Entry<'_>>)| SceneCurves {
            scene: judge.subject.name.clone(),
            truth: judge.finer.clone(),
            curves: entries.into_iter().map(Entry::curve).collect(),
        };
        Ok(ErrorCurves { points: POINTS, scenes: judges.iter().zip(scenes).map(finish).collect() })
    }
}

impl<'a> Judge<'a> {
    fn new(subject: &'a Subject<'a>, error: f64, watch: &mut dyn Observer) -> Result<Self, StudyError> {
        let problem = &subject.problem;
        let (outcome, seconds) = timed(|| solve_to(problem, Basis::M3, error, watch));
        whole(&outcome)?;
        let solution = &outcome.solution;
        let points = spread(problem.surfaces, POINTS);
        let irradiance = irradiance(solution, &points);
        let reference = subject.reference.as_ref();
        let finer = Finer {
            basis: "m3".to_owned(),
            error,
            estimate: solution.error_estimate,
            seconds,
            elements: outcome.elements,
            at_probes: reference.map(|reference| reference.deviation(solution, problem.occluder)),
            noise: reference.and_then(|reference| reference.noise),
        };
        let reflected = reflected(problem.surfaces, &points, &irradiance);
        Ok(Self { subject, points, irradiance, reflected, finer })
    }

    fn case(&self, error: f64, outcome: &Outcome, seconds: f64) -> Case {
        let Problem { scene, surfaces, occluder, .. } = self.subject.problem;
        let solution = &outcome.solution;
        let bands = scene.bands.len();
        let here = irradiance(solution, &self.points);
        let reference = self.subject.reference.as_ref();
        Case {
            error,
            estimate: solution.error_estimate,
            // Until it is repeated, what there is.
            seconds: Spread { median: seconds, least: seconds, greatest: seconds, count: 1 },
            elements: outcome.elements,
            passes: outcome.passes,
            rays: outcome.work.visibility_rays,
            kernel_evaluations: outcome.work.kernel_evaluations,
            lambert_evaluations: outcome.work.lambert_evaluations,
            memory_bytes: outcome.footprint.bytes_by_kind.values().sum(),
            reflected: Deviation::new(bands, &reflected(surfaces, &self.points, &here), &self.reflected),
            irradiance: Deviation::new(bands, &here, &self.irradiance),
            at_probes: reference.map(|reference| reference.deviation(solution, occluder)),
        }
    }
}

impl<'a> Entry<'a> {
    fn new(judge: &'a Judge<'a>, (name, basis): &'a (String, Basis)) -> Self {
        Self { judge, name, basis: *basis, runs: Vec::new(), too_long: None }
    }

    /// Solves to one error after the other until one takes too long, and compares.
    fn warm_up(&mut self, study: &ErrorStudy, watch: &mut dyn Observer) -> Result<(), StudyError> {
        for error in &study.errors {
            let mut limited = Limited { watch, end: Instant::now() + study.longest, stopped: false };
            let problem = &self.judge.subject.problem;
            let (outcome, seconds) = timed(|| solve_to(problem, self.basis, *error, &mut limited));
            if outcome.solution.incomplete && !limited.stopped {
                self.too_long = Some(*error);
                return Ok(());
            }
            whole(&outcome)?;
            self.runs.push((self.judge.case(*error, &outcome, seconds), Vec::new()));
        }
        Ok(())
    }

    fn repeat(&mut self, watch: &mut dyn Observer) -> Result<(), StudyError> {
        for (case, seconds) in &mut self.runs {
            let problem = &self.judge.subject.problem;
            let (outcome, taken) = timed(|| solve_to(problem, self.basis, case.error, watch));
            whole(&outcome)?;
            seconds.push(taken);
        }
        Ok(())
    }

    fn curve(self) -> Curve {
        let finish = |(case, seconds): (Case, Vec<f64>)| {
            let seconds = Spread::of(&seconds).unwrap_or(case.seconds);
            Case { seconds, ..case }
        };
        let cases = self.runs.into_iter().map(finish).collect();
        Curve { basis: self.name.to_owned(), cases, too_long: self.too_long }
    }
}

fn solve_to(problem: &Problem<'_>, basis: Basis, error: f64, watch: &mut dyn Observer) -> Outcome {
    let options = Options { error, basis, ..problem.options.clone() };
    solve(problem.scene, problem.surfaces, problem.occluder, &options, watch)
}

/// An observer that also stops a run which takes too long.
struct Limited<'a> {
    watch: &'a mut dyn Observer,
    end: Instant,
    /// Whether it was the other one that stopped it.
    stopped: bool,
}

impl Observer for Limited<'_> {
    fn pass(&mut self, number: usize) {
        self.watch.pass(number);
    }

    fn progress(&mut self, stage: Stage, share: f64) {
        self.watch.progress(stage, share);
    }

    fn interrupted(&mut self) -> bool {
        self.stopped |= self.watch.interrupted();
        self.stopped || Instant::now() > self.end
    }
}
