//! The Cornell box of `scenes/cornell-box.iv`, its walls tiled as finely as there are surfaces.

use glam::{DVec2, DVec3, dvec3};

use super::placement::Placement;
use super::sketch::{Paint, Sketch, lamp, matt, part};
use super::solids::prism;

const WHITE: Paint = matt(0.73, 0.73, 0.73);
const RED: Paint = matt(0.61, 0.06, 0.05);
const GREEN: Paint = matt(0.14, 0.44, 0.09);
const LIGHT: Paint = lamp(40.0, 30.0, 18.0);

/// Draws the box.
pub(super) fn draw() -> Sketch {
    let mut sketch = Sketch::default();
    sketch.view("inside", dvec3(0.5, 0.01, 0.5), dvec3(0.5, 1.0, 0.5), 75.0);
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    sketch.pave("floor", [DVec3::ZERO, x, y], [WHITE; 3]);
    sketch.pave("ceiling", [z, y, x], [WHITE; 3]);
    sketch.pave("back", [y, x, z], [WHITE; 3]);
    sketch.pave("front", [x, -x, z], [WHITE; 3]);
    sketch.pave("left_red", [DVec3::ZERO, y, z], [RED; 3]);
    sketch.pave("right_green", [x + y, -y, z], [GREEN; 3]);
    let (low, high) = (dvec3(0.38, 0.41, 0.998), dvec3(0.62, 0.6, 0.998));
    sketch.add(
        "light",
        LIGHT,
        vec![vec![low, dvec3(low.x, high.y, low.z), high, dvec3(high.x, low.y, low.z)]],
    );
    let blocks =
        [("short", (0.335, 0.305), 0.297, 0.297, -16.0), ("tall", (0.755, 0.63), 0.297, 0.595, 17.0)];
    for (name, (x, y), width, height, degrees) in blocks {
        let half = 0.5 * width;
        let square = [(-half, -half), (half, -half), (half, half), (-half, half)].map(DVec2::from);
        let faces = prism(&square, 0.0, height, false, true);
        sketch.place(
            name,
            &Placement::standing(dvec3(x, y, 0.0), degrees),
            vec![part("block", WHITE, faces)],
        );
    }
    sketch
}
