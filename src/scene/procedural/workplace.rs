//! A desk with what lies on it, and its chair. The desk stands on the origin; who sits there looks towards +y.

use glam::{DVec3, dvec3};

use super::Detail;
use super::dice::Dice;
use super::fittings::moved;
use super::furniture::{DARK, METAL, WOOD, chair, fronts};
use super::placement::Placement;
use super::sketch::{Paint, Part, Polygon, matt, part};
use super::solids::{BETWEEN, STANDING, Side, cuboid, lathe};

const PLASTIC: Paint = matt(0.55, 0.54, 0.5);
const KEY: Paint = matt(0.66, 0.65, 0.62);
const PAPER: Paint = matt(0.8, 0.79, 0.76);
const MUG: [Paint; 3] = [matt(0.6, 0.1, 0.08), matt(0.75, 0.75, 0.72), matt(0.1, 0.25, 0.5)];

/// Height of the desk.
const TOP: f64 = 0.74;

/// Draws it.
pub(super) fn workplace(detail: Detail, dice: &mut Dice) -> Vec<Part> {
    let mut parts = desk(detail);
    parts.extend(computer(detail));
    parts.push(part("papers", PAPER, papers(detail, dice)));
    let cup = [(0.035, 0.0), (0.04, 0.09), (0.035, 0.09), (0.03, 0.01)];
    let at = dvec3(dice.between(-0.6, -0.5), dice.between(-0.2, 0.0), TOP);
    parts.push(part("mug", dice.pick(&MUG), moved(lathe(&cup, detail.count(5, 0.4, 24), false, true), at)));
    let seat = Placement::standing(dvec3(dice.between(-0.15, 0.15), -0.75, 0.0), dice.between(-50.0, 50.0));
    parts.extend(chair(detail, dice).into_iter().map(|p| Part {
        name: format!("chair_{}", p.name),
        faces: seat.faces(p.faces),
        ..p
    }));
    parts
}

fn desk(detail: Detail) -> Vec<Part> {
    let under = TOP - 0.04;
    let top = cuboid(dvec3(-0.8, -0.4, under), dvec3(0.8, 0.4, TOP), &[]);
    let mut panels = Vec::new();
    for x in [-0.78, 0.75] {
        panels.extend(cuboid(dvec3(x, -0.38, 0.0), dvec3(x + 0.03, 0.38, under), BETWEEN));
    }
    let screen = [Side::Left, Side::Right, Side::Top];
    panels.extend(cuboid(dvec3(-0.75, 0.34, 0.25), dvec3(0.75, 0.36, under), &screen));
    let mut drawers = cuboid(dvec3(0.33, -0.36, 0.06), dvec3(0.73, 0.3, under), &[Side::Top]);
    drawers.extend(fronts([0.335, 0.725, 0.07, under - 0.01], -0.36, detail.count(1, 0.15, 4)));
    vec![part("top", WOOD, top), part("panels", WOOD, panels), part("drawers", METAL, drawers)]
}

/// Screen, keyboard, and the machine below the desk.
fn computer(detail: Detail) -> Vec<Part> {
    let mut screen = cuboid(dvec3(-0.14, 0.08, TOP), dvec3(0.14, 0.26, TOP + 0.02), STANDING);
    screen.extend(cuboid(dvec3(-0.03, 0.17, TOP + 0.02), dvec3(0.03, 0.2, TOP + 0.12), BETWEEN));
    screen.extend(cuboid(dvec3(-0.28, 0.14, TOP + 0.12), dvec3(0.28, 0.2, TOP + 0.48), &[]));
    let glass = cuboid(dvec3(-0.26, 0.138, TOP + 0.14), dvec3(0.26, 0.14, TOP + 0.46), &[Side::Back]);
    let mut tower = cuboid(dvec3(-0.7, -0.2, 0.0), dvec3(-0.5, 0.28, 0.45), STANDING);
    let bays = detail.count(1, 0.15, 5);
    for i in 0..bays {
        let z = 0.43 - 0.06 * (i + 1) as f64;
        tower.extend(cuboid(dvec3(-0.68, -0.208, z), dvec3(-0.52, -0.2, z + 0.05), &[Side::Back]));
    }
    let base = cuboid(dvec3(-0.24, -0.26, TOP), dvec3(0.24, -0.1, TOP + 0.015), STANDING);
    let mouse = cuboid(dvec3(0.3, -0.24, TOP), dvec3(0.36, -0.14, TOP + 0.03), STANDING);
    vec![
        part("screen", PLASTIC, screen),
        part("glass", DARK, glass),
        part("tower", PLASTIC, tower),
        part("keyboard", PLASTIC, base),
        part("keys", KEY, keys(detail)),
        part("mouse", PLASTIC, mouse),
    ]
}

fn keys(detail: Detail) -> Vec<Polygon> {
    let (rows, columns) = (detail.count(1, 0.25, 6), detail.count(2, 0.9, 21));
    let (width, depth) = (0.46 / columns as f64, 0.14 / rows as f64);
    let mut faces = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let low = dvec3(-0.23 + width * column as f64, -0.25 + depth * row as f64, TOP + 0.015);
            let size = dvec3(0.86 * width, 0.86 * depth, 0.008);
            faces.extend(cuboid(low, low + size, STANDING));
        }
    }
    faces
}

/// A pile of thin stacks, each turned a little and smaller than the one below it.
fn papers(detail: Detail, dice: &mut Dice) -> Vec<Polygon> {
    let (mut faces, mut z, mut scale) = (Vec::new(), TOP, 1.0);
    for _ in 0..detail.count(1, 0.2, 6) {
        let height = dice.between(0.004, 0.03);
        let at = Placement::standing(dvec3(0.58, 0.02, z), dice.between(-6.0, 6.0));
        let half = scale * dvec3(0.105, 0.15, 0.0);
        faces.extend(at.faces(cuboid(-half, half + height * DVec3::Z, STANDING)));
        z += height;
        scale *= 0.8;
    }
    faces
}
