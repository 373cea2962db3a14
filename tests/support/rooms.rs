//! Solutions made by hand: rooms whose irradiance is a known smooth function, on randomly split trees.

use glam::{DVec2, DVec3};

use super::lib::math::quadrature::gauss;
use super::lib::math::{Basis, Cell, Split, polygon};
use super::lib::radiosity::{Field, Node, Solution};
use super::lib::scene::{Camera, Face, Frame, Material, Projection, Scene, Sides, Surface};

/// The irradiance at a point, per band: smooth and positive.
pub fn light(p: DVec3, band: usize) -> f64 {
    let d = (p - DVec3::new(2.0, 1.5, 3.2)).length_squared();
    let tint = [1.0, 0.85, 0.6][band % 3];
    tint * 6.0 / (1.0 + 0.5 * d) + 0.3 * (0.8 * p.x + 0.4 * band as f64).sin() + 0.4
}

/// Random numbers in [0, 1): xorshift.
pub struct Random(pub u64);

impl Random {
    /// The next one.
    pub fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// The surface of one side of a face: its parallelogram along the first edge, and the polygon in it.
pub fn surface(scene: &Scene, face: usize, back: bool) -> Surface {
    let corners = &scene.faces[face].vertices;
    let n = (0..corners.len())
        .map(|i| corners[i].cross(corners[(i + 1) % corners.len()]))
        .sum::<DVec3>()
        .normalize();
    let normal = if back { -n } else { n };
    let e = (corners[1] - corners[0]).normalize();
    let f = normal.cross(e);
    let plane = |p: &DVec3| DVec2::new((*p - corners[0]).dot(e), (*p - corners[0]).dot(f));
    let flat: Vec<DVec2> = corners.iter().map(plane).collect();
    let low = flat.iter().fold(DVec2::INFINITY, |a, b| a.min(*b));
    let high = flat.iter().fold(DVec2::NEG_INFINITY, |a, b| a.max(*b));
    let size = high - low;
    let frame = Frame {
        origin: corners[0] + low.x * e + low.y * f,
        u: size.x * e,
        v: size.y * f,
        normal,
        area_m2: size.x * size.y,
    };
    let mut outline: Vec<DVec2> = flat.iter().map(|p| (*p - low) / size).collect();
    if back {
        outline.reverse();
    }
    let share = polygon::area(&outline);
    let material = &scene.materials[scene.faces[face].material as usize];
    Surface {
        face: face as u32,
        back,
        full: outline.len() == 4 && (share - 1.0).abs() < 1e-12,
        area_m2: share * frame.area_m2,
        frame,
        outline,
        reflectance: material.reflectance.clone(),
        exitance_w_m2: material.exitance_w_m2.clone(),
    }
}

/// A tree split at random down to at most `depth`, its leaves the projection of [`light`].
pub fn field(surface: &Surface, basis: Basis, bands: usize, depth: usize, random: &mut Random) -> Field {
    let mut field = Field::new(basis, bands, vec![Node::Outside], Vec::new());
    let mut stack = vec![(0usize, Cell::UNIT, depth)];
    while let Some((index, cell, left)) = stack.pop() {
        let part = polygon::clip_to_cell(&surface.outline, &cell);
        if !surface.full && polygon::area(&part) < 1e-14 {
            continue;
        }
        if left > 0 && (left + 2 > depth || random.next() < 0.8) {
            let split = [Split::Both, Split::Both, Split::U, Split::V][(random.next() * 4.0) as usize];
            let first = field.nodes.len();
            field.nodes[index] = Node::Inner(split, first as u32);
            for i in 0..split.children().len() {
                field.nodes.push(Node::Outside);
                stack.push((first + i, cell.child(split, i), left - 1));
            }
        } else {
            field.nodes[index] = Node::Leaf(field.coefficients.len() as u32);
            field.coefficients.extend(project(surface, basis, bands, &cell));
        }
    }
    field
}

fn project(surface: &Surface, basis: Basis, bands: usize, cell: &Cell) -> Vec<f64> {
    let (nodes, weights) = gauss(5);
    let mut out = vec![0.0; basis.len() * bands];
    for (x, wx) in nodes.iter().zip(weights) {
        for (y, wy) in nodes.iter().zip(weights) {
            let local = DVec2::new(*x, *y);
            let point = surface.frame.point(cell.to_surface(local));
            let phi = basis.evaluate(local);
            for a in 0..basis.len() {
                for band in 0..bands {
                    out[a * bands + band] += wx * wy * phi[a] * light(point, band);
                }
            }
        }
    }
    out
}

/// A scene of polygons (`corners`, index of material) made of `materials` (reflectance, exitance), RGB.
pub fn scene(name: &str, polygons: &[(&[[f64; 3]], u32)], materials: &[([f64; 3], [f64; 3])]) -> Scene {
    Scene {
        name: name.to_owned(),
        bands: ["r", "g", "b"].map(str::to_owned).to_vec(),
        faces: polygons
            .iter()
            .map(|(corners, material)| Face {
                vertices: corners.iter().map(|c| DVec3::from_array(*c)).collect(),
                material: *material,
                sides: Sides::One,
            })
            .collect(),
        materials: materials
            .iter()
            .map(|(rho, m)| Material { reflectance: rho.to_vec(), exitance_w_m2: m.to_vec() })
            .collect(),
        ..Scene::default()
    }
}

/// The solution of a scene whose irradiance is [`light`]; two-sided faces get two surfaces.
pub fn solution(scene: Scene, basis: Basis, depth: usize, seed: u64) -> Solution {
    let mut random = Random(0x9e37_79b9_7f4a_7c15 ^ (seed + 1));
    let sides = |face: &Face| if face.sides == Sides::Two { 2 } else { 1 };
    let surfaces: Vec<Surface> = (0..scene.faces.len())
        .flat_map(|f| (0..sides(&scene.faces[f])).map(move |back| (f, back == 1)))
        .map(|(f, back)| surface(&scene, f, back))
        .collect();
    on_surfaces(scene, surfaces, basis, depth, &mut random)
}

/// A solution on the given surfaces.
pub fn on_surfaces(
    scene: Scene,
    surfaces: Vec<Surface>,
    basis: Basis,
    depth: usize,
    random: &mut Random,
) -> Solution {
    let fields = surfaces.iter().map(|s| field(s, basis, scene.bands.len(), depth, random)).collect();
    Solution { scene, surfaces, fields, error_target: 0.01, error_estimate: 0.008, incomplete: false }
}

const WALLS: [([f64; 3], [f64; 3]); 5] = [
    ([0.75, 0.73, 0.7], [0.0; 3]),
    ([0.65, 0.15, 0.12], [0.0; 3]),
    ([0.15, 0.3, 0.6], [0.0; 3]),
    ([0.5; 3], [18.0, 16.0, 12.0]),
    ([0.7, 0.6, 0.3], [0.0; 3]),
];

/// A closed room 4 × 3 × 3.5 m with an L-shaped ledge, a lamp with a hole (a bridge edge joins it), a
/// slanted triangle that is two-sided; one camera.
pub fn gallery(basis: Basis, depth: usize, seed: u64) -> Solution {
    let (x, y, z) = (4.0, 3.0, 3.5);
    let polygons: [(&[[f64; 3]], u32); 9] = [
        (&[[0., 0., 0.], [x, 0., 0.], [x, y, 0.], [0., y, 0.]], 0),
        (&[[0., 0., z], [0., y, z], [x, y, z], [x, 0., z]], 0),
        (&[[0., 0., 0.], [0., y, 0.], [0., y, z], [0., 0., z]], 1),
        (&[[x, 0., 0.], [x, 0., z], [x, y, z], [x, y, 0.]], 2),
        (&[[0., y, 0.], [x, y, 0.], [x, y, z], [0., y, z]], 0),
        (&[[0., 0., 0.], [0., 0., z], [x, 0., z], [x, 0., 0.]], 0),
        (
            &[[0.1, 0.9, 1.], [2.9, 0.9, 1.], [2.9, 1.7, 1.], [1.1, 1.7, 1.], [1.1, 2.9, 1.], [0.1, 2.9, 1.]],
            4,
        ),
        (
            &[
                [1., 1., 3.4],
                [1., 2., 3.4],
                [3., 2., 3.4],
                [3., 1., 3.4],
                [1., 1., 3.4],
                [1.5, 1.3, 3.4],
                [2.5, 1.2, 3.4],
                [2.4, 1.8, 3.4],
                [1.6, 1.7, 3.4],
                [1.5, 1.3, 3.4],
            ],
            3,
        ),
        (&[[3.2, 0.4, 0.2], [3.7, 1.2, 0.2], [3.2, 1.9, 1.9]], 4),
    ];
    let mut scene = scene("gallery", &polygons, &WALLS);
    scene.faces[8].sides = Sides::Two;
    scene.cameras.push(Camera {
        name: "door".to_owned(),
        position: DVec3::new(3.8, 0.15, 2.2),
        direction: DVec3::new(-1.8, 1.5, -0.8).normalize(),
        up: DVec3::Z,
        projection: Projection::Perspective(1.2),
        aspect: 4.0 / 3.0,
    });
    solution(scene, basis, depth, seed)
}

/// A box standing in the void, seen from outside: five faces, the front of each outside.
pub fn block(basis: Basis, depth: usize, seed: u64) -> Solution {
    let polygons: [(&[[f64; 3]], u32); 5] = [
        (&[[0., 0., 1.], [2., 0., 1.], [2., 1., 1.], [0., 1., 1.]], 0),
        (&[[0., 0., 0.], [2., 0., 0.], [2., 0., 1.], [0., 0., 1.]], 1),
        (&[[2., 0., 0.], [2., 1., 0.], [2., 1., 1.], [2., 0., 1.]], 2),
        (&[[2., 1., 0.], [0., 1., 0.], [0., 1., 1.], [2., 1., 1.]], 4),
        (&[[0., 1., 0.], [0., 0., 0.], [0., 0., 1.], [0., 1., 1.]], 0),
    ];
    solution(scene("block", &polygons, &WALLS), basis, depth, seed)
}

/// The nearest surface along a ray, by trying all of them: whichever side faces the ray, else the front.
pub fn cast(solution: &Solution, origin: DVec3, direction: DVec3) -> Option<(u32, DVec2)> {
    let mut best: Option<(f64, u32, DVec2)> = None;
    for (index, surface) in solution.surfaces.iter().enumerate() {
        let facing = direction.dot(surface.frame.normal);
        let t = (surface.frame.origin - origin).dot(surface.frame.normal) / facing;
        if t > 1e-9 && best.is_none_or(|b| t < b.0) {
            let uv = surface.frame.uv(origin + t * direction);
            if polygon::contains(&surface.outline, uv) {
                best = Some((t, index as u32, uv));
            }
        }
    }
    best.map(|(_, index, uv)| (index, uv))
}
