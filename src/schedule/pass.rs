//! A pass over the scene, in batches: direct illumination, what a first solution reflects, then progressive shooting (the paper's
//! section 4) of what is left.

use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

use crate::radiosity::{Tree, add_ambient};
use crate::transport::lamp::Lamp;
use crate::transport::{Packet, Rules, Scratch, Work};
use crate::visibility::Occluder;

use super::batch::{Batch, Batches};
use super::control::{Observer, Stage};

/// What a pass is to do.
pub struct Pass<'a, const N: usize> {
    /// Lights without area.
    pub lamps: &'a [Lamp<N>],
    /// What may stand between.
    pub occluder: &'a dyn Occluder,
    /// Rules of the pair tasks.
    pub rules: &'a Rules,
    /// Whether to stop after direct illumination.
    pub direct_only: bool,
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
    /// Seconds in direct illumination.
    pub direct_s: f64,
    /// Seconds in interreflection.
    pub interreflection_s: f64,
    /// Emitters shot, lights included.
    pub shots: u64,
    /// Batches of shots; between two of them all receivers must be done.
    pub batches: u64,
    /// Power left unshot in W.
    pub unshot_w: f64,
    /// Power sent by the lights in W that arrived, reflected once.
    pub first_reflection_w: f64,
    /// Whether the pass was interrupted.
    pub interrupted: bool,
}

impl<const N: usize> Pass<'_, N> {
    /// Runs the pass. Trees that hold light are taken as a first solution: every surface sends what it reflects by it once, and from
    /// then on only what the new solution differs from the old.
    pub fn run(&self, trees: &mut [Tree<N>], observer: &mut dyn Observer) -> PassStatistics {
        let mut statistics = PassStatistics::default();
        let start = Instant::now();
        let mut scratch = Scratch::default();
        let reflected = self.restart(trees);
        observer.progress(Stage::Direct, 0.0);
        let emitters: Vec<Packet<N>> = trees
            .iter()
            .filter(|tree| tree.exitance_w_m2.iter().any(|m| *m > 0.0))
            .map(Tree::exitance_packet)
            .collect();
        let batch = Batch { lamps: self.lamps, packets: &emitters };
        self.shoot(&batch, trees, &mut scratch, &mut statistics, observer);
        statistics.direct = take_work(trees);
        statistics.first_reflection_w = unshot_w(trees);
        statistics.direct_s = start.elapsed().as_secs_f64();
        let start = Instant::now();
        if !self.direct_only {
            self.interreflect(trees, &reflected, &mut scratch, &mut statistics, observer);
        }
        statistics.interreflection = take_work(trees);
        statistics.interreflection_s = start.elapsed().as_secs_f64();
        statistics.error_squared = trees.iter().map(|tree| tree.error_squared).sum();
        statistics.unshot_w = unshot_w(trees);
        statistics
    }

    /// Takes the light that the trees reflect into packets. Surfaces that reflect least, together half of what may be left unshot, send
    /// nothing yet.
    fn restart(&self, trees: &mut [Tree<N>]) -> Vec<Packet<N>> {
        trees.iter_mut().for_each(Tree::unshoot);
        let mut order: Vec<usize> = (0..trees.len()).collect();
        order.sort_by(|a, b| trees[*b].unshot_w.total_cmp(&trees[*a].unshot_w).then(a.cmp(b)));
        let mut left = unshot_w(trees);
        let mut packets = Vec::new();
        for index in order {
            let tree = &mut trees[index];
            if left > 0.5 * self.stop_w {
                left -= tree.unshot_w;
                packets.push(tree.restart(self.prune_w_m2));
            } else {
                tree.darken();
            }
        }
        packets
    }

    fn interreflect(
        &self,
        trees: &mut [Tree<N>],
        reflected: &[Packet<N>],
        scratch: &mut Scratch,
        statistics: &mut PassStatistics,
        observer: &mut dyn Observer,
    ) {
        observer.progress(Stage::Interreflection, 0.0);
        let mut shot_w = [0.0; N];
        for tree in trees.iter_mut() {
            tree.indirect_w = [0.0; N];
        }
        for packet in reflected {
            for n in 0..N {
                shot_w[n] += packet.nodes[0].coefficients[0][n] * trees[packet.surface as usize].area_m2;
            }
        }
        self.shoot(&Batch { lamps: &[], packets: reflected }, trees, scratch, statistics, observer);
        if !reflected.is_empty() {
            trees.iter_mut().for_each(Tree::measure_unshot);
        }
        let first = unshot_w(trees);
        loop {
            let left = unshot_w(trees);
            if left <= self.stop_w || statistics.interrupted {
                return add_ambient(trees, &shot_w);
            }
            // Power decays geometrically: progress on a logarithmic scale.
            observer.progress(Stage::Interreflection, (first / left).ln() / (first / self.stop_w).ln());
            let mut packets = Vec::new();
            for shooter in self.batches.choose(trees) {
                let power_w = trees[shooter].unshot_by_band_w();
                for n in 0..N {
                    shot_w[n] += power_w[n];
                }
                packets.push(trees[shooter].take_packet(self.prune_w_m2));
            }
            self.shoot(&Batch { lamps: &[], packets: &packets }, trees, scratch, statistics, observer);
        }
    }

    fn shoot(
        &self,
        batch: &Batch<'_, N>,
        trees: &mut [Tree<N>],
        scratch: &mut Scratch,
        statistics: &mut PassStatistics,
        observer: &mut dyn Observer,
    ) {
        if batch.is_empty() {
            return;
        }
        let stop = AtomicBool::new(statistics.interrupted);
        for tree in trees.iter_mut() {
            batch.light(tree, self.occluder, self.rules, scratch, &stop);
            stop.fetch_or(observer.interrupted(), Relaxed);
        }
        statistics.interrupted = stop.into_inner();
        statistics.shots += batch.len() as u64;
        statistics.batches += 1;
    }
}

/// Power left to shoot in W, all surfaces.
fn unshot_w<const N: usize>(trees: &[Tree<N>]) -> f64 {
    trees.iter().map(|tree| tree.unshot_w).sum()
}

/// The work done on all surfaces; their accounts start anew.
fn take_work<const N: usize>(trees: &mut [Tree<N>]) -> Work {
    let mut sum = Work::default();
    trees.iter_mut().for_each(|tree| sum += std::mem::take(&mut tree.work));
    sum
}
