//! Emission packets: an immutable, compact snapshot of what one surface has to shoot, as a tree of cells.
//!
//! The paper's "lazy copy": receivers read the packet while the emitter's own tree may change. A packet holds levels only as deep as their detail
//! matters; deeper ones are made on the fly by pushing coefficients down.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, OnceLock};

use glam::{DVec2, DVec3};
use wide::f64x4;

use super::nodes::Nodes;
use super::recent::Recent;
use super::recording::Unit;
use crate::math::basis::MAX_FUNCTIONS;
use crate::math::chance::coarse;
use crate::math::{Basis, Cell, Split, polygon};
use crate::scene::{Frame, Surface};

/// What one surface has to shoot, `N` bands.
#[derive(Clone, Debug)]
pub struct Packet<const N: usize> {
    /// Which packet it is; its copies are the same.
    id: u64,
    /// Index of the surface.
    pub surface: u32,
    /// Its face, which never shadows it.
    pub face: u32,
    /// The parallelogram.
    pub frame: Frame,
    /// The polygon in the frame's parameters; `None` where it is the whole parallelogram.
    pub outline: Option<Box<[DVec2]>>,
    /// The basis of the coefficients.
    pub basis: Basis,
    /// Nodes; the root is number 0, the children of a node stand side by side.
    pub nodes: Vec<PacketNode<N>>,
    /// Quadrature on the root, 1 × 1 to 3 × 3 nodes, made when first asked for: of many packets most are only looked at from afar.
    root_nodes: [OnceLock<Box<Nodes<N>>>; 3],
}

/// How far the radiosity below a cell differs from the cell's polynomial, in W/m², all bands.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Detail {
    /// RMS over the cell.
    pub rms_w_m2: f64,
    /// Bound on the largest difference.
    pub max_w_m2: f64,
}

impl Detail {
    /// The detail that counts for points that see the cell at these ratios of its size to its distance. Near by the kernel picks out a part
    /// of the cell; far away it is a polynomial itself and the detail's vanishing moments of this order make it fade.
    #[inline]
    pub fn seen_w_m2(&self, ratio: f64x4, order: usize) -> f64x4 {
        let far = ratio.fast_min(f64x4::ONE);
        let fading = [far, far * far, far * (far * far)][order.clamp(1, 3) - 1];
        let near = f64x4::splat(self.rms_w_m2) * ratio.fast_max(f64x4::ONE);
        near.fast_min(f64x4::splat(self.max_w_m2)) * fading
    }
}

/// One cell of a packet.
#[derive(Clone, Debug)]
pub struct PacketNode<const N: usize> {
    /// Coefficients of the unshot radiosity in W/m².
    pub coefficients: [[f64; N]; MAX_FUNCTIONS],
    /// What this cell's polynomial leaves out.
    pub detail: Detail,
    /// How it is divided and its first child's index.
    pub children: Option<(Split, u32)>,
}

/// A cell of an emitter on the way down: a packet's node, or a part of one.
#[derive(Clone, Debug)]
pub struct EmitterCell<const N: usize> {
    /// Where it lies.
    pub cell: Cell,
    /// The node, where it is one.
    pub node: Option<u32>,
    /// Coefficients of the radiosity on it.
    pub coefficients: [[f64; N]; MAX_FUNCTIONS],
    /// The emitting polygon within the cell, in the surface's parameters; `None` where the whole cell emits.
    pub outline: Option<Arc<[DVec2]>>,
    /// Splits below the packet's deepest level.
    pub virtual_depth: u8,
    /// How it belongs to its node, where links are recorded.
    pub(super) unit: Option<Box<Unit>>,
}

impl<const N: usize> Packet<N> {
    /// Middle and radius in metres of a sphere around the parallelogram.
    pub(super) fn sphere(&self) -> (DVec3, f64) {
        let (u, v) = (self.frame.u, self.frame.v);
        (self.frame.point(DVec2::splat(0.5)), 0.5 * (u + v).length().max((u - v).length()))
    }

    /// The packet of the surface with this index; `nodes` as in [`Packet::nodes`].
    pub fn new(
        index: u32,
        face: u32,
        frame: Frame,
        outline: Option<Box<[DVec2]>>,
        basis: Basis,
        nodes: Vec<PacketNode<N>>,
    ) -> Self {
        static PACKETS: AtomicU64 = AtomicU64::new(0);
        let id = PACKETS.fetch_add(1, Relaxed);
        Self { id, surface: index, face, frame, outline, basis, nodes, root_nodes: Default::default() }
    }

    /// A number that no other packet has, whatever it holds, but its copies do.
    pub(super) fn id(&self) -> u64 {
        self.id
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        let made = self.root_nodes.iter().filter(|nodes| nodes.get().is_some()).count();
        self.bytes_with(made)
    }

    /// Bytes that it takes at most, with all quadrature on the root.
    pub fn most_bytes(&self) -> usize {
        self.bytes_with(self.root_nodes.len())
    }

    fn bytes_with(&self, quadratures: usize) -> usize {
        let outline = self.outline.as_deref().map_or(0, size_of_val);
        let nodes = self.nodes.capacity() * size_of::<PacketNode<N>>();
        size_of::<Self>() + nodes + quadratures * size_of::<Nodes<N>>() + outline
    }

    /// The n × n nodes of the root, for n up to 3.
    #[inline]
    pub fn root_nodes(&self, n: usize) -> &Nodes<N> {
        self.root_nodes[n - 1].get_or_init(|| Box::new(Nodes::of_cell(self, &self.root(), n)))
    }

    /// The whole emitter.
    pub fn root(&self) -> EmitterCell<N> {
        self.root_within(self.outline.as_deref().map(Arc::from))
    }

    /// The whole emitter, with its outline from among those that a worker remembers.
    pub(super) fn root_of(&self, outlines: &mut RecentOutlines) -> EmitterCell<N> {
        let remembered = |outline: &[DVec2]| {
            let whole = outlines.get((self.id, Cell::UNIT, 0), |_| Shape::Part(Arc::from(outline), 1.0));
            whole.outline().cloned()
        };
        self.root_within(self.outline.as_deref().and_then(remembered))
    }

    fn root_within(&self, outline: Option<Arc<[DVec2]>>) -> EmitterCell<N> {
        let coefficients = self.nodes[0].coefficients;
        EmitterCell { cell: Cell::UNIT, node: Some(0), coefficients, outline, virtual_depth: 0, unit: None }
    }

    /// How `emitter` divides: as the packet does, else across its longer side, or both ways where the sides are alike.
    pub fn split_of(&self, emitter: &EmitterCell<N>) -> Split {
        if let Some((split, _)) = emitter.node.and_then(|n| self.nodes[n as usize].children) {
            return split;
        }
        let (du, dv) =
            (self.frame.u.length() * emitter.cell.size.x, self.frame.v.length() * emitter.cell.size.y);
        if du > 1.9 * dv {
            Split::U
        } else if dv > 1.9 * du {
            Split::V
        } else {
            Split::Both
        }
    }

    /// Child number `index` of `emitter`; `None` where nothing of the polygon lies in it.
    pub fn child(
        &self,
        emitter: &EmitterCell<N>,
        split: Split,
        index: usize,
        outlines: &mut RecentOutlines,
    ) -> Option<EmitterCell<N>> {
        let cell = emitter.cell.child(split, index);
        let outline = match &emitter.outline {
            None => None,
            Some(outline) => {
                match outlines.get((self.id, cell, 0), |_| Shape::cut(outline, &cell).map(Arc::from)) {
                    Shape::Outside => return None,
                    part => part.outline().cloned(),
                }
            }
        };
        let node = emitter.node.and_then(|n| self.nodes[n as usize].children).map(|(_, c)| c + index as u32);
        let coefficients = match node {
            Some(n) => self.nodes[n as usize].coefficients,
            None => {
                let mut pushed = [[0.0; N]; MAX_FUNCTIONS];
                self.basis.push(split, index, &emitter.coefficients, &mut pushed);
                pushed
            }
        };
        let virtual_depth = if node.is_some() { 0 } else { emitter.virtual_depth + 1 };
        let unit = emitter.unit.as_ref().map(|unit| match node {
            Some(n) => Box::new(Unit::of_node(self.basis, n, cell, outline.clone())),
            None => Box::new(unit.part(self.basis, split, index, outline.clone())),
        });
        Some(EmitterCell { cell, node, coefficients, outline, virtual_depth, unit })
    }
}

impl<const N: usize> PacketNode<N> {
    /// Root of the mean square over the cell, all bands, of what its polynomial sends.
    pub(super) fn strength_w_m2(&self) -> f64 {
        self.coefficients.iter().flatten().map(|c| c * c).sum::<f64>().sqrt()
    }
}

impl<const N: usize> EmitterCell<N> {
    /// The corners of the cell in space, counter-clockwise.
    pub fn hull(&self, frame: &Frame) -> [DVec3; 4] {
        cell_corners(&self.cell).map(|corner| frame.point(corner))
    }

    /// The corners of the emitting polygon (the cell where all of it emits) in space, counter-clockwise.
    pub fn corners<'a>(&'a self, frame: &'a Frame) -> impl Iterator<Item = DVec3> + Clone + 'a {
        let whole = cell_corners(&self.cell);
        let count = self.outline.as_ref().map_or(4, |o| o.len());
        (0..count).map(move |i| frame.point(self.outline.as_ref().map_or_else(|| whole[i], |o| o[i])))
    }
}

/// Puts packets in an order that follows from where they lie, as far as rounding does not reach, whatever the numbers of their surfaces:
/// receivers look at them in their order, and what one of them needs decides what the next ones find.
pub fn by_place<const N: usize>(packets: &mut [Packet<N>]) {
    let middle = |packet: &Packet<N>| packet.sphere().0;
    let low = packets.iter().map(middle).fold(DVec3::INFINITY, DVec3::min);
    let high = packets.iter().map(middle).fold(DVec3::NEG_INFINITY, DVec3::max);
    let size = (high - low).max_element().max(f64::MIN_POSITIVE);
    packets.sort_by_cached_key(|packet| {
        let area = packet.frame.area_m2 / (size * size);
        ([(middle(packet) - low) / size, packet.frame.normal].map(|v| v.to_array().map(coarse)), coarse(area))
    });
}

/// The corners of a cell, counter-clockwise.
pub fn cell_corners(cell: &Cell) -> [DVec2; 4] {
    let (low, high) = (cell.low, cell.low + cell.size);
    [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)]
}

/// How emitter cells that a worker divided to lately lie to their polygons.
pub type RecentOutlines = Recent<Shape<Arc<[DVec2]>>>;

/// How a cell lies to a surface's polygon; `O` holds the outline where it is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape<O = Box<[DVec2]>> {
    /// The cell lies inside.
    Whole,
    /// They do not overlap.
    Outside,
    /// The part of the polygon inside the cell, in the surface's parameters, and its share of the cell's area.
    Part(O, f64),
}

impl Shape {
    /// How the polygon lies in the surface's whole parallelogram.
    pub fn of_surface(surface: &Surface) -> Self {
        if surface.full { Shape::Whole } else { Self::cut(&surface.outline, &Cell::UNIT) }
    }

    /// Cuts a polygon to a cell. Shares of the cell below 1e-9 count as none, above 1 − 1e-9 as all.
    pub fn cut(outline: &[DVec2], cell: &Cell) -> Self {
        let part = polygon::clip_to_cell(outline, cell);
        let share = if part.len() < 3 { 0.0 } else { polygon::area(&part) / cell.area() };
        if share < 1e-9 {
            Shape::Outside
        } else if share > 1.0 - 1e-9 {
            Shape::Whole
        } else {
            Shape::Part(part.into_boxed_slice(), share)
        }
    }
}

impl Shape<&[DVec2]> {
    /// The shape of the child cell within this shape's cell.
    pub fn of_child(&self, child: &Cell) -> Shape {
        match self {
            Shape::Part(outline, _) => Shape::cut(outline, child),
            Shape::Whole => Shape::Whole,
            Shape::Outside => Shape::Outside,
        }
    }
}

impl<O> Shape<O> {
    /// The outline where the cell is cut.
    fn outline(&self) -> Option<&O> {
        match self {
            Shape::Part(outline, _) => Some(outline),
            Shape::Whole | Shape::Outside => None,
        }
    }

    /// The same shape, its outline made into another kind.
    pub fn map<P>(self, kind: impl FnOnce(O) -> P) -> Shape<P> {
        match self {
            Shape::Whole => Shape::Whole,
            Shape::Outside => Shape::Outside,
            Shape::Part(outline, share) => Shape::Part(kind(outline), share),
        }
    }

    /// The share of the cell that belongs to the polygon.
    pub fn share(&self) -> f64 {
        match self {
            Shape::Whole => 1.0,
            Shape::Outside => 0.0,
            Shape::Part(_, share) => *share,
        }
    }
}
