//! A bounding volume hierarchy with eight boxes to a node, tested together in single precision ([`super::beam`]), and faces four to a
//! block, tested together in double precision ([`super::block`]).
//!
//! It is the binary tree of [`super::binned`] with inner nodes drawn together, the largest boxes first. Boxes are rounded outward and
//! told from the middle of the scene, so that the single precision never loses a face; which faces block is decided by the
//! arithmetic of [`OpaqueFaces`] alone. Faces keep the order of the binary tree's leaves.

use glam::DVec3;
use wide::f32x8;

use super::beam::{Beam, Boxes, Fan, PAD};
use super::binned::{BinaryNode, BinaryTree, MAX_DEPTH, half_area};
use super::block::{Block, Line, NO_FACE};
use super::opaque::ROUNDING;
use super::{MAX_BUNDLE, Occluder, OpaqueFaces, Shaft};
use crate::math::lanes::LANES;

const WIDTH: usize = 8;
/// A child with this bit is a leaf: below [`COUNT_SHIFT`] its first block, above it the number of further blocks.
const LEAF: u32 = 1 << 31;
const COUNT_SHIFT: u32 = 29;

/// The hierarchy.
#[derive(Clone)]
pub struct Bvh {
    faces: OpaqueFaces,
    nodes: Vec<Node>,
    blocks: Vec<Block>,
    /// Boxes are told from here.
    centre: DVec3,
    /// The greatest coordinate of a box, and as much more as [`PAD`] takes to cover what coordinates lose far from the origin.
    extent: f64,
    depth: usize,
}

#[derive(Clone)]
struct Node {
    boxes: Boxes,
    children: [u32; WIDTH],
}

/// Where a walk is: lanes of nodes that are still to be visited.
struct Walk {
    stack: [(u32, u32); MAX_DEPTH],
    depth: usize,
    node: u32,
    pending: u32,
}

impl Walk {
    fn new(pending: u32) -> Self {
        Self { stack: [(0, 0); MAX_DEPTH], depth: 0, node: 0, pending }
    }

    /// The next child, from left to right, as a lane of its node.
    #[inline]
    fn next<'a>(&mut self, nodes: &'a [Node]) -> Option<(&'a Node, usize)> {
        while self.pending == 0 {
            self.depth = self.depth.checked_sub(1)?;
            (self.node, self.pending) = self.stack[self.depth];
        }
        let lane = self.pending.trailing_zeros() as usize;
        self.pending &= self.pending - 1;
        Some((&nodes[self.node as usize], lane % WIDTH))
    }

    /// Goes down to these lanes of a node.
    #[inline]
    fn enter(&mut self, node: u32, pending: u32) {
        if self.pending != 0 {
            self.stack[self.depth] = (self.node, self.pending);
            self.depth += 1;
        }
        (self.node, self.pending) = (node, pending);
    }
}

impl Bvh {
    /// Builds the hierarchy over `faces`.
    pub fn new(faces: OpaqueFaces) -> Self {
        let tree = BinaryTree::new(&faces);
        let (nodes, blocks) = (Vec::new(), Vec::new());
        let Some(root) = tree.nodes.first() else {
            return Self { faces, nodes, blocks, centre: DVec3::ZERO, extent: 0.0, depth: 0 };
        };
        let centre = 0.5 * (root.low + root.high);
        // An edge and a segment that passes it each lose as much as both told from the origin.
        let lost = 2.0 * ROUNDING * root.low.abs().max(root.high.abs()).element_sum();
        let extent =
            (0.5 * (root.high - root.low)).max_element() * (1.0 + f64::from(f32::EPSILON)) + lost / PAD;
        let mut bvh = Self { faces, nodes, blocks, centre, extent, depth: 0 };
        bvh.collapse(&tree, 0, 1);
        bvh
    }

    /// Makes a node of a subtree; returns its index.
    fn collapse(&mut self, tree: &BinaryTree, root: u32, depth: usize) -> u32 {
        self.depth = self.depth.max(depth);
        let mut members = vec![root];
        while members.len() < WIDTH {
            let area = |i: &usize| {
                let node = &tree.nodes[members[*i] as usize];
                half_area(node.low, node.high)
            };
            let inner = (0..members.len()).filter(|i| tree.nodes[members[*i] as usize].count == 0);
            let Some(largest) = inner.max_by(|i, j| area(i).total_cmp(&area(j))) else { break };
            let opened = members[largest];
            members.splice(largest..=largest, [opened + 1, tree.nodes[opened as usize].start]);
        }
        let index = self.nodes.len();
        let of_members: Vec<&BinaryNode> = members.iter().map(|m| &tree.nodes[*m as usize]).collect();
        self.nodes.push(Node { boxes: self.boxes(&of_members), children: [0; WIDTH] });
        for (lane, node) in of_members.iter().enumerate() {
            self.nodes[index].children[lane] = match node.count {
                0 => self.collapse(tree, members[lane], depth + 1),
                count => self.add_leaf(&tree.order[node.start as usize..(node.start + count) as usize]),
            };
        }
        index as u32
    }

    /// The boxes of at most eight nodes; the other lanes hold boxes that nothing meets.
    fn boxes(&self, nodes: &[&BinaryNode]) -> Boxes {
        let side = |axis: usize, high: bool| {
            f32x8::from(std::array::from_fn::<f32, WIDTH, _>(|lane| match (nodes.get(lane), high) {
                (None, false) => f32::MAX,
                (None, true) => f32::MIN,
                (Some(node), false) => ((node.low - self.centre)[axis] as f32).next_down(),
                (Some(node), true) => ((node.high - self.centre)[axis] as f32).next_up(),
            }))
        };
        std::array::from_fn(|i| side(i % 3, i >= 3))
    }

    fn add_leaf(&mut self, list: &[u32]) -> u32 {
        let first = self.blocks.len() as u32;
        self.blocks.extend(list.chunks(LANES).map(|chunk| Block::new(&self.faces, chunk)));
        LEAF | (self.blocks.len() as u32 - first - 1) << COUNT_SHIFT | first
    }

    /// Which of the `open` segments from `from` along these no face blocks; the last face that blocks one goes to `last`.
    #[inline]
    fn search(&self, from: DVec3, along: &[DVec3], skip: [u32; 2], mut open: u32, last: &mut u32) -> u32 {
        let (mut least, mut greatest) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (i, along) in along.iter().enumerate() {
            if open >> i & 1 != 0 {
                (least, greatest) = (least.min(*along), greatest.max(*along));
            }
        }
        let beam = Beam::new(from - self.centre, least, greatest, 1.0, self.extent);
        let (Some(beam), Some(root)) = (beam, self.nodes.first()) else { return open };
        let mut walk = Walk::new(beam.meets(&root.boxes));
        let fan = (along.len() > 1).then(|| Fan::new(&beam, from - self.centre, along));
        while open != 0
            && let Some((node, lane)) = walk.next(&self.nodes)
        {
            let child = node.children[lane];
            if child & LEAF == 0 {
                walk.enter(child, beam.meets(&self.nodes[child as usize].boxes));
                continue;
            }
            let mut near = fan.as_ref().map_or(open, |fan| open & fan.meets(&node.boxes, lane));
            for block in self.leaf(child) {
                if near == 0 {
                    break;
                }
                let blocked = block.blocked(&self.faces, from, along, skip, near, last);
                (near, open) = (near & !blocked, open & !blocked);
            }
        }
        open
    }

    #[inline]
    fn leaf(&self, child: u32) -> &[Block] {
        let first = (child & ((1 << COUNT_SHIFT) - 1)) as usize;
        &self.blocks[first..=first + (child >> COUNT_SHIFT & 3) as usize]
    }
}

impl Occluder for Bvh {
    fn faces(&self) -> &OpaqueFaces {
        &self.faces
    }

    fn blocker(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> Option<u32> {
        let mut last = NO_FACE;
        (self.search(from, &[to - from], skip, 1, &mut last) == 0).then_some(last)
    }

    fn blocked(&self, from: DVec3, to: &[DVec3], skip: [u32; 2], last: &mut u32) -> u32 {
        assert!(to.len() <= MAX_BUNDLE, "{} segments at once, at most {MAX_BUNDLE} are answered", to.len());
        let all = (1u64 << to.len()) - 1;
        let mut along = [DVec3::ZERO; MAX_BUNDLE];
        let along = &mut along[..to.len()];
        let mut open = all as u32;
        let known = (*last as usize) < self.faces.len() && !skip.contains(last);
        let likely = known.then_some(*last);
        for (i, target) in to.iter().enumerate() {
            along[i] = target - from;
            if likely.is_some_and(|face| self.faces.blocks(face, from, along[i])) {
                open &= !(1 << i);
            }
        }
        all as u32 & !self.search(from, along, skip, open, last)
    }

    fn any_blocks(
        &self,
        from: DVec3,
        to: DVec3,
        skip: [u32; 2],
        is_wanted: &mut dyn FnMut(u32) -> bool,
    ) -> bool {
        let along = to - from;
        let beam = Beam::new(from - self.centre, along, along, 1.0, self.extent);
        let (Some(beam), Some(root)) = (beam, self.nodes.first()) else { return false };
        let mut found = false;
        let mut walk = Walk::new(beam.meets(&root.boxes));
        while !found && let Some((node, lane)) = walk.next(&self.nodes) {
            let child = node.children[lane];
            if child & LEAF == 0 {
                walk.enter(child, beam.meets(&self.nodes[child as usize].boxes));
                continue;
            }
            let mut last = NO_FACE;
            let is_met = |block: &&Block| block.blocked(&self.faces, from, &[along], skip, 1, &mut last) != 0;
            let faces = self.leaf(child).iter().filter(is_met).flat_map(|block| block.face);
            let blocks = |face: &u32| !skip.contains(face) && self.faces.blocks(*face, from, along);
            found = faces.take_while(|face| *face != NO_FACE).filter(blocks).any(&mut *is_wanted);
        }
        found
    }

    fn candidates(&self, shaft: &Shaft, skip: [u32; 2], limit: usize, out: &mut Vec<u32>) -> bool {
        let start = out.len();
        let Some(root) = self.nodes.first() else { return true };
        let sides = shaft.told_from(self.centre, self.extent);
        let mut walk = Walk::new(sides.may_hold(&root.boxes));
        while let Some((node, lane)) = walk.next(&self.nodes) {
            let child = node.children[lane];
            if child & LEAF == 0 {
                walk.enter(child, sides.may_hold(&self.nodes[child as usize].boxes));
                continue;
            }
            let faces = self.leaf(child).iter().flat_map(|block| block.face);
            for face in faces.take_while(|face| *face != NO_FACE) {
                if !skip.contains(&face) && shaft.may_hold(&self.faces, face) {
                    if out.len() - start == limit {
                        out.truncate(start);
                        return false;
                    }
                    out.push(face);
                }
            }
        }
        true
    }

    fn first_hit(&self, origin: DVec3, direction: DVec3) -> Option<(u32, f64)> {
        let mut beam = Beam::new(origin - self.centre, direction, direction, f64::INFINITY, self.extent)?;
        let line = Line::new(origin, direction);
        let mut walk = Walk::new(beam.meets(&self.nodes.first()?.boxes));
        let mut nearest: Option<(u32, f64)> = None;
        while let Some((node, lane)) = walk.next(&self.nodes) {
            let child = node.children[lane];
            if child & LEAF == 0 {
                walk.enter(child, beam.meets(&self.nodes[child as usize].boxes));
                continue;
            }
            for block in self.leaf(child) {
                let reach = nearest.map_or(f64::INFINITY, |(_, t)| t);
                block.hits(&self.faces, &line, reach, |face, t| {
                    // Of faces at the same place the first one counts.
                    if nearest.is_none_or(|(f, s)| t < s || t == s && face < f) {
                        nearest = Some((face, t));
                    }
                });
            }
            if let Some((_, t)) = nearest {
                beam.shorten(t);
            }
        }
        nearest
    }

    fn bytes(&self) -> usize {
        self.faces.bytes() + size_of_val(&*self.nodes) + size_of_val(&*self.blocks)
    }

    fn depth(&self) -> usize {
        self.depth
    }

    fn replica(&self) -> Option<Box<dyn Occluder + Send>> {
        Some(Box::new(self.clone()))
    }
}
