//! One link: the light of a source on one element, sampled, projected, and judged at points that are not nodes.

use glam::{DVec2, DVec3};

use super::candidates::Candidates;
use super::gather::{Tolerance, norm};
use super::packet::Shape;
use super::pair::{COARSE, Oracle, Shoot};
use super::receiver::{Receiver, Waiting};
use super::samples::{MAX_SAMPLES, Projected, SampleRule};
use super::source::Source;
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

/// How much more of an element's light shadows between those few points may take.
const MODEST_UNSEEN: f64 = 8.0;

/// How much sharper each further look is, and the sharpest there is.
const SHARPER: f64 = 0.2;
const SHARPEST: f64 = 1e-6;

/// Cells are not divided below this extent of the surface's parametrisation.
const LEAST_EXTENT: f64 = 1.0 / (1 << 20) as f64;

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
    /// The largest error at a test point.
    worst: f64,
    unseen: f64,
    light: f64,
}

/// An element that a link is tried on, and what the link may lose there.
struct Trial<'a> {
    cell: &'a Cell,
    hull: &'a [DVec3; 4],
    candidates: Candidates,
    area_m2: f64,
    /// Deviation at a point above which the link goes down to finer elements that are there.
    point_w_m2: f64,
    /// The sharpest tolerance of sample points that makes sense.
    strict_w_m2: f64,
    /// Share of the light that shadows between the sample points of the full rule may take.
    hideable: f64,
    /// Whether the link is to be taken whatever its error.
    forced: bool,
}

/// What came of a trial.
enum Verdict<const N: usize> {
    /// The light is deposited.
    Linked,
    /// The link goes down to the parts that are there.
    Down(Split),
    /// A sharper look is wanted; the light seen in W/m².
    Sharper(f64),
    /// The element must be divided.
    Rough(Look<N>),
}

impl<const N: usize, S: Source<N>> Shoot<'_, N, S> {
    /// Samples the element; deposits its projection and returns `None`, or returns how to divide it.
    pub(super) fn try_link<R: Receiver<N>>(
        &mut self,
        receiver: &mut R,
        cell: &Cell,
        hull: &[DVec3; 4],
        candidates: Candidates,
    ) -> Option<Split> {
        let area_m2 = self.patch.frame.area_m2 * cell.area() * receiver.shape().share();
        let weight = self.weight * area_m2.sqrt();
        // Where several sources' light is smooth in sum only, noise would show at points long before it counts in the mean square.
        let point_w_m2 = self.rules.point_w_m2;
        let (point_w_m2, quiet_w_m2) = match candidates {
            Candidates::Free => (point_w_m2, POINT_NOISE * point_w_m2),
            _ => (SHADED * point_w_m2, f64::INFINITY),
        };
        let strict_w_m2 = (POINT_SHARE * self.threshold).min(quiet_w_m2 * area_m2.sqrt()) / weight;
        let middle = 0.25 * hull.iter().sum::<DVec3>();
        let radius = hull.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
        let estimate = self.source.estimate_w_m2(middle, radius, self.patch.frame.normal);
        let hideable = self.hideable(cell, candidates);
        let uniform = matches!(self.rules.oracle, Oracle::Uniform(_));
        let indivisible = cell.size.max_element() <= LEAST_EXTENT;
        let forced = uniform || indivisible;
        let trial = Trial { cell, hull, candidates, area_m2, point_w_m2, strict_w_m2, hideable, forced };
        let rules = self.rules;
        // What nothing shades costs no rays, and must be smooth in the sum over sources.
        if candidates != Candidates::Free && !forced {
            if weight * estimate <= MODEST * self.threshold {
                let tolerance = Tolerance { relative: SHARPEST, absolute_w_m2: strict_w_m2 };
                let rule = &rules.samples.modest;
                let sampling = self.sample(rule, receiver.shape(), cell);
                match self.judge(receiver, &trial, (rule, &sampling), MODEST_UNSEEN, tolerance) {
                    Verdict::Linked => return None,
                    Verdict::Down(split) => return Some(split),
                    Verdict::Sharper(_) | Verdict::Rough(_) => {}
                }
            } else {
                let unseen = 0.7 * hideable * self.glance(&middle, estimate);
                if weight * unseen > self.threshold {
                    return Some(self.longer_side(cell));
                }
            }
        }
        // A first look, only as sharp as it takes to see that the element must be divided.
        let mut tolerance =
            Tolerance { relative: COARSE, absolute_w_m2: (COARSE * estimate).max(strict_w_m2) };
        let rule = &rules.samples.full;
        let sampling = self.sample(rule, receiver.shape(), cell);
        loop {
            match self.judge(receiver, &trial, (rule, &sampling), 1.0, tolerance) {
                Verdict::Linked => return None,
                Verdict::Down(split) => return Some(split),
                Verdict::Rough(look) => return Some(self.direction(cell, &look)),
                Verdict::Sharper(light) => {
                    let absolute_w_m2 = (SHARPER * tolerance.absolute_w_m2.min(light)).max(strict_w_m2);
                    let relative = (absolute_w_m2 / light).clamp(SHARPEST, COARSE);
                    tolerance = Tolerance { relative, absolute_w_m2 };
                }
            }
        }
    }

    /// Looks at the element by a rule between whose points `unseen` times more may hide than between the full one's, and links if that will
    /// do.
    fn judge<R: Receiver<N>>(
        &mut self,
        receiver: &mut R,
        trial: &Trial<'_>,
        (rule, sampling): (&SampleRule, &Sampling),
        unseen: f64,
        tolerance: Tolerance,
    ) -> Verdict<N> {
        let look = self.look(rule, sampling, trial, tolerance, receiver.shape() == Shape::Whole);
        let root_area = trial.area_m2.sqrt();
        let link_error = root_area * look.error;
        let sharp = tolerance.absolute_w_m2.max(tolerance.relative * look.light) <= 1.001 * trial.strict_w_m2
            || tolerance.relative <= SHARPEST;
        // What the look may be wrong by must not divide the element.
        let noise_w_m2 = if sharp { 0.0 } else { self.weight * tolerance.absolute_w_m2 };
        let hidden = unseen * trial.hideable * root_area * look.unseen;
        if !trial.forced && link_error.hypot(hidden) > self.threshold + root_area * noise_w_m2 {
            return Verdict::Rough(look);
        }
        let deviates = look.worst > trial.point_w_m2 + noise_w_m2;
        if let Some(split) = receiver.split().filter(|_| deviates) {
            return Verdict::Down(split);
        }
        if !sharp {
            return Verdict::Sharper(look.light);
        }
        self.scratch.work.interactions += 1;
        let (light, error_squared) = (look.projected.coefficients, link_error * link_error);
        self.deposited.error_squared += error_squared;
        self.deposit(receiver, &light, trial.area_m2);
        let indivisible = trial.cell.size.max_element() <= LEAST_EXTENT;
        if deviates && trial.candidates == Candidates::Free && !indivisible {
            let (cell, area_m2) = (*trial.cell, trial.area_m2);
            self.deposited.waiting.push(Waiting { cell, light, area_m2, error_squared });
        }
        Verdict::Linked
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
        rule: &SampleRule,
        sampling: &Sampling,
        trial: &Trial<'_>,
        tolerance: Tolerance,
        whole: bool,
    ) -> Look<N> {
        let mut values = [[0.0; N]; MAX_SAMPLES];
        let mut uncertain = [0.0; MAX_SAMPLES];
        let n = sampling.count;
        self.gather(
            &sampling.position[..n],
            &sampling.eye[..n],
            trial.hull,
            trial.candidates,
            tolerance,
            &mut values[..n],
            &mut uncertain[..n],
        );
        let projected = rule.project(&values[..n]);
        let (error, worst) = self.residual(rule, sampling, &projected, &values, whole);
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
        whole: bool,
    ) -> (f64, f64) {
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
    pub(super) fn longer_side(&self, cell: &Cell) -> Split {
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

    fn sample(&self, rule: &SampleRule, shape: Shape<&[DVec2]>, cell: &Cell) -> Sampling {
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

/// The point of `outline` nearest to `uv` outside of it, a thousandth of the way further in, or towards the mean of its corners, so that it does
/// not lie on an edge, where rounding decides what it sees.
fn nearest_inside(outline: &[DVec2], uv: DVec2, frame: &Frame) -> DVec2 {
    let near =
        polygon::nearest_on_boundary(outline, uv, |d| (d.x * frame.u + d.y * frame.v).length_squared());
    let mean = outline.iter().sum::<DVec2>() / outline.len() as f64;
    let further = [near - uv, mean - near].map(|inwards| near + 1e-3 * inwards);
    further.into_iter().find(|point| polygon::contains(outline, *point)).unwrap_or(near)
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
