//! What was typed. Values are checked in [`super::plan`], so that each refusal can say what is available.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

/// Wavelet radiosity: the inter-reflection of light in diffuse scenes, to a stated error.
#[derive(Clone, Debug, Parser)]
#[command(name = "wrad", version = version(), after_help = EXIT_CODES)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

const EXIT_CODES: &str = "Exit codes: 0 done, 1 failed, 2 wrong usage or bad input, 130 interrupted.\n\
     A first Ctrl-C stops cleanly and writes what is done, marked incomplete; a second one ends at once.";

fn version() -> &'static str {
    match option_env!("WRAD_COMMIT") {
        Some(commit) if !commit.is_empty() => {
            concat!(env!("CARGO_PKG_VERSION"), " (", env!("WRAD_COMMIT"), ")")
        }
        _ => env!("CARGO_PKG_VERSION"),
    }
}

/// The commands.
#[derive(Clone, Debug, Subcommand)]
pub enum Command {
    /// Computes the light in a scene and writes meshes, pictures, probes and a report.
    Solve(Box<SolveArguments>),
    /// Makes a picture of a saved solution, or of a scene, which is solved first.
    Render(RenderArguments),
    /// Describes a scene: statistics, problems, and what would be computed and what skipped.
    Info(InfoArguments),
    /// Draws one of the paper's scenes by rule, with an exact number of surfaces.
    Generate(GenerateArguments),
    /// Shows the machine and which worker goes where, checked live.
    Topology(TopologyArguments),
    /// Measures and predicts, and writes what it finds below results/.
    Study(StudyArguments),
}

/// What to solve and how finely.
#[derive(Clone, Debug, Args)]
pub struct AccuracyArguments {
    /// Relative error asked for: the L2 norm over all surfaces and bands, measured on reflected radiosity.
    #[arg(long, value_name = "E", default_value = "0.01", allow_negative_numbers = true)]
    pub error: String,
    /// Function basis: haar, m2, m3, or auto: at most that of m3, and less where light is smooth.
    #[arg(long, value_name = "NAME", default_value = "auto")]
    pub basis: String,
}

/// Arguments of `wrad topology`.
#[derive(Clone, Debug, Args)]
pub struct TopologyArguments {
    /// Plan for another machine: an hwloc synthetic description, such as "pack:2 numa:4 core:8 pu:2".
    #[arg(long, value_name = "DESCRIPTION", conflicts_with = "xml")]
    pub synthetic: Option<String>,
    /// Plan for another machine: a file made by hwloc's `lstopo --of xml`.
    #[arg(long, value_name = "FILE")]
    pub xml: Option<PathBuf>,
    /// Where workers go: compact, scatter, none, or a list of CPUs such as 0,2,4-7.
    #[arg(long, value_name = "POLICY", default_value = "compact")]
    pub pin: String,
    /// Workers; as many as the policy finds CPUs where not given.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// JSON instead of text.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `wrad solve`.
#[derive(Clone, Debug, Args)]
pub struct SolveArguments {
    /// The scene: an Open Inventor or VRML 1.0 file in text form.
    pub scene: PathBuf,
    /// How finely.
    #[command(flatten)]
    pub accuracy: AccuracyArguments,
    /// Solver: shoot, progressively, or gather, which makes all light afresh until it changes no more. To gather, use the schedules stealing or
    /// sequential.
    #[arg(long, value_name = "NAME", default_value = "shoot")]
    pub method: String,
    /// Links between elements: recompute, store (to gather; says so where there is no room), or auto: store to gather, recompute to shoot.
    #[arg(long, value_name = "NAME", default_value = "auto")]
    pub links: String,
    /// What stored links may take, such as 512M; what finds no room is recomputed [default: 512M].
    #[arg(long, value_name = "SIZE", allow_negative_numbers = true)]
    pub link_memory: Option<String>,
    /// What refinement looks at: energy (light transported) or geometry (the kernel alone).
    #[arg(long, value_name = "NAME", default_value = "energy")]
    pub oracle: String,
    /// Visibility: bvh, bsp (the paper's, slower), or none where nothing stands in between. Without it: none
    /// for scenes seen to be convex, else bvh.
    #[arg(long, value_name = "NAME")]
    pub visibility: Option<String>,
    /// Computes direct illumination only.
    #[arg(long)]
    pub direct_only: bool,
    /// Who computes which pair when: sequential, stealing, inner-loop, single-queue[+lure] or outer-loop[+lure]. The first two give the
    /// same bits; in the others surfaces shoot one at a time, and in the last ones as workers become free.
    #[arg(long, value_name = "NAME", default_value = super::workers::DEFAULT_SCHEDULE)]
    pub schedule: String,
    /// Workers; one per core, or per CPU of a list, where not given.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<String>,
    /// Which worker on which CPU: compact, scatter, none, or a list of CPUs such as 0,2,4-7 [default: compact].
    #[arg(long, value_name = "POLICY")]
    pub pin: Option<String>,
    /// Where elements lie in memory: node (each surface's on its home node), interleave (page by page round all nodes), first-touch (on the
    /// node of the worker that makes them), or malloc (wherever the allocator puts them). Without it: node, and malloc for sequential.
    #[arg(long, value_name = "POLICY")]
    pub memory: Option<String>,
    /// Cache and memory counters: auto (what can be counted), hardware (or fail), off.
    #[arg(long, value_name = "SOURCE", default_value = "auto")]
    pub counters: String,
    /// Points to measure at: CSV whose header holds x, y, z, nx, ny, nz.
    #[arg(long, value_name = "FILE.csv", requires = "probes_out")]
    pub probes: Option<PathBuf>,
    /// Where the probes go, with irradiance and radiosity appended.
    #[arg(long, value_name = "FILE.csv", requires = "probes")]
    pub probes_out: Option<PathBuf>,
    /// A result, by extension: .glb .ply .vtu (meshes), .png .exr (pictures), .wrad (solution). Repeatable.
    #[arg(long, value_name = "FILE")]
    pub out: Vec<PathBuf>,
    /// Where the report of the run goes.
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,
    /// Prints neither summary nor progress nor warnings.
    #[arg(long)]
    pub quiet: bool,
}

/// Arguments of `wrad render`.
#[derive(Clone, Debug, Args)]
pub struct RenderArguments {
    /// A solution saved by `wrad solve --out FILE.wrad`, or a scene.
    pub input: PathBuf,
    /// The picture: .png or .exr.
    #[arg(long, value_name = "IMAGE")]
    pub out: PathBuf,
    /// A camera of the scene by its name; without it the first, or an automatic view.
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Width and height in pixels, such as 1280x960.
    #[arg(long, value_name = "WxH")]
    pub size: Option<String>,
    /// Draws the borders of the elements.
    #[arg(long)]
    pub mesh: bool,
    /// Shows irradiance in false colours, with a legend.
    #[arg(long, conflicts_with = "exposure")]
    pub falsecolor: bool,
    /// The factor from radiance to display values (0.18 is middle grey); automatic without it.
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true)]
    pub exposure: Option<String>,
    /// Error to which a scene is solved first [default: 0.01].
    #[arg(long, value_name = "E", allow_negative_numbers = true)]
    pub error: Option<String>,
    /// Basis in which a scene is solved first [default: auto].
    #[arg(long, value_name = "NAME")]
    pub basis: Option<String>,
    /// Prints no progress and no warnings.
    #[arg(long)]
    pub quiet: bool,
}

/// Arguments of `wrad info`.
#[derive(Clone, Debug, Args)]
pub struct InfoArguments {
    /// The scene: an Open Inventor or VRML 1.0 file in text form.
    pub scene: PathBuf,
}

/// Arguments of `wrad generate`.
#[derive(Clone, Debug, Args)]
pub struct GenerateArguments {
    /// Scene: stanislas, quito, soda-room, soda-floor or cornell.
    pub name: String,
    /// The scene file to write: .iv.
    #[arg(long, value_name = "FILE.iv")]
    pub out: PathBuf,
    /// Number of surfaces [default: that of the paper's scene].
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub surfaces: Option<String>,
    /// Seed of all that is left to chance.
    #[arg(long, value_name = "S", default_value = "1", allow_negative_numbers = true)]
    pub seed: String,
    /// Writes the surfaces in random order, so that neighbours in the file are none in space.
    #[arg(long)]
    pub shuffle: bool,
}

/// Arguments of `wrad study`.
#[derive(Clone, Debug, Args)]
pub struct StudyArguments {
    /// What to study.
    #[command(subcommand)]
    pub command: StudyCommand,
}

/// The studies.
#[derive(Clone, Debug, Subcommand)]
pub enum StudyCommand {
    /// Measures speed-up by schedule and number of threads here, and predicts it for other machines.
    Speedup(SpeedupArguments),
    /// Measures time, elements, rays and memory against the true error, by basis.
    Error(ErrorArguments),
}

/// Arguments of `wrad study speedup`.
#[derive(Clone, Debug, Args)]
pub struct SpeedupArguments {
    /// The scene: an Open Inventor or VRML 1.0 file in text form.
    pub scene: PathBuf,
    /// How finely.
    #[command(flatten)]
    pub accuracy: AccuracyArguments,
    /// Computes direct illumination only.
    #[arg(long)]
    pub direct_only: bool,
    /// Numbers of threads to measure, such as 1,2,4 [default: powers of two up to the number of cores].
    #[arg(long, value_name = "N,N,…", allow_negative_numbers = true)]
    pub threads: Option<String>,
    /// Schedules: those of wrad solve, and inner-loop-whole, the paper's, which is only predicted. Others than stealing and sequential
    /// are predicted from a second record, of single shooters.
    #[arg(long, value_name = "NAME,NAME,…", default_value = "sequential,stealing,inner-loop")]
    pub schedules: String,
    /// Repetitions of every run, after one that warms up.
    #[arg(long, value_name = "R", default_value = "3", allow_negative_numbers = true)]
    pub repeat: String,
    /// Which worker on which CPU: compact, scatter, none, or a list of CPUs such as 0,2,4-7.
    #[arg(long, value_name = "POLICY", default_value = "compact")]
    pub pin: String,
    /// Numbers of workers to predict for; those that a machine has no CPUs for are left out.
    #[arg(
        long,
        value_name = "N,N,…",
        default_value = "1,2,4,8,16,32,36,48,64",
        allow_negative_numbers = true
    )]
    pub predict: String,
    /// A machine to predict for: an hwloc synthetic description. Repeatable.
    #[arg(long, value_name = "DESCRIPTION", default_values = ["pack:32 numa:1 core:2 pu:1", "pack:8 numa:1 core:8 pu:1"])]
    pub machine: Vec<String>,
    /// Where the results go: DIR/<date>-<host>-<commit>/speedup-<scene>.
    #[arg(long, value_name = "DIR", default_value = "results")]
    pub out: PathBuf,
    /// Prints no tables, no progress and no warnings.
    #[arg(long)]
    pub quiet: bool,
}

/// Arguments of `wrad study error`.
#[derive(Clone, Debug, Args)]
pub struct ErrorArguments {
    /// The scenes: Open Inventor or VRML 1.0 files in text form. Where NAME.probes.csv lies beside NAME.iv, with columns
    /// x,y,z,nx,ny,nz and the true irradiance E_<band>, solutions are compared with that too.
    #[arg(value_name = "SCENE", required = true)]
    pub scenes: Vec<PathBuf>,
    /// Errors to ask for.
    #[arg(long, value_name = "E,E,…", default_value = "0.1,0.03,0.01,0.003", allow_negative_numbers = true)]
    pub errors: String,
    /// Bases to solve in: haar, m2, m3 or auto.
    #[arg(long, value_name = "NAME,NAME,…", default_value = "haar,m2,m3")]
    pub bases: String,
    /// Repetitions of every run, after one that warms up and is compared.
    #[arg(long, value_name = "R", default_value = "3", allow_negative_numbers = true)]
    pub repeat: String,
    /// Seconds after which a run is given up, and with it all finer ones in its basis.
    #[arg(long, value_name = "S", default_value = "60", allow_negative_numbers = true)]
    pub longest: String,
    /// Where the results go: DIR/<date>-<host>-<commit>/error-<scenes>.
    #[arg(long, value_name = "DIR", default_value = "results")]
    pub out: PathBuf,
    /// Prints no tables, no progress and no warnings.
    #[arg(long)]
    pub quiet: bool,
}
