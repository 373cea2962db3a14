//! A binary bounding volume hierarchy over faces, built by a binned surface-area heuristic (Wald 2007).

use glam::DVec3;

use super::{Occluder, OpaqueFaces, Shaft};

const BINS: usize = 16;
const LEAF_FACES: usize = 4;
/// From this depth on lists are halved, so that the traversal stack of 64 entries always suffices.
const HALVE_DEPTH: usize = 32;

/// The hierarchy.
#[derive(Clone)]
pub struct Bvh {
    faces: OpaqueFaces,
    nodes: Vec<Node>,
    order: Vec<u32>,
}

#[derive(Clone, Copy)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// Leaf: first entry of `order`; inner: the right child (the left one follows its parent).
    start: u32,
    /// Leaf: number of faces; inner: 0.
    count: u32,
}

fn half_area(low: DVec3, high: DVec3) -> f64 {
    let d = high - low;
    d.x * d.y + d.y * d.z + d.z * d.x
}

impl Bvh {
    /// Builds the hierarchy over `faces`.
    pub fn new(faces: OpaqueFaces) -> Self {
        let mut bvh = Self { order: (0..faces.len() as u32).collect(), nodes: Vec::new(), faces };
        if !bvh.order.is_empty() {
            let centres: Vec<DVec3> = (0..bvh.faces.len() as u32)
                .map(|f| {
                    let (low, high) = bvh.faces.bounds(f);
                    0.5 * (low + high)
                })
                .collect();
            bvh.build(0, bvh.order.len(), 0, &centres);
        }
        bvh
    }

    fn bounds(&self, start: usize, end: usize) -> (DVec3, DVec3) {
        self.order[start..end].iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), f| {
            let (l, h) = self.faces.bounds(*f);
            (low.min(l), high.max(h))
        })
    }

    fn build(&mut self, start: usize, end: usize, depth: usize, centres: &[DVec3]) {
        let (low, high) = self.bounds(start, end);
        let index = self.nodes.len();
        self.nodes.push(Node { low, high, start: start as u32, count: (end - start) as u32 });
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
            let (l, h) = self.faces.bounds(*f);
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

    /// Calls `visit` with every face of every leaf whose box the segment meets before `reach`; `visit` returns the new reach.
    #[inline]
    fn along(&self, from: DVec3, along: DVec3, mut reach: f64, mut visit: impl FnMut(u32, f64) -> f64) {
        if self.nodes.is_empty() {
            return;
        }
        let inverse = along.recip();
        let mut stack = [0u32; 64];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let index = stack[depth];
            let node = &self.nodes[index as usize];
            let (a, b) = ((node.low - from) * inverse, (node.high - from) * inverse);
            let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
            // NaN (a flat box met along its plane) must count as met: compare so that it falls through.
            if near > far.min(reach) || far < 0.0 {
                continue;
            }
            if node.count > 0 {
                for f in &self.order[node.start as usize..(node.start + node.count) as usize] {
                    reach = visit(*f, reach);
                    if reach < 0.0 {
                        return;
                    }
                }
            } else {
                debug_assert!(depth + 2 <= stack.len());
                stack[depth] = node.start;
                stack[depth + 1] = index + 1;
                depth += 2;
            }
        }
    }
}

impl Occluder for Bvh {
    fn faces(&self) -> &OpaqueFaces {
        &self.faces
    }

    fn blocker(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> Option<u32> {
        let along = to - from;
        let mut found = None;
        self.along(from, along, 1.0, |f, reach| {
            if !skip.contains(&f) && self.faces.blocks(f, from, along) {
                found = Some(f);
                return -1.0;
            }
            reach
        });
        found
    }

    fn candidates(&self, shaft: &Shaft, skip: [u32; 2], limit: usize, out: &mut Vec<u32>) -> bool {
        let start = out.len();
        if self.nodes.is_empty() {
            return true;
        }
        let mut stack = vec![0u32];
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index as usize];
            if !shaft.may_hold_box(node.low, node.high) {
                continue;
            }
            if node.count == 0 {
                stack.extend([node.start, index + 1]);
                continue;
            }
            for f in &self.order[node.start as usize..(node.start + node.count) as usize] {
                if !skip.contains(f) && shaft.may_hold(self.faces.vertices(*f)) {
                    if out.len() - start == limit {
                        out.truncate(start);
                        return false;
                    }
                    out.push(*f);
                }
            }
        }
        true
    }

    fn first_hit(&self, origin: DVec3, direction: DVec3) -> Option<(u32, f64)> {
        let mut found = None;
        self.along(origin, direction, f64::INFINITY, |f, reach| match self.faces.hit(f, origin, direction) {
            Some(t) if t > 0.0 && t < reach => {
                found = Some((f, t));
                t
            }
            _ => reach,
        });
        found
    }

    fn bytes(&self) -> usize {
        self.faces.bytes() + size_of_val(&*self.nodes) + size_of_val(&*self.order)
    }

    fn replica(&self) -> Option<Box<dyn Occluder + Send>> {
        Some(Box::new(self.clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::super::Brute;
    use super::*;
    use crate::scene::{Face, Material, Scene, Sides};
    use proptest::prelude::*;

    fn soup(triangles: &[[f64; 9]]) -> Scene {
        let face = |t: &[f64; 9]| Face {
            vertices: t.chunks(3).map(DVec3::from_slice).collect(),
            material: 0,
            sides: Sides::Two,
        };
        let grey = Material { reflectance: vec![0.5], exitance_w_m2: vec![0.0] };
        Scene {
            faces: triangles.iter().map(face).collect(),
            materials: vec![grey],
            bands: vec!["grey".into()],
            ..Scene::default()
        }
    }

    proptest! {
        #[test]
        fn agrees_with_brute_force(
            triangles in proptest::collection::vec(proptest::array::uniform9(-1.0..1.0f64), 1..80),
            segments in proptest::collection::vec(proptest::array::uniform6(-1.5..1.5f64), 40),
        ) {
            let scene = soup(&triangles);
            let (bvh, brute) = (Bvh::new(OpaqueFaces::new(&scene)), Brute(OpaqueFaces::new(&scene)));
            for s in segments {
                let (a, b) = (DVec3::from_slice(&s[..3]), DVec3::from_slice(&s[3..]));
                prop_assert_eq!(bvh.blocker(a, b, [0, 1]).is_some(), brute.blocker(a, b, [0, 1]).is_some());
                prop_assert_eq!(bvh.first_hit(a, b - a), brute.first_hit(a, b - a));
                let across = [a, a + 0.1 * DVec3::X, a + 0.1 * DVec3::Y];
                let shaft = Shaft::between(&across, None, &[b], None);
                let (mut x, mut y) = (Vec::new(), Vec::new());
                bvh.candidates(&shaft, [0, 0], usize::MAX, &mut x);
                brute.candidates(&shaft, [0, 0], usize::MAX, &mut y);
                x.sort();
                prop_assert_eq!(&x, &y);
                for w in [0.2, 0.5, 0.9] {
                    let from = a + 0.05 * (DVec3::X + w * DVec3::Y);
                    if let Some(f) = brute.blocker(from, b, [0, 0]) {
                        prop_assert!(y.contains(&f), "blocker {} is missing among the candidates {:?}", f, y);
                    }
                }
            }
        }
    }
}
