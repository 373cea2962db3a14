//! Shape nodes → faces in world coordinates, with their materials and lit sides.

use std::rc::Rc;

use glam::DVec3;

use super::document::Node;
use super::polygons::{self, Corner, Polygon};
use super::schema::Kind;
use super::solids;
use super::state::{Ordering, State};
use super::walk::{Here, Walker};
use crate::scene::read::ReadError;
use crate::scene::{Face, Material, Sides};

/// A vertex-based shape.
pub(super) fn polygons(walker: &mut Walker, here: Here, state: &State) -> Result<(), ReadError> {
    let node = here.node;
    let mut own;
    let mut state = state;
    if let Some(property) = node.nodes("vertexProperty").first().or(node.nodes("coord").first()) {
        own = state.clone();
        walker.property(here.sibling(*property), &mut own);
        state = &own;
    }
    if !is_drawn(walker, state) {
        return Ok(());
    }
    // Charged whole: many instances of long lists without a single good face are work too.
    for list in ["coordIndex", "materialIndex"] {
        walker.charge(here, node.numbers(list).map_or(0, |list| list.len()))?;
    }
    let reverse = state.reverses(state.is_clockwise());
    let binding = Binding::new(node, state, walker);
    polygons::for_each(node, state.coordinates.count(), &mut |polygon| {
        walker.charge(here, 1 + polygon.corners.len())?;
        let corners = polygon.corners.iter().map(|corner| state.coordinates.get(corner.point));
        let Some(corners) = corners.collect::<Option<Vec<DVec3>>>() else {
            walker
                .scene
                .findings
                .repair("face with a coordinate index out of range dropped", || here.place());
            return Ok(());
        };
        if corners.len() < 3 {
            walker.scene.findings.repair("face with fewer than three vertices dropped", || here.place());
            return Ok(());
        }
        let (reflectance, exitance) = binding.colors(&polygon);
        walker.face(here, state, corners, reverse, reflectance, exitance);
        Ok(())
    })
}

/// Cube, sphere, cone or cylinder. Their faces are counter-clockwise from outside whatever `ShapeHints` says
/// of vertex lists.
pub(super) fn solid(walker: &mut Walker, here: Here, state: &State) -> Result<(), ReadError> {
    if !is_drawn(walker, state) {
        return Ok(());
    }
    let per_part = match state.binding {
        "PER_PART" | "PER_PART_INDEXED" => true,
        "PER_FACE" | "PER_FACE_INDEXED" => here.node.kind == Kind::Cube,
        _ => false,
    };
    let reverse = state.reverses(false);
    solids::for_each(here.node, state.complexity, &mut |corners, part| {
        walker.charge(here, corners.len())?;
        let number = if per_part { part } else { 0 };
        let (reflectance, exitance) = (state.diffuse.get(number), state.emissive.get(number));
        walker.face(here, state, corners.to_vec(), reverse, reflectance, exitance);
        Ok(())
    })
}

/// VRML97's `Shape`: an appearance and a geometry, nothing inherited but the transformation.
pub(super) fn shape97(walker: &mut Walker, here: Here, state: &State) -> Result<(), ReadError> {
    let mut state =
        State { matrix: state.matrix, ordering: Ordering::CounterClockwise, solid: true, ..State::default() };
    let material =
        here.node.nodes("appearance").first().and_then(|id| here.sibling(*id).node.nodes("material").first());
    if let Some(material) = material {
        walker.property(here.sibling(*material), &mut state);
    }
    let Some(geometry) = here.node.nodes("geometry").first().map(|id| here.sibling(*id)) else {
        return Ok(());
    };
    match geometry.node.kind {
        Kind::IndexedFaceSet => {
            if !geometry.node.flag("ccw", true) {
                state.ordering = Ordering::Clockwise;
            }
            state.solid = geometry.node.flag("solid", true);
            polygons(walker, geometry, &state)
        }
        _ => solid(walker, geometry, &state),
    }
}

fn is_drawn(walker: &mut Walker, state: &State) -> bool {
    if state.style != "FILLED" {
        walker.scene.findings.skip(&format!("shape drawn as {}", state.style));
    }
    state.style == "FILLED"
}

impl Walker<'_> {
    fn face(
        &mut self,
        here: Here,
        state: &State,
        mut vertices: Vec<DVec3>,
        reverse: bool,
        reflectance: DVec3,
        exitance: DVec3,
    ) {
        for vertex in &mut vertices {
            *vertex = state.matrix.project_point3(*vertex);
        }
        if reverse {
            vertices.reverse();
        }
        let one_sided = state.solid && state.ordering != Ordering::Unknown;
        let sides = if one_sided { Sides::One } else { Sides::Two };
        let material = self.material(reflectance, exitance);
        self.scene.faces.push(Face { vertices, material, sides });
        self.origins.push((here.number, here.node.at));
    }

    /// The number of the material with these colours.
    fn material(&mut self, reflectance: DVec3, exitance: DVec3) -> u32 {
        let (r, e) = (reflectance.to_array(), exitance.to_array());
        let key = [r[0], r[1], r[2], e[0], e[1], e[2]].map(f64::to_bits);
        let materials = &mut self.scene.materials;
        *self.palette.entry(key).or_insert_with(|| {
            materials.push(Material { reflectance: r.to_vec(), exitance_w_m2: e.to_vec() });
            materials.len() as u32 - 1
        })
    }
}

/// How the polygons of one shape take their colours from the lists in the state.
struct Binding<'a> {
    state: &'a State,
    materials: Option<Rc<[f64]>>,
}

impl<'a> Binding<'a> {
    fn new(node: &Node, state: &'a State, walker: &mut Walker) -> Self {
        if state.binding.starts_with("PER_VERTEX") {
            walker.scene.findings.skip("colours per vertex (each face takes their mean)");
        }
        // A list of one -1 is the default: it means "use coordIndex".
        let given = |list: &&Rc<[f64]>| list.iter().any(|index| *index >= 0.0);
        let name = match state.binding.ends_with("_INDEXED") {
            true if node.numbers("materialIndex").filter(given).is_some() => Some("materialIndex"),
            true if state.binding == "PER_VERTEX_INDEXED" => Some("coordIndex"),
            _ => None,
        };
        Binding { state, materials: name.and_then(|name| node.numbers(name)).cloned() }
    }

    /// Reflectance and exitance of a polygon.
    fn colors(&self, polygon: &Polygon) -> (DVec3, DVec3) {
        let number = match self.state.binding {
            "PER_PART" | "PER_PART_INDEXED" => self.look_up(polygon.part),
            "PER_FACE" | "PER_FACE_INDEXED" => self.look_up(polygon.face),
            "PER_VERTEX" => return self.mean(polygon, |corner| corner.vertex),
            "PER_VERTEX_INDEXED" => return self.mean(polygon, |corner| self.look_up(corner.slot)),
            _ => 0,
        };
        (self.state.diffuse.get(number), self.state.emissive.get(number))
    }

    /// The colour number at place `i` of the index list; `i` itself where there is none.
    fn look_up(&self, i: usize) -> usize {
        match &self.materials {
            Some(list) => list.get(i).map_or(0, |index| index.max(0.0) as usize),
            None => i,
        }
    }

    fn mean(&self, polygon: &Polygon, number: impl Fn(&Corner) -> usize) -> (DVec3, DVec3) {
        let share = 1.0 / polygon.corners.len() as f64;
        let mut sum = (DVec3::ZERO, DVec3::ZERO);
        for corner in polygon.corners {
            let number = number(corner);
            sum.0 += share * self.state.diffuse.get(number);
            sum.1 += share * self.state.emissive.get(number);
        }
        sum
    }
}
