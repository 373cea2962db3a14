//! A batch: sources that each receiver takes together, and the choice of who shoots next.
//!
//! Everything a batch changes belongs to one receiver, so the order of receivers, and who takes which, does not show in the result.

use crate::radiosity::Tree;
use crate::transport::{Clusters, Helpers, Lamp, Packet, Rules, Scratch, Task};
use crate::visibility::Occluder;

use super::walks::Walks;
use super::watch::Watch;

/// At most this share of the surfaces that have light to send shoot at once, and at most as many as the square root of their number, which
/// is the lower limit from a hundred on. On the reference scenes at an error of 0.02 batches cost at most 8 % more interactions and 2 %
/// more evaluations than one shooter at a time, and leave a third to two thirds of the batches.
const LARGEST_SHARE: f64 = 0.1;

/// Who joins a batch has at least this share of the brightest's power.
const LEAST_POWER: f64 = 0.25;

/// From this many lit surfaces on they cluster ([`Clusters`]), and a batch costs less than its shooters one by one: all but the dimmest shoot.
const MANY: usize = 256;

/// Share of the unshot power that the dimmest keep then.
const KEPT: f64 = 0.2;

/// How many surfaces shoot between two choices, and all must have finished.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Batches {
    /// As many as cost little more than one at a time would.
    #[default]
    Fitted,
    /// One at a time, as the paper does.
    Single,
    /// There are no batches: emitters follow each other without a barrier. Without a team, as [`Batches::Single`].
    None(Walks),
    /// All of them, and each sends all that it reflects, until that changes no more: the paper's gathering ([`super::gathering`]).
    All {
        /// Bytes of links that may be stored.
        link_bytes: u64,
    },
}

impl Batches {
    /// Who shoots next, by index: the brightest, and with it those that are nearly as bright; of many, all but the dimmest. `stop_w` is the
    /// power in W that may be left unshot.
    pub fn choose<const N: usize>(self, trees: &[Tree<N>], stop_w: f64) -> Vec<usize> {
        let lit = || trees.iter().map(|tree| tree.unshot_w).filter(|unshot_w| *unshot_w > 0.0);
        if self == Batches::Fitted && lit().count() >= MANY {
            let kept = (KEPT * lit().sum::<f64>()).max(0.5 * stop_w);
            let mut shooters = brightest(trees, kept);
            shooters.sort_unstable();
            return shooters;
        }
        let mut lit = brightest(trees, f64::NEG_INFINITY);
        let most = match self {
            Batches::Single | Batches::None(_) => 1,
            Batches::Fitted | Batches::All { .. } => {
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

/// Surfaces that have light to send, the brightest first, as many as it takes to leave no more than `left_w` unshot.
pub(super) fn brightest<const N: usize>(trees: &[Tree<N>], left_w: f64) -> Vec<usize> {
    let mut lit: Vec<(f64, usize)> =
        trees.iter().map(|tree| tree.unshot_w).zip(0..).filter(|(unshot_w, _)| *unshot_w > 0.0).collect();
    lit.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut left: f64 = trees.iter().map(|tree| tree.unshot_w).sum();
    let shoots = lit.iter().take_while(|(unshot_w, _)| {
        let shoots = left > left_w;
        left -= unshot_w;
        shoots
    });
    shoots.map(|(_, index)| *index).collect()
}

/// Sources that are shot together.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a, const N: usize> {
    /// Lights without area; they come first.
    pub lamps: &'a [Lamp<N>],
    /// What surfaces send.
    pub packets: &'a [Packet<N>],
    /// How the packets cluster, where they do.
    pub clusters: Option<&'a Clusters>,
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

    /// Shoots all sources to one receiver, until told to stop.
    pub(super) fn light(
        &self,
        tree: &mut Tree<N>,
        (occluder, rules): (&dyn Occluder, &Rules),
        scratch: &mut Scratch,
        helpers: &dyn Helpers,
        watch: &Watch,
    ) {
        let Tree { patch, root, store, .. } = &mut *tree;
        let task = Task { patch, occluder, rules, go_on: &|| !watch.stopped() };
        let of_lamps = task.shoot((self.lamps, None), root, scratch, helpers);
        let packets = (self.packets, self.clusters);
        let of_packets = match store {
            Some(store) => task.shoot_stored(packets, root, store, scratch, helpers),
            None => task.shoot(packets, root, scratch, helpers),
        };
        tree.book(&of_lamps);
        tree.book(&of_packets);
        tree.work += std::mem::take(&mut scratch.work);
        watch.part_done();
    }
}

#[cfg(test)]
mod tests {
    use ccnuma::Arena;
    use ccnuma::arena::Backend;

    use super::*;
    use crate::math::Basis;
    use crate::radiosity::trees as trees_of;
    use crate::scene::{Surface, read::read_file, surfaces};

    #[test]
    fn shooters_follow_from_the_energy_alone() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/furnished-room.iv");
        let mut trees =
            trees_of::<3>(&surfaces(&read_file(&path).unwrap()), Basis::Haar, &Arena::new(Backend::Malloc));
        let count = trees.len();
        assert_eq!(Batches::Fitted.choose(&trees, 0.0), [0; 0], "nothing is lit");
        trees[3].unshot_w = 1e-9;
        assert_eq!(Batches::Fitted.choose(&trees, 0.0), [3], "one shoots, however dim");
        for (i, tree) in trees.iter_mut().enumerate() {
            tree.unshot_w = 1.0 + (i % 7) as f64 / 10.0;
        }
        let even = Batches::Fitted.choose(&trees, 0.0);
        assert_eq!(even.len(), count / 10);
        assert!(
            even.is_sorted() && even.iter().all(|i| i % 7 == 6),
            "the brightest, in the order of the surfaces"
        );
        assert_eq!(Batches::Single.choose(&trees, 0.0), [6]);
        trees[10].unshot_w = 10.0;
        assert_eq!(Batches::Fitted.choose(&trees, 0.0), [10], "the others are too dim beside it");
        let (all, arena) = (surfaces(&read_file(&path).unwrap()), Arena::new(Backend::Malloc));
        let all: Vec<Surface> = all.iter().cycle().take(10 * MANY).cloned().collect();
        let mut many = trees_of::<3>(&all, Basis::Haar, &arena);
        many.iter_mut().enumerate().for_each(|(i, tree)| tree.unshot_w = 1.0 + (i % 7) as f64);
        let total: f64 = many.iter().map(|tree| tree.unshot_w).sum();
        let shot: f64 = Batches::Fitted.choose(&many, 0.0).iter().map(|i| many[*i].unshot_w).sum();
        assert!((shot / total - 0.8).abs() < 0.01, "a fifth is kept");
        let shot: f64 = Batches::Fitted.choose(&many, total).iter().map(|i| many[*i].unshot_w).sum();
        assert!((shot / total - 0.5).abs() < 0.01, "more is kept where more may be left");
    }
}
