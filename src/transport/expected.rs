//! What a source is expected to make a receiver cost, before anything is known of either: what it would bring if nothing stood in between,
//! against what is small enough to be left alone.

use super::receiver::Patch;
use super::{Rules, Source};

impl<const N: usize> Patch<N> {
    /// The cost to be expected of `source`, in no particular unit, for a surface of `area_m2`. Links that are divided until each carries no
    /// more than the threshold are as many as the root of what is to be carried, more or less: of the powers 0.5, 0.7, 1, and 1.3 it is
    /// the one that ordered the recorded tasks of two scenes best.
    pub fn expected_cost(&self, source: &impl Source<N>, area_m2: f64, rules: &Rules) -> f64 {
        if source.surface() == self.surface || !source.reaches(self.frame.normal, &self.corners) {
            return 0.0;
        }
        let (centre, radius) = self.sphere();
        let estimate = source.estimate_w_m2(centre, radius, self.frame.normal);
        let carried_w_m = self.weight(rules.least_reflectance) * estimate * area_m2.sqrt();
        (carried_w_m / rules.threshold_w_m).sqrt()
    }
}
