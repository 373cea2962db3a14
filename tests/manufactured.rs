//! Manufactured solutions (numerics §8): the radiosity of every face of a closed room is chosen, a constant `c_i`, and the exitance set so
//! that it is the exact solution, `M_i(x) = c_i − ρ Σ_j c_j F(x → what x sees of face j)`. What the solver has to find is the irradiance
//! `Σ_j c_j F`, with all that it does at edges and corners.
//!
//! `WRAD_MANUFACTURED=long` runs all reflectances and errors; rows go to standard output.

use std::time::{Duration, Instant};

use glam::{DVec2, DVec3};
use wavelet_radiosity::math::basis::MAX_FUNCTIONS;
use wavelet_radiosity::math::{Basis, Cell, Split, polygon, quadrature::gauss};
use wavelet_radiosity::radiosity::{Field, Node};
use wavelet_radiosity::scene::{self, Face, Material, Scene, Sides, Surface};
use wavelet_radiosity::schedule::{Observer, Options, Outcome, solve_emitting};
use wavelet_radiosity::transport::{Oracle, lambert::form_factor};
use wavelet_radiosity::visibility::{Bvh, OpaqueFaces};

/// Radiosity of the faces in W/m², floor and ceiling first.
const CHOSEN: [f64; 8] = [1.0, 0.6, 1.4, 0.8, 1.2, 0.5, 0.9, 1.1];

/// A part of a face: which face, its corners, and on which side of the reflex corner it lies, in rooms that have one.
struct Piece {
    face: usize,
    corners: Vec<DVec3>,
    arm: Arm,
}

/// Where a point of an L-shaped room lies.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Arm {
    /// In the square that sees all of the room.
    Square,
    /// Beyond x = 1.
    X,
    /// Beyond y = 1.
    Y,
}

impl Arm {
    fn of(p: DVec3) -> Self {
        // Walls in the planes through the reflex corner belong to their own arm.
        match (p.x > 1.0 + 1e-9, p.y > 1.0 + 1e-9) {
            (true, _) => Arm::X,
            (_, true) => Arm::Y,
            _ => Arm::Square,
        }
    }
}

/// A closed prism seen from inside, of height 1.
struct Room {
    name: &'static str,
    faces: Vec<Vec<DVec3>>,
    pieces: Vec<Piece>,
}

impl Room {
    /// Over a convex base given counter-clockwise from above: everything sees everything.
    fn convex(name: &'static str, base: &[DVec2]) -> Self {
        let faces = prism(base);
        let whole = |(face, corners): (usize, &Vec<DVec3>)| Piece {
            face,
            corners: corners.clone(),
            arm: Arm::Square,
        };
        let pieces = faces.iter().enumerate().map(whole).collect();
        Self { name, faces, pieces }
    }

    /// Two squares beside a third one.
    fn l() -> Self {
        let base = [(0., 0.), (2., 0.), (2., 1.), (1., 1.), (1., 2.), (0., 2.)].map(DVec2::from);
        let faces = prism(&base);
        let mut pieces = Vec::new();
        for (face, corners) in faces.iter().enumerate() {
            for (arm, low, high) in [
                (Arm::Square, DVec2::ZERO, DVec2::ONE),
                (Arm::X, DVec2::X, DVec2::new(2.0, 1.0)),
                (Arm::Y, DVec2::Y, DVec2::new(1.0, 2.0)),
            ] {
                let bounds: [&dyn Fn(DVec3) -> f64; 4] =
                    [&|p| p.x - low.x, &|p| p.y - low.y, &|p| high.x - p.x, &|p| high.y - p.y];
                let part = bounds.iter().fold(corners.clone(), |part, side| clip(&part, side));
                if extent(&part) > 1e-9 {
                    pieces.push(Piece { face, corners: part, arm });
                }
            }
        }
        Self { name: "L", faces, pieces }
    }

    /// The irradiance at `x` of a face with this normal, in W/m², where the faces' radiosity is `of`.
    fn irradiance(&self, x: DVec3, normal: DVec3, of: &dyn Fn(usize) -> f64) -> f64 {
        let at = Arm::of(x);
        // Of the other arm a point sees what lies on the origin's side of the vertical plane through it and the reflex corner.
        let (dx, dy) = (1.0 - x.x, 1.0 - x.y);
        let across = if dy > dx { DVec2::new(-dy, dx) } else { DVec2::new(dy, -dx) };
        let sees = |p: DVec3| across.dot(p.truncate() - 1.0);
        let light = |piece: &Piece| {
            let beyond = at != Arm::Square && piece.arm != Arm::Square && piece.arm != at;
            let part = if beyond { clip(&piece.corners, &sees) } else { piece.corners.clone() };
            of(piece.face) * form_factor(x, normal, part.into_iter())
        };
        self.pieces.iter().map(light).sum()
    }

    /// The irradiance that the solver is to find.
    fn exact(&self, surface: &Surface, uv: DVec2) -> f64 {
        self.irradiance(surface.frame.point(uv), surface.frame.normal, &|face| CHOSEN[face])
    }

    fn scene(&self, rho: f64) -> Scene {
        let face =
            |vertices: &Vec<DVec3>| Face { vertices: vertices.clone(), material: 0, sides: Sides::One };
        let mut scene = Scene {
            bands: vec!["grey".to_owned()],
            materials: vec![Material { reflectance: vec![rho], exitance_w_m2: vec![0.0] }],
            faces: self.faces.iter().map(face).collect(),
            ..Scene::default()
        };
        scene::validate(&mut scene);
        assert_eq!(scene.faces.len(), self.faces.len());
        scene
    }
}

/// The faces of a prism over a base given counter-clockwise from above: floor, ceiling, walls.
fn prism(base: &[DVec2]) -> Vec<Vec<DVec3>> {
    let at = |z: f64| base.iter().map(move |p| p.extend(z));
    let mut faces = vec![at(0.0).collect(), at(1.0).rev().collect()];
    let edges = (0..base.len()).map(|i| (base[i], base[(i + 1) % base.len()]));
    faces.extend(edges.map(|(a, b)| vec![b.extend(0.0), a.extend(0.0), a.extend(1.0), b.extend(1.0)]));
    faces
}

/// The part of a polygon with `side(p) ≥ 0`.
fn clip(polygon: &[DVec3], side: &dyn Fn(DVec3) -> f64) -> Vec<DVec3> {
    let mut out = Vec::new();
    for (i, a) in polygon.iter().enumerate() {
        let b = polygon[(i + 1) % polygon.len()];
        let (here, there) = (side(*a), side(b));
        if here >= 0.0 {
            out.push(*a);
        }
        if here * there < 0.0 {
            out.push(a.lerp(b, here / (here - there)));
        }
    }
    out
}

/// Twice the area of a polygon.
fn extent(polygon: &[DVec3]) -> f64 {
    let edges =
        (1..polygon.len()).map(|i| (polygon[i] - polygon[0], polygon[(i + 1) % polygon.len()] - polygon[0]));
    edges.map(|(a, b)| a.cross(b)).sum::<DVec3>().length()
}

/// Points of the part of a surface within a cell, with the area of each as a share of the surface's parallelogram: exact for polynomials of
/// degree 8. The part must be convex.
fn points(surface: &Surface, cell: &Cell) -> Vec<(DVec2, f64)> {
    let (nodes, weights) = gauss(5);
    let part = if surface.full {
        let (low, high) = (cell.low, cell.low + cell.size);
        vec![low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)]
    } else {
        polygon::clip_to_cell(&surface.outline, cell)
    };
    let mut points = Vec::new();
    for i in 2..part.len() {
        let (o, a, b) = (part[0], part[i - 1] - part[0], part[i] - part[0]);
        for (s, ws) in nodes.iter().zip(weights) {
            for (t, wt) in nodes.iter().zip(weights) {
                points.push((o + *s * a.lerp(b, *t), ws * wt * s * a.perp_dot(b)));
            }
        }
    }
    points
}

/// The exitance of a surface as a field, divided until what it leaves out has an RMS below `tolerance` of the whole surface's.
fn exitance(room: &Room, surface: &Surface, tolerance_w_m2: f64) -> Field {
    let mut field = Field::new(Basis::M3, 1, vec![Node::Outside], Vec::new());
    fit(room, surface, tolerance_w_m2, Cell::UNIT, 0, &mut field);
    field
}

fn fit(room: &Room, surface: &Surface, tolerance_w_m2: f64, cell: Cell, slot: usize, field: &mut Field) {
    let points = points(surface, &cell);
    let share: f64 = points.iter().map(|(_, w)| w).sum::<f64>() / cell.area();
    if share < 1e-9 {
        return;
    }
    let whole = share > 1.0 - 1e-9;
    let emitted =
        |uv: DVec2| CHOSEN[surface.face as usize] - surface.reflectance[0] * room.exact(surface, uv);
    let values: Vec<f64> = points.iter().map(|(uv, _)| emitted(*uv)).collect();
    let functions: Vec<_> = points.iter().map(|(uv, _)| Basis::M3.evaluate(cell.to_local(*uv))).collect();
    let weights: Vec<f64> = points.iter().map(|(_, w)| w / (share * cell.area())).collect();
    let coefficients = least_squares(&functions, &values, &weights);
    let square: f64 = (0..values.len())
        .map(|p| {
            let fitted: f64 = functions[p].iter().zip(&coefficients).map(|(f, c)| f * c).sum();
            weights[p] * (fitted - values[p]).powi(2)
        })
        .sum();
    let convex = surface.full || surface.outline.len() < 5 || whole;
    if convex && (square * share * cell.area()).sqrt() < tolerance_w_m2 || cell.size.x < 1e-5 {
        field.nodes[slot] = Node::Leaf(field.coefficients.len() as u32);
        field.coefficients.extend(coefficients);
        return;
    }
    let first = field.nodes.len();
    field.nodes[slot] = Node::Inner(Split::Both, first as u32);
    field.nodes.resize(first + 4, Node::Outside);
    for child in 0..4 {
        fit(room, surface, tolerance_w_m2, cell.child(Split::Both, child), first + child, field);
    }
}

/// The coefficients that fit best, by Cholesky's factorisation of the normal equations.
fn least_squares(
    functions: &[[f64; MAX_FUNCTIONS]],
    values: &[f64],
    weights: &[f64],
) -> [f64; MAX_FUNCTIONS] {
    let (mut m, mut x) = ([[0.0; MAX_FUNCTIONS]; MAX_FUNCTIONS], [0.0; MAX_FUNCTIONS]);
    for ((f, value), weight) in functions.iter().zip(values).zip(weights) {
        for i in 0..MAX_FUNCTIONS {
            x[i] += weight * f[i] * value;
            for j in 0..MAX_FUNCTIONS {
                m[i][j] += weight * f[i] * f[j];
            }
        }
    }
    for i in 0..MAX_FUNCTIONS {
        // Of functions that are alike on a small part of a cell, the later ones are left alone.
        m[i][i] += 1e-12;
        for j in 0..=i {
            let sum: f64 = m[i][j] - (0..j).map(|k| m[i][k] * m[j][k]).sum::<f64>();
            m[i][j] = if i == j { sum.max(1e-24).sqrt() } else { sum / m[j][j] };
        }
    }
    for i in 0..MAX_FUNCTIONS {
        x[i] = (x[i] - (0..i).map(|k| m[i][k] * x[k]).sum::<f64>()) / m[i][i];
    }
    for i in (0..MAX_FUNCTIONS).rev() {
        x[i] = (x[i] - (i + 1..MAX_FUNCTIONS).map(|k| m[k][i] * x[k]).sum::<f64>()) / m[i][i];
    }
    x
}

/// Largest and RMS error of reflected radiosity, over the RMS of what is exact: what `--error` asks for.
fn deviation(room: &Room, outcome: &Outcome) -> (f64, f64) {
    let (mut largest, mut square, mut norm, mut area_m2) = (0.0f64, 0.0, 0.0, 0.0);
    for (surface, field) in outcome.solution.surfaces.iter().zip(&outcome.solution.fields) {
        field.for_each_leaf(&mut |leaf| {
            for (uv, share) in points(surface, &leaf.cell) {
                let mut e = [0.0];
                leaf.irradiance(field.basis, uv, &mut e);
                let exact = room.exact(surface, uv);
                largest = largest.max((e[0] - exact).abs());
                square += share * surface.frame.area_m2 * (e[0] - exact).powi(2);
                norm += share * surface.frame.area_m2 * exact * exact;
                area_m2 += share * surface.frame.area_m2;
            }
        });
    }
    (largest / (norm / area_m2).sqrt(), (square / norm).sqrt())
}

/// Gives up after a while.
struct Patience(Instant, Duration);

impl Observer for Patience {
    fn interrupted(&mut self) -> bool {
        self.0.elapsed() > self.1
    }
}

fn judge(room: &Room, rho: f64, basis: Basis, errors: &[f64]) {
    let scene = room.scene(rho);
    let surfaces = scene::surfaces(&scene);
    let bvh = Bvh::new(OpaqueFaces::new(&scene));
    for error in errors {
        let exitance: Vec<Field> = surfaces.iter().map(|s| exitance(room, s, 0.01 * error)).collect();
        let start = Instant::now();
        let options = Options { error: *error, basis, oracle: Oracle::Energy, direct_only: false };
        let mut patience = Patience(start, Duration::from_secs(100));
        let outcome = solve_emitting(&scene, &surfaces, &exitance, &bvh, &options, &mut patience);
        let (largest, rms) = deviation(room, &outcome);
        println!(
            "{} | {rho} | {basis:?} | {error} | {largest:.1e} | {rms:.1e} | {:.1e} | {} | {} | {} | {:.2}",
            room.name,
            outcome.solution.error_estimate,
            outcome.elements,
            outcome.statistics.batches,
            outcome.work.cost(),
            start.elapsed().as_secs_f64()
        );
        if outcome.solution.incomplete {
            assert!(long(), "given up");
            return;
        }
        assert!(rms <= *error, "{} ρ {rho} {basis:?}: {rms} above {error}", room.name);
    }
}

fn long() -> bool {
    std::env::var_os("WRAD_MANUFACTURED").is_some_and(|form| form == "long")
}

fn judge_all(room: &Room) {
    let errors: &[f64] = if long() { &[0.1, 0.03, 0.01, 0.003, 0.001] } else { &[0.1, 0.01] };
    let reflectances: &[f64] = if long() { &[0.5, 0.9, 0.99] } else { &[0.5, 0.9] };
    for rho in reflectances {
        for basis in [Basis::M2, Basis::M3] {
            judge(room, *rho, basis, errors);
        }
    }
}

fn cube() -> Room {
    Room::convex("cube", &[(0., 0.), (1., 0.), (1., 1.), (0., 1.)].map(DVec2::from))
}

fn wedge() -> Room {
    let side = |degrees: f64| DVec2::from_angle(degrees.to_radians());
    Room::convex("wedge", &[DVec2::ZERO, side(-10.0), side(10.0)])
}

#[test]
fn in_a_cube() {
    judge_all(&cube());
}

#[test]
fn in_a_wedge_of_20_degrees() {
    judge_all(&wedge());
}

#[test]
fn in_an_l_shaped_room() {
    judge_all(&Room::l());
}

/// What the others rest on: whatever a point sees fills its hemisphere.
#[test]
fn form_factors_add_up_to_one() {
    for room in [cube(), wedge(), Room::l()] {
        for surface in scene::surfaces(&room.scene(0.5)) {
            for i in 0..64 {
                let uv = (DVec2::new((i % 8) as f64, (i / 8) as f64) + 0.5) / 8.0;
                if polygon::contains(&surface.outline, uv) {
                    let sum = room.irradiance(surface.frame.point(uv), surface.frame.normal, &|_| 1.0);
                    assert!((sum - 1.0).abs() < 1e-12, "{} face {} at {uv}: {sum}", room.name, surface.face);
                }
            }
        }
    }
}
