//! Error control: passes at decreasing link thresholds until the estimated error meets the target.
//!
//! The target is `E ‖B − M‖`, the relative L2 error of reflected radiosity (stricter than the contract's `‖B‖`, which a bright lamp
//! would dominate). It is divided in squares: `LINK_SHARE` for links, the rest for power left unshot. A cheap pilot pass tells the norm
//! and how link errors add up; the threshold of the next pass follows from their growth with it. Each pass starts from the solution of the
//! one before: fine links carry every surface's light once, not shot by shot.

use ccnuma::arena::Memory;
use ccnuma::{Team, WorkerPanic};

use crate::math::Basis;
use crate::radiosity::{Field, Solution, Tree, add_ambient, extent_m, field_packet};
use crate::scene::{Light, Scene, Surface};
use crate::transport::lamp::Lamp;
use crate::transport::{Oracle, Packet, Rules, SampleRules, Source, Work};
use crate::visibility::Occluder;

use super::batch::Batches;
use super::copies::Copies;
use super::crew::Crew;
use super::footprint::Footprint;
use super::pass::{Pass, PassStatistics, REFLECTED_SHARE};
use super::record::Record;
use super::watch::{Observer, Watch, observed};

/// Share of the error that links may use.
const LINK_SHARE: f64 = 0.97;
/// Share of the error that power left unshot may cause; with the links' share it adds up to one in squares.
const UNSHOT_SHARE: f64 = 0.2;
/// Share of the error, taken as a deviation at a point, above which a link goes down to elements that others have made: what several links
/// bring to a corner is smooth in sum only, and sums are exact where all are projected on the same elements.
const POINT_LIMIT: f64 = 0.003;
/// Light that is still to come does not spread evenly: RMS over mean.
const SPREAD: f64 = 1.5;
/// The root of the sum of squared link errors, times this, is the error of the solution in dark scenes (calibrated on the reference scenes).
const LINK_CALIBRATION: f64 = 1.4;
/// Link errors are reflected on. Those of all signs grow with the root of the gain `ρ/(1 − ρ)`, their small mean with the gain itself
/// (calibrated on furnaces and manufactured solutions at ρ 0.5 to 0.999).
const REFLECTED: (f64, f64) = (0.4, 0.13);
/// Below one percent, errors that no sample shows (contacts, thin shadows) fall slower than those of links: the calibration grows with this
/// power of the target under 0.01.
const UNSEEN_GROWTH: f64 = 0.25;
/// A target at or above this may be met by the pilot. Finer ones want a pass that carries every surface's light once: many shots, each
/// projected for itself, sum up to more than their links show.
const PILOT_ONLY: f64 = 0.1;
/// A pilot whose direct light errs by at most this share of the target is to meet it.
const HOPEFUL: f64 = 0.7;
/// How much coarser its links may then become: what coarser ones lose, they do not see.
const COARSEST: f64 = 4.0;
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

/// Who works, and between which batches all must have finished. The result depends on the batches, not on who works.
#[derive(Debug, Default)]
pub struct Schedule<'t> {
    /// The team; without one, receivers are done one after the other.
    pub team: Option<&'t mut Team>,
    /// How many surfaces shoot at once.
    pub batches: Batches,
    /// Where the elements of each surface live; [`Memory::Node`] is its home. Without a team only [`Memory::FirstTouch`] is heeded.
    pub memory: Memory,
}

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
    /// Share of the last pass' cost in the costliest receiver of each batch: no team that leaves receivers whole can be faster.
    pub longest_receivers: f64,
    /// Share of the last pass' cost in the longest chain of dependent parts in each batch: no team at all can be faster.
    pub longest_chains: f64,
    /// Leaf elements.
    pub elements: u64,
    /// Memory.
    pub footprint: Footprint,
}

/// Solves `scene` sequentially; `surfaces` are its surfaces and `occluder` holds its faces. At most three bands.
pub fn solve(
    scene: &Scene,
    surfaces: &[Surface],
    occluder: &dyn Occluder,
    options: &Options,
    observer: &mut dyn Observer,
) -> Outcome {
    solve_by(Schedule::default(), scene, surfaces, occluder, options, observer)
        .unwrap_or_else(|panic| unreachable!("there is no team, and yet {panic}"))
}

/// As [`solve`], by a schedule. The observer is called on this thread only, the work is done on others.
///
/// # Errors
/// A worker panicked: a mistake in this program.
pub fn solve_by(
    schedule: Schedule<'_>,
    scene: &Scene,
    surfaces: &[Surface],
    occluder: &dyn Occluder,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<Outcome, WorkerPanic> {
    observed(observer, |watch| {
        let mut crew = Crew::new(schedule.team, schedule.memory, surfaces)?;
        let occluders = crew.copy(occluder.bytes(), || occluder.replica())?;
        let means = Means { batches: schedule.batches, crew: &mut crew, occluders, watch };
        solve_in_bands(scene, surfaces, None, occluder, options, means)
    })
}

/// As [`solve`], where the exitance varies over surfaces: a field for each of them, in W/m², stands for what its material emits, and may be
/// negative. The fields of the solution are the irradiance as ever; its radiosity knows nothing of these.
pub fn solve_emitting(
    scene: &Scene,
    surfaces: &[Surface],
    exitance: &[Field],
    occluder: &dyn Occluder,
    options: &Options,
    observer: &mut dyn Observer,
) -> Outcome {
    let solved = observed(observer, |watch| {
        let mut crew = Crew::new(None, Memory::default(), surfaces)?;
        let means = Means { batches: Batches::default(), crew: &mut crew, occluders: Copies::none(), watch };
        solve_in_bands(scene, surfaces, Some(exitance), occluder, options, means)
    });
    solved.unwrap_or_else(|panic: WorkerPanic| unreachable!("there is no team, and yet {panic}"))
}

/// As [`solve`], with a record of what was done.
pub fn solve_recorded(
    batches: Batches,
    scene: &Scene,
    surfaces: &[Surface],
    occluder: &dyn Occluder,
    options: &Options,
    observer: &mut dyn Observer,
) -> (Outcome, Record) {
    let solved = observed(observer, |watch| {
        let mut crew = Crew::recording(surfaces);
        let means = Means { batches, crew: &mut crew, occluders: Copies::none(), watch };
        let outcome = solve_in_bands(scene, surfaces, None, occluder, options, means)?;
        Ok((outcome, crew.into_record().unwrap_or_default()))
    });
    solved.unwrap_or_else(|panic: WorkerPanic| unreachable!("there is no team, and yet {panic}"))
}

fn solve_in_bands(
    scene: &Scene,
    surfaces: &[Surface],
    exitance: Option<&[Field]>,
    occluder: &dyn Occluder,
    options: &Options,
    means: Means<'_, '_, '_>,
) -> Result<Outcome, WorkerPanic> {
    match scene.bands.len() {
        1 => Run::<1>::new(scene, surfaces, exitance, occluder, options).solve(means),
        2 => Run::<2>::new(scene, surfaces, exitance, occluder, options).solve(means),
        _ => Run::<3>::new(scene, surfaces, exitance, occluder, options).solve(means),
    }
}

struct Run<'a, const N: usize> {
    scene: &'a Scene,
    surfaces: &'a [Surface],
    occluder: &'a dyn Occluder,
    options: &'a Options,
    lamps: Vec<Lamp<N>>,
    /// What surfaces emit.
    emitters: Vec<Packet<N>>,
    area_m2: f64,
    /// Area-weighted mean over surfaces of the largest reflectance over bands.
    mean_reflectance: f64,
    /// `ρ/(1 − ρ)` of the RMS reflectance: how much reflected light a watt causes.
    gain: f64,
}

/// Who works, how, and who is told.
struct Means<'c, 't, 'w> {
    batches: Batches,
    crew: &'c mut Crew<'t>,
    /// Copies of the visibility structure near the workers.
    occluders: Copies<Box<dyn Occluder + Send>>,
    watch: &'w Watch,
}

/// What a pass has come to; norm and errors in W/m.
#[derive(Clone, Copy)]
struct Attempt {
    statistics: PassStatistics,
    /// Of links of interreflection, in W/m.
    threshold_w_m: f64,
    norm: f64,
    link_error: f64,
    unshot_error: f64,
}

impl<'a, const N: usize> Run<'a, N> {
    fn new(
        scene: &'a Scene,
        surfaces: &'a [Surface],
        exitance: Option<&[Field]>,
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
        let emits = |s: &Surface| s.exitance_w_m2.iter().any(|m| *m > 0.0);
        let even = |s: &Surface| Field::even(&s.exitance_w_m2);
        let packet = |i: usize, field: &Field| field_packet(i, &surfaces[i], field, |_, _, m| m);
        let emitters = match exitance {
            Some(fields) => fields.iter().enumerate().map(|(i, field)| packet(i, field)).collect(),
            None => surfaces
                .iter()
                .enumerate()
                .filter(|(_, s)| emits(s))
                .map(|(i, s)| packet(i, &even(s)))
                .collect(),
        };
        Self {
            scene,
            surfaces,
            occluder,
            options,
            lamps,
            emitters,
            area_m2,
            mean_reflectance: mean,
            gain: rho / (1.0 - rho),
        }
    }

    fn solve(&self, mut means: Means<'_, '_, '_>) -> Result<Outcome, WorkerPanic> {
        let watch = means.watch;
        let target = self.options.error;
        let mut work = Work::default();
        let pilot_error = (4.0 * target).clamp(0.02, 0.3);
        let guess = self.guess_norm();
        let threshold = pilot_error * guess / (32.0 * (self.surfaces.len().max(1) as f64).powf(0.25));
        watch.pass(0);
        let mut trees = means.crew.grow::<N>(self.surfaces, self.options.basis)?;
        let mut attempt = self.attempt(&mut trees, threshold, (pilot_error, guess), true, &mut means)?;
        let mut threshold = attempt.threshold_w_m;
        let mut packet_bytes = attempt.statistics.packet_bytes;
        let mut finished = None;
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
            threshold *= attempt.statistics.growth;
            if links > 0.0 {
                // Errors of a pilot that mixed states are those of coarse links made many times brighter, and fall faster.
                let growth = if passes == 1 && attempt.statistics.mixed { 1.0 } else { self.growth() };
                threshold *= (allowed / links).min(1.0).powf(1.0 / growth).max(1e-4);
            }
            watch.pass(passes);
            let fields = means.crew.map(&mut trees, |_| true, |tree| tree.field())?;
            let last = attempt;
            attempt = self.attempt(&mut trees, threshold, (target, attempt.norm), false, &mut means)?;
            work += attempt.work();
            packet_bytes = packet_bytes.max(attempt.statistics.packet_bytes);
            if attempt.statistics.interrupted {
                // What an unfinished pass holds is worth less than the pass before it.
                attempt = last;
                attempt.statistics.interrupted = true;
                finished = Some(fields);
            } else {
                means.crew.discard(fields)?;
            }
            passes += 1;
        }
        attempt.statistics.packet_bytes = packet_bytes;
        let fields = match finished {
            Some(fields) => fields,
            None => means.crew.map(&mut trees, |_| true, |tree| tree.field())?,
        };
        self.outcome(attempt, fields, trees, work, passes, means)
    }

    /// An order of magnitude of the norm of reflected radiosity, in W/m: an integrating sphere with the scene's area and power.
    fn guess_norm(&self) -> f64 {
        let area_m2 = |packet: &Packet<N>| self.surfaces[packet.surface as usize].area_m2;
        let emitted: f64 = self.emitters.iter().map(|p| area_m2(p) * p.strength()).sum();
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

    /// One pass, which is to err by `error` where the norm is as given. That of a pilot is known by guess only, and of a coarse target put
    /// right by the direct light found.
    fn attempt(
        &self,
        trees: &mut [Tree<N>],
        mut threshold_w_m: f64,
        (mut error, mut norm_w_m): (f64, f64),
        pilot: bool,
        means: &mut Means<'_, '_, '_>,
    ) -> Result<Attempt, WorkerPanic> {
        let (target, batches, watch) = (self.options.error, means.batches, means.watch);
        let aim_w_m = error * norm_w_m;
        let rules = self.rules(threshold_w_m, aim_w_m);
        let pass = self.pass((&rules, !pilot), (error, norm_w_m), &means.occluders, batches);
        let (mut statistics, reflected) = pass.illuminate(trees, means.crew, watch)?;
        if self.options.direct_only {
            let norm = self.norm(trees, means.crew)?;
            let link_error = self.link_error(&statistics);
            return Ok(Attempt { statistics, threshold_w_m, norm, link_error, unshot_error: 0.0 });
        }
        let may_suffice = pilot && target >= PILOT_ONLY && !pass.mixes();
        if may_suffice {
            norm_w_m = self.norm(trees, means.crew)?;
            let (found, wanted) = (self.link_error(&statistics), target * norm_w_m);
            if found <= HOPEFUL * wanted {
                // The target may be within reach at once, and with links no finer than it takes.
                threshold_w_m *= (wanted / found).powf(1.0 / self.growth()).clamp(1.0, COARSEST);
                error = target;
            }
        }
        let rules = self.rules(threshold_w_m, aim_w_m);
        let pass = self.pass((&rules, !pilot), (error, norm_w_m), &means.occluders, batches);
        let done = if reflected.is_empty() { 0.0 } else { REFLECTED_SHARE };
        let mut shot_w = pass.reflect(trees, reflected, means.crew, watch, &mut statistics)?;
        pass.interreflect(trees, (done, &mut shot_w), means.crew, watch, &mut statistics)?;
        let norm_w_m = self.norm(trees, means.crew)?;
        if may_suffice && self.link_error(&statistics) <= LINK_SHARE * target * norm_w_m {
            // Links are good enough already: what is left to send need not wait for another pass.
            let pass = self.pass((&rules, !pilot), (target, norm_w_m), &means.occluders, batches);
            pass.interreflect(trees, (1.0, &mut shot_w), means.crew, watch, &mut statistics)?;
        }
        add_ambient(trees, &shot_w);
        Ok(Attempt {
            statistics,
            threshold_w_m,
            norm: self.norm(trees, means.crew)?,
            link_error: self.link_error(&statistics),
            unshot_error: SPREAD * statistics.unshot_w * self.gain / self.area_m2.sqrt(),
        })
    }

    fn rules(&self, threshold_w_m: f64, allowed_w_m: f64) -> Rules {
        let root_area = self.area_m2.sqrt();
        Rules {
            oracle: self.options.oracle,
            threshold_w_m,
            reference_w_m2: self.guess_norm() / root_area,
            least_reflectance: self.mean_reflectance,
            point_w_m2: match self.options.basis {
                // Constants deviate everywhere: all links would go down all the way.
                Basis::Haar => f64::INFINITY,
                Basis::M2 | Basis::M3 => POINT_LIMIT * allowed_w_m / root_area,
            },
            samples: SampleRules::new(self.options.basis),
        }
    }

    fn pass<'b>(
        &'b self,
        (rules, lit): (&'b Rules, bool),
        (error, norm_w_m): (f64, f64),
        occluders: &'b Copies<Box<dyn Occluder + Send>>,
        batches: Batches,
    ) -> Pass<'b, N> {
        let (root_area, allowed_w_m) = (self.area_m2.sqrt(), error * norm_w_m);
        Pass {
            lamps: &self.lamps,
            emitters: &self.emitters,
            occluder: self.occluder,
            occluders,
            rules,
            lit,
            direct_only: self.options.direct_only,
            norm_w_m,
            gain: self.gain,
            stop_w: UNSHOT_SHARE * allowed_w_m * root_area / (SPREAD * self.gain.max(1e-9)),
            prune_w_m2: 0.02 * allowed_w_m / root_area,
            batches,
        }
    }

    /// The norm of reflected radiosity in W/m.
    fn norm(&self, trees: &mut [Tree<N>], crew: &mut Crew<'_>) -> Result<f64, WorkerPanic> {
        let squares = crew.map(trees, |_| true, |tree| tree.reflected_norm_squared())?;
        Ok(squares.iter().sum::<f64>().sqrt())
    }

    /// What the errors of links come to in the solution, in W/m.
    fn link_error(&self, statistics: &PassStatistics) -> f64 {
        let unseen = (0.01 / self.options.error).max(1.0).powf(UNSEEN_GROWTH);
        let reflected = (REFLECTED.0 * self.gain.sqrt()).hypot(REFLECTED.1 * self.gain);
        let calibration = LINK_CALIBRATION * reflected.hypot(1.0) * unseen;
        calibration * statistics.error_squared.sqrt()
    }

    /// Link errors grow with this power of the threshold, which depends on the order (measured).
    fn growth(&self) -> f64 {
        match self.options.basis {
            Basis::Haar => 0.5,
            Basis::M2 => 0.6,
            Basis::M3 => 0.65,
        }
    }

    fn outcome(
        &self,
        attempt: Attempt,
        fields: Vec<Field>,
        mut trees: Vec<Tree<N>>,
        work: Work,
        passes: usize,
        means: Means<'_, '_, '_>,
    ) -> Result<Outcome, WorkerPanic> {
        let statistics = attempt.statistics;
        let error = attempt.link_error.hypot(attempt.unshot_error);
        let first = statistics.first_reflection_w;
        let elements = fields.iter().map(Field::leaves).sum();
        let visibility = self.occluder.bytes() * (1 + means.occluders.len());
        let others = [
            ("packets", statistics.packet_bytes),
            ("visibility", visibility as u64),
            ("solution", fields.iter().map(Field::bytes).sum::<usize>() as u64),
        ];
        let footprint = means.crew.footprint(&mut trees, others)?;
        let surface = |tree: &Tree<N>| self.surfaces[tree.patch.surface as usize].clone();
        let solution = Solution {
            scene: self.scene.clone(),
            surfaces: means.crew.fell(&mut trees, surface)?,
            fields,
            error_target: self.options.error,
            error_estimate: if attempt.norm > 0.0 { error / attempt.norm } else { 0.0 },
            incomplete: statistics.interrupted,
        };
        let cost = attempt.work().cost().max(1) as f64;
        let share = |longest: u64| longest as f64 / cost;
        Ok(Outcome {
            longest_receivers: share(statistics.longest.receiver),
            longest_chains: share(statistics.longest.chain),
            unshot_fraction: if first > 0.0 { statistics.unshot_w / first } else { 0.0 },
            elements,
            footprint,
            statistics,
            work,
            passes,
            solution,
        })
    }
}

impl Attempt {
    fn work(&self) -> Work {
        let mut work = self.statistics.direct;
        work += self.statistics.interreflection;
        work
    }
}

fn square_sum(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum()
}
