//! A polygon cut by line segments: the cells of their arrangement inside the polygon.
//!
//! Segments that do not help to close a loop, with each other or with the polygon's boundary, cut nothing.
//! Points nearer to each other than a tolerance are one, and so are points and edges: what almost touches
//! touches. A cell with holes, and a cell around loops that lie free inside it, is one closed walk: bridge
//! edges run from the leftmost corner of each loop straight to the left. There may be any number of them.

use glam::DVec2;

use super::graph::{Edge, Graph};
use super::walks::dissolve;
use crate::math::polygon;

/// Polygons with more segments on them stay whole.
const MAX_SEGMENTS: usize = 4096;
/// Cells with less than this share of the polygon's area are dropped.
const SLIVER: f64 = 1e-9;
/// How much the cells may differ from the polygon in area, as a share of it, before they are refused.
const MISSING: f64 = 1e-6;

/// What segments do to a polygon.
#[derive(Clone, Debug, PartialEq)]
pub enum Cells {
    /// They do not cut it.
    Whole,
    /// They cut it into these, each counter-clockwise.
    Parts(Vec<Vec<DVec2>>),
    /// They are too many, or too near to each other, to tell.
    Unclear,
}

/// Cuts `outline`, counter-clockwise, by `segments`; what is nearer than `tolerance` touches. Cells smaller
/// than `least_area` are joined with a neighbour, unless `is_kept` says otherwise of a point inside.
pub fn cells(
    outline: &[DVec2],
    segments: &[(DVec2, DVec2)],
    tolerance: f64,
    least_area: f64,
    is_kept: impl Fn(DVec2) -> bool,
) -> Cells {
    if segments.is_empty() {
        return Cells::Whole;
    }
    if segments.len() > MAX_SEGMENTS {
        return Cells::Unclear;
    }
    let mut graph = Graph::new(tolerance);
    let corners: Vec<u32> = outline.iter().map(|p| graph.point(*p)).collect();
    graph.edges = polygon_edges(&corners).map(|(a, b)| Edge { a, b, outline: true }).collect();
    for (a, b) in segments {
        let [a, b] = [a, b].map(|p| graph.point(on_outline(outline, *p, tolerance)));
        graph.edges.push(Edge { a, b, outline: false });
    }
    if !graph.meet() {
        return Cells::Unclear;
    }
    graph.drop_bridges();
    graph.drop_outside(outline);
    graph.drop_open();
    if graph.edges.iter().all(|edge| edge.outline) {
        return Cells::Whole;
    }
    let walks = dissolve(&mut graph, least_area, |cell| interior_point(cell).is_some_and(&is_kept));
    let whole = polygon::area(outline);
    let parts = walks.all.into_iter().filter(|walk| !walk.outside).map(|walk| walk.corners);
    let parts: Vec<Vec<DVec2>> = parts.filter(|part| polygon::area(part) > SLIVER * whole).collect();
    let perimeter: f64 = polygon::edges(outline).map(|(a, b)| a.distance(b)).sum();
    let total: f64 = parts.iter().map(|part| polygon::area(part)).sum();
    if (total - whole).abs() > MISSING * whole + tolerance * perimeter {
        return Cells::Unclear;
    }
    if parts.len() > 1 { Cells::Parts(parts) } else { Cells::Whole }
}

/// A point inside a polygon: the middle of the widest stretch on the line half-way up the widest gap between
/// heights of its corners.
pub fn interior_point(polygon: &[DVec2]) -> Option<DVec2> {
    let mut heights: Vec<f64> = polygon.iter().map(|p| p.y).collect();
    heights.sort_by(f64::total_cmp);
    let gap = heights.windows(2).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))?;
    let y = 0.5 * (gap[0] + gap[1]);
    let mut met: Vec<f64> = polygon::edges(polygon)
        .filter(|(a, b)| (a.y > y) != (b.y > y))
        .map(|(a, b)| a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x))
        .collect();
    met.sort_by(f64::total_cmp);
    let widest = met.chunks_exact(2).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))?;
    Some(DVec2::new(0.5 * (widest[0] + widest[1]), y))
}

/// The nearest point of the outline where that is within `tolerance`, so that contacts do not bend it.
fn on_outline(outline: &[DVec2], point: DVec2, tolerance: f64) -> DVec2 {
    let near = polygon::nearest_on_boundary(outline, point, |d| d.length_squared());
    if near.distance(point) <= tolerance { near } else { point }
}

fn polygon_edges(corners: &[u32]) -> impl Iterator<Item = (u32, u32)> + '_ {
    let n = corners.len();
    (0..n).map(move |i| (corners[i], corners[(i + 1) % n])).filter(|(a, b)| a != b)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn points(corners: &[(f64, f64)]) -> Vec<DVec2> {
        corners.iter().map(|p| DVec2::from(*p)).collect()
    }

    fn parts(outline: &[DVec2], segments: &[(DVec2, DVec2)], least_area: f64) -> Vec<Vec<DVec2>> {
        match cells(outline, segments, 1e-9, least_area, |_| false) {
            Cells::Parts(parts) => parts,
            Cells::Whole => vec![outline.to_vec()],
            Cells::Unclear => panic!("unclear: {segments:?}"),
        }
    }

    fn square(x: f64, y: f64, side: f64) -> Vec<(DVec2, DVec2)> {
        let corners = points(&[(x, y), (x + side, y), (x + side, y + side), (x, y + side)]);
        polygon::edges(&corners).collect()
    }

    /// A square with a square hole, joined by a bridge edge.
    fn ring() -> Vec<DVec2> {
        points(&[
            (0., 0.),
            (8., 0.),
            (8., 8.),
            (0., 8.),
            (0., 0.),
            (3., 3.),
            (3., 5.),
            (5., 5.),
            (5., 3.),
            (3., 3.),
        ])
    }

    #[test]
    fn loops_in_a_polygon_with_a_hole_become_cells() {
        // Free, in each other, around the hole, across it, and over the edge.
        let segments =
            [square(1., 1., 1.), square(6., 1., 1.), square(6.25, 1.25, 0.5), square(2.5, 2.5, 3.)];
        let mut areas: Vec<f64> =
            parts(&ring(), &segments.concat(), 0.0).iter().map(|p| polygon::area(p)).collect();
        areas.sort_by(f64::total_cmp);
        assert_eq!(areas, [0.25, 0.75, 1.0, 5.0, 64.0 - 9.0 - 2.0]);
        let across = [square(4., 4., 2.), square(7., 7., 3.)].concat();
        let mut areas: Vec<f64> = parts(&ring(), &across, 0.0).iter().map(|p| polygon::area(p)).collect();
        areas.sort_by(f64::total_cmp);
        assert_eq!(areas, [1.0, 3.0, 60.0 - 4.0]);
    }

    #[test]
    fn small_cells_join_the_neighbour_they_share_most_with() {
        let outline = points(&[(0., 0.), (4., 0.), (4., 1.), (0., 1.)]);
        // A thin strip across leaves one cut; a small loop leaves nothing.
        let line = |x: f64| (DVec2::new(x, 0.0), DVec2::new(x, 1.0));
        let strip = [vec![line(2.0), line(2.01)], square(0.5, 0.5, 0.1)].concat();
        let mut areas: Vec<f64> = parts(&outline, &strip, 0.1).iter().map(|p| polygon::area(p)).collect();
        areas.sort_by(f64::total_cmp);
        assert!(
            areas.len() == 2 && (areas[0] + areas[1] - 4.0).abs() < 1e-12 && areas[0] > 1.98,
            "{areas:?}"
        );
        assert_eq!(parts(&outline, &strip, 0.0).len(), 4);
    }

    #[test]
    fn open_segments_cut_nothing() {
        let open = [(DVec2::new(1., 1.), DVec2::new(2., 2.)), (DVec2::new(2., 2.), DVec2::new(2., 9.))];
        assert_eq!(cells(&ring(), &open, 1e-9, 0.0, |_| false), Cells::Whole);
        assert_eq!(cells(&ring(), &square(3., 3., 2.), 1e-9, 0.0, |_| false), Cells::Whole);
    }

    proptest! {
        #[test]
        fn cells_tile_the_polygon(
            ends in proptest::collection::vec((-1.0..9.0f64, -1.0..9.0f64, -1.0..9.0f64, -1.0..9.0f64), 1..24),
            round: bool,
        ) {
            let at = |x: f64| if round { x.round() } else { x };
            let ends = ends.iter().map(|(a, b, c, d)| [*a, *b, *c, *d].map(at));
            let segments: Vec<_> = ends.map(|[a, b, c, d]| (DVec2::new(a, b), DVec2::new(c, d))).collect();
            let parts = parts(&ring(), &segments, 0.0);
            let total: f64 = parts.iter().map(|part| polygon::area(part)).sum();
            prop_assert!((total - 60.0).abs() < 1e-6);
            for (i, part) in parts.iter().enumerate() {
                let inside = interior_point(part).unwrap();
                for (j, other) in parts.iter().enumerate() {
                    prop_assert_eq!(polygon::contains(other, inside), i == j);
                }
            }
        }
    }
}
