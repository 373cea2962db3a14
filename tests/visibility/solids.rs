//! Closed solids whose faces meet in every way that scenes have: shared edges, T-junctions, concave polygons, duplicates.

use glam::{DQuat, DVec3};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

/// Draws numbers from a sequence that is the same everywhere.
pub struct Dice(Pcg64Mcg);

impl Dice {
    pub fn new(seed: u64) -> Self {
        Self(Pcg64Mcg::new(u128::from(seed)))
    }

    /// From 0 to 1.
    pub fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// As often as not near to one of the ends, as near as a share of 1e-13.
    pub fn near_an_end(&mut self, low: f64, high: f64) -> f64 {
        let gap = (high - low) * 10f64.powf(self.between(-13.0, -1.0));
        match self.below(4) {
            0 => low + gap,
            1 => high - gap,
            _ => self.between(low, high),
        }
    }

    pub fn below(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }

    pub fn direction(&mut self) -> DVec3 {
        loop {
            let v = DVec3::new(self.between(-1.0, 1.0), self.between(-1.0, 1.0), self.between(-1.0, 1.0));
            if (1e-3..=1.0).contains(&v.length()) {
                return v.normalize();
            }
        }
    }
}

/// Which solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A box of squares that share edges.
    Squares,
    /// A box of triangles.
    Triangles,
    /// A box of tiles of which none ends where its neighbour does.
    TJunctions,
    /// A box of concave polygons and what fills their notches.
    Polygons,
    /// A box of squares, some of them twice or thrice, and larger ones in the same planes.
    Duplicates,
    /// A ball of triangles with dents.
    Ball,
    /// A box of polygons and triangles cut near their sides in both directions, so that specks are left, far from the origin. Segments start
    /// as near to a wall as a millionth of its width, or are short.
    Specks,
}

impl Kind {
    pub const ALL: [Kind; 7] = [
        Kind::Squares,
        Kind::Triangles,
        Kind::TJunctions,
        Kind::Polygons,
        Kind::Duplicates,
        Kind::Ball,
        Kind::Specks,
    ];
}

/// A solid somewhere in space.
pub struct Solid {
    pub faces: Vec<Vec<DVec3>>,
    kind: Kind,
    centre: DVec3,
    size: f64,
    turn: DQuat,
}

impl Solid {
    /// A solid of a kind in a random place, of a random size, turned at random or not at all.
    pub fn new(kind: Kind, dice: &mut Dice) -> Self {
        let faces = match kind {
            Kind::Ball => ball(dice),
            _ => {
                (0..6).flat_map(|side| wall(kind, dice).into_iter().map(move |f| on_side(&f, side))).collect()
            }
        };
        let size = 10f64.powf(dice.between(-3.0, 3.0));
        let turned = dice.unit() < 0.7;
        let turn = if turned {
            DQuat::from_axis_angle(dice.direction(), dice.between(0.0, 6.0))
        } else {
            DQuat::IDENTITY
        };
        let centre = match kind {
            Kind::Specks => dice.direction() * size * 10f64.powf(dice.between(-1.0, 4.0)),
            _ if dice.unit() < 0.5 => DVec3::ZERO,
            _ => dice.direction() * size * dice.between(0.0, 100.0),
        };
        let mut solid = Self { faces: Vec::new(), kind, centre, size, turn };
        solid.faces = faces.iter().map(|f| f.iter().map(|p| solid.place(*p)).collect()).collect();
        solid
    }

    fn place(&self, p: DVec3) -> DVec3 {
        self.centre + self.turn * (p * self.size)
    }

    /// A segment from inside to outside, as often as not through an edge or a corner.
    pub fn way_out(&self, dice: &mut Dice) -> (DVec3, DVec3) {
        let specks = self.kind == Kind::Specks;
        let near_wall = |dice: &mut Dice| {
            let gap = if dice.unit() < 0.5 { dice.unit() } else { 10f64.powf(dice.between(-4.0, 0.0)) };
            (1.0 - gap) * if dice.unit() < 0.5 { 1.0 } else { -1.0 }
        };
        let origin = match self.kind {
            Kind::Ball => dice.direction() * dice.between(0.0, 0.5),
            _ => DVec3::new(near_wall(dice), near_wall(dice), near_wall(dice)),
        };
        let origin = self.place(origin);
        let face = &self.faces[dice.below(self.faces.len())];
        let i = if specks { shortest_edge(face) } else { dice.below(face.len()) };
        let (a, b, c) = (face[i], face[(i + 1) % face.len()], face[(i + 2) % face.len()]);
        let target = match dice.below(4) {
            0 => a,
            1 => 0.5 * (a + b),
            2 => a.lerp(b, dice.unit()),
            _ => a.lerp(b, dice.unit()).lerp(c, dice.unit()),
        };
        let mut origin = origin;
        if specks {
            // Near to the face's plane, or to the target.
            let to = if dice.unit() < 0.7 {
                face[(i + 2 + dice.below(face.len() - 2)) % face.len()]
            } else {
                target
            };
            origin = to.lerp(origin, 10f64.powf(dice.between(-6.0, 0.0)));
        }
        (origin, origin + (target - origin) * dice.between(1.5, 5.0))
    }

    /// A segment anywhere around.
    pub fn way_across(&self, dice: &mut Dice) -> (DVec3, DVec3) {
        let mut end = || self.place(dice.direction() * dice.between(0.0, 3.0));
        (end(), end())
    }
}

/// The square −1…1 turned to be a side of the box.
fn on_side(face: &[[f64; 2]], side: usize) -> Vec<DVec3> {
    let height = if side < 3 { 1.0 } else { -1.0 };
    let mut turned: Vec<DVec3> = face.iter().map(|[u, v]| DVec3::new(*u, *v, height)).collect();
    if side >= 3 {
        turned.reverse();
    }
    (0..side % 3).for_each(|_| turned.iter_mut().for_each(|p| *p = DVec3::new(p.z, p.x, p.y)));
    turned
}

/// Where a face's shortest edge starts.
fn shortest_edge(face: &[DVec3]) -> usize {
    let length = |i: &usize| face[*i].distance(face[(i + 1) % face.len()]);
    (0..face.len()).min_by(|i, j| length(i).total_cmp(&length(j))).unwrap_or(0)
}

/// The faces of one wall, on −1…1.
fn wall(kind: Kind, dice: &mut Dice) -> Vec<Vec<[f64; 2]>> {
    let rectangle = |u: [f64; 2], v: [f64; 2]| vec![[u[0], v[0]], [u[1], v[0]], [u[1], v[1]], [u[0], v[1]]];
    let at = |i: usize| -1.0 + 2.0 * i as f64 / 3.0;
    let end = |i: usize| if i == 3 { 1.0 } else { at(i) };
    let mut faces: Vec<Vec<[f64; 2]>> = Vec::new();
    for (i, j) in (0..9).map(|k| (k % 3, k / 3)) {
        let (u, v) = ([end(i), end(i + 1)], [end(j), end(j + 1)]);
        let square = rectangle(u, v);
        match kind {
            Kind::Triangles => {
                faces.push(vec![square[0], square[1], square[2]]);
                faces.push(vec![square[0], square[2], square[3]]);
            }
            Kind::TJunctions => {
                let (cut, across) = (dice.near_an_end(0.0, 1.0), dice.unit() < 0.5);
                let (x, y) = (u[0] + cut * (u[1] - u[0]), v[0] + cut * (v[1] - v[0]));
                let halves =
                    if across { [([u[0], x], v), ([x, u[1]], v)] } else { [(u, [v[0], y]), (u, [y, v[1]])] };
                faces.extend(halves.map(|(u, v)| rectangle(u, v)));
            }
            Kind::Specks if dice.unit() < 0.5 => {
                let centre = [dice.near_an_end(u[0], u[1]), dice.near_an_end(v[0], v[1])];
                faces.extend((0..4).map(|i| vec![square[i], square[(i + 1) % 4], centre]));
            }
            Kind::Polygons | Kind::Specks => {
                // An L, and the rectangle in its notch cut askew: some of them no more than strips, but none a speck.
                let (x, y) = if kind == Kind::Specks {
                    (dice.near_an_end(u[0], u[1]), dice.near_an_end(v[0], v[1]))
                } else if dice.unit() < 0.5 {
                    (dice.near_an_end(u[0], u[1]), dice.between(v[0], v[1]))
                } else {
                    (dice.between(u[0], u[1]), dice.near_an_end(v[0], v[1]))
                };
                faces.push(vec![[u[0], v[0]], [u[1], v[0]], [u[1], y], [x, y], [x, v[1]], [u[0], v[1]]]);
                let skew = if y < v[1] - 0.1 * (v[1] - v[0]) {
                    dice.near_an_end(x, u[1])
                } else {
                    dice.between(x, u[1])
                };
                faces.push(vec![[x, y], [u[1], y], [skew, v[1]], [x, v[1]]]);
                faces.push(vec![[u[1], y], [u[1], v[1]], [skew, v[1]]]);
            }
            _ => faces.push(square.clone()),
        }
        if kind == Kind::Duplicates {
            (0..dice.below(3)).for_each(|_| faces.push(square.clone()));
            if dice.unit() < 0.2 {
                faces.push(rectangle([-1.0, u[1]], [-1.0, v[1]]));
            }
        }
    }
    faces
}

/// A ball of triangles whose corners lie at random heights.
fn ball(dice: &mut Dice) -> Vec<Vec<DVec3>> {
    let octahedron = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y];
    let mut faces: Vec<Vec<DVec3>> = Vec::new();
    for i in 0..4 {
        let (a, b) = (octahedron[i], octahedron[(i + 1) % 4]);
        faces.push(vec![a, b, DVec3::Z]);
        faces.push(vec![b, a, DVec3::NEG_Z]);
    }
    for _ in 0..2 {
        let quarters = |f: &Vec<DVec3>| {
            let [ab, bc, ca] = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (f[i] + f[j]).normalize());
            [vec![f[0], ab, ca], vec![ab, f[1], bc], vec![ca, bc, f[2]], vec![ab, bc, ca]]
        };
        faces = faces.iter().flat_map(quarters).collect();
    }
    let seed = dice.between(1.0, 9.0);
    // The same for the same corner, whichever face asks.
    let height = |p: DVec3| 1.0 + 0.15 * ((seed * (p.x + 2.0 * p.y + 3.0 * p.z) * 7.0).sin());
    let round = |x: f64| (x * 1e9).round() / 1e9;
    let corner = |p: &DVec3| {
        let p = DVec3::new(round(p.x), round(p.y), round(p.z));
        p * height(p)
    };
    faces.iter().map(|f| f.iter().map(corner).collect()).collect()
}
