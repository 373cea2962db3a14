//! Receivers under locks, and the ledger of what each has left to shoot, which is read without them.

use std::sync::Mutex;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

use ccnuma::deferred::Held;
use ccnuma::{Arena, Deferred, Worker};

use crate::radiosity::{Form, Lure, Tree};
use crate::transport::{Deposited, Packet, Patch, Receiver, Scratch};

/// All receivers of a scene.
pub(super) struct Receivers<'t, const N: usize> {
    trees: Vec<Deferred<&'t mut Tree<N>, Lure<N>>>,
    /// By tree; empty where workers wait for locks. Locked for moments only, inside a tree's lock or alone.
    forms: Vec<Mutex<Form<N>>>,
    /// Bits of each tree's unshot power in W, with what lures hold that are still to be merged.
    ///
    /// Relaxed: who looks while others work sees a moment of each number, short by what is on its way to the ledger, and chooses by it. That
    /// nothing is left is concluded only when all have returned to the desk, whose lock makes what they did before visible.
    unshot_w: Vec<AtomicU64>,
}

/// A pair task whose receiver is still to be given.
pub(super) trait Pair<const N: usize> {
    /// Runs it; new elements live in `arena`.
    fn shoot<R: Receiver<N>>(
        &self,
        patch: &Patch<N>,
        receiver: &mut R,
        scratch: &mut Scratch,
        arena: &Arena,
    ) -> Deposited<N>;
}

/// The right to take a surface's packet.
pub(super) struct Claim {
    pub surface: usize,
    /// What is off the ledger for it, in W.
    power_w: f64,
    prune_w_m2: f64,
}

impl<'t, const N: usize> Receivers<'t, N> {
    /// Puts the trees under locks.
    pub fn new(trees: &'t mut [Tree<N>], lure: bool) -> Self {
        let form = |tree| Mutex::new(Form::new(tree));
        let forms = if lure { trees.iter().map(form).collect() } else { Vec::new() };
        let unshot_w = trees.iter().map(|tree| AtomicU64::new(tree.unshot_w.to_bits())).collect();
        Self { trees: trees.iter_mut().map(Deferred::new).collect(), forms, unshot_w }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.trees.len()
    }

    /// Has one receiver lit by `pair`, on a lure where it is locked and lures are used; its new elements live in `arena`.
    pub fn light(
        &self,
        worker: &Worker,
        index: usize,
        arena: &Arena,
        scratch: &mut Scratch,
        pair: &impl Pair<N>,
    ) {
        let free = match self.forms.is_empty() {
            true => Some(self.lock(worker, index, arena)),
            false => self.try_lock(worker, index, arena),
        };
        let Some(mut tree) = free else {
            let form = worker.lock(&self.forms[index]).clone();
            let mut lure = form.lure();
            lure.deposited = pair.shoot(&form.patch, &mut lure.root, scratch, arena);
            lure.work = std::mem::take(&mut scratch.work);
            let more_w = lure.deposited.to_reflect_w;
            worker.defer(&self.trees[index], lure);
            return self.book(index, more_w);
        };
        let Tree { patch, root, .. } = &mut **tree;
        let deposited = pair.shoot(patch, root, scratch, arena);
        tree.book(&deposited);
        tree.work += std::mem::take(&mut scratch.work);
        self.book(index, deposited.to_reflect_w);
    }

    /// Merges the lures of a receiver that nobody merged yet.
    pub fn close(&self, worker: &Worker, index: usize, arena: &Arena) {
        drop(self.lock(worker, index, arena));
    }

    /// A receiver, with its lures merged.
    fn lock(&self, worker: &Worker, index: usize, arena: &Arena) -> Held<'_, &'t mut Tree<N>> {
        let mut lured = false;
        let tree = worker.lock_deferred(&self.trees[index], merge(arena, &mut lured));
        self.follow(worker, index, &tree, lured);
        tree
    }

    /// As [`Receivers::lock`], if the receiver is free.
    fn try_lock(&self, worker: &Worker, index: usize, arena: &Arena) -> Option<Held<'_, &'t mut Tree<N>>> {
        let mut lured = false;
        let tree = self.trees[index].try_lock(merge(arena, &mut lured))?;
        self.follow(worker, index, &tree, lured);
        Some(tree)
    }

    /// Where there were lures there will be more: lets them follow what was divided meanwhile.
    fn follow(&self, worker: &Worker, index: usize, tree: &Tree<N>, lured: bool) {
        if lured {
            worker.lock(&self.forms[index]).renew(tree);
        }
    }

    /// The unshot power of all but those `taken`, in order, and the brightest of them; the first of equals.
    pub fn survey(&self, taken: &[usize]) -> (f64, Option<usize>) {
        let (mut sum, mut most, mut brightest) = (0.0, 0.0, None);
        let mut start = 0;
        for end in taken.iter().copied().chain([self.len()]) {
            for (index, unshot_w) in self.unshot_w[start..end].iter().enumerate() {
                let unshot_w = f64::from_bits(unshot_w.load(Relaxed));
                sum += unshot_w;
                if unshot_w > most {
                    (most, brightest) = (unshot_w, Some(start + index));
                }
            }
            start = end + 1;
        }
        (sum, brightest)
    }

    /// Strikes a surface's unshot power off the ledger, for somebody to take.
    pub fn claim(&self, surface: usize, prune_w_m2: f64) -> Claim {
        let power_w = f64::from_bits(self.unshot_w[surface].swap(0f64.to_bits(), Relaxed));
        Claim { surface, power_w, prune_w_m2 }
    }

    /// Takes what a surface has to shoot. `first` is called on it before.
    pub fn take_packet(
        &self,
        worker: &Worker,
        claim: &Claim,
        arena: &Arena,
        first: impl FnOnce(&Tree<N>),
    ) -> Packet<N> {
        let mut tree = self.lock(worker, claim.surface, arena);
        first(&tree);
        // More may have come since.
        self.book(claim.surface, claim.power_w - tree.unshot_w);
        tree.take_packet(claim.prune_w_m2)
    }

    fn book(&self, index: usize, more_w: f64) {
        if more_w != 0.0 {
            let sum = |bits| Some((f64::from_bits(bits) + more_w).to_bits());
            // Never fails: `sum` always has an answer.
            let _ = self.unshot_w[index].fetch_update(Relaxed, Relaxed, sum);
        }
    }
}

/// Merges a lure and notes that there was one.
fn merge<'t, const N: usize>(arena: &Arena, lured: &mut bool) -> impl FnMut(&mut &'t mut Tree<N>, Lure<N>) {
    |tree, lure| {
        tree.merge(&lure, arena);
        *lured = true;
    }
}

#[cfg(test)]
mod tests {
    use ccnuma::arena::Backend;
    use ccnuma::{Machine, Plan, Policy, Team};

    use super::*;
    use crate::math::Basis;
    use crate::math::basis::MAX_FUNCTIONS;
    use crate::radiosity::trees;
    use crate::scene::{read::read_file, surfaces};

    /// Brings 0.5 W/m², of which 1 W is to be reflected.
    struct Half;

    impl Pair<3> for Half {
        fn shoot<R: Receiver<3>>(
            &self,
            _: &Patch<3>,
            receiver: &mut R,
            _: &mut Scratch,
            _: &Arena,
        ) -> Deposited<3> {
            receiver.deposit(&[[0.5; 3]; MAX_FUNCTIONS]);
            Deposited { to_reflect_w: 1.0, ..Deposited::default() }
        }
    }

    #[test]
    fn the_ledger_knows_what_lures_hold_and_what_is_claimed() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/furnished-room.iv");
        let mut trees =
            trees::<3>(&surfaces(&read_file(&path).unwrap()), Basis::Haar, &Arena::new(Backend::Malloc));
        (trees[1].unshot_w, trees[3].unshot_w) = (2.0, 5.0);
        let receivers = Receivers::new(&mut trees, true);
        let machine = Machine::synthetic("core:1 pu:1").unwrap();
        let mut team = Team::new(&Plan::new(machine.into(), Policy::None, Some(1)).unwrap()).unwrap();
        team.run(|worker| {
            let arena = &Arena::new(Backend::Malloc);
            let light = |index| receivers.light(worker, index, arena, &mut Scratch::default(), &Half);
            let hold = |index: usize| receivers.lock(worker, index, arena);
            assert_eq!(receivers.survey(&[]), (7.0, Some(3)));
            assert_eq!(receivers.survey(&[3]), (2.0, Some(1)));
            assert_eq!(receivers.survey(&[1, 3]), (0.0, None));
            let claim = receivers.claim(3, 0.0);
            assert_eq!(receivers.survey(&[]), (2.0, Some(1)));
            let held = hold(3);
            light(3);
            assert_eq!(held.unshot_w, 5.0, "the light went to a lure");
            drop(held);
            light(3);
            assert_eq!(receivers.survey(&[]), (4.0, Some(1)));
            receivers.take_packet(worker, &claim, arena, |tree| assert_eq!(tree.unshot_w, 7.0));
            assert_eq!(receivers.survey(&[]), (2.0, Some(1)), "nothing of it is left");
            let held = hold(1);
            light(1);
            drop(held);
            receivers.close(worker, 1, arena);
        })
        .unwrap();
        assert_eq!((trees[1].unshot_w, trees[3].unshot_w), (3.0, 0.0), "the end merges what nobody did");
        assert_eq!(trees[1].root.mean_unshot(), [0.5; 3]);
        assert_eq!(team.times()[0].deferrals, 2);
    }
}
