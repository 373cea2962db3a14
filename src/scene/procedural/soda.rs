//! Offices, after Soda Hall in Berkeley: one room, and a floor of rooms outside and inside of a ring of corridors.

use glam::{DVec3, dvec3};

use super::Detail;
use super::dice::Dice;
use super::furniture::plant;
use super::office::{CARPET, DOOR, HEIGHT, Room, Use, WALL, luminaire};
use super::openings::{Opening, wall};
use super::placement::Placement;
use super::sketch::{Paint, Sketch, matt};

/// Modules of an outer row at the paper's size: 64 rooms with two lamps each, 35 lamps in the corridors.
const MODULES: f64 = 17.0;
/// Width of an outer room with a wall, depth of all rooms, width of the corridor.
const MODULE: f64 = 4.8;
const DEPTH: f64 = 6.0;
const CORRIDOR: f64 = 2.4;

const PLASTER: Paint = matt(0.74, 0.73, 0.68);
const CEILING: Paint = matt(0.8, 0.8, 0.78);

/// Draws one large office with three lamps.
pub(super) fn room(detail: Detail, dice: &mut Dice) -> Sketch {
    let mut sketch = Sketch::default();
    let (width, depth) = (8.4, 6.6);
    let at = Placement::standing(DVec3::ZERO, 0.0);
    let room = Room { name: "room", at, width, depth, has_windows: true, detail };
    room.shell(false, &mut sketch);
    room.lamps(3, &mut sketch);
    room.furnish(Use::Office, dice, &mut sketch);
    room.meeting(0.45 * width, 0.5 * depth, 3, dice, &mut sketch);
    room.whiteboard(&mut sketch);
    sketch.view("door", dvec3(0.9, 0.25, 1.75), dvec3(5.2, 5.0, 0.9), 62.0);
    sketch.view("window", dvec3(7.9, 6.2, 2.2), dvec3(1.5, 1.0, 0.7), 62.0);
    sketch
}

/// A row of rooms along a corridor.
struct Row {
    name: &'static str,
    /// The plane of the corridor's wall before it.
    y: f64,
    /// Where it begins and ends along x, and its rooms.
    from: f64,
    to: f64,
    rooms: usize,
    /// Whether the rooms lie at smaller y than their corridor.
    is_below: bool,
    is_outer: bool,
}

/// Draws a floor, `scale` times as large as the paper's.
pub(super) fn floor(scale: f64, detail: Detail, dice: &mut Dice) -> Sketch {
    let modules = (((MODULES - 1.0) * scale).round() as usize + 1).max(3);
    let width = MODULE * modules as f64;
    let first = DEPTH + WALL;
    let inner = [first + CORRIDOR, first + CORRIDOR + 2.0 * (DEPTH + WALL) + WALL];
    let last = inner[1] + CORRIDOR;
    let mut sketch = Sketch::default();
    let outer =
        |name, y, is_below| Row { name, y, from: 0.0, to: width, rooms: modules, is_below, is_outer: true };
    let core = |name, y, is_below| Row {
        name,
        y,
        from: CORRIDOR,
        to: width - CORRIDOR,
        rooms: modules - 2,
        is_below,
        is_outer: false,
    };
    for row in [
        outer("a", first, true),
        core("b", inner[0], false),
        core("c", inner[1], true),
        outer("d", last, false),
    ] {
        row.draw(detail, dice, &mut sketch);
    }
    corridors(width, [first, inner[0], inner[1], last], 2 * modules + 1, detail, &mut sketch);
    sketch.view("corridor", dvec3(0.6, first + 0.9, 1.7), dvec3(width, first + 1.3, 1.3), 60.0);
    sketch.view("cross_corridor", dvec3(1.2, last - 0.4, 1.7), dvec3(1.3, first, 1.3), 60.0);
    sketch.view("office", dvec3(MODULE - 2.0, DEPTH - 0.3, 1.8), dvec3(1.9, 0.0, 0.8), 65.0);
    sketch
}

impl Row {
    fn draw(&self, detail: Detail, dice: &mut Dice, sketch: &mut Sketch) {
        // Neighbours share a wall, each with half of its thickness.
        let pitch = (self.to - self.from) / self.rooms as f64;
        let mut doors = Vec::new();
        for i in 0..self.rooms {
            let (x0, x1) =
                (self.from + pitch * i as f64 + 0.5 * WALL, self.from + pitch * (i + 1) as f64 - 0.5 * WALL);
            let (at, door) = if self.is_below {
                (Placement::standing(dvec3(x1, self.y - WALL, 0.0), 180.0), [x1 - DOOR[1], x1 - DOOR[0]])
            } else {
                (Placement::standing(dvec3(x0, self.y + WALL, 0.0), 0.0), [x0 + DOOR[0], x0 + DOOR[1]])
            };
            doors.push(door);
            let name = format!("room_{}{i}", self.name);
            let room =
                Room { name: &name, at, width: x1 - x0, depth: DEPTH, has_windows: self.is_outer, detail };
            room.shell(true, sketch);
            room.lamps(2, sketch);
            let used = match dice.below(6) {
                0 => Use::Seminar,
                1 | 2 => Use::Laboratory,
                _ => Use::Office,
            };
            room.furnish(used, dice, sketch);
        }
        self.corridor_wall(&doors, sketch);
    }

    fn corridor_wall(&self, doors: &[[f64; 2]], sketch: &mut Sketch) {
        // In the wall's own coordinates, from left to right as seen from the corridor.
        let length = self.to - self.from;
        let (origin, right) = if self.is_below { (self.to, -DVec3::X) } else { (self.from, DVec3::X) };
        let local = |door: &[f64; 2]| {
            let [a, b] = door.map(|x| (x - origin) * right.x);
            Opening::rectangle(a.min(b), a.max(b), 0.0, DOOR[2])
        };
        let mut openings: Vec<Opening> = doors.iter().map(local).collect();
        if self.is_below {
            openings.reverse();
        }
        let at = Placement::wall(dvec3(origin, self.y, 0.0), right);
        sketch.add(
            &format!("corridor_{}", self.name),
            PLASTER,
            at.faces(vec![wall(0.0, length, HEIGHT, &openings)]),
        );
    }
}

/// Floor, ceiling, the walls without doors, lamps and some furniture of the ring; `y` are the planes of its long walls.
fn corridors(width: f64, y: [f64; 4], lamps: usize, detail: Detail, sketch: &mut Sketch) {
    let c = CORRIDOR;
    let rectangles = [
        ("south", 0.0, width, y[0], y[1]),
        ("west", 0.0, c, y[1], y[2]),
        ("east", width - c, width, y[1], y[2]),
        ("north", 0.0, width, y[2], y[3]),
    ];
    for (name, x0, x1, y0, y1) in rectangles {
        let sides = [dvec3(x0, y0, 0.0), (x1 - x0) * DVec3::X, (y1 - y0) * DVec3::Y];
        sketch.pave(&format!("corridor_{name}_floor"), sides, CARPET);
    }
    let (outer, inner) = ([0.0, width], [c, width - c]);
    // Seen from below the outside runs clockwise and the hole counter to it, joined by a bridge.
    let ring = [
        (outer[0], y[0]),
        (outer[0], y[3]),
        (outer[1], y[3]),
        (outer[1], y[0]),
        (outer[0], y[0]),
        (inner[0], y[1]),
        (inner[1], y[1]),
        (inner[1], y[2]),
        (inner[0], y[2]),
        (inner[0], y[1]),
    ];
    sketch.add("corridor_ceiling", CEILING, vec![ring.map(|(x, y)| dvec3(x, y, HEIGHT)).to_vec()]);
    let ends = [
        ("west_outer", dvec3(0.0, y[0], 0.0), DVec3::Y, y[3] - y[0]),
        ("east_outer", dvec3(width, y[3], 0.0), -DVec3::Y, y[3] - y[0]),
        ("west_inner", dvec3(c, y[2], 0.0), -DVec3::Y, y[2] - y[1]),
        ("east_inner", dvec3(width - c, y[1], 0.0), DVec3::Y, y[2] - y[1]),
    ];
    for (name, origin, right, length) in ends {
        let face = wall(0.0, length, HEIGHT, &[]);
        sketch.add(&format!("corridor_{name}"), PLASTER, Placement::wall(origin, right).faces(vec![face]));
    }
    let path = [width - c, y[3] - y[0] - c];
    for i in 0..lamps {
        let (x, y, degrees) = along(path, 2.0 * (path[0] + path[1]) * (i as f64 + 0.5) / lamps as f64);
        let at = dvec3(0.5 * c + x, DEPTH + WALL + 0.5 * c + y, 0.0);
        sketch.place(
            &format!("corridor_lamp{i}"),
            &Placement::standing(at + HEIGHT * DVec3::Z, degrees),
            luminaire(0.2),
        );
    }
    for (i, (x, y)) in
        [(0.5, y[0] + 0.5), (width - 0.5, y[0] + 0.5), (0.5, y[3] - 0.5), (width - 0.5, y[3] - 0.5)]
            .into_iter()
            .enumerate()
    {
        sketch.place(
            &format!("corridor_plant{i}"),
            &Placement::standing(dvec3(x, y, 0.0), 0.0),
            plant(detail),
        );
    }
}

/// A point at some length along the edge of a rectangle with a corner at the origin, and the direction of the edge.
fn along([a, b]: [f64; 2], length: f64) -> (f64, f64, f64) {
    if length < a {
        (length, 0.0, 0.0)
    } else if length < a + b {
        (a, length - a, 90.0)
    } else if length < 2.0 * a + b {
        (2.0 * a + b - length, b, 0.0)
    } else {
        (0.0, 2.0 * (a + b) - length, 90.0)
    }
}
