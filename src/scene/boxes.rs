//! Which of many boxes meet a given one: a tree of boxes, halved at the median of their centres.

use glam::DVec3;

/// Boxes in a leaf.
const LEAF: usize = 4;

/// A tree over boxes that are numbered in the order they were given.
pub struct Boxes {
    /// In the order of a walk that goes down before it goes on.
    nodes: Vec<Node>,
    numbers: Vec<u32>,
}

struct Node {
    low: DVec3,
    high: DVec3,
    /// The node to go on with when this one is missed.
    next: u32,
    /// Where its boxes stand in `numbers`; empty for inner nodes.
    first: u32,
    end: u32,
}

impl Boxes {
    /// A tree over boxes given by their least and greatest corners.
    pub fn new(boxes: &[(DVec3, DVec3)]) -> Boxes {
        let mut tree = Boxes { nodes: Vec::new(), numbers: (0..boxes.len() as u32).collect() };
        if !boxes.is_empty() {
            tree.build(boxes, 0, boxes.len());
        }
        tree
    }

    fn build(&mut self, boxes: &[(DVec3, DVec3)], first: usize, end: usize) {
        let corners = |number: &u32| boxes[*number as usize];
        let centre = |number: &u32| corners(number).0 + corners(number).1;
        let held = &mut self.numbers[first..end];
        let around = |(low, high): (DVec3, DVec3), p: (DVec3, DVec3)| (low.min(p.0), high.max(p.1));
        let (low, high) = held.iter().map(corners).fold(corners(&held[0]), around);
        let at = self.nodes.len();
        let is_leaf = held.len() <= LEAF;
        let (leaf_first, leaf_end) = if is_leaf { (first as u32, end as u32) } else { (0, 0) };
        self.nodes.push(Node { low, high, next: 0, first: leaf_first, end: leaf_end });
        if !is_leaf {
            let points = held.iter().map(|number| (centre(number), centre(number)));
            let (least, most) = points.fold((centre(&held[0]), centre(&held[0])), around);
            let axis = (most - least).max_position();
            let half = held.len() / 2;
            held.select_nth_unstable_by(half, |a, b| centre(a)[axis].total_cmp(&centre(b)[axis]));
            self.build(boxes, first, first + half);
            self.build(boxes, first + half, end);
        }
        self.nodes[at].next = self.nodes.len() as u32;
    }

    /// Calls `found` with the numbers of boxes that may meet the box from `low` to `high`, touching included:
    /// all that do and a few near by.
    pub fn near(&self, low: DVec3, high: DVec3, mut found: impl FnMut(u32)) {
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if node.low.cmple(high).all() && node.high.cmpge(low).all() {
                self.numbers[node.first as usize..node.end as usize].iter().for_each(|number| found(*number));
                at += 1;
            } else {
                at = node.next as usize;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_box_that_meets_another_is_found() {
        let boxes: Vec<(DVec3, DVec3)> = (0..300u32)
            .map(|i| {
                let low = DVec3::new((i * 37 % 101) as f64, (i * 59 % 97) as f64, (i * 11 % 89) as f64);
                (low, low + DVec3::new((i % 7) as f64, (i % 5) as f64, (i % 13) as f64))
            })
            .collect();
        let tree = Boxes::new(&boxes);
        for (low, high) in &boxes {
            let mut found = Vec::new();
            tree.near(*low, *high, |number| found.push(number));
            let meets = |i: &u32| {
                let (a, b) = boxes[*i as usize];
                a.cmple(*high).all() && b.cmpge(*low).all()
            };
            assert!((0..300).filter(meets).all(|i| found.contains(&i)));
        }
        assert!(Boxes::new(&[]).nodes.is_empty());
    }
}
