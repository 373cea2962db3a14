//! The traversal state: what the nodes before a shape have set, scoped by separators.
//!
//! Lists are shared with the document, so saving the state, setting a property and instancing cost the same
//! however long they are.

use std::rc::Rc;

use glam::{DMat4, DVec3};

use super::document::Node;

/// Colours as a node gives them: one or many.
#[derive(Clone, Debug)]
pub enum Colors {
    /// Triples of numbers.
    Floats(Rc<[f64]>),
    /// `0xRRGGBBAA` each.
    Packed(Rc<[f64]>),
    /// `0xAABBGGRR` each, the order of Inventor 2.0.
    PackedBackwards(Rc<[f64]>),
}

impl Colors {
    /// The same colour everywhere.
    pub fn uniform(color: DVec3) -> Colors {
        Colors::Floats(color.to_array().into())
    }

    /// Colour number `i`; the list repeats when it is too short, as Inventor's does.
    pub fn get(&self, i: usize) -> DVec3 {
        match self {
            Colors::Floats(numbers) => match numbers.len() / 3 {
                0 => DVec3::ZERO,
                n => DVec3::from_slice(&numbers[i % n * 3..]),
            },
            Colors::Packed(numbers) => unpacked(numbers, i, [24, 16, 8]),
            Colors::PackedBackwards(numbers) => unpacked(numbers, i, [0, 8, 16]),
        }
    }
}

/// Red, green and blue of packed colour number `i`, found at these bits.
fn unpacked(numbers: &[f64], i: usize, shifts: [u32; 3]) -> DVec3 {
    let packed = numbers.get(i % numbers.len().max(1)).map_or(0, |packed| *packed as i64);
    DVec3::from_array(shifts.map(|shift| ((packed >> shift) & 0xff) as f64 / 255.0))
}

/// Points in local coordinates, `stride` numbers each (4: homogeneous).
#[derive(Clone, Debug)]
pub struct Coordinates {
    numbers: Rc<[f64]>,
    stride: usize,
}

impl Coordinates {
    /// Points of three or four numbers.
    pub fn new(numbers: Rc<[f64]>, stride: usize) -> Coordinates {
        Coordinates { numbers, stride }
    }

    /// How many points.
    pub fn count(&self) -> usize {
        self.numbers.len() / self.stride
    }

    /// Point number `i`.
    pub fn get(&self, i: usize) -> Option<DVec3> {
        let start = i.checked_mul(self.stride)?;
        let numbers = self.numbers.get(start..start + self.stride)?;
        let point = DVec3::from_slice(numbers);
        Some(numbers.get(3).map_or(point, |w| point / *w))
    }
}

/// `ShapeHints.vertexOrdering`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ordering {
    /// The file does not say which side is the front.
    Unknown,
    /// Clockwise from the front.
    Clockwise,
    /// Counter-clockwise from the front.
    CounterClockwise,
}

/// What the nodes visited so far have set.
#[derive(Clone, Debug)]
pub struct State {
    /// Local → world, for column vectors.
    pub matrix: DMat4,
    /// Metres per unit of length, as `Units` nodes state it.
    pub metres_per_unit: f64,
    /// Reflectances.
    pub diffuse: Colors,
    /// Exitances.
    pub emissive: Colors,
    /// How colours are dealt out to parts, faces and vertices.
    pub binding: &'static str,
    /// Points for vertex-based shapes.
    pub coordinates: Coordinates,
    /// Which way round faces are written.
    pub ordering: Ordering,
    /// Whether shapes are closed solids.
    pub solid: bool,
    /// How finely curved shapes are tessellated, 0 to 1.
    pub complexity: f64,
    /// `FILLED`, `LINES`, `POINTS` or `INVISIBLE`.
    pub style: &'static str,
    /// The child chosen by the switch, array or copy around this place.
    pub switch: i64,
}

impl Default for State {
    fn default() -> Self {
        State {
            matrix: DMat4::IDENTITY,
            metres_per_unit: 1.0,
            diffuse: Colors::uniform(DVec3::splat(0.8)),
            emissive: Colors::uniform(DVec3::ZERO),
            binding: "OVERALL",
            coordinates: Coordinates::new([].into(), 3),
            ordering: Ordering::Unknown,
            solid: false,
            complexity: 0.5,
            style: "FILLED",
            switch: -1,
        }
    }
}

impl State {
    /// Takes over the colours of a `Material` node; fields not written mean their defaults, as in Inventor.
    pub fn set_material(&mut self, node: &Node) {
        set_colors(&mut self.diffuse, node, "diffuseColor", 0.8);
        set_colors(&mut self.emissive, node, "emissiveColor", 0.0);
    }

    /// `BaseColor`: the diffuse colour alone.
    pub fn set_base_color(&mut self, node: &Node) {
        set_colors(&mut self.diffuse, node, "rgb", 0.8);
    }

    /// `PackedColor`, or the colours of a `VertexProperty`.
    pub fn set_packed_color(&mut self, node: &Node) {
        if let Some(numbers) = node.numbers("orderedRGBA").filter(|numbers| !numbers.is_empty()) {
            self.diffuse = Colors::Packed(numbers.clone());
        } else if let Some(numbers) = node.numbers("rgba").filter(|numbers| !numbers.is_empty()) {
            self.diffuse = Colors::PackedBackwards(numbers.clone());
        }
    }

    /// `VertexProperty`: points, and colours with their own binding.
    pub fn set_vertex_property(&mut self, node: &Node) {
        if let Some(numbers) = node.numbers("vertex").filter(|numbers| !numbers.is_empty()) {
            self.coordinates = Coordinates::new(numbers.clone(), 3);
        }
        if node.numbers("orderedRGBA").is_some_and(|numbers| !numbers.is_empty()) {
            self.set_packed_color(node);
            self.binding = node.word("materialBinding", "OVERALL");
        }
    }

    /// `ShapeHints`; fields not written mean "unknown", as in Inventor.
    pub fn set_shape_hints(&mut self, node: &Node) {
        if !node.ignores("vertexOrdering") {
            self.ordering = match node.word("vertexOrdering", "UNKNOWN_ORDERING") {
                "CLOCKWISE" => Ordering::Clockwise,
                "COUNTERCLOCKWISE" => Ordering::CounterClockwise,
                _ => Ordering::Unknown,
            };
        }
        if !node.ignores("shapeType") {
            self.solid = node.word("shapeType", "UNKNOWN_SHAPE_TYPE") == "SOLID";
        }
    }
}

fn set_colors(colors: &mut Colors, node: &Node, field: &str, default: f64) {
    match node.numbers(field) {
        Some(numbers) if !numbers.is_empty() => *colors = Colors::Floats(numbers.clone()),
        None if !node.ignores(field) => *colors = Colors::uniform(DVec3::splat(default)),
        _ => {}
    }
}
