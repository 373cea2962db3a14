//! Irradiance at a bundle of points from one emission packet, integrated hierarchically over the emitter.
//!
//! From the root of the packet down, each point takes a cell as a whole or asks for its parts, until what it may lose by it is within
//! tolerance; only the points that ask go on:
//! * its **detail** (what finer levels hold) must not matter at its distance;
//! * its **kernel** must be smooth enough for n × n Gauss nodes, n ≤ 3; nearer than that Lambert's closed form takes over, with
//!   singularity subtraction `∫ Kφ = φ(y*) F + ∫ K (φ − φ(y*))` where the radiosity varies (numerics §4);
//! * its **visibility** must be certain (no candidate in the shaft), unanimous among rays, or of no consequence. Where few blockers leave a
//!   part of the cell visible, the fragments they leave are integrated; else the cell is divided.

use glam::DVec3;

use super::candidates::{Candidates, narrow};
use super::light::Ready;
use super::nodes::Nodes;
use super::packet::{Detail, EmitterCell, Packet, cell_corners};
use super::pair::Scratch;
use super::recording::Unit;
use super::samples::MAX_SAMPLES;
use super::view::{Geometry, View};
use crate::math::basis::MAX_FUNCTIONS;
use crate::visibility::{Occluder, Shaft};

/// Relative error of n × n Gauss quadrature over a cell of size s seen from distance d: `ERROR[n] (s/d)^(2n)`; fitted to the table
/// of numerics §2, doubled for oblique pairs.
const QUADRATURE_ERROR: [f64; 4] = [1.0, 5.0, 1.5, 0.5];

/// Error of the singularity-subtracted rule per unit of radiosity variation and form factor (measured: numerics §4).
const SUBTRACTION_ERROR: f64 = 0.02;

/// Share of a cell's light that n × n rays may misjudge when they disagree, and when they agree.
const MIXED_ERROR: [f64; 4] = [1.0, 0.5, 0.2, 0.1];
const UNANIMOUS_ERROR: [f64; 4] = [1.0, 0.3, 0.06, 0.02];

/// Blockers times points from which on a shaft costs less than the ray tests it may save (measured).
const WORTH_A_SHAFT: usize = 32;

/// Error of the light of visible fragments per unit of radiosity variation and form factor, far from the cell and near it.
const FRAGMENT_ERROR: [f64; 2] = [0.03, 0.1];

/// The most convex blockers whose projections are followed exactly.
const EXACT_PIECES: usize = 40;

/// Virtual splits below a packet's deepest level, at most.
const MAX_VIRTUAL_DEPTH: u8 = 8;

/// A bundle of points on one plane.
pub struct Points<'a> {
    /// Where the kernel is evaluated, in metres.
    pub position: &'a [DVec3],
    /// Where visibility is taken from: the same, or the nearest point of the receiving polygon.
    pub eye: &'a [DVec3],
    /// Unit normal of the plane.
    pub normal: DVec3,
    /// The face they lie on, which never shadows them; `u32::MAX` for points in free space.
    pub face: u32,
    /// At most four corners around all of them.
    pub hull: &'a [DVec3],
}

/// What a gathering may lose: a cell is accepted when its error is below either.
#[derive(Clone, Copy, Debug)]
pub struct Tolerance {
    /// Share of the cell's own light, so that all cells together lose this share of the whole.
    pub relative: f64,
    /// Irradiance in W/m² (Euclidean norm over bands).
    pub absolute_w_m2: f64,
}

/// The gathering of one packet by one bundle.
pub struct Gather<'a, const N: usize> {
    /// What is shot.
    pub packet: &'a Packet<N>,
    /// Who receives it.
    pub points: &'a Points<'a>,
    /// What may stand between.
    pub occluder: &'a dyn Occluder,
    /// Irradiance per point in W/m², added to.
    pub irradiance: &'a mut [[f64; N]],
    /// Irradiance per point, all bands, whose visibility rests on rays alone, added to.
    pub uncertain: &'a mut [f64],
    /// Working memory and counts.
    pub scratch: &'a mut Scratch,
    centre: DVec3,
    radius: f64,
}

/// How a cell's light is taken.
pub(super) struct How {
    /// Gauss nodes per dimension of the quadrature.
    pub nodes: usize,
    pub closed_form: bool,
    pub constant: bool,
    /// Size of the cell over its distance.
    pub nearest: f64,
    /// Rays per dimension to judge visibility by; none where it is certain.
    rays: usize,
    partial: Partial,
    /// Whether even a unanimous vote of the rays leaves too much in doubt.
    doubt: bool,
}

/// What to do for points that see a cell in part.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Partial {
    /// Believe the rays.
    Rays,
    /// Compute the visible part exactly.
    Exact,
    /// Divide the cell for them.
    Divide,
}

impl<'a, const N: usize> Gather<'a, N> {
    /// Prepares a gathering; results are added to `irradiance` and `uncertain`.
    pub fn new(
        packet: &'a Packet<N>,
        points: &'a Points<'a>,
        occluder: &'a dyn Occluder,
        irradiance: &'a mut [[f64; N]],
        uncertain: &'a mut [f64],
        scratch: &'a mut Scratch,
    ) -> Self {
        let centre = points.hull.iter().sum::<DVec3>() / points.hull.len() as f64;
        let radius = points.hull.iter().map(|p| p.distance(centre)).fold(0.0, f64::max);
        Self { packet, points, occluder, irradiance, uncertain, scratch, centre, radius }
    }

    /// Gathers the whole packet.
    pub fn run(&mut self, candidates: Candidates, tolerance: Tolerance) {
        let active = u32::MAX >> (32 - self.points.position.len() as u32);
        let mut root = self.packet.root();
        if self.scratch.recording.points > 0 {
            let outline = self.packet.outline.clone();
            root.unit = Some(Box::new(Unit::of_node(self.packet.basis, 0, root.cell, outline)));
        }
        self.visit(&root, active, candidates, tolerance);
    }

    fn visit(&mut self, emitter: &EmitterCell<N>, active: u32, candidates: Candidates, tolerance: Tolerance) {
        let geometry = Geometry::new(&self.packet.frame, emitter);
        if geometry.faces_away(self.points.normal, self.centre, self.radius) {
            return;
        }
        let strength = strength(&emitter.coefficients);
        let traceable = self.is_traceable(candidates);
        let ready = Ready::default();
        let mut divided = 0;
        for p in points_of(active) {
            let x = self.points.position[p];
            let Some(view) = geometry.view(self.points.normal, x) else { continue };
            match self.judge(emitter, strength, traceable, &view, candidates, tolerance) {
                Some(how) if self.take(p, emitter, &ready, candidates, &how) => {}
                _ => divided |= 1 << p,
            }
        }
        if divided != 0 {
            self.divide(emitter, divided, candidates, tolerance);
        }
    }

    /// How a point with this view takes the light of a cell with this mean and variation; `None` where it must be divided. Where a shadow
    /// crosses it, its blockers may be `traceable`.
    fn judge(
        &self,
        emitter: &EmitterCell<N>,
        (mean, variation): (f64, f64),
        traceable: bool,
        view: &View,
        candidates: Candidates,
        tolerance: Tolerance,
    ) -> Option<How> {
        let order = self.packet.basis.order();
        let detail = emitter.node.map_or(Detail::default(), |n| self.packet.nodes[n as usize].detail);
        let estimate = (mean + variation) * view.form_factor;
        let variation = variation * view.form_factor;
        let allowed = (tolerance.relative * estimate).max(tolerance.absolute_w_m2);
        if detail.seen_w_m2(view.nearest, order) * view.form_factor > 0.5 * allowed {
            return None;
        }
        let constant = variation <= 0.1 * allowed;
        let smooth = (if constant { 1 } else { order.max(2) }..=3)
            .find(|n| QUADRATURE_ERROR[*n] * view.ratio.powi(2 * *n as i32) * estimate <= 0.5 * allowed);
        let splittable = emitter.virtual_depth < MAX_VIRTUAL_DEPTH;
        if smooth.is_none() && !constant && splittable && SUBTRACTION_ERROR * variation > 0.5 * allowed {
            return None;
        }
        let nodes = smooth.unwrap_or(if constant { 1 } else { 3 });
        let how = How {
            nodes,
            closed_form: smooth.is_none(),
            constant,
            nearest: view.nearest,
            rays: 0,
            partial: Partial::Rays,
            doubt: false,
        };
        if candidates == Candidates::Free {
            return Some(how);
        }
        // Where a shadow's edge crosses the cell, its detail does not fade: it may well have that edge too, and then all such cells
        // err to the same side.
        let edged = detail.rms_w_m2 * view.form_factor > 0.05 * tolerance.absolute_w_m2;
        // Enough rays that a unanimous vote is safe to believe.
        let enough =
            (1 + edged as usize..=3).find(|n| UNANIMOUS_ERROR[*n] * estimate <= tolerance.absolute_w_m2);
        let rays = enough.unwrap_or(3);
        let partial = if edged {
            Partial::Divide
        } else if MIXED_ERROR[rays] * estimate <= tolerance.absolute_w_m2 {
            Partial::Rays
        } else if traceable
            && (FRAGMENT_ERROR[how.closed_form as usize] * variation <= tolerance.absolute_w_m2
                || !splittable)
        {
            Partial::Exact
        } else if splittable {
            Partial::Divide
        } else {
            Partial::Rays
        };
        Some(How { rays, partial, doubt: enough.is_none(), ..how })
    }

    /// Whether the candidates are few enough to follow what each of them leaves visible.
    fn is_traceable(&self, candidates: Candidates) -> bool {
        let Candidates::List(start, end) = candidates else { return false };
        let faces = self.occluder.faces();
        let list = &self.scratch.candidates[start..end];
        list.iter().map(|f| faces.piece_count(*f)).sum::<usize>() <= EXACT_PIECES
    }

    /// Adds the cell's light to point `p`; `false` where the cell must be divided for it after all.
    fn take(
        &mut self,
        p: usize,
        emitter: &EmitterCell<N>,
        ready: &Ready<N>,
        candidates: Candidates,
        how: &How,
    ) -> bool {
        if how.rays == 0 {
            let light = self.whole_light(p, emitter, ready, how);
            self.add(p, emitter, &light, None, how);
            return true;
        }
        let targets = ready.nodes.get(self.packet, emitter, how.rays);
        let all = (1u32 << targets.count) - 1;
        let visible = self.trace(p, targets, candidates);
        let unanimous = visible == 0 || visible == all;
        let open = !unanimous || how.doubt;
        if how.partial == Partial::Divide && open {
            return false;
        }
        if how.partial == Partial::Exact && open {
            let Some((light, whole)) = self.visible_light(p, emitter, candidates, how.constant) else {
                return false;
            };
            self.add(p, emitter, &light, None, how);
            self.uncertain[p] += whole * norm(&emitter.coefficients[0]);
            return true;
        }
        let light = self.whole_light(p, emitter, ready, how);
        self.uncertain[p] += norm(&light);
        if visible == all {
            self.add(p, emitter, &light, None, how);
        } else if visible != 0 {
            let share = self.visible_share(self.points.position[p], targets, visible);
            self.add(p, emitter, &light, Some(share), how);
        }
        true
    }

    /// Which of the nodes point `p` sees, as a bit mask.
    fn trace(&mut self, p: usize, nodes: &Nodes<N>, candidates: Candidates) -> u32 {
        let (from, targets) = (self.points.eye[p], &nodes.eye[..nodes.count]);
        let all = (1 << nodes.count) - 1;
        self.scratch.work.visibility_rays += nodes.count as u64;
        match candidates {
            Candidates::Free => all,
            Candidates::Hidden => 0,
            Candidates::List(start, end) => {
                let faces = self.occluder.faces();
                let list = &mut self.scratch.candidates[start..end];
                let mut visible = 0;
                for (q, to) in targets.iter().enumerate() {
                    match list.iter().position(|f| faces.blocks(*f, from, to - from)) {
                        // The last blocker comes first next time.
                        Some(found) => list.swap(0, found),
                        None => visible |= 1 << q,
                    }
                }
                visible
            }
            Candidates::Scene => {
                let skip = [self.points.face, self.packet.face];
                all & !self.occluder.blocked(from, targets, skip, &mut self.scratch.last_blocker)
            }
        }
    }

    fn divide(
        &mut self,
        emitter: &EmitterCell<N>,
        active: u32,
        candidates: Candidates,
        tolerance: Tolerance,
    ) {
        let split = self.packet.split_of(emitter);
        let count = split.children().len();
        // The edge of a shadow runs through about the square root of the parts, and their errors are of either sign.
        let absolute_w_m2 = tolerance.absolute_w_m2 / (count as f64).sqrt().sqrt();
        let tolerance = Tolerance { absolute_w_m2, ..tolerance };
        for index in 0..count {
            let Some(child) = self.packet.child(emitter, split, index) else { continue };
            let top = self.scratch.candidates.len();
            let narrowed = self.narrow(&child, active, candidates);
            if narrowed != Candidates::Hidden {
                self.visit(&child, active, narrowed, tolerance);
            }
            self.scratch.candidates.truncate(top);
        }
    }

    /// The candidates that reach into the shaft to `emitter`.
    fn narrow(&mut self, emitter: &EmitterCell<N>, active: u32, candidates: Candidates) -> Candidates {
        match candidates {
            Candidates::Free | Candidates::Hidden => return candidates,
            Candidates::List(start, end)
                if (end - start) * (active.count_ones() as usize) < WORTH_A_SHAFT =>
            {
                return candidates;
            }
            _ => {}
        }
        let corners = cell_corners(&emitter.cell).map(|c| self.packet.frame.point(c));
        let shaft = Shaft::between(
            self.points.hull,
            Some(self.points.normal),
            &corners,
            Some(self.packet.frame.normal),
        );
        let skip = [self.points.face, self.packet.face];
        narrow(self.occluder, &shaft, candidates, skip, self.points.hull, &corners, self.scratch)
    }
}

/// Norm over bands of the mean, and of the part that varies, times √3: the largest value of a linear function over its RMS.
fn strength<const N: usize>(coefficients: &[[f64; N]; MAX_FUNCTIONS]) -> (f64, f64) {
    let rest: f64 = coefficients[1..].iter().flatten().map(|c| c * c).sum();
    (norm(&coefficients[0]), (3.0 * rest).sqrt())
}

/// Euclidean norm over bands.
pub fn norm<const N: usize>(values: &[f64; N]) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn points_of(mask: u32) -> impl Iterator<Item = usize> {
    (0..MAX_SAMPLES).filter(move |p| mask & (1 << p) != 0)
}
