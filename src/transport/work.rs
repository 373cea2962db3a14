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
    /// Of these, the ones tested against a shaft's few candidates instead of all faces.
    pub rays_listed: u64,
    /// Cells looked at from a point by rays, or by one to a light without area.
    pub sights_by_rays: u64,
    /// The same where the shaft was empty: no ray was needed.
    pub sights_free: u64,
    /// The same where one face is known to hide the cell from the point: no ray was needed.
    pub sights_hidden: u64,
    /// Accepted transfers that needed no ray.
    pub interactions_without_rays: u64,
    /// Visible parts of emitter cells computed exactly.
    pub exact_visibilities: u64,
    /// Receiver–emitter pairs whose shaft held no candidate: no ray was needed.
    pub pairs_unoccluded: u64,
    /// Pairs of surfaces that were resolved: neither skipped, nor taken by one sample, nor in a cluster.
    pub pairs_resolved: u64,
    /// Receiver elements proven hidden from the emitter by one face.
    pub pairs_hidden: u64,
    /// Pairs of surfaces skipped because one lies behind the other.
    pub pairs_behind: u64,
    /// Transfers too small for the error budget to be resolved: one sample was taken.
    pub pairs_coarse: u64,
    /// What these cost.
    pub coarse_cost: u64,
    /// Clusters of emitters that were taken as one, for one receiver each.
    pub clusters: u64,
    /// What these cost.
    pub clusters_cost: u64,
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
        self.rays_listed += o.rays_listed;
        self.sights_by_rays += o.sights_by_rays;
        self.sights_free += o.sights_free;
        self.sights_hidden += o.sights_hidden;
        self.interactions_without_rays += o.interactions_without_rays;
        self.exact_visibilities += o.exact_visibilities;
        self.pairs_unoccluded += o.pairs_unoccluded;
        self.pairs_resolved += o.pairs_resolved;
        self.pairs_hidden += o.pairs_hidden;
        self.pairs_behind += o.pairs_behind;
        self.pairs_coarse += o.pairs_coarse;
        self.coarse_cost += o.coarse_cost;
        self.clusters += o.clusters;
        self.clusters_cost += o.clusters_cost;
        self.pairs_clustered += o.pairs_clustered;
        self.links_stored += o.links_stored;
        self.links_reused += o.links_reused;
    }
}
