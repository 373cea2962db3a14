//! A furnished office: floor and ceiling of tiles, a door to the corridor, windows with blinds, lamps, furniture.
//!
//! Coordinates: x along the corridor from 0 to the width, y from the corridor's wall (0) to the windows, z up.

use glam::{DVec3, dvec3};

use super::Detail;
use super::dice::Dice;
use super::furniture::{METAL, WOOD, bin, bookcase, cabinet, chair, plant, table};
use super::openings::{Opening, wall};
use super::placement::Placement;
use super::sketch::{Paint, Part, Polygon, Sketch, lamp, matt, part};
use super::solids::{Side, block, cuboid, prism, ring};
use super::workplace::workplace;

/// Of all rooms.
pub(super) const HEIGHT: f64 = 2.9;
/// Of walls between rooms and the corridor.
pub(super) const WALL: f64 = 0.15;
/// The door: left, right, top.
pub(super) const DOOR: [f64; 3] = [0.55, 1.45, 2.1];

const PLASTER: Paint = matt(0.72, 0.7, 0.65);
const FRAME: Paint = matt(0.55, 0.53, 0.5);
const NIGHT: Paint = matt(0.06, 0.06, 0.08);
const SLAT: Paint = matt(0.7, 0.7, 0.68);
const BOARD: Paint = matt(0.82, 0.82, 0.82);
const LIGHT: Paint = lamp(160.0, 155.0, 140.0);
pub(super) const CARPET: [Paint; 3] = [matt(0.22, 0.23, 0.27), matt(0.2, 0.21, 0.25), matt(0.24, 0.25, 0.29)];
pub(super) const TILE: [Paint; 3] = [matt(0.8, 0.8, 0.78), matt(0.78, 0.78, 0.76), matt(0.82, 0.82, 0.8)];

/// How a room is used.
#[derive(Clone, Copy, Debug)]
pub(super) enum Use {
    Office,
    Laboratory,
    Seminar,
}

/// A room with its corner in a place.
pub(super) struct Room<'a> {
    pub name: &'a str,
    pub at: Placement,
    pub width: f64,
    pub depth: f64,
    pub has_windows: bool,
    pub detail: Detail,
}

impl Room<'_> {
    /// Draws the shell with its door closed by a leaf or open.
    pub fn shell(&self, is_open: bool, sketch: &mut Sketch) {
        let (w, d, h) = (self.width, self.depth, HEIGHT);
        self.pave("carpet", [DVec3::ZERO, w * DVec3::X, d * DVec3::Y], CARPET, sketch);
        self.pave("ceiling", [h * DVec3::Z, d * DVec3::Y, w * DVec3::X], TILE, sketch);
        let door = Opening::rectangle(w - DOOR[1], w - DOOR[0], 0.0, DOOR[2]);
        let mut faces = vec![wall(0.0, w, h, std::slice::from_ref(&door))];
        faces.extend(door.reveals(WALL));
        let [x0, x1, top] = DOOR;
        let mut leaf = if is_open {
            cuboid(dvec3(x0 - 0.06, 0.02, 0.01), dvec3(x0 - 0.02, x1 - x0, top - 0.02), &[])
        } else {
            vec![[(x1, 0.0), (x0, 0.0), (x0, top), (x1, top)].map(|(x, z)| dvec3(x, -WALL, z)).to_vec()]
        };
        if !is_open {
            leaf.extend(cuboid(
                dvec3(x1 - 0.15, -WALL, 1.0),
                dvec3(x1 - 0.05, -WALL + 0.05, 1.03),
                &[Side::Front],
            ));
        }
        let frame = door.frame(&[(0.0, 0.0), (0.0, 0.03), (0.08, 0.03), (0.08, 0.0)]);
        let corridor_side = Placement::wall(dvec3(w, 0.0, 0.0), -DVec3::X);
        self.put(
            "entry",
            &corridor_side,
            vec![part("wall", PLASTER, faces), part("frame", FRAME, frame)],
            sketch,
        );
        self.put("door", &Placement::standing(DVec3::ZERO, 0.0), vec![part("leaf", WOOD, leaf)], sketch);
        for (name, origin, right, length) in
            [("left", DVec3::ZERO, DVec3::Y, d), ("right", dvec3(w, d, 0.0), -DVec3::Y, d)]
        {
            self.put(
                name,
                &Placement::wall(origin, right),
                vec![part("wall", PLASTER, vec![wall(0.0, length, h, &[])])],
                sketch,
            );
        }
        self.window_wall(sketch);
    }

    fn put(&self, name: &str, at: &Placement, parts: Vec<Part>, sketch: &mut Sketch) {
        sketch.place(&format!("{}_{name}", self.name), &self.at.then(at), parts);
    }

    fn stand(&self, name: &str, x: f64, y: f64, degrees: f64, parts: Vec<Part>, sketch: &mut Sketch) {
        self.put(name, &Placement::standing(dvec3(x, y, 0.0), degrees), parts, sketch);
    }

    fn pave(&self, name: &str, [corner, u, v]: [DVec3; 3], tones: [Paint; 3], sketch: &mut Sketch) {
        let turned = |v: DVec3| self.at.point(v) - self.at.point(DVec3::ZERO);
        sketch.pave(&format!("{}_{name}", self.name), [self.at.point(corner), turned(u), turned(v)], tones);
    }

    /// The wall opposite to the door: windows with blinds, or none.
    fn window_wall(&self, sketch: &mut Sketch) {
        let at = Placement::wall(dvec3(0.0, self.depth, 0.0), DVec3::X);
        let count = if self.has_windows { (self.width / 2.2) as usize } else { 0 };
        let pitch = self.width / count.max(1) as f64;
        let window = |i: usize| {
            let x = pitch * (i as f64 + 0.5);
            Opening::rectangle(x - 0.8, x + 0.8, 0.95, 2.4)
        };
        let openings: Vec<Opening> = (0..count).map(window).collect();
        self.put(
            "end",
            &at,
            vec![part("wall", PLASTER, vec![wall(0.0, self.width, HEIGHT, &openings)])],
            sketch,
        );
        for (i, opening) in openings.iter().enumerate() {
            let (low, high) = opening.bounds();
            let slats = self.detail.count(2, 1.0, 48);
            let step = (high.y - low.y - 0.04) / slats as f64;
            let slat = |j: usize| {
                let y = low.y + 0.03 + step * j as f64;
                cuboid(dvec3(low.x + 0.02, y, -0.12), dvec3(high.x - 0.02, y + 0.004, -0.07), &[])
            };
            let board =
                block(dvec3(low.x - 0.1, low.y - 0.06, 0.0), dvec3(high.x + 0.1, low.y - 0.02, 0.15), &[]);
            let parts = vec![
                part("reveal", PLASTER, opening.reveals(0.25)),
                part("pane", NIGHT, vec![opening.pane(0.25)]),
                part("sill", FRAME, board),
                part("blind", SLAT, (0..slats).flat_map(slat).collect()),
            ];
            self.put(&format!("window{i}"), &at, parts, sketch);
        }
    }

    /// Lamps in a row across the middle of the room, each one light.
    pub fn lamps(&self, count: usize, sketch: &mut Sketch) {
        for i in 0..count {
            let x = self.width * (i as f64 + 0.5) / count as f64;
            let at = self.at.then(&Placement::standing(dvec3(x, 0.5 * self.depth, HEIGHT), 0.0));
            sketch.place(&format!("{}_lamp{i}", self.name), &at, luminaire(0.4));
        }
    }

    /// Puts furniture in.
    pub fn furnish(&self, used: Use, dice: &mut Dice, sketch: &mut Sketch) {
        let (w, d) = (self.width, self.depth);
        self.stand("bin", w - 0.3, 0.35, 0.0, bin(self.detail), sketch);
        self.stand("plant", 0.45, d - 0.5, 0.0, plant(self.detail), sketch);
        match used {
            Use::Office => {
                self.desks(w - 0.45, 270.0, 3, dice, sketch);
                self.bookcases(2, dice, sketch);
            }
            Use::Laboratory => {
                self.desks(w - 0.45, 270.0, 3, dice, sketch);
                self.desks(0.45, 90.0, 2, dice, sketch);
            }
            Use::Seminar => {
                self.meeting(0.5 * w + 0.3, 0.5 * d + 0.2, 4, dice, sketch);
                self.bookcases(1, dice, sketch);
                self.whiteboard(sketch);
            }
        }
    }

    /// Desks along a side wall, from the windows on; who sits there looks at the wall.
    pub fn desks(&self, x: f64, degrees: f64, count: usize, dice: &mut Dice, sketch: &mut Sketch) {
        for i in 0..count {
            let y = self.depth - 1.75 - 1.7 * i as f64 + if degrees > 180.0 { 0.6 } else { 0.0 };
            let side = if degrees > 180.0 { "right" } else { "left" };
            self.stand(&format!("{side}_desk{i}"), x, y, degrees, workplace(self.detail, dice), sketch);
        }
    }

    /// Bookcases and a cabinet along the left wall.
    pub fn bookcases(&self, count: usize, dice: &mut Dice, sketch: &mut Sketch) {
        for i in 0..count {
            let y = self.depth - 1.5 - 1.1 * i as f64;
            self.stand(&format!("bookcase{i}"), 0.35, y, 90.0, bookcase(self.detail, dice), sketch);
        }
        let y = self.depth - 1.5 - 1.1 * count as f64 + 0.2;
        self.stand("cabinet", 0.5, y, 90.0, cabinet(self.detail), sketch);
    }

    /// A table with chairs on both sides.
    pub fn meeting(&self, x: f64, y: f64, chairs: usize, dice: &mut Dice, sketch: &mut Sketch) {
        let length = 0.7 * chairs as f64;
        self.stand("table", x, y, 90.0, table(length, 1.1), sketch);
        for i in 0..chairs {
            let along = y + length * ((i as f64 + 0.5) / chairs as f64 - 0.5);
            for (side, across, degrees) in [("left", -0.85, 270.0), ("right", 0.85, 90.0)] {
                let turn = degrees + dice.between(-20.0, 20.0);
                self.stand(
                    &format!("{side}_chair{i}"),
                    x + across,
                    along,
                    turn,
                    chair(self.detail, dice),
                    sketch,
                );
            }
        }
    }

    /// A white board with a tray on the right wall.
    pub fn whiteboard(&self, sketch: &mut Sketch) {
        let at = Placement::wall(dvec3(self.width, self.depth, 0.0), -DVec3::Y);
        let (x0, x1) = (0.5 * self.depth - 1.0, 0.5 * self.depth + 1.0);
        let mut rim = Opening::rectangle(x0, x1, 0.95, 2.1).frame(&[
            (0.0, 0.0),
            (0.0, 0.03),
            (0.04, 0.03),
            (0.04, 0.0),
        ]);
        rim.extend(block(dvec3(x0 - 0.04, 0.88, 0.0), dvec3(x1 + 0.04, 0.94, 0.09), &[]));
        let face = block(dvec3(x0 + 0.01, 0.96, 0.0), dvec3(x1 - 0.01, 2.09, 0.015), &[]);
        self.put("whiteboard", &at, vec![part("face", BOARD, face), part("rim", METAL, rim)], sketch);
    }
}

/// A lamp on two rods below the origin that shines down.
pub(super) fn luminaire(drop: f64) -> Vec<Part> {
    let (low, high) = (dvec3(-0.6, -0.14, -drop), dvec3(0.6, 0.14, -drop + 0.08));
    let others = [Side::Left, Side::Right, Side::Front, Side::Back, Side::Top];
    let mut housing: Vec<Polygon> = cuboid(low, high, &[Side::Bottom]);
    for x in [-0.5, 0.5] {
        let mut rod = prism(&ring(0.008, 4), high.z, 0.0, false, false);
        rod.iter_mut().flatten().for_each(|p| p.x += x);
        housing.extend(rod);
    }
    vec![part("housing", METAL, housing), part("light", LIGHT, cuboid(low, high, &others))]
}
