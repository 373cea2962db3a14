//! Counts of the work done, in units that do not depend on the machine.

use serde::{Deserialize, Serialize};

/// What a pair task did; additive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Work {
    /// Accepted transfers to a receiver element.
    pub interactions: u64,
    /// Evaluations of the kernel at a pair of points.
    pub kernel_evaluations: u64,
    /// Evaluations of Lambert's closed form.
    pub lambert_evaluations: u64,
    /// Segments tested for visibility.
    pub visibility_rays: u64,
    /// Visible parts of emitter cells computed exactly.
    pub exact_visibilities: u64,
    /// Receiver–emitter pairs whose shaft held no candidate: no ray was needed.
    pub pairs_unoccluded: u64,
    /// Receiver elements proven hidden from the emitter by one face.
    pub pairs_hidden: u64,
    /// Pairs of surfaces skipped because one lies behind the other.
    pub pairs_behind: u64,
    /// Transfers too small for the error budget to be resolved: one sample was taken.
    pub pairs_coarse: u64,
    /// Clusters of emitters that were taken as one, for one receiver each.
    pub clusters: u64,
    /// Pairs of surfaces that were taken in clusters.
    pub pairs_clustered: u64,
    /// Links that were stored.
    pub links_stored: u64,
    /// Transfers by stored links, which are no interactions.
    pub links_reused: u64,
}

impl Work {
    /// What it cost, in evaluations: kernel, closed form and rays take about the same time each.
    pub fn cost(&self) -> u64 {
        self.kernel_evaluations + self.lambert_evaluations + self.visibility_rays
    }
}

impl std::ops::AddAssign for Work {
    fn add_assign(&mut self, o: Self) {
        self.interactions += o.interactions;
        self.kernel_evaluations += o.kernel_evaluations;
        self.lambert_evaluations += o.lambert_evaluations;
        self.visibility_rays += o.visibility_rays;
        self.exact_visibilities += o.exact_visibilities;
        self.pairs_unoccluded += o.pairs_unoccluded;
        self.pairs_hidden += o.pairs_hidden;
        self.pairs_behind += o.pairs_behind;
        self.pairs_coarse += o.pairs_coarse;
        self.clusters += o.clusters;
        self.pairs_clustered += o.pairs_clustered;
        self.links_stored += o.links_stored;
        self.links_reused += o.links_reused;
    }
}
