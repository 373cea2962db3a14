//! What a look at an element records, so that the link that may come of it can be kept: rows, one for each sample point and emitter cell.
//!
//! A row holds what each function of the packet's node that holds the cell brings for a coefficient of 1. The light is then the row times the
//! node's coefficients, and the row holds for other coefficients too.

use std::sync::Arc;

use glam::DVec2;

use super::gather::{Gather, norm};
use super::judge::How;
use super::light::Ready;
use super::nodes::Nodes;
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
    pub fn of_node(basis: Basis, node: u32, cell: Cell, outline: Option<Arc<[DVec2]>>) -> Self {
        let mut coefficients = [[0.0; MAX_FUNCTIONS]; MAX_FUNCTIONS];
        (0..basis.len()).for_each(|a| coefficients[a][a] = 1.0);
        let sent = EmitterCell { cell, node: None, coefficients, outline, virtual_depth: 0, unit: None };
        Self { node, cell, sent }
    }

    /// A part of this, likewise.
    pub fn part(&self, basis: Basis, split: Split, index: usize, outline: Option<Arc<[DVec2]>>) -> Self {
        let cell = self.sent.cell.child(split, index);
        let mut coefficients = [[0.0; MAX_FUNCTIONS]; MAX_FUNCTIONS];
        basis.push(split, index, &self.sent.coefficients, &mut coefficients);
        let virtual_depth = self.sent.virtual_depth + 1;
        let sent = EmitterCell { cell, node: None, coefficients, outline, virtual_depth, unit: None };
        Self { node: self.node, cell: self.cell, sent }
    }
}

impl<const N: usize> Gather<'_, N> {
    /// The points that are recorded where the cell is one that can be.
    pub(super) fn recorded(&self, emitter: &EmitterCell<N>) -> u32 {
        if emitter.unit.is_some() { (1 << self.scratch.recording.points) - 1 } else { 0 }
    }

    /// What sends to point `p` in place of the cell, if that is recorded.
    pub(super) fn unit<'e>(&self, p: usize, emitter: &'e EmitterCell<N>) -> Option<&'e Unit> {
        emitter.unit.as_deref().filter(|_| p < self.scratch.recording.points)
    }

    /// The light that a row brings, which is kept for [`Gather::add`].
    pub(super) fn by_row(&mut self, unit: &Unit, row: [f64; MAX_FUNCTIONS]) -> [f64; N] {
        let coefficients = &self.packet.nodes[unit.node as usize].coefficients;
        let mut light = [0.0; N];
        for (factor, coefficient) in row.iter().zip(coefficients) {
            for n in 0..N {
                light[n] += factor * coefficient[n];
            }
        }
        self.scratch.recording.row = row;
        light
    }

    /// Adds to point `p` what was just found of each band that share of it which is seen, and records it.
    pub(super) fn add(
        &mut self,
        p: usize,
        emitter: &EmitterCell<N>,
        light: &[f64; N],
        mut share: [f64; N],
        how: &How,
    ) {
        if let Some(unit) = self.unit(p, emitter) {
            share = [self.record(p, unit, light, &share, how); N];
        }
        self.brighten(p, light, &share);
    }

    /// Records the row of the light just found, for all bands alike, and returns the share of it that stands for theirs.
    fn record(&mut self, p: usize, unit: &Unit, light: &[f64; N], share: &[f64; N], how: &How) -> f64 {
        let (lit, seen) = light
            .iter()
            .zip(share)
            .fold((0.0, 0.0), |(lit, seen), (light, share)| (lit + light.abs(), seen + share * light.abs()));
        let even = if lit > seen { seen / lit } else { share[0] };
        let node = &self.packet.nodes[unit.node as usize];
        let recording = &mut self.scratch.recording;
        recording.rows.push(Row {
            point: p,
            cell: unit.cell,
            strength_w_m2: node.strength_w_m2(),
            detail_w_m2: node.detail.rms_w_m2,
            fading: how.nearest(p).min(1.0).powi(self.packet.basis.order() as i32),
            factors: recording.row.map(|factor| even * factor),
        });
        even
    }

    /// Takes the light of a whole cell to point `p`, which is recorded and of whose rays these hit.
    pub(super) fn take_recorded(
        &mut self,
        p: usize,
        emitter: &EmitterCell<N>,
        ready: &Ready<N>,
        how: &How,
        visible: u32,
    ) {
        let Some(unit) = self.unit(p, emitter) else { return };
        let (x, n) = (self.points.position[p], how.nodes_of(p));
        let make = || Box::new(Nodes::new(&self.packet.frame, self.packet.basis, &unit.sent, n));
        let nodes = || ready.unit[n - 1].get_or_init(make).as_ref();
        let row = if how.closed_form & 1 << p != 0 {
            self.near(x, &unit.sent, |_| nodes(), how.constant & 1 << p != 0)
        } else {
            self.far(x, nodes())
        };
        let light = self.by_row(unit, row);
        let share = self.share_seen(p, emitter, ready, how, norm(&light), visible);
        if share != [0.0; N] {
            self.add(p, emitter, &light, share, how);
        }
    }
}
