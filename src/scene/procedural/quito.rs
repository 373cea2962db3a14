//! A cloister, after San Francisco in Quito: two storeys of arcades around a court with a fountain; bowls in the galleries shine at
//! white ceilings, so that most light arrives indirectly.

use glam::{DVec2, DVec3, dvec3};

use super::Detail;
use super::dice::Dice;
use super::gallery::{BAY, DEPTH, Gallery};
use super::placement::Placement;
use super::sketch::{Paint, Part, Sketch, lamp, matt, part};
use super::solids::{Side, cuboid, lathe, prism};
use super::square::bench;

/// Bays of a side at the paper's size: with the corners 80 bowls, and three lamps at the fountain.
const BAYS: f64 = 9.0;

const STONE: Paint = matt(0.6, 0.57, 0.52);
const WATER: Paint = matt(0.1, 0.14, 0.15);
const HEDGE: Paint = matt(0.08, 0.2, 0.05);
const IRON: Paint = matt(0.1, 0.1, 0.1);
const LIGHT: Paint = lamp(700.0, 600.0, 450.0);
const PAVING: [Paint; 3] = [matt(0.55, 0.52, 0.47), matt(0.5, 0.47, 0.43), matt(0.6, 0.57, 0.51)];

/// Draws the cloister, `scale` times as rich as the paper's.
pub(super) fn draw(scale: f64, detail: Detail, dice: &mut Dice) -> Sketch {
    let bays = ((BAYS * scale.sqrt()).round() as usize).clamp(2, 64);
    let half = 0.5 * BAY * bays as f64;
    let mut sketch = Sketch::default();
    sketch.pave("court", [dvec3(-half, -half, 0.0), 2.0 * half * DVec3::X, 2.0 * half * DVec3::Y], PAVING);
    for (name, degrees) in [("north", 0.0), ("west", 90.0), ("south", 180.0), ("east", 270.0)] {
        let at = Placement::standing(DVec3::ZERO, degrees);
        Gallery { name, at, bays, detail }.draw(dice, &mut sketch);
        garden(name, &at, half, detail, &mut sketch);
    }
    sketch.place("fountain", &Placement::standing(DVec3::ZERO, 0.0), fountain(detail));
    for (i, degrees) in [30.0, 150.0, 270.0].into_iter().enumerate() {
        let turn = Placement::standing(DVec3::ZERO, degrees);
        let at = turn.then(&Placement::standing(dvec3(0.0, -3.1, 0.0), 0.0));
        sketch.place(&format!("court_lamp{i}"), &at, floodlight());
    }
    let middle = half + 0.55 * DEPTH;
    sketch.view("court", dvec3(-0.85 * half, -0.8 * half, 1.7), dvec3(0.5 * half, 0.9 * half, 4.2), 60.0);
    sketch.view("gallery", dvec3(-half, middle, 1.7), dvec3(half, middle - 0.3, 2.2), 60.0);
    sketch.view("upper_gallery", dvec3(-half, middle, 6.5), dvec3(half, middle - 1.0, 6.6), 60.0);
    sketch.view("above", dvec3(-1.5 * half, -2.6 * half, 25.0 + half), dvec3(0.0, 0.0, 2.0), 45.0);
    sketch
}

/// A basin with a bowl on a stem, on the origin.
fn fountain(detail: Detail) -> Vec<Part> {
    let sides = detail.count(8, 0.6, 48);
    let basin = [(2.5, 0.0), (2.5, 0.55), (2.65, 0.6), (2.65, 0.72), (2.2, 0.72), (2.2, 0.35)];
    let stem = [
        (0.5, 0.35),
        (0.3, 0.6),
        (0.22, 1.2),
        (0.5, 1.4),
        (1.0, 1.65),
        (1.0, 1.72),
        (0.85, 1.72),
        (0.2, 1.6),
        (0.12, 1.8),
        (0.14, 2.1),
        (0.4, 2.35),
        (0.4, 2.4),
        (0.1, 2.42),
        (0.06, 2.7),
    ];
    vec![
        part("basin", STONE, lathe(&basin, sides, false, false)),
        part("water", WATER, lathe(&[(2.2, 0.35)], sides, false, true)),
        part("stem", STONE, lathe(&stem, sides, false, true)),
    ]
}

/// A lamp on a post that shines at the arcade behind it (towards −y).
fn floodlight() -> Vec<Part> {
    let (low, high) = (dvec3(-0.25, -0.15, 1.2), dvec3(0.25, 0.1, 1.5));
    let lens = [Side::Left, Side::Right, Side::Back, Side::Bottom, Side::Top];
    vec![
        part(
            "post",
            IRON,
            cuboid(dvec3(-0.05, -0.05, 0.0), dvec3(0.05, 0.05, 1.2), &[Side::Bottom, Side::Top]),
        ),
        part("head", IRON, cuboid(low, high, &[Side::Front])),
        part("lens", LIGHT, cuboid(low, high, &lens)),
    ]
}

/// A hedge around a bed and a bench at one corner of the court, if there is room.
fn garden(name: &str, at: &Placement, half: f64, detail: Detail, sketch: &mut Sketch) {
    if half < 8.0 {
        return;
    }
    let (a, b, w) = (0.35 * half, 0.8 * half, 0.8);
    let angle =
        [(a, a + w), (a, b), (b, b), (b, a), (b - w, a), (b - w, b - w), (a + w, b - w), (a + w, a + w)];
    let outline: Vec<DVec2> = angle.into_iter().rev().map(DVec2::from).collect();
    sketch.place(name, at, vec![part("hedge", HEDGE, prism(&outline, 0.0, 0.9, false, true))]);
    let seat = at.then(&Placement::standing(dvec3(0.55 * half, 0.55 * half, 0.0), 45.0));
    sketch.place(&format!("{name}_bench"), &seat, bench(detail));
}
