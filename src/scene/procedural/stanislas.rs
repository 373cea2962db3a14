//! A square before an opera, after Place Stanislas in Nancy: the long façade of the opera lit by a pair of lamps at each of its
//! piers, low pavilions left and right, a statue in the middle, paving.

use glam::{DVec3, dvec3};

use super::Detail;
use super::dice::Dice;
use super::opera::{BAY, CORNICE, Facade, LEDGE};
use super::placement::Placement;
use super::sketch::{Paint, Sketch, matt};
use super::solids::{Side, cuboid};
use super::square::{bench, lantern, statue};

/// Bays of the opera at the paper's size: 18 piers, 36 lamps.
const BAYS: f64 = 17.0;
/// Between the opera and the pavilions.
const GAP: f64 = 5.0;
/// Depth of the buildings.
const DEPTH: f64 = 9.0;

const PLASTER: Paint = matt(0.6, 0.56, 0.48);
const PAVING: [Paint; 3] = [matt(0.5, 0.47, 0.42), matt(0.46, 0.43, 0.38), matt(0.54, 0.5, 0.44)];

/// Draws the square, `scale` times as rich as the paper's.
pub(super) fn draw(scale: f64, detail: Detail, dice: &mut Dice) -> Sketch {
    let bays = ((BAYS * scale.sqrt()).round() as usize).clamp(3, 64);
    let mut sketch = Sketch::default();
    let opera = Facade::new("opera", DVec3::ZERO, 0.0, bays, detail);
    opera.draw_grand(&mut sketch);
    let half = opera.half();
    body("opera", &Placement::standing(DVec3::ZERO, 0.0), half, CORNICE, &mut sketch);
    let side = half + 3.0;
    let side_bays = bays.div_ceil(2).max(2);
    let length = 0.5 * BAY * side_bays as f64 + GAP + 1.0;
    for (name, x, degrees) in [("west", -side, 90.0), ("east", side, 270.0)] {
        let origin = dvec3(x, -length, 0.0);
        let pavilion = Facade::new(name, origin, degrees, side_bays, detail);
        pavilion.draw_low(&mut sketch);
        body(name, &Placement::standing(origin, degrees), pavilion.half(), LEDGE, &mut sketch);
    }
    let depth = 2.0 * length + 4.0;
    let corner = dvec3(-side, -depth, 0.0);
    sketch.pave("paving", [corner, 2.0 * side * DVec3::X, depth * DVec3::Y], PAVING);
    let middle = dvec3(0.0, -0.55 * depth, 0.0);
    sketch.place("statue", &Placement::standing(middle, 0.0), statue(detail));
    furnish(side, depth, bays, detail, dice, &mut sketch);
    sketch.view("square", dvec3(-0.45 * side, -depth + 1.0, 1.8), dvec3(0.1 * side, 0.0, 7.0), 50.0);
    sketch.view("facade", dvec3(2.0, -16.0, 1.7), dvec3(-8.0, 0.0, 7.0), 60.0);
    sketch.view("above", dvec3(0.7 * side, -1.3 * depth, 26.0), dvec3(0.0, -0.3 * depth, 2.0), 45.0);
    sketch
}

/// Sides, back and roof of a building behind its façade, which is centred on the placement's origin.
fn body(name: &str, at: &Placement, half: f64, height: f64, sketch: &mut Sketch) {
    let faces = cuboid(dvec3(-half, 0.0, 0.0), dvec3(half, DEPTH, height), &[Side::Front, Side::Bottom]);
    sketch.add(&format!("{name}_body"), PLASTER, at.faces(faces));
}

/// Lanterns and benches in two rows.
fn furnish(side: f64, depth: f64, bays: usize, detail: Detail, dice: &mut Dice, sketch: &mut Sketch) {
    let count = (bays / 2).max(2);
    for row in 0..2 {
        let y = -depth * (0.25 + 0.5 * f64::from(row));
        for i in 0..count {
            let x = 1.6 * side * ((i as f64 + 0.5) / count as f64 - 0.5);
            sketch.place(
                &format!("lantern{row}_{i}"),
                &Placement::standing(dvec3(x, y, 0.0), 0.0),
                lantern(detail),
            );
            let at = Placement::standing(dvec3(x + 2.0, y, 0.0), dice.pick(&[0.0, 180.0]));
            sketch.place(&format!("bench{row}_{i}"), &at, bench(detail));
        }
    }
}
