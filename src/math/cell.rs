//! Cells: axis-aligned boxes in the unit square of a surface's parametrisation, and how they are split.

use glam::DVec2;
use serde::{Deserialize, Serialize};

/// A box in the unit square: lower corner and extent, exact dyadic numbers down to level 52.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Lower corner.
    pub low: DVec2,
    /// Extent in u and v.
    pub size: DVec2,
}

/// How a cell is divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Split {
    /// In two halves along u.
    U,
    /// In two halves along v.
    V,
    /// In four quarters.
    Both,
}

impl Split {
    /// The halves (s, t) of each child in order: 0 or 1 in a split direction, `None` where the child spans the parent.
    pub fn children(self) -> &'static [(Option<usize>, Option<usize>)] {
        match self {
            Split::U => &[(Some(0), None), (Some(1), None)],
            Split::V => &[(None, Some(0)), (None, Some(1))],
            Split::Both => &[(Some(0), Some(0)), (Some(1), Some(0)), (Some(0), Some(1)), (Some(1), Some(1))],
        }
    }

    /// The index of the child that holds a point given in the parent's own unit square.
    pub fn child_at(self, local: DVec2) -> usize {
        let (right, upper) = ((local.x >= 0.5) as usize, (local.y >= 0.5) as usize);
        match self {
            Split::U => right,
            Split::V => upper,
            Split::Both => right + 2 * upper,
        }
    }
}

impl Cell {
    /// The whole unit square.
    pub const UNIT: Cell = Cell { low: DVec2::ZERO, size: DVec2::ONE };

    /// Child number `index` of this cell under `split`.
    pub fn child(&self, split: Split, index: usize) -> Cell {
        let (s, t) = split.children()[index];
        let part = |low: f64, size: f64, half: Option<usize>| match half {
            None => (low, size),
            Some(side) => (low + side as f64 * 0.5 * size, 0.5 * size),
        };
        let ((u, du), (v, dv)) = (part(self.low.x, self.size.x, s), part(self.low.y, self.size.y, t));
        Cell { low: DVec2::new(u, v), size: DVec2::new(du, dv) }
    }

    /// From this cell's own unit square to the surface's.
    pub fn to_surface(&self, local: DVec2) -> DVec2 {
        self.low + self.size * local
    }

    /// From the surface's unit square to this cell's own.
    pub fn to_local(&self, uv: DVec2) -> DVec2 {
        (uv - self.low) / self.size
    }

    /// Area as a share of the surface's parallelogram.
    pub fn area(&self) -> f64 {
        self.size.x * self.size.y
    }

    /// The middle.
    pub fn centre(&self) -> DVec2 {
        self.low + 0.5 * self.size
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_tile_their_parent_and_are_found_by_point() {
        let parent = Cell { low: DVec2::new(0.25, 0.5), size: DVec2::new(0.25, 0.125) };
        for split in [Split::U, Split::V, Split::Both] {
            let children: Vec<Cell> = (0..split.children().len()).map(|i| parent.child(split, i)).collect();
            assert_eq!(children.iter().map(Cell::area).sum::<f64>(), parent.area());
            for (i, child) in children.iter().enumerate() {
                assert_eq!(split.child_at(parent.to_local(child.centre())), i);
            }
        }
    }
}
