//! A binary tree of boxes over faces by a binned surface-area heuristic (Wald 2007), from which the wide hierarchy is made.

use glam::DVec3;

use super::OpaqueFaces;

const BINS: usize = 16;
const LEAF_FACES: usize = 4;
/// From this depth on lists are halved, so that no path is longer than [`MAX_DEPTH`].
const HALVE_DEPTH: usize = 32;
/// The longest path from the root, for up to 2³² faces.
pub(super) const MAX_DEPTH: usize = 64;

/// The tree.
pub(super) struct BinaryTree {
    /// The root comes first.
    pub nodes: Vec<BinaryNode>,
    /// The faces of the leaves, from left to right.
    pub order: Vec<u32>,
    boxes: Vec<(DVec3, DVec3)>,
}

#[derive(Clone, Copy)]
pub(super) struct BinaryNode {
    pub low: DVec3,
    pub high: DVec3,
    /// Leaf: first entry of `order`; inner: the right child (the left one follows its parent).
    pub start: u32,
    /// Leaf: number of faces; inner: 0.
    pub count: u32,
}

pub(super) fn half_area(low: DVec3, high: DVec3) -> f64 {
    let d = high - low;
    d.x * d.y + d.y * d.z + d.z * d.x
}

impl BinaryTree {
    /// Builds the tree over `faces`.
    pub fn new(faces: &OpaqueFaces) -> Self {
        let all = 0..faces.len() as u32;
        let boxes = all.clone().map(|f| faces.bounds(f)).collect();
        let mut tree = Self { order: all.clone().collect(), nodes: Vec::new(), boxes };
        if !faces.is_empty() {
            let centres: Vec<DVec3> = tree.boxes.iter().map(|(low, high)| 0.5 * (low + high)).collect();
            tree.build(0, faces.len(), 0, &centres);
        }
        tree
    }

    fn bounds(&self, start: usize, end: usize) -> (DVec3, DVec3) {
        self.order[start..end].iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), f| {
            let (l, h) = self.boxes[*f as usize];
            (low.min(l), high.max(h))
        })
    }

    fn build(&mut self, start: usize, end: usize, depth: usize, centres: &[DVec3]) {
        let (low, high) = self.bounds(start, end);
        let index = self.nodes.len();
        self.nodes.push(BinaryNode { low, high, start: start as u32, count: (end - start) as u32 });
        let middle = if depth >= HALVE_DEPTH && end - start > LEAF_FACES {
            Some(start + (end - start) / 2)
        } else {
            self.partition(start, end, centres, half_area(low, high))
        };
        let Some(middle) = middle else { return };
        self.build(start, middle, depth + 1, centres);
        self.nodes[index].start = self.nodes.len() as u32;
        self.nodes[index].count = 0;
        self.build(middle, end, depth + 1, centres);
    }

    /// Orders the faces of the range around the best of the binned splits; `None` where a leaf is cheaper.
    fn partition(&mut self, start: usize, end: usize, centres: &[DVec3], area: f64) -> Option<usize> {
        let count = end - start;
        if count <= LEAF_FACES {
            return None;
        }
        let range = self.order[start..end].iter().map(|f| centres[*f as usize]);
        let (low, high) =
            range.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), c| (l.min(c), h.max(c)));
        let axis = (high - low).max_position();
        if high[axis] <= low[axis] {
            // All centres coincide: halve the list, so that leaves stay small.
            return Some(start + count / 2);
        }
        let scale = BINS as f64 / (high[axis] - low[axis]);
        let bin_of = |f: u32| (((centres[f as usize][axis] - low[axis]) * scale) as usize).min(BINS - 1);
        let mut bins = [(DVec3::INFINITY, DVec3::NEG_INFINITY, 0usize); BINS];
        for f in &self.order[start..end] {
            let (l, h) = self.boxes[*f as usize];
            let bin = &mut bins[bin_of(*f)];
            *bin = (bin.0.min(l), bin.1.max(h), bin.2 + 1);
        }
        let join =
            |a: (DVec3, DVec3, usize), b: &(DVec3, DVec3, usize)| (a.0.min(b.0), a.1.max(b.1), a.2 + b.2);
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0);
        let cost = |split: usize| {
            let (left, right) =
                (bins[..split].iter().fold(empty, join), bins[split..].iter().fold(empty, join));
            if left.2 == 0 || right.2 == 0 {
                return f64::INFINITY;
            }
            half_area(left.0, left.1) * left.2 as f64 + half_area(right.0, right.1) * right.2 as f64
        };
        let best = (1..BINS).min_by(|a, b| cost(*a).total_cmp(&cost(*b)))?;
        if cost(best) >= area * count as f64 && count <= 4 * LEAF_FACES {
            return None;
        }
        let slice = &mut self.order[start..end];
        slice.sort_by_key(|f| bin_of(*f) >= best);
        Some(start + slice.partition_point(|f| bin_of(*f) < best))
    }
}
