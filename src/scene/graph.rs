//! The boundary of a polygon and segments on it as a plane graph: made to meet in common points, pruned, and
//! connected by bridge edges.

use std::collections::{HashMap, HashSet};

use glam::DVec2;

use crate::math::polygon;

/// Edges are divided in as many rounds at most until they share end points only.
const ROUNDS: usize = 16;

/// A line between two points of a graph.
#[derive(Clone, Copy, Debug)]
pub struct Edge {
    /// The point it starts at.
    pub a: u32,
    /// The point it ends at.
    pub b: u32,
    /// Whether it is part of the polygon's boundary, in its direction.
    pub outline: bool,
}

impl Edge {
    fn ends(&self, point: u32) -> bool {
        self.a == point || self.b == point
    }

    /// Its ends, the same for the edge that runs back.
    pub fn undirected(&self) -> (u32, u32) {
        (self.a.min(self.b), self.a.max(self.b))
    }
}

/// Points, and edges between them.
pub struct Graph {
    points: Vec<DVec2>,
    /// Points by the square of a grid they lie in.
    grid: HashMap<(i64, i64), Vec<u32>>,
    /// The boundary and the contacts.
    pub edges: Vec<Edge>,
    tolerance: f64,
}

impl Graph {
    /// A graph without points, in which what is nearer than `tolerance` touches.
    pub fn new(tolerance: f64) -> Graph {
        Graph { points: Vec::new(), grid: HashMap::new(), edges: Vec::new(), tolerance }
    }

    /// The number of a point, that of one within the tolerance if there is one.
    pub fn point(&mut self, p: DVec2) -> u32 {
        let square =
            |p: DVec2| ((p.x / self.tolerance).floor() as i64, (p.y / self.tolerance).floor() as i64);
        let (x, y) = square(p);
        let around = (-1..=1).flat_map(|i| (-1..=1).map(move |j| (x.saturating_add(i), y.saturating_add(j))));
        let near = around
            .filter_map(|square| self.grid.get(&square))
            .flatten()
            .find(|i| self.points[**i as usize].distance(p) <= self.tolerance);
        if let Some(near) = near {
            return *near;
        }
        let number = self.points.len() as u32;
        self.points.push(p);
        self.grid.entry((x, y)).or_default().push(number);
        number
    }

    /// Where a point lies.
    pub fn at(&self, point: u32) -> DVec2 {
        self.points[point as usize]
    }

    /// Divides edges where they cross or touch, until they share end points only; whether that succeeded.
    pub fn meet(&mut self) -> bool {
        for _ in 0..ROUNDS {
            self.drop_repeated();
            let mut cuts = self.cuts();
            if cuts.is_empty() {
                return true;
            }
            let mut edges = Vec::with_capacity(self.edges.len() + cuts.len());
            for (i, edge) in self.edges.iter().enumerate() {
                let from = self.at(edge.a);
                let mut stops = cuts.remove(&i).unwrap_or_default();
                stops.sort_by(|p, q| from.distance(self.at(*p)).total_cmp(&from.distance(self.at(*q))));
                let mut a = edge.a;
                for b in stops.into_iter().chain([edge.b]) {
                    if a != b {
                        edges.push(Edge { a, b, ..*edge });
                    }
                    a = b;
                }
            }
            self.edges = edges;
        }
        false
    }

    /// Drops edges without length, and contacts that run along the outline or along each other.
    fn drop_repeated(&mut self) {
        let mut seen: HashSet<(u32, u32)> =
            self.edges.iter().filter(|edge| edge.outline).map(Edge::undirected).collect();
        self.edges.retain(|edge| edge.a != edge.b && (edge.outline || seen.insert(edge.undirected())));
    }

    /// Where each edge must be divided, by a sweep over the edges' extents along the first axis.
    fn cuts(&mut self) -> HashMap<usize, Vec<u32>> {
        let tolerance = self.tolerance;
        let extent = |graph: &Graph, i: usize| {
            let (a, b) = (graph.at(graph.edges[i].a), graph.at(graph.edges[i].b));
            (a.min(b) - tolerance, a.max(b) + tolerance)
        };
        let extents: Vec<(DVec2, DVec2)> = (0..self.edges.len()).map(|i| extent(self, i)).collect();
        let mut order: Vec<usize> = (0..self.edges.len()).collect();
        order.sort_by(|i, j| extents[*i].0.x.total_cmp(&extents[*j].0.x));
        let mut cuts: HashMap<usize, Vec<u32>> = HashMap::new();
        for (k, &i) in order.iter().enumerate() {
            for &j in order[k + 1..].iter().take_while(|j| extents[**j].0.x <= extents[i].1.x) {
                if extents[j].0.y <= extents[i].1.y && extents[j].1.y >= extents[i].0.y {
                    self.cut_pair(i, j, &mut cuts);
                }
            }
        }
        cuts
    }

    fn cut_pair(&mut self, i: usize, j: usize, cuts: &mut HashMap<usize, Vec<u32>>) {
        let (e, f) = (self.edges[i], self.edges[j]);
        let mut touched = false;
        for (edge, index, other) in [(e, i, f), (f, j, e)] {
            for point in [other.a, other.b].into_iter().filter(|point| !edge.ends(*point)) {
                if self.touches(edge, point) {
                    cuts.entry(index).or_default().push(point);
                    touched = true;
                }
            }
        }
        if touched || e.ends(f.a) || e.ends(f.b) {
            return;
        }
        let [a, b, c, d] = [e.a, e.b, f.a, f.b].map(|point| self.at(point));
        let (of_c, of_d) = ((b - a).perp_dot(c - a), (b - a).perp_dot(d - a));
        let (of_a, of_b) = ((d - c).perp_dot(a - c), (d - c).perp_dot(b - c));
        if of_c * of_d < 0.0 && of_a * of_b < 0.0 {
            let point = self.point(c + (d - c) * (of_c / (of_c - of_d)));
            for (edge, index) in [(e, i), (f, j)] {
                if !edge.ends(point) {
                    cuts.entry(index).or_default().push(point);
                }
            }
        }
    }

    /// Whether a point lies on an edge between its ends.
    fn touches(&self, edge: Edge, point: u32) -> bool {
        let (a, b, p) = (self.at(edge.a), self.at(edge.b), self.at(point));
        let along = (p - a).dot(b - a) / (b - a).length_squared();
        along > 0.0 && along < 1.0 && (a + along * (b - a)).distance(p) <= self.tolerance
    }

    /// Drops the polygon's own bridge edges, which would close loops where nothing does.
    pub fn drop_bridges(&mut self) {
        let directed: HashSet<(u32, u32)> =
            self.edges.iter().filter(|edge| edge.outline).map(|edge| (edge.a, edge.b)).collect();
        self.edges.retain(|edge| !edge.outline || !directed.contains(&(edge.b, edge.a)));
    }

    /// Drops contacts outside the polygon.
    pub fn drop_outside(&mut self, outline: &[DVec2]) {
        let points = &self.points;
        let middle = |edge: &Edge| 0.5 * (points[edge.a as usize] + points[edge.b as usize]);
        self.edges.retain(|edge| edge.outline || polygon::contains(outline, middle(edge)));
    }

    /// Drops contacts with a loose end, again and again.
    pub fn drop_open(&mut self) {
        loop {
            let mut degree = vec![0u32; self.points.len()];
            for edge in &self.edges {
                degree[edge.a as usize] += 1;
                degree[edge.b as usize] += 1;
            }
            let before = self.edges.len();
            self.edges
                .retain(|edge| edge.outline || degree[edge.a as usize].min(degree[edge.b as usize]) > 1);
            if self.edges.len() == before {
                return;
            }
        }
    }

    /// Connects loops that lie free, and holes, with what is straight to the left of their leftmost corner.
    pub fn bridge(&mut self) {
        let component = self.components();
        let mut leftmost: HashMap<u32, u32> = HashMap::new();
        let order = |i: u32, j: u32| {
            let (p, q) = (self.at(i), self.at(j));
            p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)).is_lt()
        };
        for point in self.edges.iter().flat_map(|edge| [edge.a, edge.b]) {
            let least = leftmost.entry(component[point as usize]).or_insert(point);
            if order(point, *least) {
                *least = point;
            }
        }
        let mut starts: Vec<u32> = leftmost.into_values().collect();
        starts.sort_unstable();
        for start in starts {
            self.bridge_from(start);
        }
    }

    fn bridge_from(&mut self, start: u32) {
        let from = self.at(start);
        let mut nearest: Option<(f64, usize)> = None;
        for (i, edge) in self.edges.iter().enumerate().filter(|(_, edge)| !edge.ends(start)) {
            let (a, b) = (self.at(edge.a), self.at(edge.b));
            if a.y.min(b.y) > from.y || a.y.max(b.y) < from.y {
                continue;
            }
            let x = if a.y == b.y { a.x.max(b.x) } else { a.x + (from.y - a.y) / (b.y - a.y) * (b.x - a.x) };
            if x < from.x && nearest.is_none_or(|(most, _)| x > most) {
                nearest = Some((x, i));
            }
        }
        // To the left of the polygon's outer boundary there is nothing.
        let Some((x, i)) = nearest else { return };
        let foot = DVec2::new(x, from.y);
        let edge = self.edges[i];
        let end = [edge.a, edge.b].into_iter().find(|end| self.at(*end).distance(foot) <= self.tolerance);
        let end = end.unwrap_or_else(|| {
            self.points.push(foot);
            let point = self.points.len() as u32 - 1;
            self.divide(edge, point);
            point
        });
        self.edges.push(Edge { a: start, b: end, outline: false });
    }

    /// Divides an edge, and the one that runs back along it, at a point.
    fn divide(&mut self, edge: Edge, point: u32) {
        let alike = |other: &Edge| other.undirected() == edge.undirected();
        let (divided, mut edges): (Vec<Edge>, Vec<Edge>) = self.edges.iter().partition(|other| alike(other));
        for Edge { a, b, outline } in divided {
            edges.extend([Edge { a, b: point, outline }, Edge { a: point, b, outline }]);
        }
        self.edges = edges;
    }

    /// A number for each point, the same for points connected by edges.
    fn components(&self) -> Vec<u32> {
        let mut of: Vec<u32> = (0..self.points.len() as u32).collect();
        fn root(of: &mut [u32], mut i: u32) -> u32 {
            while of[i as usize] != i {
                of[i as usize] = of[of[i as usize] as usize];
                i = of[i as usize];
            }
            i
        }
        for edge in &self.edges {
            let (a, b) = (root(&mut of, edge.a), root(&mut of, edge.b));
            of[a.max(b) as usize] = a.min(b);
        }
        (0..self.points.len() as u32).map(|i| root(&mut of, i)).collect()
    }
}
