//! A pass over the scene, in batches: direct illumination, what a first solution reflects, then progressive shooting (the paper's
//! section 4) of what is left.

use std::time::Instant;

use ccnuma::WorkerPanic;

use crate::radiosity::Tree;
use crate::transport::lamp::Lamp;
use crate::transport::{Clusters, Packet, Rules, Unresolved, Work, by_place};
use crate::visibility::Occluder;

use super::batch::{Batch, Batches, brightest};
use super::copies::Copies;
use super::crew::{Crew, Longest};
use super::mixing::{LEAST_GAIN, Look, Mixer, PATIENCE, shooters};
use super::walks::Supply;
use super::watch::{Stage, Watch};

/// Share of interreflection that sending a first solution's light takes, for the progress shown.
pub(super) const REFLECTED_SHARE: f64 = 0.8;

/// So many sources are looked at to tell receivers that will cost much from those that will not; what is expected counts in such parts.
const LOOKED_AT: usize = 64;
const COST_UNIT: f64 = 100.0;

/// A norm is far too low a guess from this factor on.
const FAR_TOO_LOW: f64 = 2.0;

/// What a pass is to do.
#[derive(Clone, Copy)]
pub struct Pass<'a, const N: usize> {
    /// Lights without area.
    pub lamps: &'a [Lamp<N>],
    /// What surfaces emit.
    pub emitters: &'a [Packet<N>],
    /// What may stand between.
    pub occluder: &'a dyn Occluder,
    /// Copies of it near the workers.
    pub(super) occluders: &'a Copies<Box<dyn Occluder + Send>>,
    /// Rules of the pair tasks.
    pub rules: &'a Rules,
    /// Whether the trees hold a first solution: every surface sends what it reflects by it once, and from then on only what the new solution
    /// differs from the old.
    pub lit: bool,
    /// Whether to stop after direct illumination.
    pub direct_only: bool,
    /// The norm of reflected radiosity in W/m that rules, `stop_w` and `prune_w_m2` go by; far too low a guess is put right on the way.
    pub norm_w_m: f64,
    /// `ρ/(1 − ρ)` of the scene.
    pub gain: f64,
    /// Stop once this much power in W is left unshot.
    pub stop_w: f64,
    /// Detail of packets below this is averaged, in W/m².
    pub prune_w_m2: f64,
    /// How many surfaces shoot at once.
    pub batches: Batches,
}

/// What a pass did.
#[derive(Clone, Copy, Debug, Default)]
pub struct PassStatistics {
    /// Work in direct illumination.
    pub direct: Work,
    /// Work in interreflection.
    pub interreflection: Work,
    /// Sum of the squared link errors in W²/m².
    pub error_squared: f64,
    /// Those of light that was not resolved.
    pub unresolved: Unresolved,
    /// Seconds in direct illumination.
    pub direct_s: f64,
    /// Seconds in interreflection.
    pub interreflection_s: f64,
    /// Emitters shot, lights included.
    pub shots: u64,
    /// Batches of shots; between two of them all receivers must be done. Where light is gathered, its iterations and direct light.
    pub batches: u64,
    /// What no number of workers can be faster than.
    pub longest: Longest,
    /// Bytes of the packets of the largest batch, copies included.
    pub packet_bytes: u64,
    /// How often light was gathered.
    pub iterations: u64,
    /// The most bytes of links stored at once.
    pub link_bytes: u64,
    /// Whether there was no room for links in the last iteration.
    pub links_refused: bool,
    /// Power left unshot in W.
    pub unshot_w: f64,
    /// Share of what surfaces send that transport lost, or made if it is negative, before the ambient correction put that right; `None` where it
    /// does not.
    pub lost: Option<f64>,
    /// Power sent by the lights in W that arrived, reflected once.
    pub first_reflection_w: f64,
    /// How many times the norm is larger than what the pass was told, if that was far too low; else 1.
    pub growth: f64,
    /// Whether states were mixed.
    pub mixed: bool,
    /// Whether the pass was interrupted.
    pub interrupted: bool,
}

impl<const N: usize> Pass<'_, N> {
    /// Direct illumination. Trees that hold light are taken as a first solution: what each of them reflects by it is returned, to be sent.
    pub(super) fn illuminate(
        &self,
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
        watch: &Watch,
    ) -> Result<(PassStatistics, Vec<Packet<N>>), WorkerPanic> {
        let start = Instant::now();
        watch.stage(Stage::Direct);
        crew.map(trees, |tree| tree.store.is_some(), |tree| tree.store = None)?;
        if !self.lit && crew.plans() {
            let expected = crew.map(trees, |_| true, |tree| self.expected_cost(tree))?;
            crew.expect(expected);
        }
        crew.settle(trees)?;
        let reflected = self.begin(trees, crew)?;
        let mut statistics = PassStatistics { growth: 1.0, ..PassStatistics::default() };
        self.light_up(start, trees, crew, watch, &mut statistics)?;
        Ok((statistics, reflected))
    }

    /// Direct illumination once more, of elements that are there.
    pub(super) fn illuminate_again(
        &self,
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
        watch: &Watch,
        statistics: &mut PassStatistics,
    ) -> Result<(), WorkerPanic> {
        let start = Instant::now();
        crew.settle(trees)?;
        crew.map(trees, |_| true, Tree::darken)?;
        self.light_up(start, trees, crew, watch, statistics)
    }

    /// Direct illumination of dark trees.
    fn light_up(
        &self,
        start: Instant,
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
        watch: &Watch,
        statistics: &mut PassStatistics,
    ) -> Result<(), WorkerPanic> {
        self.shoot_known(self.lamps, self.emitters, (0.0, 1.0), trees, crew, watch, statistics)?;
        statistics.direct += take_work(trees);
        statistics.first_reflection_w = unshot_w(trees);
        statistics.direct_s += start.elapsed().as_secs_f64();
        self.conclude(trees, watch, statistics);
        Ok(())
    }

    /// Sends what surfaces `reflected` by a first solution, as interreflection; returns how much that is per band, in W.
    pub(super) fn reflect(
        &self,
        trees: &mut [Tree<N>],
        reflected: Vec<Packet<N>>,
        crew: &mut Crew<'_>,
        watch: &Watch,
        statistics: &mut PassStatistics,
    ) -> Result<[f64; N], WorkerPanic> {
        let start = Instant::now();
        watch.stage(Stage::Interreflection);
        if self.mixes() || self.gathers() {
            crew.map(trees, |_| true, Tree::keep_direct)?;
        }
        let shot_w = self.send(trees, reflected, (0.0, REFLECTED_SHARE), crew, watch, statistics)?;
        statistics.interreflection_s += start.elapsed().as_secs_f64();
        Ok(shot_w)
    }

    /// Sends all that surfaces `reflected`, which takes the stage from one share to another; nothing was sent before. Returns how much that is
    /// per band, in W.
    pub(super) fn send(
        &self,
        trees: &mut [Tree<N>],
        reflected: Vec<Packet<N>>,
        shares: (f64, f64),
        crew: &mut Crew<'_>,
        watch: &Watch,
        statistics: &mut PassStatistics,
    ) -> Result<[f64; N], WorkerPanic> {
        let mut shot_w = [0.0; N];
        for tree in trees.iter_mut() {
            tree.indirect_w = [0.0; N];
        }
        if !reflected.is_empty() {
            for packet in &reflected {
                for n in 0..N {
                    shot_w[n] += packet.nodes[0].coefficients[0][n] * trees[packet.surface as usize].area_m2;
                }
            }
            self.allot(&reflected, trees, crew)?;
            self.shoot_known(&[], &reflected, shares, trees, crew, watch, statistics)?;
            self.survey_links(trees, statistics);
            crew.discard(reflected)?;
            crew.map(trees, |_| true, Tree::measure_unshot)?;
        }
        Ok(shot_w)
    }

    /// Has surfaces shoot until little is left; of interreflection the share `done` is behind, and `shot_w` counts what is sent.
    pub(super) fn interreflect(
        &self,
        trees: &mut [Tree<N>],
        (done, shot_w): (f64, &mut [f64; N]),
        crew: &mut Crew<'_>,
        watch: &Watch,
        statistics: &mut PassStatistics,
    ) -> Result<(), WorkerPanic> {
        let start = Instant::now();
        self.shoot_brightest(trees, (done, shot_w), crew, watch, statistics)?;
        statistics.interreflection += take_work(trees);
        statistics.interreflection_s += start.elapsed().as_secs_f64();
        self.conclude(trees, watch, statistics);
        Ok(())
    }

    fn conclude(&self, trees: &[Tree<N>], watch: &Watch, statistics: &mut PassStatistics) {
        statistics.error_squared = trees.iter().map(|tree| tree.error_squared).sum();
        statistics.unresolved = Unresolved::default();
        trees.iter().for_each(|tree| statistics.unresolved += tree.unresolved);
        statistics.unshot_w = unshot_w(trees);
        statistics.interrupted = watch.stopped();
    }

    /// What a tree may cost in direct illumination, beside the others. Of many sources some stand for all.
    fn expected_cost(&self, tree: &Tree<N>) -> u64 {
        self.expected_from(self.lamps, self.emitters, tree)
    }

    /// What a tree may cost by light from these, beside the others.
    pub(super) fn expected_from(&self, lamps: &[Lamp<N>], packets: &[Packet<N>], tree: &Tree<N>) -> u64 {
        let every = (lamps.len() + packets.len()).div_ceil(LOOKED_AT).max(1);
        let area_m2 = tree.area_m2;
        let of_lamps = lamps.iter().step_by(every);
        let of_lamps = of_lamps.map(|lamp| tree.patch.expected_cost(lamp, area_m2, self.rules));
        let of_surfaces = packets.iter().step_by(every);
        let of_surfaces = of_surfaces.map(|packet| tree.patch.expected_cost(packet, area_m2, self.rules));
        (COST_UNIT * of_lamps.chain(of_surfaces).sum::<f64>()) as u64
    }

    /// Makes the trees dark, and what they reflect packets if it is to be sent on.
    fn begin(&self, trees: &mut [Tree<N>], crew: &mut Crew<'_>) -> Result<Vec<Packet<N>>, WorkerPanic> {
        if self.lit && !self.direct_only {
            return self.restart(trees, crew);
        }
        if self.lit {
            crew.map(trees, |_| true, Tree::darken)?;
        }
        Ok(Vec::new())
    }

    /// Takes the light that the trees reflect into packets, the brightest first. Surfaces that reflect least, together half of what may be
    /// left unshot, send nothing yet.
    pub(super) fn restart(
        &self,
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
    ) -> Result<Vec<Packet<N>>, WorkerPanic> {
        crew.map(trees, |_| true, Tree::unshoot)?;
        let mut rank = vec![None; trees.len()];
        let kept_w = if self.gathers() { f64::NEG_INFINITY } else { 0.5 * self.stop_w };
        for (place, index) in brightest(trees, kept_w).into_iter().enumerate() {
            rank[index] = Some(place);
        }
        let rank = |surface: u32| rank[surface as usize];
        let restart = |tree: &mut Tree<N>| match rank(tree.patch.surface) {
            Some(_) => Some(tree.restart(self.prune_w_m2)),
            None => {
                tree.darken();
                None
            }
        };
        let mut packets: Vec<Packet<N>> = crew.map(trees, |_| true, restart)?.into_iter().flatten().collect();
        packets.sort_by_key(|packet| rank(packet.surface));
        Ok(packets)
    }

    fn shoot_brightest(
        &self,
        trees: &mut [Tree<N>],
        (done, shot_w): (f64, &mut [f64; N]),
        crew: &mut Crew<'_>,
        watch: &Watch,
        statistics: &mut PassStatistics,
    ) -> Result<(), WorkerPanic> {
        let first = unshot_w(trees);
        // Power decays geometrically: progress on a logarithmic scale.
        let share = |left: f64| done + (1.0 - done) * (first / left).ln() / (first / self.stop_w).ln();
        let progress = |left: f64| watch.batch(share(left), share(left), 1);
        let supply = Supply::Brightest { stop_w: self.stop_w, prune_w_m2: self.prune_w_m2, left: &progress };
        if let Some(sent_w) = self.walk(&supply, *shot_w, trees, crew, watch, statistics)? {
            *shot_w = sent_w;
            return Ok(());
        }
        match self.gathers() {
            true => self.gather(shot_w, &share, trees, crew, watch, statistics)?,
            false => self.iterate(shot_w, &progress, trees, crew, watch, statistics)?,
        }
        if self.mixes() || self.gathers() {
            crew.map(trees, |_| true, Tree::forget_direct)?;
        }
        Ok(())
    }

    /// Has surfaces shoot until little is left.
    fn iterate(
        &self,
        shot_w: &mut [f64; N],
        progress: &dyn Fn(f64),
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
        watch: &Watch,
        statistics: &mut PassStatistics,
    ) -> Result<(), WorkerPanic> {
        let mut mixer = self.mixes().then(|| Mixer::new(self.gain, PATIENCE));
        loop {
            let left = unshot_w(trees);
            if left <= self.stop_w || watch.stopped() {
                return Ok(());
            }
            progress(left);
            let shooters = match &mut mixer {
                None => self.batches.choose(trees, self.stop_w),
                Some(mixer) => match mixer.look(trees, shot_w, crew)? {
                    Look::Fine => shooters(trees, self.stop_w),
                    Look::Stuck => return Ok(()),
                    Look::Mixed => {
                        statistics.mixed = true;
                        let Some(growth) = self.growth(trees, crew, statistics)? else { continue };
                        let rules = self.rules.brighter(growth);
                        let brighter = self.brighter(growth, &rules);
                        return brighter.iterate(shot_w, progress, trees, crew, watch, statistics);
                    }
                },
            };
            let shoots = |tree: &Tree<N>| shooters.binary_search(&(tree.patch.surface as usize)).is_ok();
            let taken =
                crew.map(trees, shoots, |tree| (tree.unshot_by_band_w(), tree.take_packet(self.prune_w_m2)))?;
            let (powers_w, mut packets): (Vec<[f64; N]>, Vec<Packet<N>>) = taken.into_iter().unzip();
            by_place(&mut packets);
            for power_w in powers_w {
                for n in 0..N {
                    shot_w[n] += power_w[n];
                }
            }
            self.shoot(
                &Batch { lamps: &[], packets: &packets, clusters: None },
                trees,
                crew,
                watch,
                statistics,
            )?;
            crew.discard(packets)?;
        }
    }

    /// How much brighter all is than the pass was told, if that was far too low a guess.
    pub(super) fn growth(
        &self,
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
        statistics: &mut PassStatistics,
    ) -> Result<Option<f64>, WorkerPanic> {
        let growth = reflected_norm(trees, crew)? / self.norm_w_m;
        let far_too_low = growth > FAR_TOO_LOW;
        if far_too_low {
            statistics.growth *= growth;
        }
        Ok(far_too_low.then_some(growth))
    }

    /// Whether states are mixed. The paper's schedules do without.
    pub(super) fn mixes(&self) -> bool {
        self.gain >= LEAST_GAIN && matches!(self.batches, Batches::Fitted | Batches::All { .. })
    }

    /// The same pass where all is so many times brighter.
    pub(super) fn brighter<'b>(&'b self, times: f64, rules: &'b Rules) -> Pass<'b, N> {
        let (norm_w_m, stop_w) = (times * self.norm_w_m, times * self.stop_w);
        Pass { rules, norm_w_m, stop_w, prune_w_m2: times * self.prune_w_m2, ..*self }
    }

    /// Shoots sources that are all known; they take the stage from one share to another.
    #[allow(clippy::too_many_arguments)]
    fn shoot_known(
        &self,
        lamps: &[Lamp<N>],
        packets: &[Packet<N>],
        (from, to): (f64, f64),
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
        watch: &Watch,
        statistics: &mut PassStatistics,
    ) -> Result<(), WorkerPanic> {
        let none: &[Packet<N>] = &[];
        let whole = match self.batches {
            Batches::Fitted | Batches::All { .. } => true,
            Batches::Single => false,
            Batches::None(_) => crew.is_team(),
        };
        let batches: Vec<Batch<'_, N>> = match whole {
            true => vec![Batch { lamps, packets, clusters: None }],
            false => {
                let lamps = lamps.chunks(1).map(|lamps| Batch { lamps, packets: none, clusters: None });
                let packets = packets.chunks(1).map(|packets| Batch { lamps: &[], packets, clusters: None });
                lamps.chain(packets).collect()
            }
        };
        let count = batches.len() as f64;
        for (i, batch) in batches.iter().enumerate() {
            let share = |i: usize| from + (to - from) * i as f64 / count;
            watch.batch(share(i), share(i + 1), trees.len());
            self.shoot(batch, trees, crew, watch, statistics)?;
        }
        Ok(())
    }

    fn shoot(
        &self,
        batch: &Batch<'_, N>,
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
        watch: &Watch,
        statistics: &mut PassStatistics,
    ) -> Result<(), WorkerPanic> {
        if batch.is_empty() {
            return Ok(());
        }
        let bytes = |packets: &[Packet<N>]| packets.iter().map(Packet::bytes).sum::<usize>() as u64;
        if self.walk(&Supply::Given(*batch), [0.0; N], trees, crew, watch, statistics)?.is_some() {
            statistics.packet_bytes = statistics.packet_bytes.max(bytes(batch.packets));
            return Ok(());
        }
        let clusters = Clusters::of(batch.packets, self.rules);
        let copies = crew.copy_all(batch.packets, batch.packets.iter().map(Packet::most_bytes).sum())?;
        let longest = crew.light(trees, |tree, scratch, helpers, node| {
            let packets = copies.on(node).map_or(batch.packets, |packets| packets);
            let occluder = self.occluder_on(node);
            let near = Batch { packets, clusters: clusters.as_ref(), ..*batch };
            near.light(tree, (occluder, self.rules), scratch, helpers, watch);
        })?;
        let copied: u64 = copies.each().map(|packets| bytes(packets)).sum();
        statistics.packet_bytes = statistics.packet_bytes.max(bytes(batch.packets) + copied);
        statistics.longest.receiver += longest.receiver;
        statistics.longest.chain += longest.chain;
        statistics.shots += batch.len() as u64;
        statistics.batches += 1;
        Ok(())
    }

    /// What a node's workers ask what may stand between.
    fn occluder_on(&self, node: usize) -> &dyn Occluder {
        self.occluders.on(node).map_or(self.occluder, |occluder| &**occluder)
    }

    /// Has a team walk where there are no batches, else does nothing; returns what was sent with `shot_w` before.
    fn walk(
        &self,
        supply: &Supply<'_, N>,
        shot_w: [f64; N],
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
        watch: &Watch,
        statistics: &mut PassStatistics,
    ) -> Result<Option<[f64; N]>, WorkerPanic> {
        let Batches::None(walks) = self.batches else { return Ok(None) };
        let walked = crew.walk(trees, |trees, team, room| {
            let occluder = |node| self.occluder_on(node);
            walks.run(trees, (supply, shot_w), (&occluder, self.rules), watch, team, room)
        })?;
        let Some((walked, longest)) = walked else { return Ok(None) };
        statistics.longest.receiver += longest.receiver;
        statistics.longest.chain += longest.chain;
        statistics.shots += walked.shots as u64;
        statistics.batches += (walked.shots > 0) as u64;
        Ok(Some(walked.shot_w))
    }
}

/// The norm of reflected radiosity in W/m, all surfaces.
pub(super) fn reflected_norm<const N: usize>(
    trees: &mut [Tree<N>],
    crew: &mut Crew<'_>,
) -> Result<f64, WorkerPanic> {
    let squares = crew.map(trees, |_| true, |tree| tree.reflected_norm_squared())?;
    Ok(squares.iter().sum::<f64>().sqrt())
}

/// Power left to shoot in W, all surfaces.
pub(super) fn unshot_w<const N: usize>(trees: &[Tree<N>]) -> f64 {
    trees.iter().map(|tree| tree.unshot_w).sum()
}

/// The work done on all surfaces; their accounts start anew.
fn take_work<const N: usize>(trees: &mut [Tree<N>]) -> Work {
    let mut sum = Work::default();
    for tree in trees {
        sum += std::mem::take(&mut tree.work);
        tree.span = 0;
    }
    sum
}
