//! Binary space partition, the structure of the paper: space is halved by planes across the axes until few faces are left in a cell.
//!
//! Where a plane goes is decided by the surface-area heuristic over [`BINS`] places per axis (MacDonald and Booth 1990). A face is
//! listed in every cell that its box and its plane reach, so some are tested twice; cells reach [`OVERLAP`] further than their
//! planes, so that rounding never sends a segment past a face. Walked front to back, with segment and faces in double precision.

use glam::DVec3;

use super::binned::half_area;
use super::{Occluder, OpaqueFaces, Shaft};

const BINS: usize = 32;
const LEAF_FACES: usize = 4;
/// Cost of a step down, relative to that of testing a face.
const STEP_COST: f64 = 0.7;
/// Longest path from the root.
const MAX_DEPTH: usize = 48;
/// Share of the scene's size by which cells overlap: more than faces ever reach beyond their edges, but for rounding of coordinates.
const OVERLAP: f64 = 1e-6;
/// Share of coordinates that rounding may take from where a segment crosses a plane.
const ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Kinds of nodes from here on are leaves.
const LEAF: u32 = 3;

/// The partition.
#[derive(Clone)]
pub struct Bsp {
    faces: OpaqueFaces,
    nodes: Vec<Node>,
    lists: Vec<u32>,
    root: Cell,
    depth: usize,
}

#[derive(Clone, Copy)]
struct Node {
    /// Inner: where the plane lies.
    plane: f64,
    /// Inner: the child above the plane (the one below follows its parent); leaf: the first entry of `lists`.
    start: u32,
    /// Inner: the plane's axis; leaf: [`LEAF`] and the number of faces.
    kind: u32,
}

/// A cell's corners.
#[derive(Clone, Copy)]
struct Cell {
    low: DVec3,
    high: DVec3,
}

impl Cell {
    fn halves(self, axis: usize, plane: f64) -> [Cell; 2] {
        let (mut below, mut above) = (self, self);
        below.high[axis] = plane;
        above.low[axis] = plane;
        [below, above]
    }

    fn grown(self, by: f64) -> Cell {
        Cell { low: self.low - by, high: self.high + by }
    }

    /// By how much cells of a scene in this one overlap.
    fn overlap(self) -> f64 {
        let coordinates = self.low.abs().max(self.high.abs()).element_sum();
        OVERLAP * (self.high - self.low).max_element() + 4.0 * ROUNDING * coordinates
    }
}

/// A cell of a walk, and where the segment is in it.
#[derive(Clone, Copy)]
struct Stretch {
    node: u32,
    enter: f64,
    leave: f64,
}

impl Bsp {
    /// Builds the partition over `faces`.
    pub fn new(faces: OpaqueFaces) -> Self {
        let all: Vec<u32> = (0..faces.len() as u32).collect();
        let nothing = Cell { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };
        let bounds = all.iter().map(|f| faces.bounds(*f));
        let around = bounds.fold(nothing, |c, (l, h)| Cell { low: c.low.min(l), high: c.high.max(h) });
        let overlap = around.overlap();
        let mut bsp = Self { faces, nodes: Vec::new(), lists: Vec::new(), root: around, depth: 0 };
        if !all.is_empty() {
            bsp.root = around.grown(overlap);
            bsp.build(bsp.root, all, 0, overlap);
        }
        bsp
    }

    fn build(&mut self, cell: Cell, list: Vec<u32>, depth: usize, overlap: f64) {
        self.depth = self.depth.max(depth);
        let index = self.nodes.len();
        let split = (depth < MAX_DEPTH).then(|| self.best_plane(cell, &list)).flatten();
        let halves = split.and_then(|(axis, plane)| {
            let halves = cell.halves(axis, plane);
            let lists = halves.map(|half| {
                let reaches = |f: &&u32| self.reaches(**f, half.grown(overlap));
                list.iter().filter(reaches).copied().collect::<Vec<u32>>()
            });
            // A plane that keeps all faces on both sides is none.
            let parts = lists.iter().any(|half| half.len() < list.len());
            parts.then_some((axis, plane, halves, lists))
        });
        let Some((axis, plane, halves, [below, above])) = halves else {
            self.nodes.push(Node {
                plane: 0.0,
                start: self.lists.len() as u32,
                kind: LEAF + list.len() as u32,
            });
            self.lists.extend(list);
            return;
        };
        drop(list);
        self.nodes.push(Node { plane, start: 0, kind: axis as u32 });
        self.build(halves[0], below, depth + 1, overlap);
        self.nodes[index].start = self.nodes.len() as u32;
        self.build(halves[1], above, depth + 1, overlap);
    }

    /// Whether a face's box and plane reach a cell.
    fn reaches(&self, face: u32, cell: Cell) -> bool {
        let (low, high) = self.faces.bounds(face);
        if low.cmpgt(cell.high).any() || high.cmplt(cell.low).any() {
            return false;
        }
        let (normal, offset) = self.faces.plane(face);
        let (middle, half) = (0.5 * (cell.low + cell.high), 0.5 * (cell.high - cell.low));
        let off = (normal.dot(middle) - offset).abs();
        // A face without a normal is hit by nothing.
        off <= normal.abs().dot(half) + ROUNDING * (offset.abs() + middle.length())
    }

    /// The plane of the least cost; `None` where a leaf is cheaper.
    fn best_plane(&self, cell: Cell, list: &[u32]) -> Option<(usize, f64)> {
        if list.len() <= LEAF_FACES {
            return None;
        }
        let whole = half_area(cell.low, cell.high);
        let mut best = (list.len() as f64, None);
        for axis in 0..3 {
            let (low, extent) = (cell.low[axis], cell.high[axis] - cell.low[axis]);
            if extent <= 0.0 {
                continue;
            }
            let bin = |x: f64| (((x - low) / extent * BINS as f64) as usize).min(BINS - 1);
            // Faces that begin and end in each bin.
            let mut ends = [(0usize, 0usize); BINS];
            for face in list {
                let (l, h) = self.faces.bounds(*face);
                ends[bin(l[axis])].0 += 1;
                ends[bin(h[axis])].1 += 1;
            }
            let (mut below, mut above) = (0, list.len());
            for i in 1..BINS {
                below += ends[i - 1].0;
                above -= ends[i - 1].1;
                let plane = low + extent * i as f64 / BINS as f64;
                let [a, b] = cell.halves(axis, plane);
                let share = |half: Cell, count: usize| half_area(half.low, half.high) * count as f64;
                let cost = STEP_COST + (share(a, below) + share(b, above)) / whole;
                if cost < best.0 {
                    best = (cost, Some((axis, plane)));
                }
            }
        }
        best.1
    }

    /// Calls `visit` with the faces of each cell that `from + t · along`, t in 0…`reach`, passes, from front to back; `visit` returns the
    /// new reach.
    #[inline]
    fn walk(&self, from: DVec3, along: DVec3, mut reach: f64, mut visit: impl FnMut(&[u32], f64) -> f64) {
        let inverse = along.recip();
        let Some((enter, leave)) = self.inside(from, inverse, reach) else { return };
        let mut stack = [Stretch { node: 0, enter, leave }; MAX_DEPTH + 1];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let Stretch { mut node, enter, mut leave } = stack[depth];
            if enter > reach {
                continue;
            }
            loop {
                let Node { plane, start, kind } = self.nodes[node as usize];
                if kind >= LEAF {
                    reach = visit(&self.lists[start as usize..][..(kind - LEAF) as usize], reach);
                    break;
                }
                let axis = kind as usize;
                let below_first = from[axis] < plane || from[axis] == plane && along[axis] <= 0.0;
                let (near, far) = if below_first { (node + 1, start) } else { (start, node + 1) };
                let crossing = (plane - from[axis]) * inverse[axis];
                let slack = ROUNDING * (from[axis].abs() + plane.abs()) * inverse[axis].abs();
                node = if !(crossing > 0.0 && crossing - slack <= leave) {
                    // It never crosses, or not before it leaves.
                    near
                } else if crossing + slack < enter {
                    far
                } else {
                    stack[depth] = Stretch { node: far, enter: enter.max(crossing - slack), leave };
                    depth += 1;
                    leave = leave.min(crossing + slack);
                    near
                };
            }
            if reach < 0.0 {
                return;
            }
        }
    }

    /// Between which t the segment is inside the root's cell.
    fn inside(&self, from: DVec3, inverse: DVec3, reach: f64) -> Option<(f64, f64)> {
        if self.nodes.is_empty() {
            return None;
        }
        let (mut enter, mut leave) = (0.0f64, reach);
        for axis in 0..3 {
            let (a, b) = (self.root.low[axis] - from[axis], self.root.high[axis] - from[axis]);
            if inverse[axis].is_infinite() {
                if a > 0.0 || b < 0.0 {
                    return None;
                }
                continue;
            }
            let (a, b) = (a * inverse[axis], b * inverse[axis]);
            let slack = ROUNDING * (a.abs() + b.abs());
            (enter, leave) = (enter.max(a.min(b) - slack), leave.min(a.max(b) + slack));
        }
        (enter <= leave).then_some((enter, leave))
    }
}

impl Occluder for Bsp {
    fn faces(&self) -> &OpaqueFaces {
        &self.faces
    }

    fn blocker(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> Option<u32> {
        let along = to - from;
        let mut found = None;
        self.walk(from, along, 1.0, |list, reach| {
            found = list.iter().copied().find(|f| !skip.contains(f) && self.faces.blocks(*f, from, along));
            if found.is_some() { -1.0 } else { reach }
        });
        found
    }

    fn any_blocks(
        &self,
        from: DVec3,
        to: DVec3,
        skip: [u32; 2],
        is_wanted: &mut dyn FnMut(u32) -> bool,
    ) -> bool {
        let (along, mut found) = (to - from, false);
        self.walk(from, along, 1.0, |list, reach| {
            let blocks = |f: &u32| !skip.contains(f) && self.faces.blocks(*f, from, along);
            found = list.iter().any(|f| blocks(f) && is_wanted(*f));
            if found { -1.0 } else { reach }
        });
        found
    }

    fn candidates(&self, shaft: &Shaft, skip: [u32; 2], limit: usize, out: &mut Vec<u32>) -> bool {
        let first = out.len();
        let overlap = self.root.overlap();
        let mut stack = vec![(0u32, self.root)];
        while let Some((index, cell)) = stack.pop() {
            let grown = cell.grown(overlap);
            let Some(node) = self.nodes.get(index as usize) else { break };
            if !shaft.may_hold_box(grown.low, grown.high) {
                continue;
            }
            if node.kind < LEAF {
                let [below, above] = cell.halves(node.kind as usize, node.plane);
                stack.extend([(node.start, above), (index + 1, below)]);
                continue;
            }
            for face in &self.lists[node.start as usize..][..(node.kind - LEAF) as usize] {
                let known = skip.contains(face) || out[first..].contains(face);
                if !known && shaft.may_hold(&self.faces, *face) {
                    if out.len() - first == limit {
                        out.truncate(first);
                        return false;
                    }
                    out.push(*face);
                }
            }
        }
        true
    }

    fn first_hit(&self, origin: DVec3, direction: DVec3) -> Option<(u32, f64)> {
        let mut nearest: Option<(u32, f64)> = None;
        self.walk(origin, direction, f64::INFINITY, |list, _| {
            for face in list {
                if let Some(t) = self.faces.hit(*face, origin, direction)
                    && t > 0.0
                    // Of faces at the same place the first one counts.
                    && nearest.is_none_or(|(f, s)| t < s || t == s && *face < f)
                {
                    nearest = Some((*face, t));
                }
            }
            nearest.map_or(f64::INFINITY, |(_, t)| t)
        });
        nearest
    }

    fn bytes(&self) -> usize {
        self.faces.bytes() + size_of_val(&*self.nodes) + size_of_val(&*self.lists)
    }

    fn depth(&self) -> usize {
        self.depth
    }

    fn replica(&self) -> Option<Box<dyn Occluder + Send>> {
        Some(Box::new(self.clone()))
    }
}
