//! What will be done: the arguments, each checked and resolved. A plan that exists can be run.

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::math::Basis;
use crate::output::{ImageOptions, OutputKind};
use crate::schedule::Options;
use crate::transport::Oracle;

use super::arguments::{Command, InfoArguments, RenderArguments, SolveArguments};
use super::choice::{choose, positive};
use super::counting::Counting;
use super::generate::GeneratePlan;
use super::study::StudyPlan;
use super::topology::TopologyPlan;
use super::workers::{DEFAULT_SCHEDULE, Workers};
use super::{Arguments, Error, Status, files, info, render, solve};

/// Solved to this error where none is asked for.
const DEFAULT_ERROR: f64 = 0.01;

/// A run that can be started.
#[derive(Clone, Debug)]
pub enum Plan {
    /// `wrad solve`.
    Solve(Box<SolvePlan>),
    /// `wrad render`.
    Render(RenderPlan),
    /// `wrad info`.
    Info(PathBuf),
    /// `wrad generate`.
    Generate(GeneratePlan),
    /// Show a machine and a plan for it.
    Topology(Box<TopologyPlan>),
    /// Measure and predict.
    Study(Box<StudyPlan>),
}

/// What `wrad solve` will do.
#[derive(Clone, Debug)]
pub struct SolvePlan {
    /// The scene file.
    pub scene: PathBuf,
    /// How to solve.
    pub options: Options,
    /// Who works.
    pub workers: Workers,
    /// Whether to say so where links find no room.
    pub warns_of_links: bool,
    /// The structure to ask about visibility.
    pub visibility: Visibility,
    /// Points to measure at, and where the readings go.
    pub probes: Option<(PathBuf, PathBuf)>,
    /// Results to write; their extensions stand for formats.
    pub out: Vec<PathBuf>,
    /// Where the report goes.
    pub report: Option<PathBuf>,
    /// Whether caches and memory are watched.
    pub counters: Counting,
    /// Whether to print neither summary nor progress nor warnings.
    pub quiet: bool,
}

/// How visibility is decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// Nothing stands between in a scene that is seen to be convex, else by the hierarchy.
    Auto,
    /// By the hierarchy.
    Bvh,
    /// By the binary space partition.
    Bsp,
    /// Nothing stands in between.
    None,
}

/// What `wrad render` will do.
#[derive(Clone, Debug)]
pub struct RenderPlan {
    /// Where the solution comes from.
    pub source: RenderSource,
    /// The picture.
    pub out: PathBuf,
    /// How it looks.
    pub image: ImageOptions,
    /// Whether to print no progress and no warnings.
    pub quiet: bool,
}

/// Where `wrad render` takes its solution from.
#[derive(Clone, Debug)]
pub enum RenderSource {
    /// A saved solution.
    Saved(PathBuf),
    /// A scene, to be solved first.
    Scene(PathBuf, Options, Box<Workers>),
}

impl Plan {
    /// Checks and resolves the arguments.
    ///
    /// # Errors
    /// [`Error::Input`]: a value that cannot be used, with what is available; files that collide.
    pub fn new(arguments: Arguments) -> Result<Plan, Error> {
        match arguments.command {
            Command::Solve(arguments) => SolvePlan::new(*arguments).map(|plan| Plan::Solve(Box::new(plan))),
            Command::Render(arguments) => RenderPlan::new(arguments).map(Plan::Render),
            Command::Topology(arguments) => Ok(Plan::Topology(Box::new(TopologyPlan::new(arguments)?))),
            Command::Generate(arguments) => GeneratePlan::new(arguments).map(Plan::Generate),
            Command::Info(InfoArguments { scene }) => Ok(Plan::Info(scene)),
            Command::Study(arguments) => Ok(Plan::Study(Box::new(StudyPlan::new(arguments)?))),
        }
    }

    /// Does what is planned; `start` is when the program started.
    ///
    /// # Errors
    /// A bad scene or probe file, or a result that cannot be written.
    pub fn run(&self, start: Instant) -> Result<Status, Error> {
        match self {
            Plan::Solve(plan) => solve::run(plan, start),
            Plan::Render(plan) => render::run(plan),
            Plan::Topology(plan) => plan.run(),
            Plan::Generate(plan) => plan.run(),
            Plan::Info(scene) => info::run(scene),
            Plan::Study(plan) => plan.run(),
        }
    }
}

impl SolvePlan {
    fn new(arguments: SolveArguments) -> Result<SolvePlan, Error> {
        let error = positive("--error", &arguments.accuracy.error, 1.0)?;
        let oracles = [("energy", Oracle::Energy), ("geometry", Oracle::Geometry)];
        let options = Options {
            error,
            basis: basis("--basis", &arguments.accuracy.basis)?,
            oracle: choose("--oracle", &arguments.oracle, &oracles, &[])?,
            direct_only: arguments.direct_only,
        };
        let visibility = match &arguments.visibility {
            None => Visibility::Auto,
            Some(name) => {
                let available =
                    [("bvh", Visibility::Bvh), ("bsp", Visibility::Bsp), ("none", Visibility::None)];
                choose("--visibility", name, &available, &[])?
            }
        };
        for path in &arguments.out {
            OutputKind::from_path(path).map_err(|error| Error::Input(error.to_string()))?;
        }
        let inputs = [Some(&arguments.scene), arguments.probes.as_ref()];
        let results = arguments.out.iter().chain(&arguments.probes_out).chain(&arguments.report);
        files::check(&paths(inputs.into_iter().flatten()), &paths(results))?;
        let (threads, pin) = (arguments.threads.as_deref(), arguments.pin.as_deref());
        Ok(SolvePlan {
            workers: Workers::new(&arguments.schedule, threads, pin)?
                .with_memory(arguments.memory.as_deref())?
                .with_method(&arguments)?,
            scene: arguments.scene,
            options,
            visibility,
            warns_of_links: arguments.links == "store",
            probes: arguments.probes.zip(arguments.probes_out),
            out: arguments.out,
            report: arguments.report,
            counters: Counting::new(&arguments.counters)?,
            quiet: arguments.quiet,
        })
    }
}

fn paths<'a>(paths: impl Iterator<Item = &'a PathBuf>) -> Vec<&'a Path> {
    paths.map(PathBuf::as_path).collect()
}

/// The basis that `name`, given to `option`, stands for. `auto` has the functions of M3, which on the three reference scenes takes 0.5 to 1.1 of
/// the time of M2 at every error from 0.1 to 0.003 and ends nearer to the truth, and uses those that the light asks for.
pub(super) fn basis(option: &str, name: &str) -> Result<Basis, Error> {
    let bases = [("haar", Basis::Haar), ("m2", Basis::M2), ("m3", Basis::M3), ("auto", Basis::Auto)];
    choose(option, name, &bases, &[])
}

/// The name of a basis.
pub(super) fn basis_name(basis: Basis) -> &'static str {
    match basis {
        Basis::Haar => "haar",
        Basis::M2 => "m2",
        Basis::M3 => "m3",
        Basis::Auto => "auto",
    }
}

impl RenderPlan {
    fn new(arguments: RenderArguments) -> Result<RenderPlan, Error> {
        let kind = OutputKind::from_path(&arguments.out).map_err(|error| Error::Input(error.to_string()))?;
        let refuse = |text: String| Err(Error::Input(text));
        let out = arguments.out.display();
        if !kind.is_image() {
            return refuse(format!(
                "{out}: wrad render writes pictures: .png or .exr; for the rest: wrad solve"
            ));
        }
        if kind == OutputKind::Exr && (arguments.mesh || arguments.falsecolor || arguments.exposure.is_some())
        {
            return refuse(format!(
                "{out}: an .exr holds linear radiance; --mesh, --falsecolor and --exposure are for .png"
            ));
        }
        files::check(&[&arguments.input], &[&arguments.out])?;
        let mut image = ImageOptions {
            camera: arguments.camera,
            mesh: arguments.mesh,
            falsecolor: arguments.falsecolor,
            ..ImageOptions::default()
        };
        image.size = arguments.size.as_deref().map(size).transpose()?;
        image.exposure =
            arguments.exposure.map(|text| positive("--exposure", &text, f64::MAX)).transpose()?;
        let saved = OutputKind::from_path(&arguments.input).is_ok_and(|kind| kind == OutputKind::Wrad);
        let source = if saved {
            if arguments.error.is_some() || arguments.basis.is_some() {
                let input = arguments.input.display();
                return refuse(format!(
                    "{input}: --error and --basis are for scenes; this is already solved"
                ));
            }
            RenderSource::Saved(arguments.input)
        } else {
            let error = arguments.error.map_or(Ok(DEFAULT_ERROR), |text| positive("--error", &text, 1.0))?;
            let basis = basis("--basis", arguments.basis.as_deref().unwrap_or("auto"))?;
            let options = Options { error, basis, oracle: Oracle::Energy, direct_only: false };
            let workers = Workers::new(DEFAULT_SCHEDULE, None, None)?;
            RenderSource::Scene(arguments.input, options, Box::new(workers))
        };
        Ok(RenderPlan { source, out: arguments.out, image, quiet: arguments.quiet })
    }
}

/// A size as in `1280x960`.
fn size(text: &str) -> Result<(u32, u32), Error> {
    let numbers = text.split_once(['x', 'X', '×']).map(|(w, h)| (w.parse(), h.parse()));
    match numbers {
        Some((Ok(width), Ok(height))) => Ok((width, height)),
        _ => {
            Err(Error::Input(format!("--size {text}: expected width and height in pixels, such as 1280x960")))
        }
    }
}
