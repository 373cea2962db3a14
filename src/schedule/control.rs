//! Error control: passes at decreasing link thresholds until the estimated error meets the target.
//!
//! The target is `E ‖B − M‖`, the relative L2 error of reflected radiosity (stricter than the contract's `‖B‖`, which a bright lamp
//! would dominate). How it is divided stands in `budget`. A cheap pilot pass tells the norm and how link errors add up; the threshold of the
//! next pass follows from their growth with it. Each pass starts from the solution of the one before: fine links carry every surface's light
//! once, not shot by shot. A coarse target the pilot may meet by itself.

use ccnuma::arena::Memory;
use ccnuma::counters::Counters;
use ccnuma::{Team, WorkerPanic};

use crate::math::Basis;
use crate::radiosity::{Field, Solution, Tree, add_ambient, extent_m, field_packet};
use crate::scene::{Scene, Surface};
use crate::transport::lamp::Lamp;
use crate::transport::{Oracle, Packet, Rules, SampleRules, Unresolved, Work, by_place};
use crate::visibility::Occluder;

use super::batch::Batches;
use super::budget::Budget;
use super::copies::Copies;
use super::crew::Crew;
use super::enclosure;
use super::footprint::Footprint;
use super::gathering::COARSER_PILOT;
use super::guess::{self, even_norm_w_m};
use super::pass::{Pass, PassStatistics, REFLECTED_SHARE, reflected_norm};
use super::record::Record;
use super::watch::{Observer, Watch, observed};

/// Passes after the pilot, at most. The third may miss the target yet where light goes to and fro through a door and fades at ρ 0.99.
const MAX_PASSES: usize = 4;

/// The region that a run is counted as.
pub const COUNTED: &str = "solve";

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
    /// What counts the run as [`COUNTED`], on the team's workers and the thread that does the rest; without a team, all of it.
    pub counters: Option<&'t Counters>,
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
    /// Relative L2 errors that light is estimated to cause that was not resolved, each kind by itself: in squares a part of the solution's.
    pub unresolved_errors: Unresolved,
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
        let Schedule { team, batches, memory, counters } = schedule;
        let solve = |team: Option<&mut Team>| {
            let mut crew = Crew::new(team, memory, surfaces)?;
            let occluders = crew.copy(occluder.bytes(), || occluder.replica())?;
            let means = Means { batches, crew: &mut crew, occluders, watch };
            solve_in_bands(scene, surfaces, None, occluder, options, means)
        };
        match counters {
            None => solve(team),
            Some(counters) => counters.span(team, COUNTED, solve)?,
        }
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
    /// All of that by surface, in W per band.
    emitted_w: Vec<[f64; N]>,
    /// The norm of reflected radiosity in W/m, guessed.
    even_norm_w_m: f64,
    /// Area-weighted mean over surfaces of the largest reflectance over bands.
    mean_reflectance: f64,
    budget: Budget,
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
    /// How many times that it errs by, link errors adding up.
    repeated: f64,
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
        let (extent, target, basis) = (extent_m(scene), options.error, options.basis);
        let lamps = scene.lights.iter().map(|light| Lamp::new(light, extent)).collect();
        let emits = |s: &Surface| s.exitance_w_m2.iter().any(|m| *m > 0.0);
        let (mut emitters, mut emitted_w) = (Vec::new(), vec![[0.0; N]; surfaces.len()]);
        let mut emit = |i: usize, field: &Field| {
            emitters.push(field_packet(i, &surfaces[i], field, |_, _, m| m));
            let power_w = field.power_w(&surfaces[i]);
            emitted_w[i] = std::array::from_fn(|n| power_w[n]);
        };
        match exitance {
            Some(fields) => fields.iter().enumerate().for_each(|(i, field)| emit(i, field)),
            None => {
                let lit = surfaces.iter().enumerate().filter(|(_, s)| emits(s));
                lit.for_each(|(i, s)| emit(i, &Field::even(&s.exitance_w_m2)));
            }
        }
        by_place(&mut emitters);
        let gain = rho / (1.0 - rho);
        Self {
            even_norm_w_m: even_norm_w_m(&scene.lights, surfaces, &emitters, gain),
            scene,
            surfaces,
            occluder,
            options,
            lamps,
            emitters,
            emitted_w,
            mean_reflectance: mean,
            budget: Budget { target, basis, gain, root_area_m: area_m2.sqrt() },
        }
    }

    fn solve(&self, mut means: Means<'_, '_, '_>) -> Result<Outcome, WorkerPanic> {
        let watch = means.watch;
        let mut work = Work::default();
        watch.pass(0);
        let mut trees = means.crew.grow::<N>(self.surfaces, self.basis_by(means.batches))?;
        // In the open, light stays near where it falls: there it makes a larger norm than if it were spread evenly.
        let (budget, sources) = (self.budget, (&self.lamps[..], &self.emitters[..]));
        let guess = guess::norm_w_m(self.even_norm_w_m, sources, self.occluder, &mut trees, means.crew)?;
        let mut threshold = budget.first_threshold_w_m(guess, self.surfaces.len());
        if matches!(means.batches, Batches::All { .. }) && !budget.pilot_may_suffice() {
            threshold *= COARSER_PILOT;
        }
        let first = (budget.pilot_error(), guess);
        let mut attempt = self.attempt(&mut trees, threshold, first, true, &mut means)?;
        let mut threshold = attempt.threshold_w_m;
        let (mut packet_bytes, mut link_bytes) =
            (attempt.statistics.packet_bytes, attempt.statistics.link_bytes);
        let mut finished = None;
        work += attempt.work();
        let mut passes = 1;
        while passes <= MAX_PASSES && !attempt.statistics.interrupted {
            let (links, norm) = (attempt.link_error, attempt.norm);
            // What elements as small as elements get lose, no threshold mends.
            let cut_short = budget.link_error_w_m(attempt.statistics.unresolved.cut_short);
            if budget.is_met(attempt.repeated * links, attempt.unshot_error, norm)
                || !budget.links_suffice(attempt.repeated * cut_short, norm)
            {
                break;
            }
            threshold *= attempt.statistics.growth;
            if links > 0.0 {
                // Errors of a pilot that mixed states are those of coarse links made many times brighter, and fall faster.
                let growth = if passes == 1 && attempt.statistics.mixed { 1.0 } else { budget.growth() };
                threshold *= budget.finer(passes, links, norm, growth);
            }
            watch.pass(passes);
            let fields = self.fields(&mut trees, &attempt, means.crew)?;
            let last = attempt;
            attempt = self.attempt(&mut trees, threshold, (budget.target, norm), false, &mut means)?;
            work += attempt.work();
            packet_bytes = packet_bytes.max(attempt.statistics.packet_bytes);
            link_bytes = link_bytes.max(attempt.statistics.link_bytes);
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
        (attempt.statistics.packet_bytes, attempt.statistics.link_bytes) = (packet_bytes, link_bytes);
        let fields = match finished {
            Some(fields) => fields,
            None => self.fields(&mut trees, &attempt, means.crew)?,
        };
        self.outcome(attempt, fields, trees, work, passes, means)
    }

    /// The basis of the trees. Stored links fit the functions that they were found for, so that packets must not change theirs.
    fn basis_by(&self, batches: Batches) -> Basis {
        match (self.options.basis, batches) {
            (Basis::Auto, Batches::All { .. }) => Basis::M3,
            (basis, _) => basis,
        }
    }

    /// What the trees have come to.
    fn fields(
        &self,
        trees: &mut [Tree<N>],
        attempt: &Attempt,
        crew: &mut Crew<'_>,
    ) -> Result<Vec<Field>, WorkerPanic> {
        let spare_w_m2 = self.budget.prune_w_m2(self.budget.target * attempt.norm);
        crew.map(trees, |_| true, |tree| tree.field().in_least_basis(spare_w_m2))
    }

    /// One pass, which is to err by `error` where the norm is as given. That of a pilot is known by guess only, and of a coarse target put
    /// right by the direct light found, which is computed again where it is too coarse for any interreflection to meet the target.
    fn attempt(
        &self,
        trees: &mut [Tree<N>],
        mut threshold_w_m: f64,
        (mut error, mut norm_w_m): (f64, f64),
        pilot: bool,
        means: &mut Means<'_, '_, '_>,
    ) -> Result<Attempt, WorkerPanic> {
        let (budget, batches, watch) = (self.budget, means.batches, means.watch);
        let repeated = if pilot { budget.shot_by_shot() } else { 1.0 };
        let link_error =
            |statistics: &PassStatistics| repeated * budget.link_error_w_m(statistics.error_squared);
        let aim_w_m = error * norm_w_m;
        let rules = self.rules(threshold_w_m, aim_w_m);
        let pass = self.pass((&rules, !pilot), (error, norm_w_m), &means.occluders, batches);
        let (mut statistics, reflected) = pass.illuminate(trees, means.crew, watch)?;
        if self.options.direct_only {
            let link_error = budget.link_error_w_m(statistics.error_squared);
            let (norm, repeated) = (reflected_norm(trees, means.crew)?, 1.0);
            return Ok(Attempt { statistics, threshold_w_m, norm, link_error, repeated, unshot_error: 0.0 });
        }
        let may_suffice = pilot && budget.pilot_may_suffice() && !pass.mixes();
        if may_suffice {
            norm_w_m = reflected_norm(trees, means.crew)?;
            if let Some(finer) = budget.again(link_error(&statistics), norm_w_m) {
                threshold_w_m *= finer;
                let rules = self.rules(threshold_w_m, aim_w_m);
                let pass = self.pass((&rules, !pilot), (error, norm_w_m), &means.occluders, batches);
                pass.illuminate_again(trees, means.crew, watch, &mut statistics)?;
                norm_w_m = reflected_norm(trees, means.crew)?;
            }
            if let Some(coarser) = budget.coarser(link_error(&statistics), norm_w_m) {
                threshold_w_m *= coarser;
                error = budget.target;
            }
        }
        let rules = self.rules(threshold_w_m, aim_w_m);
        let pass = self.pass((&rules, !pilot), (error, norm_w_m), &means.occluders, batches);
        let done = if reflected.is_empty() { 0.0 } else { REFLECTED_SHARE };
        let mut shot_w = pass.reflect(trees, reflected, means.crew, watch, &mut statistics)?;
        pass.interreflect(trees, (done, &mut shot_w), means.crew, watch, &mut statistics)?;
        if may_suffice {
            let norm_w_m = reflected_norm(trees, means.crew)?;
            if budget.links_suffice(link_error(&statistics), norm_w_m) {
                // Links are good enough already: what is left to send need not wait for another pass.
                let pass = self.pass((&rules, !pilot), (budget.target, norm_w_m), &means.occluders, batches);
                pass.interreflect(trees, (1.0, &mut shot_w), means.crew, watch, &mut statistics)?;
            }
        }
        let lost = match self.lamps.is_empty() && !statistics.interrupted {
            true => {
                enclosure::lost(error, &self.emitted_w, (self.surfaces, self.occluder), trees, means.crew)?
            }
            false => None,
        };
        statistics.lost = lost.map(|lost| lost.share);
        add_ambient(trees, &shot_w, lost.map(|lost| lost.power_w).as_ref());
        Ok(Attempt {
            statistics,
            threshold_w_m,
            norm: reflected_norm(trees, means.crew)?,
            link_error: budget.link_error_w_m(statistics.error_squared),
            repeated,
            unshot_error: budget.unshot_error_w_m(statistics.unshot_w),
        })
    }

    fn rules(&self, threshold_w_m: f64, allowed_w_m: f64) -> Rules {
        Rules {
            oracle: self.options.oracle,
            threshold_w_m,
            reference_w_m2: self.even_norm_w_m / self.budget.root_area_m,
            least_reflectance: self.mean_reflectance,
            point_w_m2: self.budget.point_w_m2(allowed_w_m),
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
        let allowed_w_m = error * norm_w_m;
        Pass {
            lamps: &self.lamps,
            emitters: &self.emitters,
            occluder: self.occluder,
            occluders,
            rules,
            lit,
            direct_only: self.options.direct_only,
            norm_w_m,
            gain: self.budget.gain,
            stop_w: self.budget.stop_w(allowed_w_m),
            prune_w_m2: self.budget.prune_w_m2(allowed_w_m),
            batches,
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
        let error = (attempt.repeated * attempt.link_error).hypot(attempt.unshot_error);
        let relative = |error_w_m: f64| if attempt.norm > 0.0 { error_w_m / attempt.norm } else { 0.0 };
        let by_links = |squared| relative(attempt.repeated * self.budget.link_error_w_m(squared));
        let first = statistics.first_reflection_w;
        let elements = fields.iter().map(Field::leaves).sum();
        let visibility = self.occluder.bytes() * (1 + means.occluders.len());
        let others = [
            ("packets", statistics.packet_bytes),
            ("visibility", visibility as u64),
            ("links", statistics.link_bytes),
            ("solution", fields.iter().map(Field::bytes).sum::<usize>() as u64),
        ];
        let footprint = means.crew.footprint(&mut trees, others)?;
        let surface = |tree: &Tree<N>| self.surfaces[tree.patch.surface as usize].clone();
        let solution = Solution {
            scene: self.scene.clone(),
            surfaces: means.crew.fell(&mut trees, surface)?,
            fields,
            error_target: self.options.error,
            error_estimate: relative(error),
            incomplete: statistics.interrupted,
        };
        let cost = attempt.work().cost().max(1) as f64;
        let share = |longest: u64| longest as f64 / cost;
        Ok(Outcome {
            longest_receivers: share(statistics.longest.receiver),
            longest_chains: share(statistics.longest.chain),
            unresolved_errors: statistics.unresolved.map(by_links),
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
