//! Parts that the stress builds scenes from: polygons in metres, counter-clockwise seen from their front; one band.

use std::f64::consts::TAU;

use glam::{DQuat, DVec2, DVec3};
use wavelet_radiosity::scene::{Face, Light, Material, Scene, Sides};

/// Corners of a face.
pub type Polygon = Vec<DVec3>;

/// A scene that grows by parts of one material.
#[derive(Clone, Default)]
pub struct Draft(pub Scene);

impl Draft {
    /// Adds one-sided faces.
    pub fn one(self, polygons: impl IntoIterator<Item = Polygon>, rho: f64, m: f64) -> Self {
        self.part(polygons, rho, m, Sides::One)
    }

    /// Adds two-sided faces.
    pub fn two(self, polygons: impl IntoIterator<Item = Polygon>, rho: f64, m: f64) -> Self {
        self.part(polygons, rho, m, Sides::Two)
    }

    /// Adds a point light.
    pub fn lamp(mut self, position: DVec3, intensity_w_sr: f64) -> Self {
        self.0.lights.push(Light::Point { position, intensity_w_sr: vec![intensity_w_sr] });
        self
    }

    fn part(mut self, polygons: impl IntoIterator<Item = Polygon>, rho: f64, m: f64, sides: Sides) -> Self {
        let scene = &mut self.0;
        scene.bands = vec!["grey".to_owned()];
        let material = scene.materials.len() as u32;
        scene.materials.push(Material { reflectance: vec![rho], exitance_w_m2: vec![m] });
        scene.faces.extend(polygons.into_iter().map(|vertices| Face { vertices, material, sides }));
        self
    }
}

/// All polygons of one reflectance and unit exitance: `B = 1/(1 − ρ)` wherever they enclose.
pub fn furnace(polygons: impl IntoIterator<Item = Polygon>, rho: f64) -> Draft {
    Draft::default().one(polygons, rho, 1.0)
}

/// The faces of a prism over a base given counter-clockwise from above, seen from inside.
pub fn room(base: &[DVec2], low: f64, high: f64) -> Vec<Polygon> {
    let at = |z: f64| base.iter().map(move |p| p.extend(z));
    let mut faces = vec![at(low).collect(), at(high).rev().collect()];
    faces.extend(walls(base, low, high));
    faces
}

/// The walls alone, seen from inside.
pub fn walls(base: &[DVec2], low: f64, high: f64) -> Vec<Polygon> {
    let edges = (0..base.len()).map(|i| (base[i], base[(i + 1) % base.len()]));
    edges.map(|(a, b)| vec![b.extend(low), a.extend(low), a.extend(high), b.extend(high)]).collect()
}

/// The same faces seen from the other side.
pub fn turned(mut faces: Vec<Polygon>) -> Vec<Polygon> {
    faces.iter_mut().for_each(|face| face.reverse());
    faces
}

/// A prism seen from outside.
pub fn solid(base: &[DVec2], low: f64, high: f64) -> Vec<Polygon> {
    turned(room(base, low, high))
}

/// The faces moved by `motion`.
pub fn moved(faces: Vec<Polygon>, motion: impl Fn(DVec3) -> DVec3) -> Vec<Polygon> {
    faces.into_iter().map(|face| face.into_iter().map(&motion).collect()).collect()
}

/// A rectangle from `low` to `high`, counter-clockwise.
pub fn rectangle(low: (f64, f64), high: (f64, f64)) -> Vec<DVec2> {
    [low, (high.0, low.1), high, (low.0, high.1)].map(DVec2::from).to_vec()
}

/// The unit square.
pub fn square() -> Vec<DVec2> {
    rectangle((0.0, 0.0), (1.0, 1.0))
}

/// A horizontal polygon that faces up.
pub fn up(outline: &[DVec2], z: f64) -> Polygon {
    outline.iter().map(|p| p.extend(z)).collect()
}

/// A horizontal polygon that faces down.
pub fn down(outline: &[DVec2], z: f64) -> Polygon {
    outline.iter().rev().map(|p| p.extend(z)).collect()
}

/// `n` corners around the origin, with the radii given in turn.
pub fn star(n: usize, radii: &[f64]) -> Vec<DVec2> {
    (0..n).map(|i| radii[i % radii.len()] * DVec2::from_angle(TAU * i as f64 / n as f64)).collect()
}

/// The part of the unit disc within `degrees` of a full turn: two faces of its room meet at the origin at that angle.
pub fn pie(degrees: f64) -> Vec<DVec2> {
    let steps = (degrees / 60.0).ceil().max(1.0) as usize;
    let arc = (0..=steps).map(|i| DVec2::from_angle(degrees.to_radians() * i as f64 / steps as f64));
    [DVec2::ZERO].into_iter().chain(arc).collect()
}

/// The faces of a pyramid whose `n` sides meet at the tip, seen from inside.
pub fn pyramid(n: usize) -> Vec<Polygon> {
    let base = star(n, &[1.0]);
    let sides = (0..n).map(|i| vec![base[(i + 1) % n].extend(0.0), base[i].extend(0.0), DVec3::Z]);
    [up(&base, 0.0)].into_iter().chain(sides).collect()
}

/// A comb with `teeth` teeth on a back, in the unit square.
pub fn comb(teeth: usize) -> Vec<DVec2> {
    let pitch = 1.0 / (2 * teeth - 1) as f64;
    let mut outline = vec![DVec2::ZERO, DVec2::X];
    for i in (0..teeth).rev() {
        let (left, right) = (2.0 * i as f64 * pitch, (2 * i + 1) as f64 * pitch);
        outline.extend([DVec2::new(right, 1.0), DVec2::new(left, 1.0)]);
        if i > 0 {
            outline.extend([DVec2::new(left, 0.2), DVec2::new(left - pitch, 0.2)]);
        }
    }
    outline
}

/// The sides of an outline divided by `n` corners each on a straight line.
pub fn divided(outline: &[DVec2], n: usize) -> Vec<DVec2> {
    let edges = (0..outline.len()).map(|i| (outline[i], outline[(i + 1) % outline.len()]));
    edges.flat_map(|(a, b)| (0..n).map(move |k| a.lerp(b, k as f64 / n as f64))).collect()
}

/// `outline` with `hole`, both counter-clockwise, joined by a bridge from the first corner of each.
pub fn bridged(outline: &[DVec2], hole: &[DVec2]) -> Vec<DVec2> {
    let (o, h) = (outline.iter().copied(), hole.iter().copied());
    o.chain([outline[0], hole[0]]).chain(h.rev()).collect()
}

/// The outline of a room without symmetry.
fn irregular_base() -> [DVec2; 5] {
    [(0.0, 0.0), (3.1, 0.2), (3.7, 2.3), (1.4, 3.3), (-0.3, 1.9)].map(DVec2::from)
}

/// A solid that stands askew in that room.
fn tilted_block() -> Vec<Polygon> {
    let tilt = DQuat::from_axis_angle(DVec3::new(0.3, 0.8, 0.5).normalize(), 0.9);
    let block = solid(&rectangle((-0.4, -0.3), (0.37, 0.41)), -0.2, 0.33);
    moved(block, |p| tilt * p + DVec3::new(1.53, 1.31, 0.87))
}

/// A room without symmetry, with a lamp and a tilted solid that casts a shadow: nothing in it is a tie.
pub fn irregular() -> Scene {
    let base = irregular_base();
    let lamp = down(&[(1.2, 1.1), (2.13, 1.37), (1.71, 2.05)].map(DVec2::from), 2.1);
    Draft::default()
        .one(room(&base, 0.0, 2.4), 0.6, 0.0)
        .one([lamp], 0.2, 10.0)
        .one(tilted_block(), 0.4, 0.0)
        .0
}

/// The same room, lit by a grid of equal lamps, of which one in five is bright, with small solids: so many lamps that for these the dim ones
/// count by draws from clusters, and wherever clusters are divided there are ties.
pub fn many_lamps() -> Scene {
    let at = |i: usize, side: usize, pitch: f64| {
        DVec2::new(0.4 + pitch * (i % side) as f64, 0.4 + pitch * (i / side) as f64)
    };
    let square = |low: DVec2, size: f64| rectangle((low.x, low.y), (low.x + size, low.y + size));
    let lamp = |i: usize| down(&square(at(i, 8, 0.25), 0.1), 2.1);
    let (bright, dim) = (0..64).partition::<Vec<usize>, _>(|i| i % 5 == 0);
    let cubes = (0..9).flat_map(|i| solid(&square(at(i, 3, 0.8), 0.12), 0.4, 0.52));
    Draft::default()
        .one(room(&irregular_base(), 0.0, 2.4), 0.6, 0.0)
        .one(bright.into_iter().map(lamp), 0.2, 100.0)
        .one(dim.into_iter().map(lamp), 0.2, 3.0)
        .one(moved(cubes.collect(), |p| DQuat::from_rotation_x(0.1) * p), 0.4, 0.0)
        .0
}
