//! One receiver's task: light from one or more sources to its tree, refined until its basis represents each within tolerance.
//!
//! First the sources are sorted ([`several`](super::several)): what matters little is taken by one sample, many of them together by a few.
//! With the others the receiver's elements are visited from the root down ([`descent`](super::descent)), and at each element each source's
//! link is judged ([`link`](super::link)).
//!
//! The oracle (after Bekaert and Willems 1996): the irradiance at sample points of the receiver element is compared with its projection.
//! A link is accepted when `‖ρ (E_projected − E)‖ √A`, its share of the L2 error of radiosity, is below the threshold τ; errors of
//! disjoint elements add up in squares exactly, so that one τ for all links spends the fewest elements on a given total.

use super::Clusters;
use super::candidates::Candidates;
use super::descent::{Aim, Descent};
use super::nodes::RecentNodes;
use super::packet::RecentOutlines;
use super::receiver::{Deposited, Patch, Receiver};
use super::recording::Recording;
use super::samples::SampleRules;
use super::several::{Sorted, sort};
use super::share::Helpers;
use super::source::Source;
use super::unblocked::Fragments;
use super::work::Work;
use crate::math::basis::MAX_FUNCTIONS;
use crate::visibility::Occluder;

/// What a link error is measured against.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Oracle {
    /// The error of the light transported: kernel error times emitted power.
    Energy,
    /// The error of the kernel alone: every emitter counts as if it emitted the reference exitance.
    Geometry,
    /// No error is measured: every receiver is divided this many times.
    Uniform(u8),
}

/// The coarsest tolerance of a look at an element, and that of a pair that is taken by one sample, as a share of the light.
pub(super) const COARSE: f64 = 0.25;

/// Whether to go on; asked before every element, so without a clock.
pub type GoOn<'a> = &'a (dyn Fn() -> bool + Sync);

/// The rules of a run's tasks.
#[derive(Clone, Debug)]
pub struct Rules {
    /// What link errors are measured against.
    pub oracle: Oracle,
    /// Threshold τ on a link's share of the L2 error of radiosity, in W/m (W/m² · √m²).
    pub threshold_w_m: f64,
    /// Exitance that the geometry oracle takes every emitter to have, in W/m².
    pub reference_w_m2: f64,
    /// Reflectances below this count as this in link errors, in all bands alike, so that dark surfaces know their irradiance too.
    pub least_reflectance: f64,
    /// Deviation at a point in W/m² of radiosity above which a link that nothing shades goes down to elements that are there already, or
    /// that other sources of its batch make.
    pub point_w_m2: f64,
    /// How receivers are sampled and projected.
    pub samples: SampleRules,
}

impl Rules {
    /// The same rules where all light is so many times brighter.
    pub fn brighter(&self, times: f64) -> Self {
        let (threshold_w_m, point_w_m2) = (times * self.threshold_w_m, times * self.point_w_m2);
        Self { threshold_w_m, point_w_m2, reference_w_m2: times * self.reference_w_m2, ..self.clone() }
    }

    /// The threshold for links of `source`, in W/m.
    pub(super) fn threshold<const N: usize>(&self, source: &impl Source<N>) -> f64 {
        match self.oracle {
            Oracle::Geometry => self.threshold_w_m * source.strength() / self.reference_w_m2,
            _ => self.threshold_w_m,
        }
    }
}

/// Working memory and counts of one worker.
#[derive(Debug, Default)]
pub struct Scratch {
    /// Stack of blocker lists.
    pub candidates: Vec<u32>,
    /// The face that blocked a segment last, where the structure was asked.
    pub last_blocker: u32,
    /// Parts of emitter cells left visible.
    pub fragments: Fragments,
    /// Nodes of emitter cells that were looked at lately.
    pub(super) nodes: RecentNodes,
    /// How emitter cells that were divided to lately lie to their polygons.
    pub(super) outlines: RecentOutlines,
    /// What looks see, for links that are to be kept.
    pub(super) recording: Recording,
    /// What was done.
    pub work: Work,
}

/// What all parts of a receiver's task have in common.
#[derive(Clone, Copy)]
pub struct Task<'a, const N: usize> {
    /// Who receives.
    pub patch: &'a Patch<N>,
    /// What may stand between.
    pub occluder: &'a dyn Occluder,
    /// The rules of the run.
    pub rules: &'a Rules,
    /// Whether to go on; what was deposited by then stays.
    pub go_on: GoOn<'a>,
}

impl<const N: usize> Task<'_, N> {
    /// Transports the light of `sources` to the tree of `receiver`. The one function every schedule runs; `helpers` say where new elements
    /// live and may take over parts of the task, which does not show in the result. `clusters` are those of the sources, where they cluster.
    ///
    /// Light that several sources bring to a corner is smooth in sum only, and the sum is exact only where all of them are projected on the
    /// same elements; so sources that come together see each other's elements, whatever their order.
    pub fn shoot<S: Source<N>, R: Receiver<N>>(
        self,
        (sources, clusters): (&[S], Option<&Clusters>),
        receiver: &mut R,
        scratch: &mut Scratch,
        helpers: &dyn Helpers,
    ) -> Deposited<N> {
        let (mut deposited, resolved) = self.sort((sources, clusters), receiver, scratch, helpers);
        let resolved: Vec<&S> = resolved.into_iter().map(|index| &sources[index]).collect();
        deposited.add_after(self.resolve(&resolved, false, receiver, scratch, helpers));
        deposited
    }

    /// Takes what matters little; the other sources, by index, are to be resolved.
    pub(super) fn sort<S: Source<N>, R: Receiver<N>>(
        self,
        (sources, clusters): (&[S], Option<&Clusters>),
        receiver: &mut R,
        scratch: &mut Scratch,
        helpers: &dyn Helpers,
    ) -> (Deposited<N>, Vec<usize>) {
        let area_m2 = self.patch.frame.area_m2 * receiver.shape().share();
        let sorted = sort(self, (sources, clusters), (receiver.shape(), area_m2), scratch, helpers);
        let mut light = [[0.0; N]; MAX_FUNCTIONS];
        light[0] = sorted.light_w_m2;
        receiver.deposit(&light);
        let Sorted { error_squared, unresolved, span, .. } = sorted;
        let mut deposited = Deposited { error_squared, unresolved, span, ..Deposited::default() };
        deposited.take(self.patch, &light, area_m2);
        (deposited, sorted.resolved)
    }

    /// Resolves sources on a receiver; their links may be recorded.
    pub(super) fn resolve<S: Source<N>, R: Receiver<N>>(
        self,
        sources: &[&S],
        records: bool,
        receiver: &mut R,
        scratch: &mut Scratch,
        helpers: &dyn Helpers,
    ) -> Deposited<N> {
        if sources.is_empty() {
            return Deposited::default();
        }
        let aims: Vec<Aim<'_, S>> = sources.iter().map(|source| Aim::new(*source, self)).collect();
        Descent::new(self, &aims, records).begin(receiver, scratch, helpers)
    }

    /// What may stand between anywhere in the scene.
    pub(super) fn candidates(&self) -> Candidates {
        if self.occluder.never_blocks() { Candidates::Free } else { Candidates::Scene }
    }

    /// What an error of irradiance counts: the largest reflectance, or the least one if that is more.
    pub(super) fn weight(&self) -> f64 {
        self.patch.weight(self.rules.least_reflectance)
    }
}
