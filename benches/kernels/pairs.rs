//! The pairs of the benchmark: an emitter of three bands whose radiosity varies, and the sample points of a receiver, in metres.

use glam::{DVec3, dvec3};
use wavelet_radiosity::math::Basis;
use wavelet_radiosity::math::basis::MAX_FUNCTIONS;
use wavelet_radiosity::scene::{Face, Frame, Material, Scene, Sides};
use wavelet_radiosity::transport::candidates::{Candidates, narrow};
use wavelet_radiosity::transport::gather::Tolerance;
use wavelet_radiosity::transport::{Detail, Gather, Packet, PacketNode, Points, SampleRules, Scratch, Work};
use wavelet_radiosity::visibility::{Bvh, OpaqueFaces};

/// An emitter and the points that look at it.
pub struct Pair {
    pub name: &'static str,
    packet: Packet<3>,
    position: Vec<DVec3>,
    hull: [DVec3; 4],
    occluder: Bvh,
    shaded: bool,
    tolerance: Tolerance,
}

/// Far apart with nothing in between, the same with blinds in between, and two that share an edge.
pub fn pairs() -> Vec<Pair> {
    let blinds: Vec<[DVec3; 4]> =
        (0..6).map(|i| square(dvec3(0.16 * i as f64, 0.1, 1.5), DVec3::X * 0.08, DVec3::Y * 0.7)).collect();
    let above = frame(dvec3(0.0, 0.0, 3.0), DVec3::Y, DVec3::X);
    let beside = frame(DVec3::ZERO, DVec3::Y, DVec3::Z);
    let tolerance = |absolute_w_m2| Tolerance { relative: 1e-3, absolute_w_m2 };
    vec![
        Pair::new("unshaded", above, &[], tolerance(0.0)),
        Pair::new("shaded", above, &blinds, tolerance(0.1)),
        Pair::new("near", beside, &[], tolerance(1e-2)),
    ]
}

impl Pair {
    /// `emitter` over the unit square on the ground, with these in between.
    fn new(name: &'static str, emitter: Frame, blockers: &[[DVec3; 4]], tolerance: Tolerance) -> Self {
        let mut coefficients = [[0.0; 3]; MAX_FUNCTIONS];
        for (a, slope) in [1.0, 0.1, 0.05, 0.0, 0.02].into_iter().enumerate() {
            coefficients[a] = [10.0 * slope, 8.0 * slope, 5.0 * slope];
        }
        let root = PacketNode { coefficients, detail: Detail::default(), children: None };
        let packet = Packet::new(0, 0, emitter, None, Basis::M3, vec![root]);
        let ground = frame(DVec3::ZERO, DVec3::X, DVec3::Y);
        let rules = SampleRules::new(Basis::M3);
        let position = rules.full.points.iter().map(|local| ground.point(*local)).collect();
        let corners = |frame: &Frame| square(frame.origin, frame.u, frame.v);
        let faces = [corners(&emitter), corners(&ground)].into_iter().chain(blockers.iter().copied());
        Self {
            name,
            packet,
            position,
            hull: corners(&ground),
            occluder: Bvh::new(OpaqueFaces::new(&scene(faces))),
            shaded: !blockers.is_empty(),
            tolerance,
        }
    }

    /// Gathers so many times; what it took.
    pub fn look(&self, times: usize) -> Work {
        let mut scratch = Scratch::default();
        let points = Points {
            position: &self.position,
            eye: &self.position,
            normal: DVec3::Z,
            face: 1,
            hull: &self.hull,
        };
        let candidates = if self.shaded { self.blockers(&mut scratch) } else { Candidates::Free };
        let mut light = vec![[0.0; 3]; self.position.len()];
        let mut uncertain = vec![0.0; self.position.len()];
        for _ in 0..times {
            Gather::new(&self.packet, &points, &self.occluder, &mut light, &mut uncertain, &mut scratch)
                .run(candidates, self.tolerance);
        }
        assert!(light.iter().flatten().any(|band| *band > 0.0), "{}: no light arrives", self.name);
        scratch.work
    }

    /// The list of those in between.
    fn blockers(&self, scratch: &mut Scratch) -> Candidates {
        let frame = &self.packet.frame;
        let corners = square(frame.origin, frame.u, frame.v);
        let (ground, emitter) = ((&self.hull[..], Some(DVec3::Z)), (&corners[..], Some(frame.normal)));
        narrow(&self.occluder, Candidates::Scene, [0, 1], ground, emitter, scratch)
    }
}

fn square(origin: DVec3, u: DVec3, v: DVec3) -> [DVec3; 4] {
    [origin, origin + u, origin + u + v, origin + v]
}

fn frame(origin: DVec3, u: DVec3, v: DVec3) -> Frame {
    let area = u.cross(v);
    Frame { origin, u, v, normal: area.normalize(), area_m2: area.length() }
}

fn scene(faces: impl Iterator<Item = [DVec3; 4]>) -> Scene {
    let grey = Material { reflectance: vec![0.5; 3], exitance_w_m2: vec![0.0; 3] };
    let face = |vertices: [DVec3; 4]| Face { vertices: vertices.to_vec(), material: 0, sides: Sides::Two };
    Scene {
        faces: faces.map(face).collect(),
        materials: vec![grey],
        bands: ["r", "g", "b"].map(Into::into).to_vec(),
        ..Scene::default()
    }
}
