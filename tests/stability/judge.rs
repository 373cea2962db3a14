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
    /// The power that all surfaces receive, in W: relative deviation.
    Received(f64),
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

/// A demand with its limit, and the limit that holds today where that is larger: a known shortfall.
pub struct Demand {
    pub what: What,
    pub limit: f64,
    pub today: f64,
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
        self.demands.push(Demand { what, limit, today: limit });
        self
    }

    /// The last demand falls short today, but not of `bound`.
    pub fn today(mut self, bound: f64) -> Self {
        self.demands.last_mut().expect("a demand to fall short of").today = bound;
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
        for (demanded, limit, today, reached) in measure(&case, &outcome) {
            // Written so that NaN fails.
            let verdict = match reached {
                r if r <= limit => "met",
                r if r <= today => "known shortfall",
                _ => "FAILED",
            };
            let row = format!(
                "{},{},{:?},{},{demanded},{limit:.1e},{reached:.1e},{verdict},{:.1e},{},{seconds:.2}",
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

/// What is demanded, its limit, the one of today, and what was reached.
fn measure(case: &Case, outcome: &Outcome) -> Vec<(&'static str, f64, f64, f64)> {
    let solution = &outcome.solution;
    let unfinished = if solution.incomplete { f64::INFINITY } else { 0.0 };
    let mut rows: Vec<_> = case
        .demands
        .iter()
        .map(|Demand { what, limit, today }| {
            let (name, reached) = match what {
                What::Truth(truth) => ("error against the truth", against(solution, truth)),
                What::Balance => ("energy balance", balance(solution)),
                What::Received(power_w) => ("power received", (received_w(solution) / power_w - 1.0).abs()),
                What::Same(twin) => ("same solution", apart(solution, twin)),
                What::Dark => ("darkness", brightest(solution)),
                What::Elements => ("elements", outcome.elements as f64),
            };
            (name, *limit, *today, reached + unfinished)
        })
        .collect();
    let unusable = solution.fields.iter().flat_map(|f| &f.coefficients).filter(|c| !c.is_finite()).count()
        + usize::from(!solution.error_estimate.is_finite())
        + usize::from(!outcome.unshot_fraction.is_finite());
    if unusable > 0 || rows.is_empty() {
        rows.push(("no number that is not finite", 0.0, 0.0, unusable as f64 + unfinished));
    }
    rows
}

fn balance(solution: &Solution) -> f64 {
    energy_balance(solution).as_result().map_or(f64::NAN, |balance| balance.abs())
}

/// Points inside the outline of a surface, in its parameters.
fn points(surface: &Surface, surfaces: usize) -> Vec<DVec2> {
    let n = if surfaces > 100 { 5 } else { 16 };
    let grid = (0..n * n).map(|i| (DVec2::new((i % n) as f64, (i / n) as f64) + 0.5) / n as f64);
    grid.filter(|uv| polygon::contains(&surface.outline, *uv)).collect()
}

fn against(solution: &Solution, truth: &Truth) -> f64 {
    let (mut square, mut norm) = (0.0, 0.0);
    for (index, surface) in solution.surfaces.iter().enumerate() {
        let rho = surface.reflectance[0];
        let points = points(surface, solution.surfaces.len());
        for uv in &points {
            let Some(exact) = truth(surface, surface.frame.point(*uv)) else { continue };
            let mut e = [0.0];
            solution.fields[index].irradiance(*uv, &mut e);
            let weight = surface.area_m2 / points.len() as f64;
            square += weight * (rho * (e[0] - exact)).powi(2);
            norm += weight * (rho * exact).powi(2);
        }
    }
    (square / norm).sqrt()
}

fn apart(solution: &Solution, twin: &Twin) -> f64 {
    let (mut square, mut norm) = (0.0, 0.0);
    let there = OfFaces::new(&solution.surfaces);
    let reference = &twin.reference;
    for (index, surface) in reference.surfaces.iter().enumerate() {
        let points = points(surface, reference.surfaces.len());
        for uv in &points {
            let weight = surface.area_m2 / points.len() as f64;
            let (mut here, mut moved) = ([0.0], [0.0]);
            reference.fields[index].irradiance(*uv, &mut here);
            let face = twin.faces.get(surface.face as usize).copied().unwrap_or(surface.face);
            let Some((i, at)) = there.at(face, surface.back, (twin.motion)(surface.frame.point(*uv))) else {
                return f64::INFINITY;
            };
            solution.fields[i as usize].irradiance(at, &mut moved);
            square += weight * (moved[0] / twin.light - here[0]).powi(2);
            norm += weight * here[0] * here[0];
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
