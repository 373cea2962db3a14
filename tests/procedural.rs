//! The generated scenes: exact, reproducible, free of repairs, closed, without faces that lie on each other.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use glam::{DVec2, DVec3};
use wavelet_radiosity::scene::procedural::{Drawing, Options, Subject, TooFewSurfaces, draw};
use wavelet_radiosity::scene::{Face, Scene, Sides, read};
use wavelet_radiosity::visibility::{Bvh, Occluder, OpaqueFaces};

fn options(surfaces: usize) -> Options {
    Options { surfaces: Some(surfaces), seed: 1, shuffle: false }
}

fn text(drawing: &Drawing) -> String {
    let mut bytes = Vec::new();
    drawing.write(&mut bytes).unwrap();
    String::from_utf8(bytes).unwrap()
}

fn parse(drawing: &Drawing) -> Scene {
    read::inventor::parse(&text(drawing), Path::new("generated.iv")).unwrap()
}

/// Each subject in a size at which a test of pairs is quick.
fn small() -> impl Iterator<Item = (Subject, Scene)> {
    [
        (Subject::Stanislas, 4000),
        (Subject::Quito, 5000),
        (Subject::SodaRoom, 3000),
        (Subject::SodaFloor, 12_000),
    ]
    .into_iter()
    .map(|(subject, n)| (subject, parse(&draw(subject, &options(n)).unwrap())))
}

fn normal(face: &Face) -> DVec3 {
    let v = &face.vertices;
    (1..v.len() - 1).map(|i| (v[i] - v[0]).cross(v[i + 1] - v[0])).sum::<DVec3>().normalize()
}

#[test]
fn numbers_of_surfaces_and_lights_are_those_of_the_paper() {
    let lights = [36, 83, 3, 163, 1];
    for (subject, lights) in Subject::ALL.into_iter().zip(lights) {
        let drawing = draw(subject, &Options { surfaces: None, seed: 3, shuffle: false }).unwrap();
        let scene = parse(&drawing);
        let emits = |face: &&Face| scene.materials[face.material as usize].exitance_w_m2[0] > 0.0;
        assert_eq!(scene.faces.len(), subject.surfaces(), "{subject:?}");
        assert_eq!(scene.faces.iter().filter(emits).count(), lights, "{subject:?}");
        assert!(!scene.cameras.is_empty());
        assert!(scene.faces.iter().all(|face| face.sides == Sides::One));
        assert!(scene.findings.repairs.is_empty(), "{subject:?}: {:?}", scene.findings);
    }
}

#[test]
fn any_number_of_surfaces_is_met_exactly() {
    let numbers = [17, 18, 100, 1999, 3600, 3601, 7001, 8200, 12_345, 20_011, 80_000];
    for subject in Subject::ALL {
        for surfaces in numbers {
            match draw(subject, &options(surfaces)) {
                Ok(drawing) => assert_eq!(parse(&drawing).faces.len(), surfaces, "{subject:?}"),
                Err(TooFewSurfaces { least, asked, .. }) => {
                    assert!(asked == surfaces && least > asked && least < 9000, "{subject:?} {least}");
                }
            }
        }
    }
}

#[test]
fn a_seed_gives_one_scene_and_shuffling_only_changes_the_order() {
    for subject in [Subject::Stanislas, Subject::Quito, Subject::SodaRoom] {
        let with = |seed, shuffle| draw(subject, &Options { surfaces: Some(5000), seed, shuffle }).unwrap();
        assert_eq!(text(&with(5, false)), text(&with(5, false)));
        assert_ne!(text(&with(5, false)), text(&with(6, false)));
        let (sorted, shuffled) = (parse(&with(5, false)), parse(&with(5, true)));
        let set = |scene: &Scene| -> BTreeSet<String> {
            let paint = |face: &Face| &scene.materials[face.material as usize];
            scene.faces.iter().map(|face| format!("{:?} {:?}", face.vertices, paint(face))).collect()
        };
        assert_eq!(set(&sorted).len(), 5000);
        assert!(set(&sorted) == set(&shuffled), "{subject:?}");
        let step = |scene: &Scene| -> f64 {
            scene.faces.windows(2).map(|pair| pair[0].vertices[0].distance(pair[1].vertices[0])).sum()
        };
        assert!(step(&sorted) < 0.2 * step(&shuffled), "{subject:?}");
    }
}

/// Light that starts at the cameras and is scattered by what it meets never meets the back of a face: all solids are closed or stand
/// on something, and look outward. In rooms it never gets out.
#[test]
fn no_back_of_a_face_can_be_seen_and_rooms_are_closed() {
    for (subject, scene) in small() {
        let bvh = Bvh::new(OpaqueFaces::new(&scene));
        let normals: Vec<DVec3> = scene.faces.iter().map(normal).collect();
        let mut state = 1u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            2.0 * (state >> 33) as f64 / f64::from(1u32 << 31) - 1.0
        };
        let mut hits = 0;
        for camera in scene.cameras.iter().cycle().take(6000) {
            let (mut origin, mut axis) = (camera.position, DVec3::ZERO);
            for _ in 0..10 {
                let ball = DVec3::new(uniform(), uniform(), uniform()).normalize();
                let direction = (1.0001 * axis + ball).normalize();
                let Some((face, distance)) = bvh.first_hit(origin, direction) else {
                    assert!(
                        !matches!(subject, Subject::SodaRoom | Subject::SodaFloor),
                        "a way out at {origin}"
                    );
                    break;
                };
                let at = origin + distance * direction;
                assert!(
                    normals[face as usize].dot(direction) < 0.0,
                    "{subject:?}: back of {face} at {at} from {origin}"
                );
                axis = normals[face as usize];
                origin = at + 1e-7 * axis;
                hits += 1;
            }
        }
        assert!(hits > 3000, "{subject:?}: {hits}");
    }
}

/// No two faces share a plane and a part of it.
#[test]
fn no_two_faces_lie_on_each_other() {
    for (subject, scene) in small() {
        let mut planes: HashMap<[i64; 4], Vec<usize>> = HashMap::new();
        for (i, face) in scene.faces.iter().enumerate() {
            let n = normal(face);
            let sign =
                if [n.x, n.y, n.z].into_iter().find(|c| c.abs() > 1e-6).unwrap() < 0.0 { -1.0 } else { 1.0 };
            let d = n.dot(face.vertices[0]);
            let key = [n.x, n.y, n.z, d].map(|c| (sign * c * 1e5).round() as i64);
            planes.entry(key).or_default().push(i);
        }
        for members in planes.values() {
            let n = normal(&scene.faces[members[0]]);
            let u = n.any_orthonormal_vector();
            let v = n.cross(u);
            let flat: Vec<Flat> = members
                .iter()
                .map(|i| {
                    Flat::new(
                        scene.faces[*i].vertices.iter().map(|p| DVec2::new(u.dot(*p), v.dot(*p))).collect(),
                    )
                })
                .collect();
            for (i, a) in flat.iter().enumerate() {
                for (j, b) in flat.iter().enumerate().filter(|(j, _)| *j != i) {
                    if let Some(at) = a.samples.iter().find(|p| b.contains(**p)) {
                        let name = |k: usize| &scene.faces[members[k]].vertices;
                        panic!("{subject:?}: {at} of {:?} lies on {:?}", name(i), name(j));
                    }
                }
            }
        }
    }
}

/// A polygon in its plane with points a little inside each of its edges.
struct Flat {
    outline: Vec<DVec2>,
    low: DVec2,
    high: DVec2,
    samples: Vec<DVec2>,
}

impl Flat {
    fn new(outline: Vec<DVec2>) -> Flat {
        let n = outline.len();
        let low = outline.iter().fold(outline[0], |a, p| a.min(*p));
        let high = outline.iter().fold(outline[0], |a, p| a.max(*p));
        let mut flat = Flat { outline, low, high, samples: Vec::new() };
        for i in 0..n {
            let (p, q) = (flat.outline[i], flat.outline[(i + 1) % n]);
            for (t, side) in
                [(0.05, 1e-4), (0.5, 1e-4), (0.95, 1e-4), (0.05, -1e-4), (0.5, -1e-4), (0.95, -1e-4)]
            {
                let at = p.lerp(q, t) + (q - p).normalize().perp() * side;
                if flat.contains(at) {
                    flat.samples.push(at);
                }
            }
        }
        flat
    }

    fn contains(&self, at: DVec2) -> bool {
        let n = self.outline.len();
        let crosses = |i: &usize| {
            let (p, q) = (self.outline[*i], self.outline[(i + 1) % n]);
            (p.y > at.y) != (q.y > at.y) && at.x < p.x + (at.y - p.y) / (q.y - p.y) * (q.x - p.x)
        };
        at.cmpge(self.low).all() && at.cmple(self.high).all() && (0..n).filter(crosses).count() % 2 == 1
    }
}
