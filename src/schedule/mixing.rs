//! When states are mixed ([`crate::radiosity::mixing`]), and by what weight.
//!
//! The weight is that which leaves no unshot power over all surfaces together, band by band: the part of what is unshot that fades slowest
//! is of one sign everywhere. What is left is of both signs, and fades as fast as light spreads in the room, however much its walls reflect.
//! All sums are in the order of the surfaces, so that they do not depend on who works.

use ccnuma::WorkerPanic;

use crate::radiosity::{Power, Tree};

use super::batch::brightest;
use super::crew::Crew;

/// States are mixed in scenes of this gain `ρ/(1 − ρ)` or more.
pub(super) const LEAST_GAIN: f64 = 4.0;

/// Mixing must leave at most this share of what is still to come.
const WORTH: f64 = 0.5;

/// Share of the unshot power that the dimmest surfaces keep while the others shoot.
const KEPT: f64 = 0.02;

/// What is still to come must fall to this share within so many batches: the little that is left is transported so coarsely that more may
/// arrive than was sent, and would never fade where walls reflect nearly all of it.
const FADES: f64 = 0.7;
pub(super) const PATIENCE: u32 = 20;

/// Who shoots where states are mixed: all but the dimmest, for light that only some have sent is uneven, and fades the slower. `stop_w` is
/// the power in W that may be left unshot.
pub(super) fn shooters<const N: usize>(trees: &[Tree<N>], stop_w: f64) -> Vec<usize> {
    let left: f64 = trees.iter().map(|tree| tree.unshot_w).sum();
    let kept = (KEPT * left).max(0.5 * stop_w);
    let mut shooters = brightest(trees, kept);
    shooters.sort_unstable();
    shooters
}

/// Looks after every batch whether to mix.
pub(super) struct Mixer {
    gain: f64,
    patience: u32,
    /// What was still to come in W when it last had faded enough, and batches since then.
    faded: (f64, u32),
}

/// What a look showed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Look {
    /// Nothing to do.
    Fine,
    /// States were mixed.
    Mixed,
    /// What is unshot fades no more.
    Stuck,
}

/// The unshot power of a band in W.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Band {
    /// The weight to mix with; 0 where it is not worth while.
    weight: f64,
    /// What is still to come, mixed with that weight.
    to_come_w: f64,
}

impl Mixer {
    /// For a scene of this gain, where light must fade within so many batches.
    pub fn new(gain: f64, patience: u32) -> Self {
        Self { gain, patience, faded: (f64::INFINITY, 0) }
    }

    /// Mixes if it is worth while; `shot_w` is what was sent so far.
    pub fn look<const N: usize>(
        &mut self,
        trees: &mut [Tree<N>],
        shot_w: &mut [f64; N],
        crew: &mut Crew<'_>,
    ) -> Result<Look, WorkerPanic> {
        let powers = crew.map(trees, |_| true, |tree| tree.power())?;
        let brightest = |n: usize| trees.iter().map(|tree| tree.patch.reflectance[n]).fold(0.0, f64::max);
        let bands: [Band; N] = std::array::from_fn(|n| self.band(&powers, n, shot_w[n], brightest(n)));
        if self.is_stuck(bands.iter().map(|band| band.to_come_w).sum()) {
            return Ok(Look::Stuck);
        }
        let weight = bands.map(|band| band.weight);
        if weight == [0.0; N] {
            return Ok(Look::Fine);
        }
        crew.map(trees, |_| true, |tree| tree.mix(&weight))?;
        for n in 0..N {
            shot_w[n] *= 1.0 + weight[n];
        }
        Ok(Look::Mixed)
    }

    fn is_stuck(&mut self, to_come_w: f64) -> bool {
        self.faded.1 += 1;
        if to_come_w < FADES * self.faded.0 {
            self.faded = (to_come_w, 0);
        }
        self.faded.1 >= self.patience
    }

    /// A band in which so much was sent; `brightest` is its largest reflectance.
    fn band<const N: usize>(&self, powers: &[Power<N>], n: usize, shot_w: f64, brightest: f64) -> Band {
        let (mut unshot_w, mut direct_w, mut apart_w, mut most_w) = (0.0, 0.0, 0.0, 0.0);
        for power in powers {
            unshot_w += power.unshot_w[n];
            direct_w += power.direct_w[n];
            apart_w += power.unshot_w[n].abs();
            most_w += power.direct_w[n].abs() / (1.0 - brightest);
        }
        // No room sends more than its brightest surface everywhere would, whatever errors of transport add up to.
        let weight = (unshot_w / (direct_w - unshot_w)).min(most_w / shot_w.abs() - 1.0);
        let mixed = |power: &Power<N>| power.unshot_w[n] + weight * (power.unshot_w[n] - power.direct_w[n]);
        // What is of one sign is reflected on and on, what is of both soon meets its opposite.
        let to_come = |sum_w: f64, apart_w: f64| sum_w.abs() * self.gain + apart_w;
        let before_w = to_come(unshot_w, apart_w);
        let after_w =
            to_come(powers.iter().map(mixed).sum(), powers.iter().map(|power| mixed(power).abs()).sum());
        // Written so that a weight that is not a number is none.
        if 1.0 + weight > 0.0 && after_w < WORTH * before_w {
            Band { weight, to_come_w: after_w }
        } else {
            Band { weight: 0.0, to_come_w: before_w }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn powers(unshot_w: &[f64], direct_w: &[f64]) -> Vec<Power<1>> {
        let both = unshot_w.iter().zip(direct_w);
        both.map(|(unshot_w, direct_w)| Power { unshot_w: [*unshot_w], direct_w: [*direct_w] }).collect()
    }

    /// In a furnace of ρ 0.99 that has shot once, 0.99 of the direct light is unshot, and a hundred times it is to be sent in all.
    #[test]
    fn light_that_only_fades_is_summed_up() {
        let mixer = Mixer::new(99.0, PATIENCE);
        let band = mixer.band(&powers(&[0.99; 6], &[1.0; 6]), 0, 6.0, 0.99);
        assert!((band.weight - 99.0).abs() < 1e-9 && band.to_come_w < 1e-6, "{band:?}");
        let band = mixer.band(&powers(&[1.001; 6], &[1.0; 6]), 0, 6.0, 0.99);
        assert_eq!(band.weight, 0.0, "light cannot grow");
        let band = mixer.band(&powers(&[0.999; 6], &[1.0; 6]), 0, 6.0, 0.99);
        assert_eq!(band.weight, 0.0, "nor can a room send more than its walls reflect");
    }

    #[test]
    fn uneven_light_is_left_to_spread() {
        let mixer = Mixer::new(4.0, PATIENCE);
        let band = mixer.band(&powers(&[0.8, 0.0, 0.0, 0.0], &[0.0, 0.0, 0.5, 0.5]), 0, 1.0, 0.8);
        assert_eq!(band.weight, 0.0);
        let band = mixer.band(&powers(&[0.0; 4], &[0.0; 4]), 0, 0.0, 0.8);
        assert_eq!((band.weight, band.to_come_w), (0.0, 0.0), "nothing is lit");
    }

    #[test]
    fn what_does_not_fade_ends() {
        let mut mixer = Mixer::new(9.0, PATIENCE);
        assert!((0..100).all(|i| !mixer.is_stuck(0.9f64.powi(i))));
        assert!((0..PATIENCE).any(|_| mixer.is_stuck(0.9f64.powi(99))));
    }
}
