//! Irradiance at a bundle of points from one emission packet, integrated hierarchically over the emitter.
//!
//! From the root of the packet down, each point takes a cell as a whole or asks for its parts, until what it may lose by it is within
//! tolerance; only the points that ask go on:
//! * its **detail** (what finer levels hold) must not matter at its distance;
//! * its **kernel** must be smooth enough for n × n Gauss nodes, n ≤ 3; nearer than that Lambert's closed form takes over, with
//!   singularity subtraction `∫ Kφ = φ(y*) F + ∫ K (φ − φ(y*))` where the radiosity varies (numerics §4);
//! * its **visibility** must be certain (no candidate in the shaft), unanimous among rays, or of no consequence. Where few blockers leave a
//!   part of the cell visible, the fragments they leave are integrated; else the cell is divided.
//!
//! Points are judged ([`super::judge`]) and lit ([`super::light`]) four side by side; rays go point by point.

use glam::DVec3;

use super::candidates::{Candidates, LIST_LIMIT, is_open, narrow, open_ones};
use super::judge::{GROUPS, How, Judge};
use super::light::Ready;
use super::nodes::{NODE_LANES, Nodes, spread};
use super::packet::{Detail, EmitterCell, Packet};
use super::pair::Scratch;
use super::recording::Unit;
use super::samples::MAX_SAMPLES;
use super::view::Geometry;
use crate::math::basis::MAX_FUNCTIONS;
use crate::math::lanes::{DVec3x4, LANES, side_by_side};
use crate::visibility::{Bundle, Occluder};

/// Blockers times points from which on a shaft costs less than the ray tests it may save (measured).
const WORTH_A_SHAFT: usize = 32;

/// Candidates from which on the points of a bundle look at different places of a cell. Fewer are mostly followed exactly, and what rays then
/// say is smoother where all points look at the same places.
const CROWD: usize = 8;

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
    /// The points, four side by side.
    pub(super) lanes: [DVec3x4; GROUPS],
    centre: DVec3,
    radius: f64,
}

/// What a point sees of a cell.
enum Sight<const N: usize> {
    /// These of the nodes it was looked at by, a bit mask.
    Nodes(u32),
    /// The part that sends this light, told exactly.
    Exact([f64; N]),
    /// The cell must be divided to tell.
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
        let lanes = side_by_side(points.position);
        Self { packet, points, occluder, irradiance, uncertain, scratch, lanes, centre, radius }
    }

    /// Gathers the whole packet.
    pub fn run(&mut self, candidates: Candidates, tolerance: Tolerance) {
        let active = u32::MAX >> (32 - self.points.position.len() as u32);
        let mut root = self.packet.root_of(&mut self.scratch.outlines);
        if self.scratch.recording.points > 0 {
            let unit = Unit::of_node(self.packet.basis, 0, root.cell, root.outline.clone());
            root.unit = Some(Box::new(unit));
        }
        self.visit(&root, active, candidates, tolerance);
    }

    fn visit(&mut self, emitter: &EmitterCell<N>, active: u32, candidates: Candidates, tolerance: Tolerance) {
        let geometry = Geometry::new(&self.packet.frame, &emitter.cell);
        if geometry.faces_away(self.points.normal, self.centre, self.radius) {
            return;
        }
        let how = self.judge(emitter, &geometry, active, candidates, tolerance);
        if candidates == Candidates::Free {
            self.scratch.work.sights_free += u64::from(how.taken().count_ones());
        }
        let ready = Ready::default();
        let mut divided = how.divided;
        // What is recorded, and what rays must tell first, goes point by point; the rest side by side.
        let recorded = self.recorded(emitter);
        let alone = if candidates == Candidates::Free { how.taken() & recorded } else { how.taken() };
        let (mut whole, mut visible) = (how.taken() & !alone, [0; MAX_SAMPLES]);
        for p in points_of(alone) {
            match self.sight(p, emitter, &ready, candidates, &how) {
                Sight::Nodes(nodes) if recorded & 1 << p != 0 => {
                    self.take_recorded(p, emitter, &ready, &how, nodes);
                }
                Sight::Nodes(nodes) => (whole, visible[p]) = (whole | 1 << p, nodes),
                Sight::Exact(light) => self.add(p, emitter, &light, [1.0; N], &how),
                Sight::Divide => divided |= 1 << p,
            }
        }
        self.take(whole, emitter, &ready, &how, &visible);
        if divided != 0 {
            self.divide(emitter, divided, candidates, tolerance);
        }
    }

    /// How those of the `active` points that light from the cell can reach take it.
    fn judge(
        &self,
        emitter: &EmitterCell<N>,
        geometry: &Geometry,
        active: u32,
        candidates: Candidates,
        tolerance: Tolerance,
    ) -> How {
        let judge = Judge {
            strength: strength(&emitter.coefficients),
            detail: emitter.node.map_or(Detail::default(), |n| self.packet.nodes[n as usize].detail),
            order: self.packet.basis.order(),
            tolerance,
            splittable: is_splittable(emitter),
            blockers: blockers(candidates),
        };
        let mut how = How::default();
        for (group, lanes) in self.lanes.iter().enumerate() {
            let of_group = active & 0b1111 << (LANES * group);
            if of_group != 0 {
                let views = geometry.views(self.points.normal, lanes);
                judge.judge(group, &views, of_group & views.seen << (LANES * group), &mut how);
            }
        }
        how
    }

    /// Whether the candidates are few enough to follow what each of them leaves visible.
    fn is_traceable(&self, candidates: Candidates) -> bool {
        let Candidates::List(start, end) = candidates else { return false };
        let faces = self.occluder.faces();
        let list = &self.scratch.candidates[start..end];
        list.iter().map(|f| faces.piece_count(*f)).sum::<usize>() <= EXACT_PIECES
    }

    /// What point `p` sees of the cell.
    fn sight(
        &mut self,
        p: usize,
        emitter: &EmitterCell<N>,
        ready: &Ready<N>,
        candidates: Candidates,
        how: &How,
    ) -> Sight<N> {
        let rays = how.rays_of(p);
        if rays == 0 || rays > 1 && self.is_hidden(p, emitter, ready, candidates) {
            return Sight::Nodes(0);
        }
        let targets = ready.nodes.get(self.packet, emitter, rays, &mut self.scratch.nodes);
        let visible = self.trace(p, emitter, targets, ready, candidates);
        let unanimous = visible == 0 || visible == targets.all();
        let is = |points: u32| points & 1 << p != 0;
        if unanimous && !is(how.doubt) {
            return Sight::Nodes(visible);
        }
        if !unanimous && !is(how.exact) {
            return if is(how.split) { Sight::Divide } else { Sight::Nodes(visible) };
        }
        // What stands between this point and the cell alone.
        let top = self.scratch.candidates.len();
        let between = self.between(p, emitter, candidates);
        let sight = match between {
            Candidates::Free | Candidates::Hidden => Sight::Nodes(visible),
            _ if is(how.split) => Sight::Divide,
            _ if is(how.exact) && self.is_traceable(between) => {
                let constant = is(how.constant);
                let seen = self.visible_light(p, emitter, between, constant);
                seen.map_or(Sight::Divide, |(light, whole)| {
                    self.uncertain[p] += whole * norm(&emitter.coefficients[0]);
                    Sight::Exact(light)
                })
            }
            _ if is_splittable(emitter) => Sight::Divide,
            _ => Sight::Nodes(visible),
        };
        self.scratch.candidates.truncate(top);
        sight
    }

    /// Whether the face that blocked a segment last hides all of the cell from point `p`. Where another one does, the rays say so too. Of a
    /// bundle alone: what blocked a single point's segment last is another pair's, and counts of rays must not hang on who came first.
    fn is_hidden(
        &mut self,
        p: usize,
        emitter: &EmitterCell<N>,
        ready: &Ready<N>,
        candidates: Candidates,
    ) -> bool {
        let faces = self.occluder.faces();
        let likely = candidates.likely(faces, self.own_faces(), self.scratch);
        let hides = |face| faces.hides(face, self.points.eye[p], ready.corners(&self.packet.frame, emitter));
        let hidden = self.points.eye.len() > 1 && likely.is_some_and(hides);
        self.scratch.work.sights_hidden += u64::from(hidden);
        hidden
    }

    /// The candidates that reach in between point `p` and the cell. A new list stands at the end of the scratch list.
    fn between(&mut self, p: usize, emitter: &EmitterCell<N>, candidates: Candidates) -> Candidates {
        let (eye, corners) = ([self.points.eye[p]], emitter.hull(&self.packet.frame));
        let point = (&eye[..], Some(self.points.normal));
        let cell = (&corners[..], Some(self.packet.frame.normal));
        narrow(self.occluder, candidates, self.own_faces(), point, cell, self.scratch)
    }

    /// Which of the nodes of a cell point `p` sees, as a bit mask. In a crowd it looks past them, elsewhere than the other points: what stood
    /// between all of them and their nodes would show to none.
    fn trace(
        &mut self,
        p: usize,
        emitter: &EmitterCell<N>,
        nodes: &Nodes<N>,
        ready: &Ready<N>,
        candidates: Candidates,
    ) -> u32 {
        let crowded = emitter.outline.is_none() && blockers(candidates) >= CROWD;
        let apart = crowded.then(|| spread(&self.packet.frame, &emitter.cell, nodes.count.isqrt(), p));
        let (from, targets) = (self.points.eye[p], &apart.as_ref().unwrap_or(&nodes.eye)[..nodes.count]);
        let all = nodes.all();
        self.scratch.work.visibility_rays += nodes.count as u64;
        self.scratch.work.sights_by_rays += 1;
        match candidates {
            Candidates::Free => all,
            Candidates::Hidden => 0,
            Candidates::List(start, end) => {
                self.scratch.work.rays_listed += nodes.count as u64;
                let (faces, list) = (self.occluder.faces(), &mut self.scratch.candidates[start..end]);
                if let [to] = targets {
                    return is_open(faces, list, from, *to).into();
                }
                let bundle = match crowded {
                    true => Bundle::new(from, &side_by_side::<NODE_LANES>(targets), nodes.count),
                    false => Bundle::new(from, ready.eyes(nodes), nodes.count),
                };
                open_ones(faces, list, &bundle)
            }
            Candidates::Scene => {
                let skip = self.own_faces();
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
            let child = self.packet.child(emitter, split, index, &mut self.scratch.outlines);
            let Some(child) = child else { continue };
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
            // A ray from one point costs less than a shaft around it.
            Candidates::Scene if active.is_power_of_two() => return candidates,
            Candidates::List(start, end)
                if (end - start) * (active.count_ones() as usize) < WORTH_A_SHAFT =>
            {
                return candidates;
            }
            _ => {}
        }
        let corners = emitter.hull(&self.packet.frame);
        let points = (self.points.hull, Some(self.points.normal));
        let cell = (&corners[..], Some(self.packet.frame.normal));
        narrow(self.occluder, candidates, self.own_faces(), points, cell, self.scratch)
    }

    /// The faces that the points and the emitter lie on, which shadow neither.
    fn own_faces(&self) -> [u32; 2] {
        [self.points.face, self.packet.face]
    }
}

/// Whether parts of a cell may be looked at.
fn is_splittable<const N: usize>(emitter: &EmitterCell<N>) -> bool {
    emitter.virtual_depth < MAX_VIRTUAL_DEPTH
}

/// How many faces may stand in between.
fn blockers(candidates: Candidates) -> usize {
    match candidates {
        Candidates::Free | Candidates::Hidden => 0,
        Candidates::List(start, end) => end - start,
        Candidates::Scene => LIST_LIMIT,
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

/// The numbers of the bits of a mask.
pub(super) fn points_of(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let point = (mask != 0).then_some(mask.trailing_zeros() as usize);
        mask &= mask.wrapping_sub(1);
        point
    })
}
