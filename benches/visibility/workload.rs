//! The segments of the benchmark: bundles between pairs of faces as the solver casts them, and pairs of points at random.

use std::path::Path;

use glam::DVec3;
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;
use wavelet_radiosity::scene::procedural::{Options, Subject, draw};
use wavelet_radiosity::scene::{Scene, read};
use wavelet_radiosity::visibility::{Occluder, OpaqueFaces};

/// Points per side of a bundle and dimension.
const GRID: usize = 4;

/// All segments between the points of two faces.
pub struct Bundle {
    /// The two faces, which never shadow.
    pub skip: [u32; 2],
    /// Where segments start.
    pub from: Vec<DVec3>,
    /// Where they end.
    pub to: Vec<DVec3>,
    /// At most four corners around either set.
    pub hulls: [Vec<DVec3>; 2],
    /// The normals of the two faces, turned to each other.
    pub normals: [DVec3; 2],
}

/// Which segments.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Bundles of 16 × 16 between faces, of which the second was met by a ray from the first: what refinement dwells on.
    Seen,
    /// Bundles of 16 × 16 between any two faces that look at each other.
    Any,
    /// One segment each, between points of any two faces.
    Pairs,
}

impl Kind {
    pub const ALL: [Kind; 3] = [Kind::Seen, Kind::Any, Kind::Pairs];

    pub fn name(self) -> &'static str {
        match self {
            Kind::Seen => "seen",
            Kind::Any => "any",
            Kind::Pairs => "pairs",
        }
    }
}

/// A scene of the paper's kind.
pub fn scene(subject: Subject, surfaces: usize) -> Scene {
    let options = Options { surfaces: Some(surfaces), seed: 1, shuffle: false };
    let drawing = draw(subject, &options).expect("a scene of this many surfaces");
    let mut text = Vec::new();
    drawing.write(&mut text).expect("writing to memory");
    let text = String::from_utf8(text).expect("scenes are text");
    read::inventor::parse(&text, Path::new("generated.iv")).expect("a generated scene is sound")
}

/// Draws from a sequence that is the same everywhere.
pub struct Dice(Pcg64Mcg);

impl Dice {
    pub fn new(seed: u128) -> Self {
        Self(Pcg64Mcg::new(seed))
    }

    fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn below(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }
}

/// So many segments of a kind.
pub fn bundles(occluder: &dyn Occluder, kind: Kind, segments: usize, dice: &mut Dice) -> Vec<Bundle> {
    let faces = occluder.faces();
    let mut bundles = Vec::new();
    let mut count = 0;
    while count < segments {
        let a = dice.below(faces.len()) as u32;
        let b = match kind {
            Kind::Seen => match seen_from(occluder, a, dice) {
                Some(b) => b,
                None => continue,
            },
            _ => dice.below(faces.len()) as u32,
        };
        let Some(bundle) = between(faces, a, b, kind, dice) else { continue };
        count += bundle.from.len() * bundle.to.len();
        bundles.push(bundle);
    }
    bundles
}

/// The four corners of a face that stand for it.
fn corners(faces: &OpaqueFaces, face: u32) -> Vec<DVec3> {
    let vertices = faces.vertices(face);
    vertices[..if vertices.len() == 4 { 4 } else { 3 }].to_vec()
}

/// The point with these coordinates in 0…1.
fn at(corners: &[DVec3], u: f64, v: f64) -> DVec3 {
    let [p, q, r, s] = [corners[0], corners[1], corners[2], *corners.last().expect("corners")];
    p.lerp(q, u).lerp(s.lerp(r, u), v)
}

fn normal(corners: &[DVec3]) -> DVec3 {
    (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize()
}

fn seen_from(occluder: &dyn Occluder, face: u32, dice: &mut Dice) -> Option<u32> {
    let corners = corners(occluder.faces(), face);
    let origin = at(&corners, dice.unit(), dice.unit());
    let normal = normal(&corners);
    let direction = loop {
        let direction = DVec3::from_array(std::array::from_fn(|_| 2.0 * dice.unit() - 1.0));
        if direction.length_squared() <= 1.0 && direction.dot(normal) > 1e-3 {
            break direction.normalize();
        }
    };
    let extent = corners[0].distance(corners[2]);
    occluder.first_hit(origin + 1e-6 * extent * normal, direction).map(|(face, _)| face)
}

/// A bundle between two faces of which each lies in front of the other.
fn between(faces: &OpaqueFaces, a: u32, b: u32, kind: Kind, dice: &mut Dice) -> Option<Bundle> {
    let hulls = [corners(faces, a), corners(faces, b)];
    let mut normals = hulls.each_ref().map(|hull| normal(hull));
    if kind == Kind::Seen && normals[1].dot(hulls[0][0] - hulls[1][0]) < 0.0 {
        normals[1] = -normals[1];
    }
    let before = |i: usize| hulls[1 - i].iter().all(|p| normals[i].dot(*p - hulls[i][0]) > 1e-9);
    if a == b || !before(0) || !before(1) {
        return None;
    }
    let points = |hull: &[DVec3], dice: &mut Dice| match kind {
        Kind::Pairs => vec![at(hull, dice.unit(), dice.unit())],
        _ => {
            let step = |i: usize| (i as f64 + 0.5) / GRID as f64;
            (0..GRID * GRID).map(|i| at(hull, step(i % GRID), step(i / GRID))).collect()
        }
    };
    let (from, to) = (points(&hulls[0], dice), points(&hulls[1], dice));
    Some(Bundle { skip: [a, b], from, to, hulls, normals })
}
