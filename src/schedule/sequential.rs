//! The sequential schedule: direct illumination, then progressive shooting, one pair after the other (the paper's section 4).

use std::time::Instant;

use crate::radiosity::{Tree, add_ambient};
use crate::transport::lamp::Lamp;
use crate::transport::{Packet, Rules, Scratch, Source, Work, shoot};
use crate::visibility::Occluder;

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
}

/// What a pass did.
#[derive(Clone, Copy, Debug, Default)]
pub struct PassStatistics {
    /// Work in direct illumination.
    pub direct: Work,
    /// Work in interreflection.
    pub interreflection: Work,
    /// Seconds in direct illumination.
    pub direct_s: f64,
    /// Seconds in interreflection.
    pub interreflection_s: f64,
    /// Emitters shot, lights included.
    pub shots: u64,
    /// Batches of shots between which all workers meet.
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
        self.direct(trees, &mut scratch, &mut statistics, observer);
        statistics.direct = std::mem::take(&mut scratch.work);
        statistics.direct_s = start.elapsed().as_secs_f64();
        let start = Instant::now();
        if !self.direct_only {
            self.interreflect(trees, &reflected, &mut scratch, &mut statistics, observer);
        }
        statistics.interreflection = scratch.work;
        statistics.interreflection_s = start.elapsed().as_secs_f64();
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

    fn direct(
        &self,
        trees: &mut [Tree<N>],
        scratch: &mut Scratch,
        statistics: &mut PassStatistics,
        observer: &mut dyn Observer,
    ) {
        let emitters: Vec<Packet<N>> = trees
            .iter()
            .filter(|tree| tree.exitance_w_m2.iter().any(|m| *m > 0.0))
            .map(Tree::exitance_packet)
            .collect();
        let total = (emitters.len() + self.lamps.len()) as f64;
        for lamp in self.lamps {
            statistics.first_reflection_w += self.shoot_all(lamp, trees, scratch, statistics, observer);
            observer.progress(Stage::Direct, statistics.shots as f64 / total);
        }
        for packet in &emitters {
            statistics.first_reflection_w += self.shoot_all(packet, trees, scratch, statistics, observer);
            observer.progress(Stage::Direct, statistics.shots as f64 / total);
        }
    }

    fn interreflect(
        &self,
        trees: &mut [Tree<N>],
        reflected: &[Packet<N>],
        scratch: &mut Scratch,
        statistics: &mut PassStatistics,
        observer: &mut dyn Observer,
    ) {
        let mut shot_w = [0.0; N];
        for tree in trees.iter_mut() {
            tree.indirect_w = [0.0; N];
        }
        for packet in reflected {
            for n in 0..N {
                shot_w[n] += packet.nodes[0].coefficients[0][n] * trees[packet.surface as usize].area_m2;
            }
            self.shoot_all(packet, trees, scratch, statistics, observer);
        }
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
            let brightest = (0..trees.len())
                .max_by(|a, b| trees[*a].unshot_w.total_cmp(&trees[*b].unshot_w).then(b.cmp(a)))
                .expect("power is left, so there is a surface");
            let power_w = trees[brightest].unshot_by_band_w();
            for n in 0..N {
                shot_w[n] += power_w[n];
            }
            let packet = trees[brightest].take_packet(self.prune_w_m2);
            self.shoot_all(&packet, trees, scratch, statistics, observer);
        }
    }

    fn shoot_all(
        &self,
        source: &impl Source<N>,
        trees: &mut [Tree<N>],
        scratch: &mut Scratch,
        statistics: &mut PassStatistics,
        observer: &mut dyn Observer,
    ) -> f64 {
        let mut to_reflect_w = 0.0;
        for tree in trees.iter_mut() {
            if statistics.interrupted {
                return to_reflect_w;
            }
            let deposited = shoot(source, &tree.patch, &mut tree.root, self.occluder, self.rules, scratch);
            tree.unshot_w += deposited.to_reflect_w;
            to_reflect_w += deposited.to_reflect_w;
            for n in 0..N {
                tree.indirect_w[n] += deposited.received_w[n];
            }
            statistics.interrupted = observer.interrupted();
        }
        statistics.shots += 1;
        statistics.batches += 1;
        to_reflect_w
    }
}

/// Power left to shoot in W, all surfaces.
pub fn unshot_w<const N: usize>(trees: &[Tree<N>]) -> f64 {
    trees.iter().map(|tree| tree.unshot_w).sum()
}
