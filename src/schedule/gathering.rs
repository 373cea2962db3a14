//! Gathering, the paper's second solver: every surface's irradiance is made afresh from all that all surfaces reflect, again and again, until it
//! changes no more. `E ← D + TρE`, with the direct irradiance `D` and the transport `T`: Jacobi's iteration.
//!
//! What an iteration changes, `U = E − E_before`, is to the new irradiance what unshot light is to that of shooting: `E = D + Tρ(E − U)`. So it
//! is marked as unshot, and what is still to come, its share of the error, when to stop, the mixing of states and the ambient correction
//! are those of shooting. Here states are mixed at any reflectance, since an iteration costs all links: it saves every second of them.

use ccnuma::WorkerPanic;

use crate::radiosity::Tree;

use super::batch::Batches;
use super::crew::Crew;
use super::mixing::{Look, Mixer};
use super::pass::{Pass, PassStatistics, unshot_w};
use super::watch::Watch;

/// Iterations within which what is still to come must fall enough. It falls by the reflectance in each, but for noise.
const PATIENCE: u32 = 4;

impl<const N: usize> Pass<'_, N> {
    /// Whether light is gathered.
    pub(super) fn gathers(&self) -> bool {
        self.batches == Batches::All
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
