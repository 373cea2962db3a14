//! Error control: passes at decreasing link thresholds until the estimated error meets the target.
//!
//! The target is `E ‖B − M‖`, the relative L2 error of reflected radiosity (stricter than the contract's `‖B‖`, which a bright lamp
//! would dominate). It is divided in squares: `LINK_SHARE` for links, the rest for power left unshot. A cheap pilot pass tells the norm
//! and how link errors add up; the threshold of the next pass follows from their growth with it.

use crate::math::Basis;
use crate::radiosity::{Solution, Tree, extent_m, trees};
use crate::scene::{Light, Scene, Surface};
use crate::transport::lamp::Lamp;
use crate::transport::{Oracle, Rules, SampleRule, Work};
use crate::visibility::Occluder;

use super::batch::Batches;
use super::pass::{Pass, PassStatistics};

/// Share of the error that links may use.
const LINK_SHARE: f64 = 0.9;
/// Share of the error that power left unshot may cause; with the links' share it adds up to one in squares.
const UNSHOT_SHARE: f64 = 0.43;
/// Light that is still to come does not spread evenly: RMS over mean.
const SPREAD: f64 = 1.5;
/// The root of the sum of squared link errors, times this, is the error of the solution in dark scenes; the second number is how it grows
/// with the gain `ρ/(1 − ρ)`, since link errors are reflected on (calibrated on the reference scenes and furnaces).
const LINK_CALIBRATION: (f64, f64) = (1.4, 0.2);
/// Passes after the pilot, at most.
const MAX_PASSES: usize = 3;

/// What to solve and how.
#[derive(Clone, Debug)]
pub struct Options {
    /// Relative L2 error of reflected radiosity asked for.
    pub error: f64,
    /// Function basis.
    pub basis: Basis,
    /// Refinement oracle.
    pub oracle: Oracle,
    /// Direct illumination only.
    pub direct_only: bool,
}

/// Where a run stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Light from the emitters.
    Direct,
    /// Light between surfaces.
    Interreflection,
}

/// Who watches a run and may stop it.
pub trait Observer {
    /// A pass begins: 0 is the pilot.
    fn pass(&mut self, _number: usize) {}
    /// Share of a stage that is done, in [0, 1].
    fn progress(&mut self, _stage: Stage, _share: f64) {}
    /// Whether to stop after the pair at hand.
    fn interrupted(&mut self) -> bool {
        false
    }
}

/// An observer that does nothing.
pub struct Silent;

impl Observer for Silent {}

/// A solved scene and how it came about.
pub struct Outcome {
    /// The solution.
    pub solution: Solution,
    /// Statistics of the last pass.
    pub statistics: PassStatistics,
    /// Work of all passes, the pilot included.
    pub work: Work,
    /// Passes run, the pilot included.
    pub passes: usize,
    /// Share of the first reflection's power left unshot.
    pub unshot_fraction: f64,
    /// Leaf elements.
    pub elements: u64,
}

/// Solves `scene`; `surfaces` are its surfaces and `occluder` holds its faces. At most three bands.
pub fn solve(
    scene: &Scene,
    surfaces: &[Surface],
    occluder: &dyn Occluder,
    options: &Options,
    observer: &mut dyn Observer,
) -> Outcome {
    match scene.bands.len() {
        1 => Run::<1>::new(scene, surfaces, occluder, options).solve(observer),
        2 => Run::<2>::new(scene, surfaces, occluder, options).solve(observer),
        _ => Run::<3>::new(scene, surfaces, occluder, options).solve(observer),
    }
}

struct Run<'a, const N: usize> {
    scene: &'a Scene,
    surfaces: &'a [Surface],
    occluder: &'a dyn Occluder,
    options: &'a Options,
    lamps: Vec<Lamp<N>>,
    area_m2: f64,
    /// Area-weighted mean over surfaces of the largest reflectance over bands.
    mean_reflectance: f64,
    /// `ρ/(1 − ρ)` of the RMS reflectance: how much reflected light a watt causes.
    gain: f64,
}

/// A pass' trees with its error, both in W/m.
#[derive(Clone)]
struct Attempt<const N: usize> {
    trees: Vec<Tree<N>>,
    statistics: PassStatistics,
    norm: f64,
    link_error: f64,
    unshot_error: f64,
}

impl<'a, const N: usize> Run<'a, N> {
    fn new(
        scene: &'a Scene,
        surfaces: &'a [Surface],
        occluder: &'a dyn Occluder,
        options: &'a Options,
    ) -> Self {
        let area_m2: f64 = surfaces.iter().map(|s| s.area_m2).sum();
        let brightest = |s: &Surface| s.reflectance.iter().copied().fold(0.0, f64::max);
        let square: f64 = surfaces.iter().map(|s| s.area_m2 * brightest(s) * brightest(s)).sum();
        let rho = if area_m2 > 0.0 { (square / area_m2).sqrt() } else { 0.0 };
        let mean: f64 = surfaces.iter().map(|s| s.area_m2 * brightest(s)).sum::<f64>() / area_m2;
        let extent = extent_m(scene);
        let lamps = scene.lights.iter().map(|light| Lamp::new(light, extent)).collect();
        Self {
            scene,
            surfaces,
            occluder,
            options,
            lamps,
            area_m2,
            mean_reflectance: mean,
            gain: rho / (1.0 - rho),
        }
    }

    fn solve(&self, observer: &mut dyn Observer) -> Outcome {
        let target = self.options.error;
        let mut work = Work::default();
        let pilot_error = (4.0 * target).clamp(0.02, 0.3);
        let guess = self.guess_norm();
        let mut threshold = pilot_error * guess / (32.0 * (self.surfaces.len().max(1) as f64).powf(0.25));
        observer.pass(0);
        let dark = trees::<N>(self.surfaces, self.options.basis);
        let mut attempt = self.attempt(dark, threshold, pilot_error * guess, observer);
        work += attempt.work();
        let mut passes = 1;
        while passes <= MAX_PASSES && !attempt.statistics.interrupted {
            let (links, unshot) = (attempt.link_error, attempt.unshot_error);
            let allowed = LINK_SHARE * target * attempt.norm;
            if links <= allowed && unshot <= UNSHOT_SHARE * target * attempt.norm * 1.01
                || attempt.norm == 0.0
            {
                break;
            }
            if links > 0.0 {
                // Link errors grow with a power of the threshold that depends on the order (measured).
                let growth = match self.options.basis {
                    Basis::Haar => 0.5,
                    Basis::M2 => 0.6,
                    Basis::M3 => 0.65,
                };
                threshold *= (allowed / links).min(1.0).powf(1.0 / growth).max(1e-4);
            }
            observer.pass(passes);
            let finished = attempt.clone();
            attempt = self.attempt(attempt.trees, threshold, target * attempt.norm, observer);
            work += attempt.work();
            if attempt.statistics.interrupted {
                // What an unfinished pass holds is worth less than the pass before it.
                attempt = finished;
                attempt.statistics.interrupted = true;
            }
            passes += 1;
        }
        self.outcome(attempt, work, passes)
    }

    /// An order of magnitude of the norm of reflected radiosity, in W/m: an integrating sphere with the scene's area and power.
    fn guess_norm(&self) -> f64 {
        let emitted: f64 =
            self.surfaces.iter().map(|s| s.area_m2 * square_sum(&s.exitance_w_m2).sqrt()).sum();
        let lamps: f64 = self
            .scene
            .lights
            .iter()
            .map(|light| match light {
                Light::Point { intensity_w_sr, .. } => {
                    4.0 * std::f64::consts::PI * square_sum(intensity_w_sr).sqrt()
                }
                Light::Spot { intensity_w_sr, .. } => {
                    std::f64::consts::PI * square_sum(intensity_w_sr).sqrt()
                }
                Light::Directional { irradiance_w_m2, .. } => {
                    0.25 * self.area_m2 * square_sum(irradiance_w_m2).sqrt()
                }
            })
            .sum();
        if self.area_m2 == 0.0 {
            return 0.0;
        }
        (emitted + lamps) * self.gain.min(4.0) / self.area_m2.sqrt()
    }

    fn attempt(
        &self,
        mut trees: Vec<Tree<N>>,
        threshold_w_m: f64,
        allowed_w_m: f64,
        observer: &mut dyn Observer,
    ) -> Attempt<N> {
        let root_area = self.area_m2.sqrt();
        let rules = Rules {
            oracle: self.options.oracle,
            threshold_w_m,
            reference_w_m2: self.guess_norm() / root_area,
            least_reflectance: self.mean_reflectance,
            samples: SampleRule::new(self.options.basis),
        };
        let pass = Pass {
            lamps: &self.lamps,
            occluder: self.occluder,
            rules: &rules,
            direct_only: self.options.direct_only,
            stop_w: UNSHOT_SHARE * allowed_w_m * root_area / (SPREAD * self.gain.max(1e-9)),
            prune_w_m2: 0.02 * allowed_w_m / root_area,
            batches: Batches::default(),
        };
        let statistics = pass.run(&mut trees, observer);
        let norm = trees.iter().map(Tree::reflected_norm_squared).sum::<f64>().sqrt();
        let unshot = if self.options.direct_only { 0.0 } else { statistics.unshot_w };
        Attempt {
            trees,
            statistics,
            norm,
            link_error: LINK_CALIBRATION.0
                * (LINK_CALIBRATION.1 * self.gain).hypot(1.0)
                * statistics.error_squared.sqrt(),
            unshot_error: SPREAD * unshot * self.gain / root_area,
        }
    }

    fn outcome(&self, attempt: Attempt<N>, work: Work, passes: usize) -> Outcome {
        let statistics = attempt.statistics;
        let error = attempt.link_error.hypot(attempt.unshot_error);
        let first = statistics.first_reflection_w;
        let solution = Solution {
            scene: self.scene.clone(),
            surfaces: self.surfaces.to_vec(),
            fields: attempt.trees.iter().map(Tree::field).collect(),
            error_target: self.options.error,
            error_estimate: if attempt.norm > 0.0 { error / attempt.norm } else { 0.0 },
            incomplete: statistics.interrupted,
        };
        let elements = attempt.trees.iter().map(|tree| tree.root.leaves()).sum();
        Outcome {
            unshot_fraction: if first > 0.0 { statistics.unshot_w / first } else { 0.0 },
            elements,
            statistics,
            work,
            passes,
            solution,
        }
    }
}

impl<const N: usize> Attempt<N> {
    fn work(&self) -> Work {
        let mut work = self.statistics.direct;
        work += self.statistics.interreflection;
        work
    }
}

fn square_sum(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum()
}
