//! One pair task: light from one source to one receiver's tree, refined until the receiver's basis represents it within tolerance.
//!
//! The oracle (after Bekaert and Willems 1996): the irradiance at sample points of the receiver element is compared with its projection.
//! A link is accepted when `‖ρ (E_projected − E)‖ √A`, its share of the L2 error of radiosity, is below the threshold τ; errors of
//! disjoint elements add up in squares exactly, so that one τ for all links spends the fewest elements on a given total.

use glam::{DVec2, DVec3};

use super::candidates::{Candidates, narrow};
use super::gather::{Points, Tolerance, norm};
use super::packet::{Shape, cell_corners};
use super::receiver::{Deposited, Patch, Receiver, Waiting};
use super::samples::SampleRules;
use super::share::Helpers;
use super::source::Source;
use super::unblocked::Fragments;
use super::work::Work;
use crate::math::basis::MAX_FUNCTIONS;
use crate::math::{Cell, Split, polygon};
use crate::visibility::{Occluder, Shaft};

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

/// Pairs that carry less than this share of the threshold are taken by one sample.
pub(super) const COARSE_SHARE: f64 = 0.5;

/// Tolerance of the first look at an element, and of a pair that is taken by one sample, as a share of the light.
pub(super) const COARSE: f64 = 0.25;

/// Whether to go on; asked before every element, so without a clock.
pub type GoOn<'a> = &'a (dyn Fn() -> bool + Sync);

/// The rules of a run's pair tasks.
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
    /// that other sources of its batch make later.
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
}

/// Working memory and counts of one worker.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// Stack of blocker lists.
    pub candidates: Vec<u32>,
    /// Parts of emitter cells left visible.
    pub fragments: Fragments,
    /// What was done.
    pub work: Work,
}

/// Transports the light of `source` to the tree of `receiver`. The one function every schedule runs; `helpers` say where new elements live
/// and may take over subtrees of the receiver, which does not show in the result.
pub fn shoot<const N: usize, R: Receiver<N>>(
    source: &impl Source<N>,
    patch: &Patch<N>,
    receiver: &mut R,
    occluder: &dyn Occluder,
    rules: &Rules,
    scratch: &mut Scratch,
    helpers: &dyn Helpers,
) -> Deposited<N> {
    shoot_while(source, patch, receiver, occluder, rules, scratch, helpers, &|| true)
}

/// As [`shoot`], while told to go on; what was deposited by then stays.
#[allow(clippy::too_many_arguments)]
pub fn shoot_while<const N: usize, R: Receiver<N>>(
    source: &impl Source<N>,
    patch: &Patch<N>,
    receiver: &mut R,
    occluder: &dyn Occluder,
    rules: &Rules,
    scratch: &mut Scratch,
    helpers: &dyn Helpers,
    go_on: GoOn<'_>,
) -> Deposited<N> {
    let deposited = shoot_first(source, patch, receiver, occluder, rules, scratch, helpers, go_on);
    Deposited { waiting: Vec::new(), ..deposited }
}

/// As [`shoot_while`], for who comes back with the links that wait: [`go_down`].
#[allow(clippy::too_many_arguments)]
pub(super) fn shoot_first<const N: usize, R: Receiver<N>>(
    source: &impl Source<N>,
    patch: &Patch<N>,
    receiver: &mut R,
    occluder: &dyn Occluder,
    rules: &Rules,
    scratch: &mut Scratch,
    helpers: &dyn Helpers,
    go_on: GoOn<'_>,
) -> Deposited<N> {
    if source.surface() == patch.surface || source.face() == patch.face {
        return Deposited::default();
    }
    if !source.reaches(patch.frame.normal, &patch.corners) {
        scratch.work.pairs_behind += 1;
        return Deposited::default();
    }
    let mut task = Setting::new(source, patch, occluder, rules, go_on).run_by(scratch, helpers);
    task.begin(receiver);
    task.deposited
}

/// Has links of `source` that wait go down where elements have been divided since. Light that several sources bring to a corner is smooth in
/// sum only, and the sum is exact only where all of them are projected on the same elements, whoever came first.
#[allow(clippy::too_many_arguments)]
pub(super) fn go_down<const N: usize, R: Receiver<N>>(
    source: &impl Source<N>,
    waiting: &[Waiting<N>],
    patch: &Patch<N>,
    receiver: &mut R,
    occluder: &dyn Occluder,
    rules: &Rules,
    scratch: &mut Scratch,
    helpers: &dyn Helpers,
) -> Deposited<N> {
    let top = scratch.candidates.len();
    // To the end in any case: what a link takes back must come again.
    let mut task = Setting::new(source, patch, occluder, rules, &|| true).run_by(scratch, helpers);
    task.visit(receiver, Cell::UNIT, Candidates::Scene, 0, Some(waiting));
    let deposited = task.deposited;
    scratch.candidates.truncate(top);
    deposited
}

/// What all parts of a pair task have in common.
struct Setting<'a, const N: usize, S> {
    source: &'a S,
    patch: &'a Patch<N>,
    occluder: &'a dyn Occluder,
    rules: &'a Rules,
    go_on: GoOn<'a>,
    threshold: f64,
    extend: bool,
    /// What an error of irradiance counts: the largest reflectance, or the least one if that is more.
    weight: f64,
}

impl<const N: usize, S> Clone for Setting<'_, N, S> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<const N: usize, S> Copy for Setting<'_, N, S> {}

impl<'a, const N: usize, S: Source<N>> Setting<'a, N, S> {
    fn new(
        source: &'a S,
        patch: &'a Patch<N>,
        occluder: &'a dyn Occluder,
        rules: &'a Rules,
        go_on: GoOn<'a>,
    ) -> Self {
        let mut threshold = rules.threshold_w_m;
        if rules.oracle == Oracle::Geometry {
            threshold *= source.strength() / rules.reference_w_m2;
        }
        let hull = cell_corners(&Cell::UNIT).map(|c| patch.frame.point(c));
        // Beyond the polygon the light of a source in front continues smoothly; that of a source whose plane cuts the
        // parallelogram does not, and is taken from the nearest point of the polygon. A plane through a side does not cut.
        let (source_hull, source_normal) = source.hull(&hull);
        let extend = source_normal.is_none_or(|n| {
            let height = |p: &DVec3| n.dot(*p - source_hull[0]);
            let least = hull.iter().map(height).fold(f64::INFINITY, f64::min);
            least > -1e-9 * hull[0].distance(hull[2]).max(hull[1].distance(hull[3]))
        });
        let weight = patch.weight(rules.least_reflectance);
        Self { source, patch, occluder, rules, go_on, threshold, extend, weight }
    }

    fn run_by<'b>(self, scratch: &'b mut Scratch, helpers: &'b dyn Helpers) -> Shoot<'b, N, S>
    where
        'a: 'b,
    {
        let Setting { source, patch, occluder, rules, go_on, threshold, extend, weight } = self;
        let deposited = Deposited::default();
        Shoot {
            source,
            patch,
            occluder,
            rules,
            go_on,
            scratch,
            helpers,
            threshold,
            extend,
            weight,
            deposited,
        }
    }

    /// Visits the parts, half of them perhaps elsewhere. `blockers` is what `candidates` lists, if it is a list.
    fn visit_parts<R: Receiver<N>>(
        self,
        helpers: &dyn Helpers,
        scratch: &mut Scratch,
        parts: &mut [Part<'_, N, R>],
        candidates: Candidates,
        blockers: &[u32],
        level: u8,
    ) {
        match parts {
            [] => {}
            [part] => {
                let top = scratch.candidates.len();
                scratch.candidates.extend_from_slice(blockers);
                let candidates = match candidates {
                    Candidates::List(..) => Candidates::List(top, scratch.candidates.len()),
                    other => other,
                };
                let mut task = self.run_by(scratch, helpers);
                task.visit(part.receiver, part.cell, candidates, level, part.waiting);
                part.deposited = task.deposited;
                scratch.candidates.truncate(top);
            }
            _ => {
                let (first, second) = parts.split_at_mut(parts.len() / 2);
                helpers.both(
                    scratch,
                    &mut |helpers, scratch| {
                        self.visit_parts(helpers, scratch, first, candidates, blockers, level);
                    },
                    &mut |helpers, scratch| {
                        self.visit_parts(helpers, scratch, second, candidates, blockers, level);
                    },
                );
            }
        }
    }
}

/// A child of a receiver that is shared out.
struct Part<'a, const N: usize, R> {
    receiver: &'a mut R,
    cell: Cell,
    waiting: Option<&'a [Waiting<N>]>,
    deposited: Deposited<N>,
}

pub(super) struct Shoot<'a, const N: usize, S> {
    pub(super) source: &'a S,
    pub(super) patch: &'a Patch<N>,
    pub(super) occluder: &'a dyn Occluder,
    pub(super) rules: &'a Rules,
    go_on: GoOn<'a>,
    pub(super) scratch: &'a mut Scratch,
    helpers: &'a dyn Helpers,
    pub(super) threshold: f64,
    pub(super) extend: bool,
    pub(super) weight: f64,
    pub(super) deposited: Deposited<N>,
}

impl<'a, const N: usize, S: Source<N>> Shoot<'a, N, S> {
    fn setting(&self) -> Setting<'a, N, S> {
        let Self { source, patch, occluder, rules, go_on, threshold, extend, weight, .. } = *self;
        Setting { source, patch, occluder, rules, go_on, threshold, extend, weight }
    }

    fn begin<R: Receiver<N>>(&mut self, receiver: &mut R) {
        let (centre, radius) = self.patch.sphere();
        let estimate = self.source.estimate_w_m2(centre, radius, self.patch.frame.normal);
        let area = self.patch.frame.area_m2 * receiver.shape().share();
        let carried = self.weight * estimate * area.sqrt();
        if carried <= COARSE_SHARE * self.threshold && !matches!(self.rules.oracle, Oracle::Uniform(_)) {
            return self.coarse(receiver, area, estimate);
        }
        let top = self.scratch.candidates.len();
        self.visit(receiver, Cell::UNIT, Candidates::Scene, 0, None);
        self.scratch.candidates.truncate(top);
    }

    /// One sample stands for the whole surface.
    fn coarse<R: Receiver<N>>(&mut self, receiver: &mut R, area_m2: f64, estimate_w_m2: f64) {
        let point = [self.patch.frame.point(middle_of(receiver.shape()))];
        let tolerance = Tolerance { relative: COARSE, absolute_w_m2: 0.5 * estimate_w_m2 };
        let mut irradiance = [[0.0; N]];
        let before = self.scratch.work.cost();
        self.gather(&point, &point, &point, Candidates::Scene, tolerance, &mut irradiance, &mut [0.0]);
        self.deposited.span = self.scratch.work.cost() - before;
        let mut coefficients = [[0.0; N]; MAX_FUNCTIONS];
        coefficients[0] = irradiance[0];
        self.deposit(receiver, &coefficients, area_m2);
        let carried = self.weight * norm(&irradiance[0]);
        self.scratch.work.interactions += 1;
        self.scratch.work.pairs_coarse += 1;
        self.deposited.error_squared += 0.1 * carried * carried * area_m2;
    }

    pub(super) fn deposit<R: Receiver<N>>(
        &mut self,
        receiver: &mut R,
        light: &[[f64; N]; MAX_FUNCTIONS],
        area_m2: f64,
    ) {
        receiver.deposit(light);
        self.deposited.take(self.patch, light, area_m2);
    }

    #[allow(clippy::too_many_arguments)]
    pub(super) fn gather(
        &mut self,
        position: &[DVec3],
        eye: &[DVec3],
        hull: &[DVec3],
        candidates: Candidates,
        tolerance: Tolerance,
        irradiance: &mut [[f64; N]],
        uncertain: &mut [f64],
    ) {
        let points = Points { position, eye, normal: self.patch.frame.normal, face: self.patch.face, hull };
        self.source.gather(
            &points,
            self.occluder,
            candidates,
            tolerance,
            irradiance,
            uncertain,
            self.scratch,
        );
    }

    /// Visits an element of the receiver; where links wait, only as far as it takes to have those go down.
    fn visit<R: Receiver<N>>(
        &mut self,
        receiver: &mut R,
        cell: Cell,
        candidates: Candidates,
        level: u8,
        waiting: Option<&[Waiting<N>]>,
    ) {
        let idle = receiver.shape() == Shape::Outside || waiting.is_some() && receiver.split().is_none();
        if idle || !(self.go_on)() {
            return;
        }
        let hull = cell_corners(&cell).map(|c| self.patch.frame.point(c));
        if !self.source.reaches(self.patch.frame.normal, &hull) {
            return;
        }
        let before = self.scratch.work.cost();
        let candidates = self.narrow(&hull, candidates);
        if level == 0 && waiting.is_none() && candidates == Candidates::Free {
            self.scratch.work.pairs_unoccluded += 1;
        }
        if candidates == Candidates::Hidden {
            self.scratch.work.pairs_hidden += 1;
            return;
        }
        let (split, waiting) = match (waiting, self.rules.oracle) {
            (Some([link]), _) if link.cell == cell => {
                receiver.deposit(&link.light.map(|c| c.map(|e| -e)));
                self.deposited.take_back(self.patch, link);
                (receiver.split(), None)
            }
            (Some(_), _) => (receiver.split(), waiting),
            (None, Oracle::Uniform(depth)) if level < depth => (Some(Split::Both), None),
            (None, _) => (self.try_link(receiver, &cell, &hull, candidates), None),
        };
        let cost = self.scratch.work.cost() - before;
        let Some(wanted) = split else {
            self.deposited.span = cost;
            return;
        };
        if receiver.split().is_none() {
            let shape = receiver.shape();
            let shapes: Vec<Shape> =
                (0..wanted.children().len()).map(|i| shape.of_child(&cell.child(wanted, i))).collect();
            receiver.subdivide(wanted, &shapes, self.helpers.arena());
        }
        let split = receiver.split().unwrap_or(wanted);
        let taken_back = std::mem::take(&mut self.deposited);
        self.visit_children(receiver, cell, split, candidates, level + 1, waiting);
        self.deposited.add_after(taken_back);
        self.deposited.span += cost;
    }

    /// Visits the children. What they receive is summed child by child, so that it is the same whoever visited them.
    fn visit_children<R: Receiver<N>>(
        &mut self,
        receiver: &mut R,
        cell: Cell,
        split: Split,
        candidates: Candidates,
        level: u8,
        waiting: Option<&[Waiting<N>]>,
    ) {
        let mut sum = Deposited::default();
        let of_child = |cell: &Cell| waiting.map(|waiting| within(waiting, cell));
        let children = receiver.children_mut().iter_mut().enumerate();
        let children = children
            .map(|(index, child)| (child, cell.child(split, index)))
            .map(|(child, cell)| (child, cell, of_child(&cell)))
            .filter(|(_, _, waiting)| waiting.is_none_or(|waiting| !waiting.is_empty()));
        let helpers = self.helpers;
        if helpers.wanted() {
            let blockers = match candidates {
                Candidates::List(start, end) => self.scratch.candidates[start..end].to_vec(),
                _ => Vec::new(),
            };
            let part =
                |(receiver, cell, waiting)| Part { receiver, cell, waiting, deposited: Deposited::default() };
            let mut parts: Vec<Part<'_, N, R>> = children.map(part).collect();
            self.setting().visit_parts(helpers, self.scratch, &mut parts, candidates, &blockers, level);
            parts.into_iter().for_each(|part| sum.add_beside(part.deposited));
        } else {
            for (child, cell, waiting) in children {
                let top = self.scratch.candidates.len();
                self.visit(child, cell, candidates, level, waiting);
                sum.add_beside(std::mem::take(&mut self.deposited));
                self.scratch.candidates.truncate(top);
            }
        }
        self.deposited = sum;
    }

    fn narrow(&mut self, hull: &[DVec3; 4], candidates: Candidates) -> Candidates {
        if candidates == Candidates::Free {
            return candidates;
        }
        let (source, normal) = self.source.hull(hull);
        let shaft = Shaft::between(hull, Some(self.patch.frame.normal), &source, normal);
        let skip = [self.patch.face, self.source.face()];
        narrow(self.occluder, &shaft, candidates, skip, hull, &source, self.scratch)
    }
}

/// Those of links in the order of the elements that lie in a cell.
fn within<'w, const N: usize>(waiting: &'w [Waiting<N>], cell: &Cell) -> &'w [Waiting<N>] {
    let inside = |link: &Waiting<N>| {
        let middle = cell.to_local(link.cell.centre());
        middle.min_element() > 0.0 && middle.max_element() < 1.0
    };
    let start = waiting.iter().position(inside).unwrap_or(waiting.len());
    let count = waiting[start..].iter().take_while(|link| inside(link)).count();
    &waiting[start..start + count]
}

/// A point of the surface that stands for it: the middle of the parallelogram, or of an outline the mean of its corners, or where that lies
/// outside, the point of the boundary nearest to it.
pub(super) fn middle_of(shape: Shape<&[DVec2]>) -> DVec2 {
    let Shape::Part(outline, _) = shape else { return DVec2::splat(0.5) };
    let mean = outline.iter().sum::<DVec2>() / outline.len() as f64;
    if polygon::contains(outline, mean) {
        mean
    } else {
        polygon::nearest_on_boundary(outline, mean, |d| d.length_squared())
    }
}
