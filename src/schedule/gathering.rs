//! Gathering, the paper's second solver: every surface's irradiance is made afresh from all that all surfaces reflect, again and again, until it
//! changes no more. `E ← D + TρE`, with the direct irradiance `D` and the transport `T`: Jacobi's iteration.
//!
//! What an iteration changes, `U = E − E_before`, is to the new irradiance what unshot light is to that of shooting: `E = D + Tρ(E − U)`. So it
//! is marked as unshot, and what is still to come, its share of the error, when to stop, the mixing of states and the ambient correction
//! are those of shooting. Here states are mixed at any reflectance, since an iteration costs all links: it saves every second of them.

use ccnuma::WorkerPanic;

use crate::radiosity::Tree;
use crate::transport::{Packet, Store};

use super::batch::Batches;
use super::crew::Crew;
use super::mixing::{Look, Mixer};
use super::pass::{Pass, PassStatistics, unshot_w};
use super::watch::Watch;

/// How much coarser the links of a first pass may be than a pilot's that shoots: each carries all light of a source at once, and errs less than
/// the sum of what it would carry shot by shot. At errors of 0.01 to 0.06 on the reference scenes this saves 20 to 60 % of all evaluations.
pub(super) const COARSER_PILOT: f64 = 2.0;

/// Iterations within which what is still to come must fall enough. It falls by the reflectance in each, but for noise.
const PATIENCE: u32 = 4;

/// A receiver may want at least this share of what receivers want on average.
const LEAST_SHARE: f64 = 0.1;

impl<const N: usize> Pass<'_, N> {
    /// Whether light is gathered.
    pub(super) fn gathers(&self) -> bool {
        matches!(self.batches, Batches::All { .. })
    }

    /// Gives every receiver its share of the bytes that links may take, beside what it has: at first by what the `reflected` light is expected
    /// to cost it, then by how much found no room.
    pub(super) fn allot(
        &self,
        reflected: &[Packet<N>],
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
    ) -> Result<(), WorkerPanic> {
        let Batches::All { link_bytes } = self.batches else { return Ok(()) };
        if link_bytes == 0 {
            return Ok(());
        }
        let mut wants = crew.map(
            trees,
            |_| true,
            |tree| match &tree.store {
                Some(store) => (store.held_bytes(), store.refused_bytes()),
                None => (0, self.expected_from(&[], reflected, tree)),
            },
        )?;
        // Who is expected to want next to nothing may still have links.
        let expected: u64 = wants.iter().map(|(_, wanted)| wanted).sum();
        let least = (LEAST_SHARE * expected as f64 / trees.len() as f64).max(1.0) as u64;
        wants.iter_mut().for_each(|(_, wanted)| *wanted = least.max(*wanted));
        let held: u64 = wants.iter().map(|(held, _)| held).sum();
        let wanted: u64 = wants.iter().map(|(_, wanted)| wanted).sum();
        let free = link_bytes.saturating_sub(held) as f64 / wanted.max(1) as f64;
        for (tree, (held, wanted)) in trees.iter_mut().zip(wants) {
            let store = tree.store.get_or_insert_default();
            store.allow(held + (free * wanted as f64) as u64);
        }
        Ok(())
    }

    /// Notes that light was gathered, and what links take.
    pub(super) fn survey_links(&self, trees: &[Tree<N>], statistics: &mut PassStatistics) {
        statistics.iterations += self.gathers() as u64;
        let stores = || trees.iter().filter_map(|tree| tree.store.as_deref());
        let held = stores().map(Store::held_bytes).sum();
        statistics.link_bytes = statistics.link_bytes.max(held);
        statistics.links_refused = stores().any(|store| store.refused_bytes() > 0);
    }

    /// Iterates until little changes; `share` of the stage is done where so much power in W changed last.
    pub(super) fn gather(
        &self,
        shot_w: &mut [f64; N],
        share: &dyn Fn(f64) -> f64,
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
        watch: &Watch,
        statistics: &mut PassStatistics,
    ) -> Result<(), WorkerPanic> {
        let mut mixer = Mixer::new(self.gain, PATIENCE);
        loop {
            let left = unshot_w(trees);
            if left <= self.stop_w || watch.stopped() {
                return Ok(());
            }

            match mixer.look(trees, shot_w, crew)? {
                Look::Fine => {}
                Look::Stuck => return Ok(()),
                Look::Mixed => {
                    let Some(growth) = self.growth(trees, crew, statistics)? else { continue };
                    let rules = self.rules.brighter(growth);
                    let brighter = self.brighter(growth, &rules);
                    return brighter.gather(shot_w, share, trees, crew, watch, statistics);
                }
            }
            let reflected = self.restart(trees, crew)?;
            crew.map(trees, |_| true, Tree::restore_direct)?;
            let shares = (share(left), share(left * self.gain / (1.0 + self.gain)));
            *shot_w = self.send(trees, reflected, shares, crew, watch, statistics)?;
        }
    }
}
