//! The ambient correction: what is still to arrive, spread as light so far has spread.
//!
//! Of the unshot power U a share κ (received over shot so far) arrives, of that a share ρ̄ is reflected again, and so on:
//! `F = κU/(1 − κρ̄)` in all. Surfaces get it in proportion to what they received by interreflection, so that a dark room beside a bright
//! one stays dark.
//!
//! Where hardly any light leaves, all must arrive, also what transport has lost on the way: with what is missing, A, the power that all surfaces
//! send less what they receive, that is `L = A − U`. Surfaces get it in proportion to all that they received, since nothing tells where it was
//! lost, and reflect a share ρ' of it: `F = (U + ρ'L)/(1 − ρ̄)`. Then sent and received are the same. What is lost counts for little where walls are dark, and a thousand times where they reflect 0.999.

use super::state::Tree;

/// Adds the correction to all trees, per band: `shot_w` is the power sent by interreflection so far, `lost_w` what transport has lost
/// where hardly any light leaves.
pub fn add_ambient<const N: usize>(trees: &mut [Tree<N>], shot_w: &[f64; N], lost_w: Option<&[f64; N]>) {
    let (all, indirect) = (Received::new(trees, received_w), Received::indirect(trees));
    let mut unshot_w = [0.0; N];
    for tree in trees.iter() {
        let of_tree_w = tree.unshot_by_band_w();
        (0..N).for_each(|n| unshot_w[n] += of_tree_w[n]);
    }
    // How many times what was received in all and by interreflection is to come.
    let shares: [(f64, f64); N] = std::array::from_fn(|n| {
        if shot_w[n] <= 0.0 || indirect.power_w[n] <= 0.0 || all.power_w[n] <= 0.0 {
            return (0.0, 0.0);
        }
        let (captured, lost_w) = match lost_w {
            Some(lost_w) => (1.0, lost_w[n]),
            None => ((indirect.power_w[n] / shot_w[n]).min(1.0), 0.0),
        };
        let reflected_w = captured * unshot_w[n] + all.reflectance(n) * lost_w;
        let to_come_w = reflected_w / (1.0 - captured * indirect.reflectance(n));
        (lost_w / all.power_w[n], to_come_w / indirect.power_w[n])
    });
    for tree in trees.iter_mut() {
        let (received_w, indirect_w) = (received_w(tree), indirect_w(tree));
        let ambient = std::array::from_fn(|n| {
            (shares[n].0 * received_w[n] + shares[n].1 * indirect_w[n]) / tree.area_m2
        });
        tree.root.add_ambient(ambient);
    }
}

/// What a tree received in all, in W per band.
fn received_w<const N: usize>(tree: &Tree<N>) -> [f64; N] {
    tree.root.mean_irradiance().map(|irradiance| (irradiance * tree.area_m2).max(0.0))
}

/// What it received by interreflection.
fn indirect_w<const N: usize>(tree: &Tree<N>) -> [f64; N] {
    tree.indirect_w.map(|power_w| power_w.max(0.0))
}

/// What all trees received, and what they reflect of it, in W per band.
#[derive(Clone, Copy, Debug)]
pub struct Received<const N: usize> {
    power_w: [f64; N],
    reflected_w: [f64; N],
}

impl<const N: usize> Received<N> {
    /// By interreflection so far.
    pub fn indirect(trees: &[Tree<N>]) -> Self {
        Self::new(trees, indirect_w)
    }

    /// How many times a watt of such light comes back, `ρ̄/(1 − ρ̄)`, in the band where it does most; 0 in the dark.
    pub fn gain(&self) -> f64 {
        let gain = |(power_w, reflected_w): (&f64, &f64)| match *power_w > 0.0 {
            true => reflected_w / (power_w - reflected_w),
            false => 0.0,
        };
        self.power_w.iter().zip(&self.reflected_w).map(gain).fold(0.0, f64::max)
    }

    fn new(trees: &[Tree<N>], of: impl Fn(&Tree<N>) -> [f64; N]) -> Self {
        let mut sum = Self { power_w: [0.0; N], reflected_w: [0.0; N] };
        for tree in trees {
            let power_w = of(tree);
            for n in 0..N {
                sum.power_w[n] += power_w[n];
                sum.reflected_w[n] += tree.patch.reflectance[n] * power_w[n];
            }
        }
        sum
    }

    fn reflectance(&self, n: usize) -> f64 {
        self.reflected_w[n] / self.power_w[n]
    }
}

#[cfg(test)]
mod tests {
    use ccnuma::Arena;
    use ccnuma::arena::Backend;

    use super::*;
    use crate::math::Basis;
    use crate::radiosity::trees;
    use crate::scene::{read::read_file, surfaces};

    #[test]
    fn the_more_is_reflected_the_larger_the_gain() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/furnished-room.iv");
        let surfaces = surfaces(&read_file(&path).unwrap());
        let mut trees = trees::<3>(&surfaces, Basis::Haar, &Arena::new(Backend::Malloc));
        assert_eq!(Received::indirect(&trees).gain(), 0.0, "dark");
        for tree in &mut trees {
            tree.patch.reflectance = [0.5, 0.9, 0.1];
            tree.indirect_w = [1.0; 3];
        }
        assert!((Received::indirect(&trees).gain() - 9.0).abs() < 1e-9);
    }
}
