//! What a look at an element records, so that the link that may come of it can be kept: rows, one for each sample point and emitter cell.

use glam::DVec2;

use super::packet::EmitterCell;
use crate::math::basis::MAX_FUNCTIONS;
use crate::math::{Basis, Cell, Split};

/// How a cell of an emitter belongs to the packet's node that holds it.
#[derive(Clone, Debug)]
pub(super) struct Unit {
    /// The node.
    pub node: u32,
    /// Its cell.
    pub cell: Cell,
    /// The part as it would send the functions of the node, each in place of a band.
    pub sent: EmitterCell<MAX_FUNCTIONS>,
}

/// What the functions of a packet's node bring to a sample point, or a part of that.
#[derive(Clone, Debug)]
pub(super) struct Row {
    /// Number of the sample point.
    pub point: usize,
    /// The node's cell.
    pub cell: Cell,
    /// What the node sent when this was recorded, and the RMS of what it left out.
    pub strength_w_m2: f64,
    pub detail_w_m2: f64,
    /// What counts of the part left out, at this distance.
    pub fading: f64,
    /// Irradiance for a coefficient of 1 of each function.
    pub factors: [f64; MAX_FUNCTIONS],
}

/// The rows of the last look, of each node side by side.
#[derive(Clone, Debug, Default)]
pub(super) struct Recording {
    /// How many of the sample points are recorded, from the first on; none where the look at hand is not.
    pub points: usize,
    pub rows: Vec<Row>,
    /// The row found last.
    pub row: [f64; MAX_FUNCTIONS],
}

impl Recording {
    /// A look begins, of which so many points are to be recorded.
    pub fn start(&mut self, points: usize) {
        self.points = points;
        self.rows.clear();
    }

    /// It ends.
    pub fn stop(&mut self) {
        self.points = 0;
    }
}

impl Unit {
    /// A whole node, the polygon in which has this outline.
    pub fn of_node(basis: Basis, node: u32, cell: Cell, outline: Option<Box<[DVec2]>>) -> Self {
        let mut coefficients = [[0.0; MAX_FUNCTIONS]; MAX_FUNCTIONS];
        (0..basis.len()).for_each(|a| coefficients[a][a] = 1.0);
        let sent = EmitterCell { cell, node: None, coefficients, outline, virtual_depth: 0, unit: None };
        Self { node, cell, sent }
    }

    /// A part of this, likewise.
    pub fn part(&self, basis: Basis, split: Split, index: usize, outline: Option<Box<[DVec2]>>) -> Self {
        let cell = self.sent.cell.child(split, index);
        let mut coefficients = [[0.0; MAX_FUNCTIONS]; MAX_FUNCTIONS];
        basis.push(split, index, &self.sent.coefficients, &mut coefficients);
        let virtual_depth = self.sent.virtual_depth + 1;
        let sent = EmitterCell { cell, node: None, coefficients, outline, virtual_depth, unit: None };
        Self { node: self.node, cell: self.cell, sent }
    }
}
