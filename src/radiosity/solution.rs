//! A finished solution: the irradiance of every surface as a piecewise polynomial on its leaves, flat and self-contained.

use std::sync::OnceLock;

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::ripples::{Limits, limits};
use crate::math::basis::MAX_FUNCTIONS;
use crate::math::polygon::{clip_to_cell, moments};
use crate::math::{Basis, Cell, Split};
use crate::scene::{Scene, Surface};

/// The irradiance on all surfaces of a scene. Radiosity is `M + ρE`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Solution {
    /// The scene that was solved.
    pub scene: Scene,
    /// Its surfaces.
    pub surfaces: Vec<Surface>,
    /// The irradiance on each, in the same order.
    pub fields: Vec<Field>,
    /// The relative L2 error asked for.
    pub error_target: f64,
    /// The estimate of what was reached.
    pub error_estimate: f64,
    /// Whether the run was cut short.
    pub incomplete: bool,
}

/// The irradiance on one surface: a tree of cells, its leaves with polynomial coefficients.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Field {
    /// Functions per dimension: 1 Haar, 2 M2, 3 M3.
    pub basis: Basis,
    /// Number of bands.
    pub bands: usize,
    /// Nodes; the root is number 0, the children of a node stand side by side.
    pub nodes: Vec<Node>,
    /// Leaf coefficients in W/m²: for each leaf `k²` functions × bands, band fastest.
    pub coefficients: Vec<f64>,
    /// What may be read of each node's leaf, by band; found when first asked for, from when on the field must not change.
    #[serde(skip)]
    pub limits: FieldLimits,
}

/// The limits of a field once they are found; they follow from the rest of it, and are no difference.
#[derive(Clone, Debug, Default)]
pub struct FieldLimits(OnceLock<Vec<Limits>>);

impl PartialEq for FieldLimits {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// A node of a [`Field`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Node {
    /// Divided; the first child's index.
    Inner(Split, u32),
    /// A leaf; where its coefficients start.
    Leaf(u32),
    /// A cell outside the surface's polygon: no function lives there.
    Outside,
}

/// A leaf as visited by [`Field::for_each_leaf`].
#[derive(Clone, Copy, Debug)]
pub struct Leaf<'a> {
    /// Where it lies in the surface's unit square.
    pub cell: Cell,
    /// Its coefficients: `k²` functions × bands, band fastest.
    pub coefficients: &'a [f64],
    /// What may be read of it, by band.
    pub limits: &'a [Limits],
}

impl Field {
    /// The same everywhere: one value per band.
    pub fn even(values: &[f64]) -> Self {
        Self::new(Basis::Haar, values.len(), vec![Node::Leaf(0)], values.to_vec())
    }

    /// A field of these nodes and coefficients.
    pub fn new(basis: Basis, bands: usize, nodes: Vec<Node>, coefficients: Vec<f64>) -> Self {
        Self { basis, bands, nodes, coefficients, limits: FieldLimits::default() }
    }

    /// Number of leaves.
    pub fn leaves(&self) -> u64 {
        (self.coefficients.len() / (self.basis.len() * self.bands)) as u64
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + self.nodes.capacity() * size_of::<Node>() + 8 * self.coefficients.capacity()
    }

    /// `∫E dA` over `surface`, whose field this is, in W, per band.
    pub fn power_w(&self, surface: &Surface) -> Vec<f64> {
        let mut sum_w = vec![0.0; self.bands];
        self.for_each_power(surface, &mut |_, _, power_w| {
            sum_w.iter_mut().zip(power_w).for_each(|(sum_w, power_w)| *sum_w += power_w);
        });
        sum_w
    }

    /// Calls `visit` for the cell of every leaf, in depth-first order, with the area in m² that the polygon of `surface`, whose field this is, has in
    /// it, and `∫E dA` over that in W, per band.
    pub fn for_each_power(&self, surface: &Surface, visit: &mut dyn FnMut(&Cell, f64, &[f64])) {
        let mut power_w = vec![0.0; self.bands];
        self.for_each_node(&mut |_, leaf| {
            let area_m2 = surface.frame.area_m2 * leaf.cell.area();
            let mut of = [0.0; MAX_FUNCTIONS];
            // The functions are orthonormal: on a whole cell only the constant one has a mean.
            of[0] = 1.0;
            if !surface.full {
                let part = clip_to_cell(&surface.outline, &leaf.cell);
                let part: Vec<_> = part.iter().map(|p| leaf.cell.to_local(*p)).collect();
                of = moments(&part, self.basis);
            }
            power_w.fill(0.0);
            for (moment, coefficients) in of.iter().zip(leaf.coefficients.chunks(self.bands)) {
                for (power_w, coefficient) in power_w.iter_mut().zip(coefficients) {
                    *power_w += area_m2 * moment * coefficient;
                }
            }
            visit(&leaf.cell, area_m2 * of[0], &power_w);
        });
    }

    /// Calls `visit` for every leaf, in depth-first order.
    pub fn for_each_leaf<'a>(&'a self, visit: &mut dyn FnMut(Leaf<'a>)) {
        self.for_each_node(&mut |node, leaf| visit(self.within_limits(node, leaf)));
    }

    /// Calls `visit` for every leaf, with its node, in depth-first order; without limits.
    pub fn for_each_node<'a>(&'a self, visit: &mut dyn FnMut(usize, Leaf<'a>)) {
        let mut stack = vec![(0usize, Cell::UNIT)];
        while let Some((index, cell)) = stack.pop() {
            match self.nodes[index] {
                Node::Outside => {}
                Node::Leaf(start) => visit(index, self.bare(start, cell)),
                Node::Inner(split, first) => {
                    for i in (0..split.children().len()).rev() {
                        stack.push((first as usize + i, cell.child(split, i)));
                    }
                }
            }
        }
    }

    /// The leaf that holds `uv` (clamped to the unit square); `None` outside the polygon's cells.
    pub fn leaf_at(&self, uv: DVec2) -> Option<Leaf<'_>> {
        self.leaf_at_bare(uv).map(|(node, leaf)| self.within_limits(node, leaf))
    }

    /// As [`Field::leaf_at`], with its node and without limits.
    pub(super) fn leaf_at_bare(&self, uv: DVec2) -> Option<(usize, Leaf<'_>)> {
        let uv = uv.clamp(DVec2::ZERO, DVec2::ONE);
        let (mut index, mut cell) = (0usize, Cell::UNIT);
        loop {
            match self.nodes[index] {
                Node::Outside => return None,
                Node::Leaf(start) => return Some((index, self.bare(start, cell))),
                Node::Inner(split, first) => {
                    let child = split.child_at(cell.to_local(uv));
                    index = first as usize + child;
                    cell = cell.child(split, child);
                }
            }
        }
    }

    /// A leaf of node `index`, which has this cell, with its limits.
    pub fn within_limits<'a>(&'a self, index: usize, leaf: Leaf<'a>) -> Leaf<'a> {
        let limits = self.limits.0.get_or_init(|| limits(self));
        Leaf { limits: &limits[index * self.bands..(index + 1) * self.bands], ..leaf }
    }

    /// The leaf with this cell whose coefficients start there, without limits.
    pub fn bare(&self, start: u32, cell: Cell) -> Leaf<'_> {
        let (start, length) = (start as usize, self.basis.len() * self.bands);
        Leaf { cell, coefficients: &self.coefficients[start..start + length], limits: &[] }
    }

    /// Irradiance at `uv` in W/m², one value per band, written to `out`; zeros outside the polygon's cells.
    pub fn irradiance(&self, uv: DVec2, out: &mut [f64]) {
        out.fill(0.0);
        if let Some(leaf) = self.leaf_at(uv) {
            leaf.irradiance(self.basis, uv, out);
        }
    }
}

impl Leaf<'_> {
    /// Irradiance of this leaf's polynomial at `uv` of the surface within its limits, one value per band; `uv` may lie outside the leaf.
    pub fn irradiance(&self, basis: Basis, uv: DVec2, out: &mut [f64]) {
        self.polynomial(basis, uv, out);
        for (value, limits) in out.iter_mut().zip(self.limits) {
            *value = value.min(limits.high_w_m2).max(limits.low_w_m2);
        }
    }

    /// The same without limits.
    pub fn polynomial(&self, basis: Basis, uv: DVec2, out: &mut [f64]) {
        out.fill(0.0);
        let values = basis.evaluate(self.cell.to_local(uv));
        for (a, phi) in values.iter().take(basis.len()).enumerate() {
            for (band, value) in out.iter_mut().enumerate() {
                *value += phi * self.coefficients[a * self.coefficients.len() / basis.len() + band];
            }
        }
    }
}

impl Solution {
    /// Radiosity `M + ρE` on surface `index` at `uv`, in W/m² per band, written to `out`.
    pub fn radiosity(&self, index: usize, uv: DVec2, out: &mut [f64]) {
        self.fields[index].irradiance(uv, out);
        let surface = &self.surfaces[index];
        for (band, value) in out.iter_mut().enumerate() {
            *value = surface.exitance_w_m2[band] + surface.reflectance[band] * *value;
        }
    }
}
