//! The cells of a plane graph as closed walks, and the small ones joined with their neighbours.

use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, HashMap, HashSet};

use glam::DVec2;

use super::graph::{Edge, Graph};
use crate::math::polygon;

/// Small cells are joined in as many rounds at most.
const ROUNDS: usize = 16;

/// The closed walks with a cell on their left.
pub struct Walks {
    /// In no order that means anything, but always the same.
    pub all: Vec<Walk>,
    /// The walk each directed edge is part of.
    left_of: HashMap<(u32, u32), u32>,
}

/// A closed walk.
pub struct Walk {
    /// Corners of the cell on its left, counter-clockwise.
    pub corners: Vec<DVec2>,
    half_edges: Vec<(u32, u32)>,
    /// Whether the polygon's outside is on its left.
    pub outside: bool,
}

impl Walks {
    fn new(graph: &Graph) -> Walks {
        let directed: HashSet<(u32, u32)> =
            graph.edges.iter().filter(|edge| edge.outline).map(|edge| (edge.a, edge.b)).collect();
        let is_outside = |(a, b): (u32, u32)| directed.contains(&(b, a)) && !directed.contains(&(a, b));
        let mut half_edges: Vec<(u32, u32)> =
            graph.edges.iter().flat_map(|edge| [(edge.a, edge.b), (edge.b, edge.a)]).collect();
        // Around each point by angle.
        let angle = |(a, b): (u32, u32)| (graph.at(b) - graph.at(a)).to_angle();
        half_edges.sort_by(|e, f| e.0.cmp(&f.0).then(angle(*e).total_cmp(&angle(*f))).then(e.1.cmp(&f.1)));
        half_edges.dedup();
        let index: HashMap<(u32, u32), usize> =
            half_edges.iter().enumerate().map(|(i, edge)| (*edge, i)).collect();
        // The cell on the left goes on along the first half-edge clockwise from the way back.
        let next = |(a, b): (u32, u32)| {
            let before = index[&(b, a)].checked_sub(1).map(|i| half_edges[i]).filter(|edge| edge.0 == b);
            before.unwrap_or_else(|| half_edges[half_edges.partition_point(|edge| edge.0 <= b) - 1])
        };
        let mut walks = Walks { all: Vec::new(), left_of: HashMap::new() };
        for start in &half_edges {
            let mut walk = Walk { corners: Vec::new(), half_edges: Vec::new(), outside: false };
            let mut edge = *start;
            while let Entry::Vacant(free) = walks.left_of.entry(edge) {
                free.insert(walks.all.len() as u32);
                walk.corners.push(graph.at(edge.0));
                walk.half_edges.push(edge);
                walk.outside |= is_outside(edge);
                edge = next(edge);
            }
            if !walk.corners.is_empty() {
                walks.all.push(walk);
            }
        }
        walks
    }
}

/// Removes the border between each cell smaller than `least_area` and the neighbour it borders on most,
/// as long as there are such cells; what `is_kept` says of keeps its border. Returns the walks around
/// the cells.
pub fn dissolve(graph: &mut Graph, least_area: f64, is_kept: impl Fn(&[DVec2]) -> bool) -> Walks {
    for _ in 0..ROUNDS {
        graph.bridge();
        let walks = Walks::new(graph);
        let kept: Vec<bool> = walks.all.iter().map(|walk| !walk.outside && is_kept(&walk.corners)).collect();
        let mut removed = HashSet::new();
        for (i, walk) in walks.all.iter().enumerate() {
            if !walk.outside && !kept[i] && polygon::area(&walk.corners) < least_area {
                removed.extend(longest_border(graph, &walks, i as u32, &kept));
            }
        }
        if removed.is_empty() {
            return walks;
        }
        graph.edges.retain(|edge| edge.outline || !removed.contains(&edge.undirected()));
        graph.drop_open();
    }
    graph.bridge();
    Walks::new(graph)
}

/// The contacts between a cell and the neighbour it shares most of its border with.
fn longest_border(graph: &Graph, walks: &Walks, cell: u32, kept: &[bool]) -> Vec<(u32, u32)> {
    let outline: HashSet<(u32, u32)> =
        graph.edges.iter().filter(|edge| edge.outline).map(Edge::undirected).collect();
    let mut borders: BTreeMap<u32, (f64, Vec<(u32, u32)>)> = BTreeMap::new();
    for (a, b) in &walks.all[cell as usize].half_edges {
        let neighbour = walks.left_of[&(*b, *a)];
        let between = (*a.min(b), *a.max(b));
        if neighbour != cell && !kept[neighbour as usize] && !outline.contains(&between) {
            let border = borders.entry(neighbour).or_default();
            border.0 += graph.at(*a).distance(graph.at(*b));
            border.1.push(between);
        }
    }
    let longest = borders.into_values().max_by(|p, q| p.0.total_cmp(&q.0));
    longest.map_or(Vec::new(), |(_, border)| border)
}
