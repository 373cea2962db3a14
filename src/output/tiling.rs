//! The leaves of one surface as convex tiles without cracks, in the surface's parameters.
//!
//! A tile is a leaf's cell, or a convex piece of the polygon within it. Tiles list every point that lies on
//! their border, so also those where a finer neighbour ends ("hanging" vertices). Cracks can only open
//! along cell borders and the cuts of [`super::convex`], all axis-aligned lines met with bit-equal
//! coordinates; points on them are found by sorting.

use std::collections::HashMap;

use glam::DVec2;

use super::convex::{Axis, clip, pieces, snap};
use crate::math::{Basis, Cell, Split, polygon};
use crate::radiosity::{Field, Leaf, Node};
use crate::scene::Surface;

/// Share of a cell's area below which the part of the polygon in it counts as nothing, or what is missing
/// as nothing.
const NEGLIGIBLE: f64 = 1e-12;

/// A convex part of a leaf.
pub(super) struct Tile {
    /// Index into [`Tiling::leaves`].
    pub leaf: u32,
    /// Corners and hanging vertices counter-clockwise, indices into [`Tiling::points`].
    pub corners: Vec<u32>,
    /// A point inside.
    pub centre: DVec2,
}

/// The tiles of a surface.
pub(super) struct Tiling<'a> {
    /// Points in the surface's parameters, all distinct.
    pub points: Vec<DVec2>,
    /// The leaves that have tiles.
    pub leaves: Vec<Leaf<'a>>,
    /// The tiles, in the order of the leaves.
    pub tiles: Vec<Tile>,
}

impl<'a> Tiling<'a> {
    /// Tiles of `surface`'s polygon by the leaves of `field`.
    pub fn new(surface: &Surface, field: &'a Field) -> Tiling<'a> {
        let mut build = Build { field, ids: HashMap::new(), tiling: Tiling::empty() };
        build.descend(surface);
        let mut tiling = build.tiling;
        tiling.insert_hanging();
        tiling
    }

    fn empty() -> Tiling<'a> {
        Tiling { points: Vec::new(), leaves: Vec::new(), tiles: Vec::new() }
    }

    /// Adds to each tile the points of others on its axis-aligned edges.
    fn insert_hanging(&mut self) {
        let points = &self.points;
        let order = |axis: Axis| {
            let mut ids: Vec<u32> = (0..points.len() as u32).collect();
            ids.sort_unstable_by(|a, b| {
                compare(key(axis, points[*a as usize]), key(axis, points[*b as usize]))
            });
            ids
        };
        let (vertical, horizontal) = (order(Axis::U), order(Axis::V));
        for tile in &mut self.tiles {
            let mut full = Vec::with_capacity(tile.corners.len() + 4);
            for (i, a) in tile.corners.iter().enumerate() {
                let b = tile.corners[(i + 1) % tile.corners.len()];
                full.push(*a);
                let (p, q) = (points[*a as usize], points[b as usize]);
                if p.x == q.x {
                    between(points, &vertical, Axis::U, p, q, &mut full);
                } else if p.y == q.y {
                    between(points, &horizontal, Axis::V, p, q, &mut full);
                }
            }
            tile.corners = full;
        }
    }
}

/// The coordinate that is constant along a line, then the one that runs along it.
fn key(fixed: Axis, p: DVec2) -> (f64, f64) {
    match fixed {
        Axis::U => (p.x, p.y),
        Axis::V => (p.y, p.x),
    }
}

fn compare(a: (f64, f64), b: (f64, f64)) -> std::cmp::Ordering {
    a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
}

/// Appends the points strictly between `p` and `q`, in that direction; `sorted` by [`key`].
fn between(points: &[DVec2], sorted: &[u32], fixed: Axis, p: DVec2, q: DVec2, out: &mut Vec<u32>) {
    let (a, b) = (key(fixed, p), key(fixed, q));
    let (low, high) = if a.1 < b.1 { (a, b) } else { (b, a) };
    let at = |id: &u32| key(fixed, points[*id as usize]);
    let first = sorted.partition_point(|id| compare(at(id), low).is_le());
    let length = sorted[first..].partition_point(|id| compare(at(id), high).is_lt());
    let inner = &sorted[first..first + length];
    if a.1 < b.1 {
        out.extend(inner);
    } else {
        out.extend(inner.iter().rev());
    }
}

struct Build<'a> {
    field: &'a Field,
    ids: HashMap<(u64, u64), u32>,
    tiling: Tiling<'a>,
}

impl Build<'_> {
    /// Carries the polygon down the tree, cutting it at each split; `None` stands for a cell wholly inside.
    fn descend(&mut self, surface: &Surface) {
        let whole = (!surface.full).then(|| restrict(&snap(&surface.outline), &Cell::UNIT));
        let mut stack = vec![(0usize, Cell::UNIT, whole)];
        while let Some((index, cell, part)) = stack.pop() {
            let part = match part {
                Some(part) => {
                    let share = polygon::area(&part) / cell.area();
                    if share < NEGLIGIBLE {
                        continue;
                    }
                    (share < 1.0 - NEGLIGIBLE).then_some(part)
                }
                None => None,
            };
            match self.field.nodes[index] {
                Node::Outside => {}
                Node::Leaf(start) => self.leaf(index, cell, start, part),
                Node::Inner(split, first) => {
                    for i in (0..split.children().len()).rev() {
                        let child = cell.child(split, i);
                        let part = part.as_ref().map(|p| halve(p, &cell, split, &child));
                        stack.push((first as usize + i, child, part));
                    }
                }
            }
        }
    }

    fn leaf(&mut self, node: usize, cell: Cell, start: u32, part: Option<Vec<DVec2>>) {
        let leaf = self.tiling.leaves.len() as u32;
        self.tiling.leaves.push(self.field.within_limits(node, self.field.bare(start, cell)));
        match part {
            None => {
                // Quadratic functions bend within a cell: give its edges a point in the middle.
                let steps: &[(f64, f64)] = match self.field.basis {
                    Basis::M3 | Basis::Auto => &[
                        (0.0, 0.0),
                        (0.5, 0.0),
                        (1.0, 0.0),
                        (1.0, 0.5),
                        (1.0, 1.0),
                        (0.5, 1.0),
                        (0.0, 1.0),
                        (0.0, 0.5),
                    ],
                    _ => &[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)],
                };
                let corners: Vec<DVec2> =
                    steps.iter().map(|(x, y)| cell.to_surface(DVec2::new(*x, *y))).collect();
                self.tile(leaf, &corners);
            }
            Some(part) => {
                for piece in pieces(&part) {
                    self.tile(leaf, &piece);
                }
            }
        }
    }

    fn tile(&mut self, leaf: u32, corners: &[DVec2]) {
        let centre = corners.iter().sum::<DVec2>() / corners.len() as f64;
        let points = &mut self.tiling.points;
        let mut id = |p: &DVec2| {
            *self.ids.entry((p.x.to_bits(), p.y.to_bits())).or_insert_with(|| {
                points.push(*p);
                points.len() as u32 - 1
            })
        };
        let corners = corners.iter().map(&mut id).collect();
        self.tiling.tiles.push(Tile { leaf, corners, centre });
    }
}

/// The part of a polygon in one child of `cell`, cut at the lines between the children only.
fn halve(part: &[DVec2], cell: &Cell, split: Split, child: &Cell) -> Vec<DVec2> {
    let mut out = part.to_vec();
    if split != Split::V {
        let at = cell.low.x + 0.5 * cell.size.x;
        out = clip(&out, Axis::U, at, child.low.x < at);
    }
    if split != Split::U {
        let at = cell.low.y + 0.5 * cell.size.y;
        out = clip(&out, Axis::V, at, child.low.y < at);
    }
    out
}

fn restrict(outline: &[DVec2], cell: &Cell) -> Vec<DVec2> {
    let high = cell.low + cell.size;
    let out = clip(&clip(outline, Axis::U, cell.low.x, false), Axis::U, high.x, true);
    clip(&clip(&out, Axis::V, cell.low.y, false), Axis::V, high.y, true)
}
