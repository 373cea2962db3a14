//! One side of a cloister: two storeys of arcades on columns, the gallery behind them with doors, windows and pictures, the roof.
//!
//! Coordinates: the origin in the middle of the court, x along the side, y towards the gallery, z up.

use glam::{DVec2, DVec3, dvec3};

use super::Detail;
use super::dice::Dice;
use super::fittings::{balustrade, bars, column, moved, raised};
use super::openings::{Opening, behind, wall};
use super::placement::Placement;
use super::sketch::{Paint, Part, Polygon, Sketch, lamp, matt, part};
use super::solids::{STANDING, Side, block, cuboid, disc, lathe, mitred, prism, ring, swell};

/// Width of a bay.
pub(super) const BAY: f64 = 3.6;
/// From the arcade's front to the back wall.
pub(super) const DEPTH: f64 = 4.5;
/// Of the arcade.
pub(super) const THICKNESS: f64 = 0.5;
/// Where the roof begins and ends.
const EAVES: f64 = 9.6;
const RIDGE: f64 = 12.0;
const OVERHANG: f64 = 0.5;

const WHITE: Paint = matt(0.84, 0.82, 0.77);
const STONE: Paint = matt(0.68, 0.64, 0.57);
const TIMBER: Paint = matt(0.42, 0.29, 0.18);
const DARK: Paint = matt(0.14, 0.13, 0.12);
const CLAY: Paint = matt(0.55, 0.28, 0.18);
const TILES: [Paint; 3] = [matt(0.5, 0.3, 0.22), matt(0.46, 0.27, 0.2), matt(0.55, 0.34, 0.25)];
const CANVAS: [Paint; 4] =
    [matt(0.3, 0.22, 0.12), matt(0.25, 0.2, 0.25), matt(0.4, 0.2, 0.15), matt(0.15, 0.25, 0.3)];
const BOWL: Paint = matt(0.3, 0.25, 0.12);
const LIGHT: Paint = lamp(260.0, 220.0, 165.0);

/// Heights of a storey.
struct Storey {
    name: &'static str,
    floor: f64,
    spring: f64,
    ceiling: f64,
    top: f64,
}

const STOREYS: [Storey; 2] = [
    Storey { name: "lower", floor: 0.0, spring: 2.6, ceiling: 4.5, top: 4.8 },
    Storey { name: "upper", floor: 4.8, spring: 7.5, ceiling: 9.3, top: EAVES },
];

/// A side of a cloister.
pub(super) struct Gallery<'a> {
    pub name: &'a str,
    pub at: Placement,
    pub bays: usize,
    pub detail: Detail,
}

impl Gallery<'_> {
    /// Draws it, with the corner at its right.
    pub fn draw(&self, dice: &mut Dice, sketch: &mut Sketch) {
        for storey in &STOREYS {
            self.floor(storey, sketch);
            self.arcade(storey, sketch);
            self.corner(storey, sketch);
            self.ceiling(storey, sketch);
            self.back_wall(storey, dice, sketch);
            for i in 0..=self.bays {
                let x = if i == self.bays { self.half() + 0.5 * (DEPTH + THICKNESS) } else { self.bay(i) };
                self.lamp(storey, i, x, sketch);
            }
        }
        self.roof(sketch);
    }

    /// Half the width of the court.
    fn half(&self) -> f64 {
        0.5 * BAY * self.bays as f64
    }

    /// The middle of a bay.
    fn bay(&self, i: usize) -> f64 {
        BAY * (i as f64 + 0.5) - self.half()
    }

    fn put(&self, name: &str, at: DVec3, parts: Vec<Part>, sketch: &mut Sketch) {
        sketch.place(&format!("{}_{name}", self.name), &self.at.then(&Placement::standing(at, 0.0)), parts);
    }

    /// Puts parts on a wall that faces the court, their origin at (0, y, z).
    fn hang(&self, name: &str, y: f64, z: f64, parts: Vec<Part>, sketch: &mut Sketch) {
        let wall = Placement::wall(dvec3(0.0, y, z), DVec3::X);
        sketch.place(&format!("{}_{name}", self.name), &self.at.then(&wall), parts);
    }

    fn floor(&self, storey: &Storey, sketch: &mut Sketch) {
        let h = self.half();
        let turned = |v: DVec3| self.at.point(v) - self.at.point(DVec3::ZERO);
        let corner = self.at.point(dvec3(-h, h, storey.floor));
        let sides = [corner, turned((2.0 * h + DEPTH) * DVec3::X), turned(DEPTH * DVec3::Y)];
        sketch.pave(&format!("{}_{}_tiles", self.name, storey.name), sides, TILES);
    }

    fn arcade(&self, storey: &Storey, sketch: &mut Sketch) {
        let (d, h) = (self.detail, self.half());
        let radius = 0.5 * BAY - 0.25;
        let arch = |i: usize| {
            let x = self.bay(i);
            Opening::arched(x - radius, x + radius, 0.0, 0.0, d.count(4, 0.8, 40))
        };
        let arches: Vec<Opening> = (0..self.bays).map(arch).collect();
        let front = wall(-h, h, storey.top - storey.spring, &arches);
        let wide = h + THICKNESS;
        let inner = behind(&wall(-wide, wide, storey.ceiling - storey.spring, &arches), THICKNESS);
        let walls = vec![part("front", WHITE, vec![front]), part("inner", WHITE, vec![inner])];
        self.hang(storey.name, h, storey.spring, walls, sketch);
        let profile = [(0.0, 0.0), (0.0, 0.05), (0.1, 0.05), (0.1, 0.03), (0.2, 0.03), (0.2, 0.0)];
        for (i, arch) in arches.iter().enumerate() {
            let parts = vec![
                part("intrados", WHITE, arch.intrados(THICKNESS)),
                part("archivolt", STONE, arch.frame(&profile)),
            ];
            self.hang(&format!("{}_arch{i}", storey.name), h, storey.spring, parts, sketch);
        }
        if storey.floor == 0.0 {
            // The upper columns stand on it.
            let course =
                [(0.0, storey.ceiling), (0.1, storey.ceiling + 0.1), (0.1, storey.top), (0.0, storey.top)];
            self.hang("course", h, 0.0, vec![part("stone", STONE, mitred(&course, h))], sketch);
        }
        let pedestal = if storey.floor > 0.0 { 1.0 } else { 0.0 };
        for i in 1..self.bays {
            let fineness = [d.count(6, 0.7, 40), d.count(1, 0.4, 16)];
            let shaft = column(storey.spring - storey.floor - pedestal, 0.22, fineness, &[]);
            let mut faces = raised(shaft, pedestal);
            if pedestal > 0.0 {
                faces.extend(cuboid(dvec3(-0.31, -0.31, 0.0), dvec3(0.31, 0.31, pedestal), STANDING));
            }
            let at = dvec3(BAY * i as f64 - h, h + 0.5 * THICKNESS, storey.floor);
            self.put(&format!("{}_column{i}", storey.name), at, vec![part("stone", STONE, faces)], sketch);
        }
        if pedestal > 0.0 {
            self.parapet(storey, sketch);
        }
    }

    /// Balustrades between the pedestals of columns.
    fn parapet(&self, storey: &Storey, sketch: &mut Sketch) {
        let (d, h) = (self.detail, self.half());
        for i in 0..self.bays {
            // Corner piers are narrower than pedestals.
            let x0 = BAY * i as f64 - h + if i == 0 { 0.25 } else { 0.31 };
            let x1 = BAY * (i + 1) as f64 - h - if i + 1 == self.bays { 0.25 } else { 0.31 };
            let faces = balustrade(x0, x1, 0.95, d.count(2, 0.4, 16), d.count(4, 0.3, 16));
            let at = dvec3(0.0, h + 0.5 * THICKNESS, storey.floor);
            self.put(&format!("parapet{i}"), at, vec![part("stone", STONE, faces)], sketch);
        }
    }

    /// The pier at the corner: an angle below a slab.
    fn corner(&self, storey: &Storey, sketch: &mut Sketch) {
        let angle = |e: f64| {
            let (a, b) = (-0.25 - e, THICKNESS + e);
            [(a, -e), (-e, -e), (-e, a), (b, a), (b, b), (a, b)].map(DVec2::from)
        };
        let height = storey.spring - storey.floor;
        let mut faces = prism(&angle(0.0), 0.0, height - 0.12, false, false);
        faces.extend(prism(&angle(0.06), height - 0.12, height, true, true));
        let at = dvec3(self.half(), self.half(), storey.floor);
        self.put(&format!("{}_corner", storey.name), at, vec![part("pier", STONE, faces)], sketch);
    }

    fn ceiling(&self, storey: &Storey, sketch: &mut Sketch) {
        let (d, h, z) = (self.detail, self.half(), storey.ceiling);
        let (near, far) = (h + THICKNESS, h + DEPTH);
        let corners = [(-near, near), (-near, far), (far, far), (far, near)];
        let mut faces = vec![corners.map(|(x, y)| dvec3(x, y, z)).to_vec()];
        self.put(storey.name, DVec3::ZERO, vec![part("ceiling", WHITE, faces)], sketch);
        let beams = d.count(1, 0.25, 12);
        let hidden = [Side::Front, Side::Back, Side::Top];
        for i in 0..self.bays {
            faces = Vec::new();
            for j in 0..beams {
                let x = BAY * (i as f64 + (j as f64 + 0.5) / beams as f64) - h;
                faces.extend(cuboid(dvec3(x - 0.06, near, z - 0.2), dvec3(x + 0.06, far, z), &hidden));
            }
            self.put(
                &format!("{}_beams{i}", storey.name),
                DVec3::ZERO,
                vec![part("wood", TIMBER, faces)],
                sketch,
            );
        }
    }

    fn back_wall(&self, storey: &Storey, dice: &mut Dice, sketch: &mut Sketch) {
        let (d, h, y) = (self.detail, self.half(), self.half() + DEPTH);
        let segments = d.count(3, 0.6, 32);
        let opening = |i: usize| {
            let x = self.bay(i);
            match i % 2 {
                0 => Opening::arched(x - 0.6, x + 0.6, 0.0, 2.0, segments),
                _ => Opening::rectangle(x - 0.5, x + 0.5, 1.1, 2.4),
            }
        };
        let openings: Vec<Opening> = (0..self.bays).map(opening).collect();
        let face = wall(-h - DEPTH, h + DEPTH, storey.ceiling - storey.floor, &openings);
        self.hang(storey.name, y, storey.floor, vec![part("back", WHITE, vec![face])], sketch);
        for (i, opening) in openings.iter().enumerate() {
            let (low, high) = opening.bounds();
            let spring = if i % 2 == 0 { 2.0 } else { high.y };
            let rows = d.count(2, 0.3, 10);
            let parts = vec![
                part("reveal", WHITE, opening.reveals(0.3)),
                part("leaf", if i % 2 == 0 { TIMBER } else { DARK }, vec![opening.pane(0.3)]),
                part("frame", STONE, opening.frame(&[(0.0, 0.0), (0.0, 0.06), (0.15, 0.06), (0.15, 0.0)])),
                part("bars", TIMBER, bars([low.x, high.x, low.y, spring], -0.3, 2, rows)),
            ];
            self.hang(&format!("{}_door{i}", storey.name), y, storey.floor, parts, sketch);
            if i > 0 {
                let x = BAY * i as f64 - h;
                let picture = Opening::rectangle(x - 0.5, x + 0.5, 1.4, 2.6);
                let canvas = block(dvec3(x - 0.5, 1.4, 0.0), dvec3(x + 0.5, 2.6, 0.03), &[]);
                let border = block(dvec3(x - 0.6, 1.3, 0.0), dvec3(x + 0.6, 1.38, 0.06), &[]);
                let mut frame = picture.frame(&[(0.02, 0.0), (0.02, 0.06), (0.1, 0.06), (0.1, 0.0)]);
                frame.extend(border);
                let parts = vec![part("canvas", dice.pick(&CANVAS), canvas), part("frame", BOWL, frame)];
                self.hang(&format!("{}_picture{i}", storey.name), y, storey.floor, parts, sketch);
            }
        }
    }

    /// A bowl that hangs on three rods and shines up.
    fn lamp(&self, storey: &Storey, number: usize, x: f64, sketch: &mut Sketch) {
        let (sides, drop) = (3 * self.detail.count(2, 0.2, 10), 1.2);
        let shape = [(0.06, -0.22), (0.2, -0.16), (0.3, -0.03), (0.33, 0.0), (0.26, 0.0)];
        let mut bowl = lathe(&shape, sides, true, false);
        for corner in ring(0.295, sides).iter().step_by(sides / 3) {
            let rod = prism(&ring(0.01, 4), 0.0, drop, false, false);
            bowl.extend(moved(rod, corner.extend(0.0)));
        }
        let at = dvec3(x, self.half() + 0.5 * (DEPTH + THICKNESS), storey.ceiling - drop);
        let parts = vec![part("bowl", BOWL, bowl), part("light", LIGHT, vec![disc(0.26, 0.0, sides)])];
        self.put(&format!("{}_lamp{number}", storey.name), at, parts, sketch);
    }

    /// Cornice, roof with rows of tiles, and the wall to the street.
    fn roof(&self, sketch: &mut Sketch) {
        let (d, h) = (self.detail, self.half());
        let (near, far) = (h - OVERHANG, h + DEPTH + OVERHANG);
        let mut profile = swell((0.05, EAVES - 0.4), (OVERHANG, EAVES - 0.1), d.count(1, 0.4, 16));
        profile.insert(0, (0.0, EAVES - 0.4));
        profile.push((OVERHANG, EAVES));
        self.hang("roof", h, 0.0, vec![part("cornice", STONE, mitred(&profile, h))], sketch);
        let slope = [(-near, near, EAVES), (near, near, EAVES), (far, far, RIDGE), (-far, far, RIDGE)];
        let street = [(far, far, 0.0), (-far, far, 0.0), (-far, far, RIDGE), (far, far, RIDGE)];
        let parts = vec![
            part("slope", CLAY, vec![slope.map(DVec3::from).to_vec()]),
            part("street", WHITE, vec![street.map(DVec3::from).to_vec()]),
        ];
        self.put("roof", DVec3::ZERO, parts, sketch);
        let (run, rise) = (far - near, RIDGE - EAVES);
        let length = run.hypot(rise);
        let up = |x: f64, s: f64, out: f64| {
            dvec3(x, near + (s * run - out * rise) / length, EAVES + (s * rise + out * run) / length)
        };
        let rows = self.bays * d.count(1, 0.5, 12);
        let courses = d.count(1, 0.6, 24);
        for row in 0..rows {
            let x = 2.0 * far * ((row as f64 + 0.5) / rows as f64 - 0.5);
            // Rows at the ends begin where the side is wide enough.
            let start = (length * (x.abs() + 0.2 - near) / run).max(0.05);
            let whole = ((length - start) / length * courses as f64).ceil() as usize;
            let step = (length - 0.05 - start) / whole as f64;
            if step > 0.15 || whole == 1 && step > 0.05 {
                let tile = |i: usize| {
                    tile(
                        start + step * i as f64,
                        start + step * (i + 1) as f64,
                        i + 1 == whole,
                        &|u, s, out| up(x + u, s, out),
                    )
                };
                self.put(
                    &format!("tiles{row}"),
                    DVec3::ZERO,
                    vec![part("clay", CLAY, (0..whole).flat_map(tile).collect())],
                    sketch,
                );
            }
        }
    }
}

/// A hollow tile that covers the narrow end of the one below it.
fn tile(low: f64, high: f64, is_last: bool, at: &dyn Fn(f64, f64, f64) -> DVec3) -> Vec<Polygon> {
    let arch = |r: f64, s: f64| {
        [(r, 0.0), (0.5 * r, 0.8 * r), (-0.5 * r, 0.8 * r), (-r, 0.0)].map(|(u, out)| at(u, s, out))
    };
    let (wide, narrow) = (arch(0.13, low), arch(0.1, high));
    let mut faces: Vec<Polygon> =
        (0..3).map(|i| vec![wide[i], wide[i + 1], narrow[i + 1], narrow[i]]).collect();
    faces.iter_mut().for_each(|face| face.reverse());
    faces.push(wide.to_vec());
    if is_last {
        faces.push(narrow.iter().rev().copied().collect());
    }
    faces
}
