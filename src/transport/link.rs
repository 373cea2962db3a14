//! One link: the light of a source on one element, sampled, projected, and judged at points that are not nodes.

use std::cell::OnceCell;

use glam::{DVec2, DVec3};

use super::candidates::Candidates;
use super::descent::Aim;
use super::gather::{Points, Tolerance, norm};
use super::packet::Shape;
use super::pair::{COARSE, Oracle, Scratch, Task};
use super::samples::{MAX_SAMPLES, Projected, SampleRule, SampleRules};
use super::source::Source;
use super::stored::{Kept, Links};
use crate::math::basis::MAX_FUNCTIONS;
use crate::math::{Cell, Split, polygon};
use crate::scene::Frame;

/// Share of an element's light that may be misjudged where all of its sample points agree on visibility and a blocker as narrow as half
/// the element may stand in between. It falls with the square of the element's size over the narrowest blocker's.
const UNSEEN_SHADOW: f64 = 0.08;

/// Share of the point tolerance in the link tolerance: noise of the points must not look like detail.
const POINT_SHARE: f64 = 0.15;

/// How much more than others links of which a part may be shaded may deviate at a point before they go down to finer elements: edges of
/// shadows do not vanish in the sum over sources.
const SHADED: f64 = 10.0;

/// Tolerance of the points of links that nothing shades, over the deviation at which these go down.
const POINT_NOISE: f64 = 5.0;

/// Light that carries at most this many thresholds is sampled at few points and projected on few functions, as long as that suffices.
const MODEST: f64 = 8.0;

/// How much brighter than the light expected a point may be before the element is looked at again by what was found: tolerances are shares of
/// the light, few points are brighter, and another look costs as much as the first.
const BRIGHTER: f64 = 2.0;

/// The sharpest relative tolerance of a look.
const SHARPEST: f64 = 1e-6;

/// Cells whose sides differ by more than this are divided across the longer one. Not 3, which rooms of round measures have exactly.
const SLENDER: f64 = 3.01;

/// Cells are not divided below this extent of the surface's parametrisation. What links to them may err by is counted as it is.
const LEAST_EXTENT: f64 = 1.0 / (1 << 20) as f64;

/// An element of a receiver.
pub(super) struct Element<'a> {
    pub cell: Cell,
    /// Its corners.
    pub hull: [DVec3; 4],
    pub shape: Shape<&'a [DVec2]>,
    /// Area of what lies on the polygon, in m².
    pub area_m2: f64,
    /// Whether it is divided already.
    pub divided: bool,
}

/// What becomes of a link.
pub(super) enum Verdict<const N: usize> {
    /// It may stay.
    Linked {
        /// Irradiance, by its coefficients, in W/m².
        light: [[f64; N]; MAX_FUNCTIONS],
        /// Squared link error in W²/m².
        error_squared: f64,
        /// Whether that is more than it may be, because the element is as small as elements get.
        cut_short: bool,
        /// Whether it must go down to finer elements if there are any.
        deviates: bool,
        /// The link, if links are recorded.
        record: Links,
    },
    /// It goes down to the parts that are there.
    Down,
    /// The element must be divided.
    Rough(Split),
}

/// The sample points of an element by one rule.
struct Sampling {
    count: usize,
    position: [DVec3; MAX_SAMPLES],
    eye: [DVec3; MAX_SAMPLES],
    inside: u32,
}

/// The sample points of an element, made when first asked for; sources share them.
pub(super) struct Samplings<'a> {
    element: &'a Element<'a>,
    frame: &'a Frame,
    rules: &'a SampleRules,
    /// By rule (full, modest, lean), and whether they extend beyond the polygon.
    made: [[OnceCell<Sampling>; 2]; 3],
}

/// What sampling an element showed; errors of radiosity and irradiances in W/m².
struct Look<const N: usize> {
    projected: Projected<N>,
    error: f64,
    /// The largest error at a test point.
    worst: f64,
    unseen: f64,
    light: f64,
}

/// What a link may lose.
struct Allowance {
    /// Deviation at a point above which the link goes down to finer elements that are there.
    point_w_m2: f64,
    /// The sharpest tolerance of sample points that makes sense.
    strict_w_m2: f64,
    /// Share of the light that shadows between the sample points of the full rule may take.
    hideable: f64,
    /// Whether the link is to be taken whatever its error.
    forced: bool,
    /// Whether that is so because the element is as small as elements get.
    least: bool,
    /// Whether the element is known to be divided.
    divided: bool,
}

/// What came of a look.
enum Found<const N: usize> {
    /// That is all there is to know.
    Verdict(Verdict<N>),
    /// A sharper look is wanted; the light seen in W/m².
    Sharper(f64),
    /// The element must be divided.
    Rough(Look<N>),
}

/// A link to be judged.
pub(super) struct Link<'a, 's, const N: usize, S> {
    pub task: Task<'a, N>,
    /// What an error of irradiance counts.
    pub weight: f64,
    /// Whether it is recorded.
    pub records: bool,
    pub aim: &'a Aim<'a, S>,
    pub element: &'s Element<'s>,
    pub samplings: &'s Samplings<'s>,
    pub candidates: Candidates,
    pub scratch: &'s mut Scratch,
}

impl<const N: usize, S: Source<N>> Link<'_, '_, N, S> {
    /// Samples the element, which is known to be `divided` or not.
    pub fn judge(mut self, divided: bool) -> Verdict<N> {
        let (element, candidates) = (self.element, self.candidates);
        let weight = self.weight * element.area_m2.sqrt();
        // Where several sources' light is smooth in sum only, noise would show at points long before it counts in the mean square.
        let point_w_m2 = self.task.rules.point_w_m2;
        let (point_w_m2, quiet_w_m2) = match candidates {
            Candidates::Free => (point_w_m2, POINT_NOISE * point_w_m2),
            _ => (SHADED * point_w_m2, f64::INFINITY),
        };
        let strict_w_m2 =
            (POINT_SHARE * self.aim.threshold).min(quiet_w_m2 * element.area_m2.sqrt()) / weight;
        let middle = 0.25 * element.hull.iter().sum::<DVec3>();
        let radius = element.hull.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
        let estimate = self.aim.source.estimate_w_m2(middle, radius, self.task.patch.frame.normal);
        let hideable = self.hideable();
        let uniform = matches!(self.task.rules.oracle, Oracle::Uniform(_));
        let least = !uniform && self.is_indivisible();
        let forced = uniform || least;
        let allowance = Allowance { point_w_m2, strict_w_m2, hideable, forced, least, divided };
        let samplings = self.samplings;
        // What nothing shades costs no rays, and must be smooth in the sum over sources.
        let shaded = candidates != Candidates::Free && !forced;
        let modest = weight * estimate <= MODEST * self.aim.threshold;
        if shaded && modest {
            let tolerance = Tolerance { relative: SHARPEST, absolute_w_m2: strict_w_m2 };
            let rule = &self.task.rules.samples.modest;
            let sampling = samplings.modest(self.aim.extend);
            if let Found::Verdict(verdict) = self.look_at((rule, sampling), &allowance, tolerance) {
                return verdict;
            }
        } else if shaded && divided {
            // Its parts cost less than a look at the whole.
            return Verdict::Down;
        }
        let full_w_m2 = self.glance(&middle, estimate);
        if shaded && !modest && weight * 0.7 * hideable * full_w_m2 > self.aim.threshold {
            return Verdict::Rough(self.longer_side());
        }
        let mut tolerance = sharp(strict_w_m2, full_w_m2);
        let samples = &self.task.rules.samples;
        let mut lean = samples.lean.as_ref().filter(|_| candidates == Candidates::Free && !forced);
        loop {
            let rule = match lean {
                Some(rule) => (rule, samplings.lean(rule, self.aim.extend)),
                None => (&samples.full, samplings.full(self.aim.extend)),
            };
            match self.look_at(rule, &allowance, tolerance) {
                Found::Sharper(light) => tolerance = sharp(strict_w_m2, light),
                Found::Verdict(Verdict::Linked { light, error_squared, cut_short, deviates, mut record }) => {
                    let (spot_w_m, beyond_w_m) = if uniform { (0.0, 0.0) } else { self.missed_w_m(&light) };
                    let overlooked = spot_w_m.max(beyond_w_m) > self.aim.threshold;
                    if overlooked && !least {
                        return Verdict::Rough(self.longer_side());
                    }
                    let spot_squared = if overlooked { spot_w_m * spot_w_m } else { 0.0 };
                    // Beyond the horizon is all the light that a dark element has: it counts, however little it is.
                    let error_squared = error_squared + spot_squared + beyond_w_m * beyond_w_m;
                    record.set_error(error_squared.sqrt());
                    let cut_short = cut_short || overlooked;
                    return Verdict::Linked { light, error_squared, cut_short, deviates, record };
                }
                // What few points find rough, the others are asked about.
                _ if lean.is_some() => lean = None,
                Found::Verdict(verdict) => return verdict,
                Found::Rough(look) => return Verdict::Rough(self.direction(&look)),
            }
        }
    }

    /// Looks at the element by a rule.
    fn look_at(
        &mut self,
        (rule, sampling): (&SampleRule, &Sampling),
        allowance: &Allowance,
        tolerance: Tolerance,
    ) -> Found<N> {
        let look = self.look(rule, sampling, tolerance);
        let root_area = self.element.area_m2.sqrt();
        let link_error = root_area * look.error;
        let lost_w_m2 = tolerance.absolute_w_m2.max(tolerance.relative * look.light);
        let sharp = lost_w_m2 <= BRIGHTER * allowance.strict_w_m2 || tolerance.relative <= SHARPEST;
        // What the look may be wrong by must not divide the element.
        let noise_w_m2 = if sharp { 0.0 } else { self.weight * lost_w_m2 };
        let hidden = rule.unseen * allowance.hideable * root_area * look.unseen;
        let most = rule.trusted * self.aim.threshold + root_area * noise_w_m2;
        let rough = link_error.hypot(hidden) > most;
        if rough && !allowance.forced {
            return Found::Rough(look);
        }
        let deviates = look.worst > allowance.point_w_m2 + noise_w_m2;
        if deviates && allowance.divided {
            return Found::Verdict(Verdict::Down);
        }
        if !sharp {
            return Found::Sharper(look.light);
        }
        let light = look.projected.coefficients;
        let cut_short = rough && allowance.least;
        let error_squared = link_error * link_error + if cut_short { hidden * hidden } else { 0.0 };
        let mut record = Links::default();
        if self.records {
            let (cell, area_m2) = (self.element.cell, self.element.area_m2);
            let room = self.aim.threshold / link_error.hypot(hidden);
            let judged = Kept { cell, area_m2, error_w_m: error_squared.sqrt(), room };
            record.note(judged, &self.scratch.recording.rows, rule);
        }
        Found::Verdict(Verdict::Linked { light, error_squared, cut_short, deviates, record })
    }

    /// Cells are not divided for ever.
    fn is_indivisible(&self) -> bool {
        self.element.cell.size.max_element() <= LEAST_EXTENT
    }

    /// Share of the light on an element that shadows between its sample points may take: narrow blockers cast narrow shadows.
    fn hideable(&self) -> f64 {
        let Candidates::List(start, end) = self.candidates else { return UNSEEN_SHADOW };
        let faces = self.task.occluder.faces();
        let list = &self.scratch.candidates[start..end];
        let narrowest = list.iter().map(|f| faces.width(*f)).fold(f64::INFINITY, f64::min);
        let (u, v) = self.sides_m();
        let half = 0.5 * u.max(v);
        UNSEEN_SHADOW * (half / narrowest).min(1.0).powi(2)
    }

    /// The light that would fall on the middle of an element if nothing stood in between, roughly.
    fn glance(&mut self, middle: &DVec3, estimate: f64) -> f64 {
        let point = std::slice::from_ref(middle);
        let tolerance = Tolerance { relative: 0.2, absolute_w_m2: 0.05 * estimate };
        let mut light = [[0.0; N]];
        self.gather((point, point, point), Candidates::Free, tolerance, &mut light, &mut [0.0]);
        norm(&light[0])
    }

    /// Samples the element once.
    fn look(&mut self, rule: &SampleRule, sampling: &Sampling, tolerance: Tolerance) -> Look<N> {
        let mut values = [[0.0; N]; MAX_SAMPLES];
        let mut uncertain = [0.0; MAX_SAMPLES];
        let n = sampling.count;
        let points = (&sampling.position[..n], &sampling.eye[..n], &self.element.hull[..]);
        self.scratch.recording.start(if self.records { rule.nodes } else { 0 });
        self.gather(points, self.candidates, tolerance, &mut values[..n], &mut uncertain[..n]);
        self.scratch.recording.stop();
        let projected = rule.project(&values[..n]);
        let (error, worst) = self.residual(rule, sampling, &projected, &values);
        let unseen = self.weight * mean_square(&uncertain[..n], sampling.inside).sqrt();
        let light = values[..n].iter().map(norm).fold(0.0, f64::max);
        Look { projected, error, worst, unseen, light }
    }

    /// RMS error of the projected irradiance over the element times the weight, and the largest at a test point, in W/m².
    fn residual(
        &self,
        rule: &SampleRule,
        sampling: &Sampling,
        projected: &Projected<N>,
        values: &[[f64; N]; MAX_SAMPLES],
    ) -> (f64, f64) {
        let whole = self.element.shape == Shape::Whole;
        let tests = if whole { rule.nodes..sampling.count } else { 0..sampling.count };
        let (mut sum, mut count, mut worst) = (0.0, 0, 0.0f64);
        for p in tests.filter(|p| sampling.inside & (1 << p) != 0) {
            let square = rule.residual_squared(p, &projected.coefficients, &values[p]);
            sum += square;
            worst = worst.max(square);
            count += 1;
        }
        let tested = if count > 0 { sum / count as f64 } else { 0.0 };
        let (beyond_u, beyond_v) = projected.beyond;
        let truncated = if whole { beyond_u * beyond_u + beyond_v * beyond_v } else { 0.0 };
        (self.weight * tested.max(truncated).sqrt(), self.weight * worst.sqrt())
    }

    /// Across which direction the error asks to divide; both where it does not say.
    fn direction(&self, look: &Look<N>) -> Split {
        let (u, v) = look.projected.beyond;
        if self.weight * u.max(v) > 0.3 * look.error {
            if u > 4.0 * v {
                return Split::U;
            }
            if v > 4.0 * u {
                return Split::V;
            }
        }
        self.longer_side()
    }

    /// Across the longer side of a slender cell, else both.
    fn longer_side(&self) -> Split {
        let (u, v) = self.sides_m();
        if u > SLENDER * v {
            Split::U
        } else if v > SLENDER * u {
            Split::V
        } else {
            Split::Both
        }
    }

    /// Lengths of the cell's sides in metres.
    pub(super) fn sides_m(&self) -> (f64, f64) {
        let (frame, size) = (&self.task.patch.frame, self.element.cell.size);
        (frame.u.length() * size.x, frame.v.length() * size.y)
    }

    pub(super) fn gather(
        &mut self,
        (position, eye, hull): (&[DVec3], &[DVec3], &[DVec3]),
        candidates: Candidates,
        tolerance: Tolerance,
        irradiance: &mut [[f64; N]],
        uncertain: &mut [f64],
    ) {
        let Task { patch, occluder, .. } = self.task;
        let points = Points { position, eye, normal: patch.frame.normal, face: patch.face, hull };
        self.aim.source.gather(&points, occluder, candidates, tolerance, irradiance, uncertain, self.scratch);
    }
}

impl<'a> Samplings<'a> {
    pub fn new<const N: usize>(element: &'a Element<'a>, task: Task<'a, N>) -> Self {
        Self { element, frame: &task.patch.frame, rules: &task.rules.samples, made: Default::default() }
    }

    /// The points of the full rule.
    fn full(&self, extend: bool) -> &Sampling {
        self.made[0][extend as usize].get_or_init(|| self.sample(&self.rules.full, extend))
    }

    /// The points of the rule for modest links.
    fn modest(&self, extend: bool) -> &Sampling {
        self.made[1][extend as usize].get_or_init(|| self.sample(&self.rules.modest, extend))
    }

    /// The points of the lean rule.
    fn lean(&self, rule: &SampleRule, extend: bool) -> &Sampling {
        self.made[2][extend as usize].get_or_init(|| self.sample(rule, extend))
    }

    fn sample(&self, rule: &SampleRule, extend: bool) -> Sampling {
        let frame = self.frame;
        let mut sampling = Sampling {
            count: rule.points.len(),
            position: [DVec3::ZERO; MAX_SAMPLES],
            eye: [DVec3::ZERO; MAX_SAMPLES],
            inside: 0,
        };
        for (p, local) in rule.points.iter().enumerate() {
            let uv = self.element.cell.to_surface(*local);
            let point = frame.point(uv);
            sampling.position[p] = point;
            sampling.eye[p] = point;
            sampling.inside |= 1 << p;
            if let Shape::Part(outline, _) = self.element.shape
                && !polygon::contains(outline, uv)
            {
                sampling.eye[p] = frame.point(polygon::nearest_inside(outline, uv, |d| frame.square_m2(d)));
                sampling.inside &= !(1 << p);
                if !extend {
                    sampling.position[p] = sampling.eye[p];
                }
            }
        }
        sampling
    }
}

/// The tolerance that loses no more than this of so much light.
fn sharp(absolute_w_m2: f64, light_w_m2: f64) -> Tolerance {
    Tolerance { relative: (absolute_w_m2 / light_w_m2).clamp(SHARPEST, COARSE), absolute_w_m2 }
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
