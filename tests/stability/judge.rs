//! The one judge: solves a case and sets what came out beside what is demanded.
//!
//! Deviations are RMS over points of all surfaces, weighted by area, relative to the truth's own RMS: of reflected radiosity
//! against a truth, of irradiance between two solutions.

use std::fmt::Write as _;
use std::io::Write as _;
use std::time::{Duration, Instant};

use glam::{DVec2, DVec3};
use wavelet_radiosity::math::{Basis, polygon};
use wavelet_radiosity::output::energy_balance;
use wavelet_radiosity::radiosity::Solution;
use wavelet_radiosity::scene::{self, OfFaces, Scene, Surface};
use wavelet_radiosity::schedule::{Observer, Options, Outcome, solve};
use wavelet_radiosity::transport::Oracle;
use wavelet_radiosity::visibility::{Bvh, OpaqueFaces};

/// A run that takes longer, or holds more memory, is stopped and fails.
const LONGEST: Duration = Duration::from_secs(120);
const MOST_BYTES: usize = 3 << 30;

/// The irradiance at a point of a surface; `None` where none is known.
pub type Truth = Box<dyn Fn(&Surface, DVec3) -> Option<f64>>;

/// What a solution is held to.
pub enum What {
    /// The deviation of reflected radiosity from the truth, relative.
    Truth(Truth),
    /// What goes out is what is absorbed: the balance of a closed scene.
    Balance,
    /// What of that was so before the ambient correction: what transport has lost of the light, as a share.
    Lost,
    /// The power that all surfaces receive, in W: relative deviation.
    Received(f64),
    /// What the power that all surfaces receive deviates by from this, in W, as a share of the error stated.
    Stated(f64),
    /// The deviation from another solution, relative.
    Same(Twin),
    /// The largest irradiance in W/m².
    Dark,
    /// The number of elements.
    Elements,
}

/// Another solution of what should be the same: face `faces[i]` of the case at `motion(x)` is `light` times face `i` at `x`.
pub struct Twin {
    pub reference: std::rc::Rc<Solution>,
    pub motion: Box<dyn Fn(DVec3) -> DVec3>,
    pub faces: Vec<u32>,
    pub light: f64,
}

/// A demand with its limit; for a known shortfall, the larger one that holds today, and the cause.
pub struct Demand {
    pub what: What,
    pub limit: f64,
    pub today: f64,
    pub cause: &'static str,
}

/// A scene, how it is solved, and what is demanded of its solution. All of it must be finite in any case.
pub struct Case {
    pub item: &'static str,
    pub name: String,
    pub scene: Scene,
    pub basis: Basis,
    pub error: f64,
    pub demands: Vec<Demand>,
}

impl Case {
    /// A case of an item of the list.
    pub fn new(item: &'static str, name: impl Into<String>, scene: Scene) -> Self {
        Self { item, name: name.into(), scene, basis: Basis::M3, error: 0.03, demands: Vec::new() }
    }

    pub fn solved(self, basis: Basis, error: f64) -> Self {
        Self { basis, error, ..self }
    }

    pub fn demand(mut self, what: What, limit: f64) -> Self {
        self.demands.push(Demand { what, limit, today: limit, cause: "" });
        self
    }

    /// All demands fall short today, but not of `bound`.
    pub fn all_today(mut self, bound: f64, cause: &'static str) -> Self {
        self.demands.iter_mut().for_each(|demand| (demand.today, demand.cause) = (bound, cause));
        self
    }
}

/// Stops what takes too long or too much.
struct Guard(Instant);

impl Observer for Guard {
    fn interrupted(&mut self) -> bool {
        self.0.elapsed() > LONGEST || resident_bytes() > MOST_BYTES
    }
}

fn resident_bytes() -> usize {
    let statm = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    statm.split_whitespace().nth(1).and_then(|pages| pages.parse::<usize>().ok()).unwrap_or(0) * 4096
}

/// Solves a validated copy of a scene.
pub fn run(scene: &Scene, basis: Basis, error: f64) -> Outcome {
    let mut scene = scene.clone();
    scene::validate(&mut scene);
    let bvh = Bvh::new(OpaqueFaces::new(&scene));
    let options = Options { error, basis, oracle: Oracle::Energy, direct_only: false };
    solve(&scene, &scene::surfaces(&scene), &bvh, &options, &mut Guard(Instant::now()))
}

/// Judges cases one after the other; rows go to standard output and, as CSV, to the file that `WRAD_STABILITY_TABLE` names.
///
/// # Panics
/// A demand was not met, nor its bound of today.
pub fn judge(cases: impl IntoIterator<Item = Case>) {
    let mut failures = String::new();
    for case in cases {
        let start = Instant::now();
        let outcome = run(&case.scene, case.basis, case.error);
        let seconds = start.elapsed().as_secs_f64();
        for (demanded, limit, today, cause, reached) in measure(&case, &outcome) {
            // Written so that NaN fails.
            let verdict = match reached {
                r if r <= limit => "met".to_owned(),
                r if r <= today => format!("known shortfall: {cause}"),
                _ => "FAILED".to_owned(),
            };
            let row = format!(
                "{},{},{:?},{},{demanded},{limit:.0e},{reached:.1e},{verdict},{:.0e},{},{seconds:.2}",
                case.item,
                case.name,
                case.basis,
                case.error,
                outcome.solution.error_estimate,
                outcome.elements
            );
            println!("{row}");
            record(&row);
            if verdict == "FAILED" {
                let _ = writeln!(failures, "{row}");
            }
        }
    }
    assert!(failures.is_empty(), "item,case,basis,error,demanded,limit,reached:\n{failures}");
}

fn record(row: &str) {
    let Some(path) = std::env::var_os("WRAD_STABILITY_TABLE") else { return };
    let table = std::fs::OpenOptions::new().append(true).create(true).open(&path);
    table.and_then(|mut table| writeln!(table, "{row}")).expect("the table can be written");
}

/// What is demanded, its limit, the one of today and its cause, and what was reached.
fn measure(case: &Case, outcome: &Outcome) -> Vec<(&'static str, f64, f64, &'static str, f64)> {
    let solution = &outcome.solution;
    let unfinished = if solution.incomplete { f64::INFINITY } else { 0.0 };
    let mut rows: Vec<_> = case
        .demands
        .iter()
        .map(|Demand { what, limit, today, cause }| {
            let (name, reached) = match what {
                What::Truth(truth) => ("error against the truth", against(solution, truth)),
                What::Balance => ("energy balance", balance(solution)),
                What::Lost => {
                    ("lost by transport", outcome.statistics.lost.map_or(balance(solution), f64::abs))
                }
                What::Received(power_w) => ("power received", (received_w(solution) / power_w - 1.0).abs()),
                What::Stated(power_w) => {
                    let apart = (received_w(solution) / power_w - 1.0).abs();
                    ("error over the estimate", apart / solution.error_estimate)
                }
                What::Same(twin) => ("same solution", apart(solution, twin)),
                What::Dark => ("darkness", brightest(solution)),
                What::Elements => ("elements", outcome.elements as f64),
            };
            (name, *limit, *today, *cause, reached + unfinished)
        })
        .collect();
    let unusable = solution.fields.iter().flat_map(|f| &f.coefficients).filter(|c| !c.is_finite()).count()
        + usize::from(!solution.error_estimate.is_finite())
        + usize::from(!outcome.unshot_fraction.is_finite());
    if unusable > 0 || rows.is_empty() {
        rows.push(("no number that is not finite", 0.0, 0.0, "", unusable as f64 + unfinished));
    }
    rows
}

fn balance(solution: &Solution) -> f64 {
    energy_balance(solution).as_result().map_or(f64::NAN, |balance| balance.abs())
}

/// Points in every leaf of a surface, inside its outline, each with the area in m² that it stands for.
fn points(solution: &Solution, index: usize) -> Vec<(DVec2, f64)> {
    let (surface, field) = (&solution.surfaces[index], &solution.fields[index]);
    let per_side = (16.0 / (field.leaves() as f64).sqrt()).ceil().clamp(2.0, 16.0);
    let per_side = if solution.surfaces.len() > 100 { 2.0 } else { per_side };
    let n = per_side as usize;
    let mut points = Vec::new();
    field.for_each_leaf(&mut |leaf| {
        let weight_m2 = surface.frame.area_m2 * leaf.cell.area() / (n * n) as f64;
        let grid = (0..n * n).map(|i| (DVec2::new((i % n) as f64, (i / n) as f64) + 0.5) / per_side);
        let inside =
            grid.map(|p| leaf.cell.to_surface(p)).filter(|p| polygon::contains(&surface.outline, *p));
        points.extend(inside.map(|p| (p, weight_m2)));
    });
    points
}

fn against(solution: &Solution, truth: &Truth) -> f64 {
    let (mut square, mut norm) = (0.0, 0.0);
    for (index, surface) in solution.surfaces.iter().enumerate() {
        let rho = surface.reflectance[0];
        for (uv, weight_m2) in points(solution, index) {
            let Some(exact) = truth(surface, surface.frame.point(uv)) else { continue };
            let mut e = [0.0];
            solution.fields[index].irradiance(uv, &mut e);
            square += weight_m2 * (rho * (e[0] - exact)).powi(2);
            norm += weight_m2 * (rho * exact).powi(2);
        }
    }
    (square / norm).sqrt()
}

fn apart(solution: &Solution, twin: &Twin) -> f64 {
    let (mut square, mut norm) = (0.0, 0.0);
    let there = OfFaces::new(&solution.surfaces);
    let reference = &twin.reference;
    for (index, surface) in reference.surfaces.iter().enumerate() {
        for (uv, weight_m2) in points(reference, index) {
            let (mut here, mut moved) = ([0.0], [0.0]);
            reference.fields[index].irradiance(uv, &mut here);
            let face = twin.faces.get(surface.face as usize).copied().unwrap_or(surface.face);
            let Some((i, at)) = there.at(face, surface.back, (twin.motion)(surface.frame.point(uv))) else {
                return f64::INFINITY;
            };
            solution.fields[i as usize].irradiance(at, &mut moved);
            square += weight_m2 * (moved[0] / twin.light - here[0]).powi(2);
            norm += weight_m2 * here[0] * here[0];
        }
    }
    (square / norm).sqrt()
}

/// From means over whole leaves: for scenes of parallelograms.
fn received_w(solution: &Solution) -> f64 {
    let of = |(index, surface): (usize, &Surface)| {
        let mut power_w = 0.0;
        solution.fields[index]
            .for_each_leaf(&mut |leaf| power_w += leaf.cell.area() * leaf.coefficients[0] * surface.area_m2);
        power_w
    };
    solution.surfaces.iter().enumerate().map(of).sum()
}

fn brightest(solution: &Solution) -> f64 {
    solution.fields.iter().flat_map(|f| &f.coefficients).fold(0.0, |most, c| c.abs().max(most))
}
