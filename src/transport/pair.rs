//! One pair task: light from one source to one receiver's tree, refined until the receiver's basis represents it within tolerance.
//!
//! The oracle (after Bekaert and Willems 1996): the irradiance at sample points of the receiver element is compared with its projection.
//! A link is accepted when `‖ρ (E_projected − E)‖ √A`, its share of the L2 error of radiosity, is below the threshold τ; errors of
//! disjoint elements add up in squares exactly, so that one τ for all links spends the fewest elements on a given total.

use glam::{DVec2, DVec3};

use super::candidates::{Candidates, narrow};
use super::gather::{Gather, Points, Tolerance, norm};
use super::packet::{Packet, Shape, cell_corners};
use super::samples::{MAX_SAMPLES, Projected, SampleRule};
use super::share::Helpers;
use super::unblocked::Fragments;
use super::work::Work;
use crate::math::basis::MAX_FUNCTIONS;
use crate::math::{Cell, Split, polygon};
use crate::scene::{Frame, Surface};
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

/// Share of an element's light that may be misjudged where all of its sample points agree on visibility and a blocker as narrow as half
/// the element may stand in between. It falls with the square of the element's size over the narrowest blocker's.
const UNSEEN_SHADOW: f64 = 0.08;

/// Share of the point tolerance in the link tolerance: noise of the points must not look like detail.
const POINT_SHARE: f64 = 0.15;

/// Pairs that carry less than this share of the threshold are taken by one sample.
const COARSE_SHARE: f64 = 0.5;

/// Tolerance of the first look at an element, and of a pair that is taken by one sample, as a share of the light.
const COARSE: f64 = 0.25;

/// How much sharper each further look is, and the sharpest there is.
const SHARPER: f64 = 0.2;
const SHARPEST: f64 = 1e-6;

/// Cells are not divided below this extent of the surface's parametrisation.
const LEAST_EXTENT: f64 = 1.0 / (1 << 20) as f64;

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
    /// How receivers are sampled and projected.
    pub samples: SampleRule,
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

/// What a pair task needs to know of the receiving surface.
#[derive(Clone, Debug)]
pub struct Patch<const N: usize> {
    /// Index of the surface.
    pub surface: u32,
    /// Its face.
    pub face: u32,
    /// The parallelogram.
    pub frame: Frame,
    /// Reflectance per band.
    pub reflectance: [f64; N],
    /// Corners of the polygon in metres.
    pub corners: Box<[DVec3]>,
}

impl<const N: usize> Patch<N> {
    /// The patch of a surface with `N` bands.
    pub fn new(index: u32, surface: &Surface) -> Self {
        Self {
            surface: index,
            face: surface.face,
            frame: surface.frame,
            reflectance: std::array::from_fn(|n| surface.reflectance[n]),
            corners: surface.outline.iter().map(|p| surface.frame.point(*p)).collect(),
        }
    }
}

impl<const N: usize> Patch<N> {
    /// Bound on the mean radiosity, all bands, that irradiance with these coefficients causes: `Σ ‖ρ b_l‖ ∫|φ_l|`.
    pub fn reflected_w_m2(&self, light: &[[f64; N]; MAX_FUNCTIONS]) -> f64 {
        // ∫|φ_l| is 1 for the mean and at most 0.87 for the others.
        let reflected = |c: &[f64; N]| (0..N).map(|n| self.reflectance[n] * c[n].abs()).sum::<f64>();
        reflected(&light[0]) + 0.87 * light[1..].iter().map(reflected).sum::<f64>()
    }
}

/// A receiving element, which owns the elements below it.
pub trait Receiver<const N: usize>: Send {
    /// How the cell lies to the surface's polygon.
    fn shape(&self) -> &Shape;
    /// How it is divided, if it is.
    fn split(&self) -> Option<Split>;
    /// Divides it; `shapes` are those of the children.
    fn subdivide(&mut self, split: Split, shapes: Vec<Shape>);
    /// The children of a divided element, else none.
    fn children_mut(&mut self) -> &mut [Self]
    where
        Self: Sized;
    /// Adds irradiance in W/m², given by its coefficients.
    fn deposit(&mut self, irradiance: &[[f64; N]; MAX_FUNCTIONS]);
}

/// Where light comes from.
pub trait Source<const N: usize>: Sync {
    /// Index of the emitting surface; `u32::MAX` for a lamp.
    fn surface(&self) -> u32;
    /// The face it lies on; `u32::MAX` for a lamp.
    fn face(&self) -> u32;
    /// Corners around the source as seen from a receiver, and its plane's normal if it has a plane.
    fn hull(&self, receiver: &[DVec3]) -> ([DVec3; 4], Option<DVec3>);
    /// Whether any light can reach the front of a plane polygon.
    fn reaches(&self, normal: DVec3, corners: &[DVec3]) -> bool;
    /// Estimate, on the safe side, of the irradiance norm on a sphere with this normal.
    fn estimate_w_m2(&self, centre: DVec3, radius: f64, normal: DVec3) -> f64;
    /// The largest exitance or intensity it has: what the geometry oracle divides by.
    fn strength(&self) -> f64;
    /// Adds the irradiance at `points`, each to about `tolerance`.
    #[allow(clippy::too_many_arguments)]
    fn gather(
        &self,
        points: &Points<'_>,
        occluder: &dyn Occluder,
        candidates: Candidates,
        tolerance: Tolerance,
        irradiance: &mut [[f64; N]],
        uncertain: &mut [f64],
        scratch: &mut Scratch,
    );
}

impl<const N: usize> Source<N> for Packet<N> {
    fn surface(&self) -> u32 {
        self.surface
    }

    fn face(&self) -> u32 {
        self.face
    }

    fn hull(&self, _receiver: &[DVec3]) -> ([DVec3; 4], Option<DVec3>) {
        (cell_corners(&Cell::UNIT).map(|c| self.frame.point(c)), Some(self.frame.normal))
    }

    fn reaches(&self, normal: DVec3, corners: &[DVec3]) -> bool {
        let size = self.frame.u.length() + self.frame.v.length();
        let in_front = |n: DVec3, origin: DVec3, p: DVec3| n.dot(p - origin) > 1e-9 * size;
        let Some(at) = corners.first() else { return false };
        let receiver_sees = match &self.outline {
            None => cell_corners(&Cell::UNIT).iter().any(|c| in_front(normal, *at, self.frame.point(*c))),
            Some(outline) => outline.iter().any(|c| in_front(normal, *at, self.frame.point(*c))),
        };
        receiver_sees && corners.iter().any(|p| in_front(self.frame.normal, self.frame.origin, *p))
    }

    fn estimate_w_m2(&self, centre: DVec3, radius: f64, normal: DVec3) -> f64 {
        let middle = self.frame.point(DVec2::splat(0.5));
        let half = 0.5 * (self.frame.u + self.frame.v).length().max((self.frame.u - self.frame.v).length());
        let between = middle - centre;
        let distance = between.length();
        let gap = (distance - radius - half).max(0.0);
        let cosine = |height: f64| if gap > 0.0 { (height / gap).clamp(0.0, 1.0) } else { 1.0 };
        let cos_x = cosine(normal.dot(between) + radius + half);
        let cos_y = cosine(-self.frame.normal.dot(between) + radius + half);
        let area = self.frame.area_m2;
        self.strength() * (cos_x * cos_y * area / (std::f64::consts::PI * gap * gap + area))
    }

    fn strength(&self) -> f64 {
        let root = &self.nodes[0];
        root.coefficients.iter().map(norm).sum::<f64>() + root.detail.rms_w_m2
    }

    fn gather(
        &self,
        points: &Points<'_>,
        occluder: &dyn Occluder,
        candidates: Candidates,
        tolerance: Tolerance,
        irradiance: &mut [[f64; N]],
        uncertain: &mut [f64],
        scratch: &mut Scratch,
    ) {
        Gather::new(self, points, occluder, irradiance, uncertain, scratch).run(candidates, tolerance);
    }
}

/// What a pair task brought to a receiver.
#[derive(Clone, Copy, Debug)]
pub struct Deposited<const N: usize> {
    /// Power received, per band, in W.
    pub received_w: [f64; N],
    /// Bound on the power to reflect, all bands, in W: `Σ ‖ρ b_l‖ ∫|φ_l|` over the coefficients.
    pub to_reflect_w: f64,
    /// Sum of squared link errors `(ρ δ)² A`, W²/m².
    pub error_squared: f64,
    /// Cost of the longest chain of parts that wait for each other: from the whole receiver down to one of its leaves.
    pub span: u64,
}

impl<const N: usize> Default for Deposited<N> {
    fn default() -> Self {
        Self { received_w: [0.0; N], to_reflect_w: 0.0, error_squared: 0.0, span: 0 }
    }
}

impl<const N: usize> Deposited<N> {
    /// Adds what another part brought that waits for none of these.
    fn add_beside(&mut self, o: Self) {
        for n in 0..N {
            self.received_w[n] += o.received_w[n];
        }
        self.to_reflect_w += o.to_reflect_w;
        self.error_squared += o.error_squared;
        self.span = self.span.max(o.span);
    }
}

/// Transports the light of `source` to the tree of `receiver`. The one function every schedule runs; `helpers`, if there are any, may take
/// over subtrees of the receiver, which does not show in the result.
pub fn shoot<const N: usize, R: Receiver<N>>(
    source: &impl Source<N>,
    patch: &Patch<N>,
    receiver: &mut R,
    occluder: &dyn Occluder,
    rules: &Rules,
    scratch: &mut Scratch,
    helpers: Option<&dyn Helpers>,
) -> Deposited<N> {
    if source.surface() == patch.surface || source.face() == patch.face {
        return Deposited::default();
    }
    if !source.reaches(patch.frame.normal, &patch.corners) {
        scratch.work.pairs_behind += 1;
        return Deposited::default();
    }
    let mut threshold = rules.threshold_w_m;
    if rules.oracle == Oracle::Geometry {
        threshold *= source.strength() / rules.reference_w_m2;
    }
    let hull = cell_corners(&Cell::UNIT).map(|c| patch.frame.point(c));
    // Beyond the polygon the light of a source well in front continues smoothly; that of a source whose plane cuts the
    // parallelogram does not, and is taken from the nearest point of the polygon.
    let (source_hull, source_normal) = source.hull(&hull);
    let extend = source_normal.is_none_or(|n| {
        let height = |p: &DVec3| n.dot(*p - source_hull[0]);
        let least = hull.iter().map(height).fold(f64::INFINITY, f64::min);
        least > 0.0
    });
    let weight = patch.reflectance.iter().copied().fold(rules.least_reflectance, f64::max);
    let setting = Setting { source, patch, occluder, rules, threshold, extend, weight };
    let mut task = setting.run_by(scratch, helpers);
    task.begin(receiver);
    task.deposited
}

/// What all parts of a pair task have in common.
struct Setting<'a, const N: usize, S> {
    source: &'a S,
    patch: &'a Patch<N>,
    occluder: &'a dyn Occluder,
    rules: &'a Rules,
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
    fn run_by<'b>(self, scratch: &'b mut Scratch, helpers: Option<&'b dyn Helpers>) -> Shoot<'b, N, S>
    where
        'a: 'b,
    {
        let Setting { source, patch, occluder, rules, threshold, extend, weight } = self;
        let deposited = Deposited::default();
        Shoot { source, patch, occluder, rules, scratch, helpers, threshold, extend, weight, deposited }
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
                let mut task = self.run_by(scratch, Some(helpers));
                task.visit(part.receiver, part.cell, candidates, level);
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
    deposited: Deposited<N>,
}

struct Shoot<'a, const N: usize, S> {
    source: &'a S,
    patch: &'a Patch<N>,
    occluder: &'a dyn Occluder,
    rules: &'a Rules,
    scratch: &'a mut Scratch,
    helpers: Option<&'a dyn Helpers>,
    threshold: f64,
    extend: bool,
    weight: f64,
    deposited: Deposited<N>,
}

/// The sample points of one element.
struct Sampling {
    count: usize,
    position: [DVec3; MAX_SAMPLES],
    eye: [DVec3; MAX_SAMPLES],
    inside: u32,
}

/// What sampling an element showed; errors of radiosity and irradiances in W/m².
struct Look<const N: usize> {
    projected: Projected<N>,
    error: f64,
    unseen: f64,
    light: f64,
}

impl<'a, const N: usize, S: Source<N>> Shoot<'a, N, S> {
    fn setting(&self) -> Setting<'a, N, S> {
        let Self { source, patch, occluder, rules, threshold, extend, weight, .. } = *self;
        Setting { source, patch, occluder, rules, threshold, extend, weight }
    }

    fn begin<R: Receiver<N>>(&mut self, receiver: &mut R) {
        let corners = &self.patch.corners;
        let centre = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let radius = corners.iter().map(|c| c.distance(centre)).fold(0.0, f64::max);
        let estimate = self.source.estimate_w_m2(centre, radius, self.patch.frame.normal);
        let area = self.patch.frame.area_m2 * receiver.shape().share();
        let carried = self.weight * estimate * area.sqrt();
        if carried <= COARSE_SHARE * self.threshold && !matches!(self.rules.oracle, Oracle::Uniform(_)) {
            return self.coarse(receiver, area, estimate);
        }
        let top = self.scratch.candidates.len();
        self.visit(receiver, Cell::UNIT, Candidates::Scene, 0);
        self.scratch.candidates.truncate(top);
    }

    /// One sample stands for the whole surface.
    fn coarse<R: Receiver<N>>(&mut self, receiver: &mut R, area_m2: f64, estimate_w_m2: f64) {
        let uv = match receiver.shape() {
            Shape::Part(outline, _) => middle_of(outline),
            _ => DVec2::splat(0.5),
        };
        let point = [self.patch.frame.point(uv)];
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

    fn deposit<R: Receiver<N>>(&mut self, receiver: &mut R, light: &[[f64; N]; MAX_FUNCTIONS], area_m2: f64) {
        receiver.deposit(light);
        self.deposited.to_reflect_w += area_m2 * self.patch.reflected_w_m2(light);
        for n in 0..N {
            self.deposited.received_w[n] += area_m2 * light[0][n];
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn gather(
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

    fn visit<R: Receiver<N>>(&mut self, receiver: &mut R, cell: Cell, candidates: Candidates, level: u8) {
        if *receiver.shape() == Shape::Outside {
            return;
        }
        let hull = cell_corners(&cell).map(|c| self.patch.frame.point(c));
        if !self.source.reaches(self.patch.frame.normal, &hull) {
            return;
        }
        let before = self.scratch.work.cost();
        let candidates = self.narrow(&hull, candidates);
        if level == 0 && candidates == Candidates::Free {
            self.scratch.work.pairs_unoccluded += 1;
        }
        if candidates == Candidates::Hidden {
            self.scratch.work.pairs_hidden += 1;
            return;
        }
        let split = match self.rules.oracle {
            Oracle::Uniform(depth) if level < depth => Some(Split::Both),
            _ => self.try_link(receiver, &cell, &hull, candidates),
        };
        let cost = self.scratch.work.cost() - before;
        let Some(wanted) = split else {
            self.deposited.span = cost;
            return;
        };
        if receiver.split().is_none() {
            let shape = receiver.shape();
            let shapes =
                (0..wanted.children().len()).map(|i| shape.of_child(&cell.child(wanted, i))).collect();
            receiver.subdivide(wanted, shapes);
        }
        let split = receiver.split().unwrap_or(wanted);
        self.visit_children(receiver, cell, split, candidates, level + 1);
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
    ) {
        let mut sum = Deposited::default();
        let children = receiver.children_mut().iter_mut().enumerate();
        if let Some(helpers) = self.helpers.filter(|helpers| helpers.wanted()) {
            let blockers = match candidates {
                Candidates::List(start, end) => self.scratch.candidates[start..end].to_vec(),
                _ => Vec::new(),
            };
            let part = |(index, receiver)| {
                let cell = cell.child(split, index);
                Part { receiver, cell, deposited: Deposited::default() }
            };
            let mut parts: Vec<Part<'_, N, R>> = children.map(part).collect();
            self.setting().visit_parts(helpers, self.scratch, &mut parts, candidates, &blockers, level);
            parts.iter().for_each(|part| sum.add_beside(part.deposited));
        } else {
            for (index, child) in children {
                let top = self.scratch.candidates.len();
                self.visit(child, cell.child(split, index), candidates, level);
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

    /// Samples the element; deposits its projection and returns `None`, or returns how to divide it.
    fn try_link<R: Receiver<N>>(
        &mut self,
        receiver: &mut R,
        cell: &Cell,
        hull: &[DVec3; 4],
        candidates: Candidates,
    ) -> Option<Split> {
        let sampling = self.sample(receiver.shape(), cell);
        let area = self.patch.frame.area_m2 * cell.area() * receiver.shape().share();
        let weight = self.weight * area.sqrt();
        let strict = POINT_SHARE * self.threshold / weight;
        let whole = *receiver.shape() == Shape::Whole;
        // A first look, only as sharp as it takes to see that the element must be divided.
        let middle = 0.25 * hull.iter().sum::<DVec3>();
        let radius = hull.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
        let estimate = self.source.estimate_w_m2(middle, radius, self.patch.frame.normal);
        let hideable = self.hideable(cell, candidates);
        if candidates != Candidates::Free && !matches!(self.rules.oracle, Oracle::Uniform(_)) {
            let light = self.glance(&middle, estimate);
            let unseen = 0.7 * self.weight * hideable * light;
            if area.sqrt() * unseen > self.threshold && cell.size.max_element() > LEAST_EXTENT {
                return Some(self.longer_side(cell));
            }
        }
        let uniform = matches!(self.rules.oracle, Oracle::Uniform(_));
        let indivisible = cell.size.max_element() <= LEAST_EXTENT;
        let mut tolerance = Tolerance { relative: COARSE, absolute_w_m2: (COARSE * estimate).max(strict) };
        loop {
            let mut look = self.look(&sampling, hull, candidates, tolerance, whole);
            look.unseen *= hideable;
            let link_error = area.sqrt() * look.error;
            let sharp = tolerance.absolute_w_m2.max(tolerance.relative * look.light) <= 1.001 * strict
                || tolerance.relative <= SHARPEST;
            // What the look may be wrong by must not divide the element.
            let noise = if sharp { 0.0 } else { weight * tolerance.absolute_w_m2 };
            let accepted = uniform
                || indivisible
                || link_error.hypot(area.sqrt() * look.unseen) <= self.threshold + noise;
            if !accepted {
                return Some(self.direction(cell, &look));
            }
            if sharp {
                self.scratch.work.interactions += 1;
                self.deposited.error_squared += link_error * link_error;
                self.deposit(receiver, &look.projected.coefficients, area);
                return None;
            }
            let absolute_w_m2 = (SHARPER * tolerance.absolute_w_m2.min(look.light)).max(strict);
            tolerance =
                Tolerance { relative: (absolute_w_m2 / look.light).clamp(SHARPEST, COARSE), absolute_w_m2 };
        }
    }

    /// Share of the light on an element that shadows between its sample points may take: narrow blockers cast narrow shadows.
    fn hideable(&self, cell: &Cell, candidates: Candidates) -> f64 {
        let Candidates::List(start, end) = candidates else { return UNSEEN_SHADOW };
        let faces = self.occluder.faces();
        let list = &self.scratch.candidates[start..end];
        let narrowest = list.iter().map(|f| faces.width(*f)).fold(f64::INFINITY, f64::min);
        let (u, v) = (self.patch.frame.u * cell.size.x, self.patch.frame.v * cell.size.y);
        let half = 0.5 * u.length().max(v.length());
        UNSEEN_SHADOW * (half / narrowest).min(1.0).powi(2)
    }

    /// The light that would fall on the middle of an element if nothing stood in between, roughly.
    fn glance(&mut self, middle: &DVec3, estimate: f64) -> f64 {
        let point = std::slice::from_ref(middle);
        let tolerance = Tolerance { relative: 0.2, absolute_w_m2: 0.05 * estimate };
        let mut light = [[0.0; N]];
        self.gather(point, point, point, Candidates::Free, tolerance, &mut light, &mut [0.0]);
        norm(&light[0])
    }

    /// Samples the element once.
    fn look(
        &mut self,
        sampling: &Sampling,
        hull: &[DVec3; 4],
        candidates: Candidates,
        tolerance: Tolerance,
        whole: bool,
    ) -> Look<N> {
        let mut values = [[0.0; N]; MAX_SAMPLES];
        let mut uncertain = [0.0; MAX_SAMPLES];
        let n = sampling.count;
        self.gather(
            &sampling.position[..n],
            &sampling.eye[..n],
            hull,
            candidates,
            tolerance,
            &mut values[..n],
            &mut uncertain[..n],
        );
        let projected = self.rules.samples.project(&values[..n]);
        let error = self.residual(sampling, &projected, &values, whole);
        let unseen = self.weight * mean_square(&uncertain[..n], sampling.inside).sqrt();
        let light = values[..n].iter().map(norm).fold(0.0, f64::max);
        Look { projected, error, unseen, light }
    }

    /// RMS error of the projected irradiance over the element times the weight, in W/m².
    fn residual(
        &self,
        sampling: &Sampling,
        projected: &Projected<N>,
        values: &[[f64; N]; MAX_SAMPLES],
        whole: bool,
    ) -> f64 {
        let rule = &self.rules.samples;
        let tests = if whole { rule.nodes..sampling.count } else { 0..sampling.count };
        let (mut sum, mut count) = (0.0, 0);
        for p in tests.filter(|p| sampling.inside & (1 << p) != 0) {
            sum += rule.residual_squared(p, &projected.coefficients, &values[p]);
            count += 1;
        }
        let tested = if count > 0 { sum / count as f64 } else { 0.0 };
        let (beyond_u, beyond_v) = projected.beyond;
        let truncated = if whole { beyond_u * beyond_u + beyond_v * beyond_v } else { 0.0 };
        self.weight * tested.max(truncated).sqrt()
    }

    /// Across which direction the error asks to divide; both where it does not say.
    fn direction(&self, cell: &Cell, look: &Look<N>) -> Split {
        let (u, v) = look.projected.beyond;
        if self.weight * u.max(v) > 0.3 * look.error {
            if u > 4.0 * v {
                return Split::U;
            }
            if v > 4.0 * u {
                return Split::V;
            }
        }
        self.longer_side(cell)
    }

    /// Across the longer side of a slender cell, else both.
    fn longer_side(&self, cell: &Cell) -> Split {
        let du = self.patch.frame.u.length() * cell.size.x;
        let dv = self.patch.frame.v.length() * cell.size.y;
        if du > 3.0 * dv {
            Split::U
        } else if dv > 3.0 * du {
            Split::V
        } else {
            Split::Both
        }
    }

    fn sample(&self, shape: &Shape, cell: &Cell) -> Sampling {
        let rule = &self.rules.samples;
        let frame = &self.patch.frame;
        let mut sampling = Sampling {
            count: rule.points.len(),
            position: [DVec3::ZERO; MAX_SAMPLES],
            eye: [DVec3::ZERO; MAX_SAMPLES],
            inside: 0,
        };
        for (p, local) in rule.points.iter().enumerate() {
            let uv = cell.to_surface(*local);
            let point = frame.point(uv);
            sampling.position[p] = point;
            sampling.eye[p] = point;
            sampling.inside |= 1 << p;
            if let Shape::Part(outline, _) = shape
                && !polygon::contains(outline, uv)
            {
                sampling.eye[p] = frame.point(nearest_inside(outline, uv, frame));
                sampling.inside &= !(1 << p);
                if !self.extend {
                    sampling.position[p] = sampling.eye[p];
                }
            }
        }
        sampling
    }
}

/// The point of `outline` nearest to `uv` outside of it, a thousandth of the way further in, so that it does not lie on an edge.
fn nearest_inside(outline: &[DVec2], uv: DVec2, frame: &Frame) -> DVec2 {
    let near =
        polygon::nearest_on_boundary(outline, uv, |d| (d.x * frame.u + d.y * frame.v).length_squared());
    let further = near + (near - uv) * 1e-3;
    if polygon::contains(outline, further) { further } else { near }
}

/// A point inside the outline: the mean of its corners, or where that lies outside, the point of the boundary nearest to it.
fn middle_of(outline: &[DVec2]) -> DVec2 {
    let mean = outline.iter().sum::<DVec2>() / outline.len() as f64;
    if polygon::contains(outline, mean) {
        mean
    } else {
        polygon::nearest_on_boundary(outline, mean, |d| d.length_squared())
    }
}

/// Mean square of the values whose bit is set.
fn mean_square(values: &[f64], mask: u32) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (_, value) in values.iter().enumerate().filter(|(p, _)| mask & (1 << p) != 0) {
        sum += value * value;
        count += 1;
    }
    if count > 0 { sum / count as f64 } else { 0.0 }
}
