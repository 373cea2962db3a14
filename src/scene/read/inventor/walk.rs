//! The traversal: visits the nodes of a document in order, carrying the state, and fills the scene.
//!
//! Everything that can multiply (instances, arrays, copies, includes, index lists) is charged against
//! [`Limits`], so that a small file cannot ask for unbounded time or memory.

use std::collections::HashMap;
use std::path::PathBuf;
use std::rc::Rc;

use glam::{DMat4, DVec3};

use super::document::{Document, Node, NodeId};
use super::grammar::MAX_DEPTH;
use super::schema::Kind;
use super::state::{Coordinates, Ordering, State};
use super::{Limits, include, lights, shapes, transforms};
use crate::scene::read::ReadError;
use crate::scene::{Light, Scene};

/// The traversal of one file and what it includes.
pub(super) struct Walker<'a> {
    pub(super) limits: &'a Limits,
    pub(super) scene: Scene,
    /// For every face: its document and the byte offset of its shape.
    pub(super) origins: Vec<(u32, usize)>,
    /// Every document read so far.
    pub(super) documents: Vec<Rc<Document>>,
    /// Included documents by canonical path, so that each is parsed once.
    pub(super) included: HashMap<PathBuf, u32>,
    /// The files being traversed, outermost first.
    pub(super) including: Vec<PathBuf>,
    /// Materials by the bits of reflectance and exitance.
    pub(super) palette: HashMap<[u64; 6], u32>,
    steps: u64,
    depth: usize,
}

/// Where the traversal stands: a node of a document.
#[derive(Clone, Copy)]
pub(super) struct Here<'d> {
    pub(super) document: &'d Document,
    pub(super) number: u32,
    pub(super) node: &'d Node,
}

impl<'a> Walker<'a> {
    pub(super) fn new(limits: &'a Limits, scene: Scene) -> Self {
        Walker {
            limits,
            scene,
            origins: Vec::new(),
            documents: Vec::new(),
            included: HashMap::new(),
            including: Vec::new(),
            palette: HashMap::new(),
            steps: 0,
            depth: 0,
        }
    }

    /// Takes a document in; its skipped nodes count once, however often it is traversed.
    pub(super) fn add(&mut self, document: Document) -> u32 {
        for (what, count) in &document.skipped {
            *self.scene.findings.skipped.entry(what.clone()).or_default() += count;
        }
        self.documents.push(Rc::new(document));
        self.documents.len() as u32 - 1
    }

    /// Visits the top-level nodes of document `number`.
    pub(super) fn document(&mut self, number: u32, state: &mut State) -> Result<(), ReadError> {
        let document = self.documents[number as usize].clone();
        self.visit_all(&document, number, &document.roots, state)
    }

    fn visit_all(
        &mut self,
        document: &Document,
        number: u32,
        ids: &[NodeId],
        state: &mut State,
    ) -> Result<(), ReadError> {
        self.depth += 1;
        for id in ids {
            let here = Here { document, number, node: &document.nodes[*id as usize] };
            self.charge(here, 1)?;
            if self.depth > MAX_DEPTH {
                return Err(here.error(
                    format!(
                        "at most {MAX_DEPTH} nodes nested in one another, instances and includes followed"
                    ),
                    "one more",
                    "flatten the file: groups without effect can be left out",
                ));
            }
            self.visit(here, state)?;
        }
        self.depth -= 1;
        Ok(())
    }

    /// Counts work; fails beyond the limits.
    pub(super) fn charge(&mut self, here: Here, steps: usize) -> Result<(), ReadError> {
        self.steps += steps as u64;
        let products = self.scene.faces.len() + self.scene.lights.len() + self.scene.cameras.len();
        if self.steps > self.limits.steps {
            return Err(here.error(
                format!("at most {} nodes and indices after expanding instances", self.limits.steps),
                "more",
                "split the file, or repeat less with USE, Array and MultipleCopy",
            ));
        }
        if products > self.limits.faces {
            return Err(here.error(
                format!("at most {} faces, lights and cameras", self.limits.faces),
                "more",
                "split the file, or repeat less with USE, Array and MultipleCopy",
            ));
        }
        Ok(())
    }

    fn visit(&mut self, here: Here, state: &mut State) -> Result<(), ReadError> {
        let node = here.node;
        // What a newer version wrote for readers that do not know the node, or not its newer fields.
        let stand_in = node.nodes("alternateRep");
        if !stand_in.is_empty() && (node.kind == Kind::Other || node.fields.len() == 1) {
            return self.visit_all(here.document, here.number, stand_in, state);
        }
        match node.kind {
            Kind::Group => self.children(here, state),
            Kind::Separator => self.children(here, &mut state.clone()),
            Kind::TransformSeparator => {
                let saved = (state.matrix, state.metres_per_unit);
                self.children(here, state)?;
                (state.matrix, state.metres_per_unit) = saved;
                Ok(())
            }
            Kind::Transform if here.document.vrml97 => {
                let mut inner = state.clone();
                transforms::apply(node, &mut inner);
                self.children(here, &mut inner)
            }
            Kind::Switch => self.switch(here, state),
            Kind::FirstChild => self.child(here, 0, state),
            Kind::Array => self.array(here, state),
            Kind::MultipleCopy => {
                let matrices = node.numbers("matrix").cloned().unwrap_or_else(|| [].into());
                let copies = matrices.chunks_exact(16).map(transforms::matrix_from_rows);
                copies.enumerate().try_for_each(|(i, matrix)| self.copy(here, state, i, matrix))
            }
            Kind::File => include::visit(self, here, state),
            Kind::Shape97 => shapes::shape97(self, here, state),
            Kind::FaceSet
            | Kind::IndexedFaceSet
            | Kind::TriangleStripSet
            | Kind::IndexedTriangleStripSet
            | Kind::QuadMesh => shapes::polygons(self, here, state),
            Kind::Cube | Kind::Sphere | Kind::Cone | Kind::Cylinder => shapes::solid(self, here, state),
            Kind::PointLight | Kind::SpotLight | Kind::DirectionalLight => {
                let light: Option<Light> = lights::light(node, &state.matrix);
                self.scene.lights.extend(light);
                Ok(())
            }
            Kind::PerspectiveCamera | Kind::OrthographicCamera => {
                let number = self.scene.cameras.len() + 1;
                self.scene.cameras.push(lights::camera(node, &state.matrix, number));
                Ok(())
            }
            _ => {
                self.property(here, state);
                Ok(())
            }
        }
    }

    /// Nodes that only change the state.
    pub(super) fn property(&mut self, here: Here, state: &mut State) {
        let node = here.node;
        match node.kind {
            Kind::Coordinate3 => set_coordinates(node, 3, state),
            Kind::Coordinate4 => set_coordinates(node, 4, state),
            Kind::VertexProperty => state.set_vertex_property(node),
            Kind::Material => state.set_material(node),
            Kind::BaseColor => state.set_base_color(node),
            Kind::PackedColor => state.set_packed_color(node),
            Kind::MaterialBinding if !node.ignores("value") => state.binding = node.word("value", "OVERALL"),
            Kind::ShapeHints => state.set_shape_hints(node),
            Kind::Complexity if !node.ignores("value") => state.complexity = node.number("value", 0.5),
            Kind::DrawStyle if !node.ignores("style") => state.style = node.word("style", "FILLED"),
            _ => transforms::apply(node, state),
        }
    }

    fn children(&mut self, here: Here, state: &mut State) -> Result<(), ReadError> {
        self.visit_all(here.document, here.number, &here.node.children, state)
    }

    fn child(&mut self, here: Here, index: usize, state: &mut State) -> Result<(), ReadError> {
        match here.node.children.get(index..index.saturating_add(1)) {
            Some(child) => self.visit_all(here.document, here.number, child, state),
            None => Ok(()),
        }
    }

    /// One child, all (-3), none (-1), or the one chosen by the switch or copy around this one (-2).
    fn switch(&mut self, here: Here, state: &mut State) -> Result<(), ReadError> {
        let node = here.node;
        let written = node.integer("whichChild", node.integer("whichChoice", -1));
        let chosen = match written {
            -2 if state.switch >= 0 => state.switch % node.children.len().max(1) as i64,
            -2 => state.switch,
            other => other,
        };
        let outer = std::mem::replace(&mut state.switch, chosen);
        match chosen {
            -3 => self.children(here, state)?,
            0.. => self.child(here, chosen as usize, state)?,
            _ => {}
        }
        state.switch = outer;
        Ok(())
    }

    /// `Array`: the children repeated along up to three directions.
    fn array(&mut self, here: Here, state: &State) -> Result<(), ReadError> {
        let node = here.node;
        let axes = [
            ("numElements1", "separation1", DVec3::X),
            ("numElements2", "separation2", DVec3::Y),
            ("numElements3", "separation3", DVec3::Z),
        ]
        .map(|(count, step, axis)| (node.integer(count, 1).max(0), node.vector(step, axis)));
        let first: DVec3 = match node.word("origin", "FIRST") {
            "CENTER" => axes.iter().map(|(n, step)| -0.5 * (*n - 1) as f64 * *step).sum(),
            "LAST" => axes.iter().map(|(n, step)| -((*n - 1) as f64) * *step).sum(),
            _ => DVec3::ZERO,
        };
        let mut element = 0;
        for k in 0..axes[2].0 {
            for j in 0..axes[1].0 {
                // Charged here too: a row may be empty.
                self.charge(here, 1)?;
                for i in 0..axes[0].0 {
                    let offset = i as f64 * axes[0].1 + j as f64 * axes[1].1 + k as f64 * axes[2].1;
                    self.copy(here, state, element, DMat4::from_translation(first + offset))?;
                    element += 1;
                }
            }
            self.charge(here, 1)?;
        }
        Ok(())
    }

    fn copy(&mut self, here: Here, state: &State, index: usize, matrix: DMat4) -> Result<(), ReadError> {
        self.charge(here, 1)?;
        let mut inner = state.clone();
        inner.matrix *= matrix;
        inner.switch = index as i64;
        self.children(here, &mut inner)
    }
}

fn set_coordinates(node: &Node, stride: usize, state: &mut State) {
    if let Some(numbers) = node.numbers("point") {
        state.coordinates = Coordinates::new(numbers.clone(), stride);
    }
}

impl Here<'_> {
    pub(super) fn error(
        &self,
        expected: impl Into<String>,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> ReadError {
        ReadError::at(&self.document.path, &self.document.text, self.node.at, expected, found, remedy)
    }

    pub(super) fn place(&self) -> String {
        self.document.place(self.node.at)
    }

    /// Another node of the same document.
    pub(super) fn sibling(&self, id: NodeId) -> Self {
        Here { node: &self.document.nodes[id as usize], ..*self }
    }
}

impl State {
    /// Whether vertex lists run clockwise from the front in world coordinates.
    pub(super) fn reverses(&self, written_clockwise: bool) -> bool {
        let mirrors = glam::DMat3::from_mat4(self.matrix).determinant() < 0.0;
        mirrors != written_clockwise
    }

    /// Whether the ordering says so.
    pub(super) fn is_clockwise(&self) -> bool {
        self.ordering == Ordering::Clockwise
    }
}
