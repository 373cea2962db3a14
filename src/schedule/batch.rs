//! A batch: sources that one receiver takes in order before the next receiver does, and the choice of who shoots next.
//!
//! Everything a batch changes belongs to one receiver, so the order of receivers, and who takes which, does not show in the result.

use crate::radiosity::Tree;
use crate::transport::{Helpers, Lamp, Packet, Rules, Scratch, shoot};
use crate::visibility::Occluder;

use super::watch::Watch;

/// At most this share of the surfaces that have light to send shoot at once, and at most as many as the square root of their number, which
/// is the lower limit from a hundred on. On the reference scenes at an error of 0.02 batches cost at most 8 % more interactions and 2 %
/// more evaluations than one shooter at a time, and leave a third to two thirds of the batches.
const LARGEST_SHARE: f64 = 0.1;

/// Who joins a batch has at least this share of the brightest's power.
const LEAST_POWER: f64 = 0.25;

/// How many surfaces shoot between two choices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Batches {
    /// As many as cost little more than one at a time would.
    #[default]
    Fitted,
    /// One at a time, as the paper does.
    Single,
}

impl Batches {
    /// Who shoots next, by index: the brightest, and with it those that are nearly as bright.
    pub fn choose<const N: usize>(self, trees: &[Tree<N>]) -> Vec<usize> {
        let mut lit: Vec<usize> = (0..trees.len()).filter(|i| trees[*i].unshot_w > 0.0).collect();
        lit.sort_by(|a, b| trees[*b].unshot_w.total_cmp(&trees[*a].unshot_w).then(a.cmp(b)));
        let most = match self {
            Batches::Single => 1,
            Batches::Fitted => {
                let lit = lit.len() as f64;
                (LARGEST_SHARE * lit).min(lit.sqrt()).max(1.0) as usize
            }
        };
        lit.truncate(most);
        let Some(brightest) = lit.first().map(|i| trees[*i].unshot_w) else { return lit };
        lit.retain(|i| trees[*i].unshot_w >= LEAST_POWER * brightest);
        lit.sort_unstable();
        lit
    }
}

/// Sources that are shot together.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a, const N: usize> {
    /// Lights without area; they come first.
    pub lamps: &'a [Lamp<N>],
    /// What surfaces send.
    pub packets: &'a [Packet<N>],
}

impl<const N: usize> Batch<'_, N> {
    /// Number of sources.
    pub fn len(&self) -> usize {
        self.lamps.len() + self.packets.len()
    }

    /// Whether there is nothing to shoot.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Shoots all sources to one receiver, in order, until told to stop.
    pub(super) fn light(
        &self,
        tree: &mut Tree<N>,
        (occluder, rules): (&dyn Occluder, &Rules),
        scratch: &mut Scratch,
        helpers: &dyn Helpers,
        watch: &Watch,
    ) {
        let go_on = || !watch.stopped();
        for lamp in self.lamps.iter().take_while(|_| go_on()) {
            let deposited = shoot(lamp, &tree.patch, &mut tree.root, occluder, rules, scratch, helpers);
            tree.book(&deposited);
        }
        for packet in self.packets.iter().take_while(|_| go_on()) {
            let deposited = shoot(packet, &tree.patch, &mut tree.root, occluder, rules, scratch, helpers);
            tree.book(&deposited);
        }
        tree.work += std::mem::take(&mut scratch.work);
        watch.receiver_done();
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
    fn shooters_follow_from_the_energy_alone() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/furnished-room.iv");
        let mut trees =
            trees::<3>(&surfaces(&read_file(&path).unwrap()), Basis::Haar, &Arena::new(Backend::Malloc));
        let count = trees.len();
        assert_eq!(Batches::Fitted.choose(&trees), [0; 0], "nothing is lit");
        trees[3].unshot_w = 1e-9;
        assert_eq!(Batches::Fitted.choose(&trees), [3], "one shoots, however dim");
        for (i, tree) in trees.iter_mut().enumerate() {
            tree.unshot_w = 1.0 + (i % 7) as f64 / 10.0;
        }
        let even = Batches::Fitted.choose(&trees);
        assert_eq!(even.len(), count / 10);
        assert!(
            even.is_sorted() && even.iter().all(|i| i % 7 == 6),
            "the brightest, in the order of the surfaces"
        );
        assert_eq!(Batches::Single.choose(&trees), [6]);
        trees[10].unshot_w = 10.0;
        assert_eq!(Batches::Fitted.choose(&trees), [10], "the others are too dim beside it");
    }
}
