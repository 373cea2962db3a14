//! Polygons cut by a cell, in convex pieces that fit together to the last bit.
//!
//! A mesh has no cracks only if both sides of a common edge compute the same points. So every intersection
//! is computed from the edge's end points in a fixed order, and a point on a cell's border has the border's
//! coordinate exactly. Pieces are found by a sweep with the even–odd rule, which holes joined by a bridge
//! edge, and the edges there and back that clipping a concave polygon leaves, pass without special cases:
//! they bound strips of no width.

use glam::DVec2;

use crate::math::polygon::edges;

/// A direction of the parametrisation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Axis {
    U,
    V,
}

impl Axis {
    fn of(self, p: DVec2) -> (f64, f64) {
        match self {
            Axis::U => (p.x, p.y),
            Axis::V => (p.y, p.x),
        }
    }

    fn point(self, along: f64, across: f64) -> DVec2 {
        match self {
            Axis::U => DVec2::new(along, across),
            Axis::V => DVec2::new(across, along),
        }
    }
}

/// The point of the edge `a b` at coordinate `at` of `axis`; the same bits for `b a`.
fn crossing(a: DVec2, b: DVec2, axis: Axis, at: f64) -> DVec2 {
    let (a, b) = (axis.of(a), axis.of(b));
    let (low, high) = if a <= b { (a, b) } else { (b, a) };
    let across = if at == low.0 {
        low.1
    } else if at == high.0 {
        high.1
    } else {
        low.1 + (high.1 - low.1) * ((at - low.0) / (high.0 - low.0))
    };
    axis.point(at, across)
}

/// The part of `polygon` below (or above) coordinate `at` of `axis`, by Sutherland and Hodgman.
pub(super) fn clip(polygon: &[DVec2], axis: Axis, at: f64, below: bool) -> Vec<DVec2> {
    let side = |p: DVec2| if below { at - axis.of(p).0 } else { axis.of(p).0 - at };
    let mut out = Vec::with_capacity(polygon.len() + 4);
    for (a, b) in edges(polygon) {
        let (da, db) = (side(a), side(b));
        if da >= 0.0 {
            out.push(a);
        }
        if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
            out.push(crossing(a, b, axis, at));
        }
    }
    out.dedup();
    while out.len() > 1 && out.first() == out.last() {
        out.pop();
    }
    out
}

/// Whether the corners turn left (or go straight) all the way round, once.
fn is_convex(polygon: &[DVec2]) -> bool {
    let n = polygon.len();
    let mut reversals = 0;
    for i in 0..n {
        let (a, b, c) = (polygon[i], polygon[(i + 1) % n], polygon[(i + 2) % n]);
        let (in_, out) = (b - a, c - b);
        let turn = in_.perp_dot(out);
        if turn < 0.0 || (turn == 0.0 && in_.dot(out) <= 0.0) {
            return false;
        }
        reversals += ((in_.x > 0.0) != (out.x > 0.0)) as usize;
    }
    reversals <= 2
}

/// Convex pieces, counter-clockwise, that tile `polygon` by the even–odd rule: the polygon itself if it is
/// convex, else trapezoids between the horizontals through its corners.
pub(super) fn pieces(polygon: &[DVec2]) -> Vec<Vec<DVec2>> {
    if is_convex(polygon) {
        return vec![polygon.to_vec()];
    }
    let mut levels: Vec<f64> = polygon.iter().map(|p| p.y).collect();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    let mut out = Vec::new();
    for slab in levels.windows(2) {
        let (low, high) = (slab[0], slab[1]);
        let spans = |a: &DVec2, b: &DVec2| a.y.min(b.y) <= low && a.y.max(b.y) >= high && a.y != b.y;
        let mut sides: Vec<(DVec2, DVec2)> = edges(polygon)
            .filter(|(a, b)| spans(a, b))
            .map(|(a, b)| (crossing(a, b, Axis::V, low), crossing(a, b, Axis::V, high)))
            .collect();
        sides.sort_by(|p, q| (p.0.x + p.1.x).total_cmp(&(q.0.x + q.1.x)));
        for pair in sides.chunks_exact(2) {
            let mut corners = vec![pair[0].0, pair[1].0, pair[1].1, pair[0].1];
            corners.dedup();
            if corners.first() == corners.last() {
                corners.pop();
            }
            if corners.len() >= 3 {
                out.push(corners);
            }
        }
    }
    out
}

/// The outline on a grid of 2⁻³⁶: corners a rounding error apart, or off a cell's border, come to lie on it.
pub(super) fn snap(outline: &[DVec2]) -> Vec<DVec2> {
    const GRID: f64 = (1u64 << 36) as f64;
    // Adding zero turns −0 into +0, which has other bits.
    outline.iter().map(|p| (*p * GRID).round() / GRID + DVec2::ZERO).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::polygon::area;
    use proptest::prelude::*;

    fn polygon(points: &[(f64, f64)]) -> Vec<DVec2> {
        points.iter().map(|(x, y)| DVec2::new(*x, *y)).collect()
    }

    fn total(parts: &[Vec<DVec2>]) -> f64 {
        parts.iter().map(|p| area(p)).sum()
    }

    /// A frame: a square with a slanted square hole, joined by a bridge edge.
    fn frame() -> Vec<DVec2> {
        polygon(&[
            (0.0, 0.0),
            (1.0, 0.0),
            (1.0, 1.0),
            (0.0, 1.0),
            (0.0, 0.0),
            (0.3, 0.4),
            (0.5, 0.8),
            (0.8, 0.6),
            (0.6, 0.2),
            (0.3, 0.4),
        ])
    }

    #[test]
    fn pieces_tile_concave_polygons_and_polygons_with_holes() {
        let l = polygon(&[(0.0, 0.0), (1.0, 0.0), (1.0, 0.4), (0.4, 0.4), (0.4, 1.0), (0.0, 1.0)]);
        assert_eq!(pieces(&l).len(), 2);
        for shape in [l, frame()] {
            let parts = pieces(&shape);
            assert!((total(&parts) - area(&shape)).abs() < 1e-14);
            assert!(parts.iter().all(|p| is_convex(p)), "{parts:?}");
        }
    }

    proptest! {
        #[test]
        fn clipping_at_a_line_loses_nothing_and_both_sides_agree(at in 0.0..1.0f64, vertical: bool) {
            let axis = if vertical { Axis::U } else { Axis::V };
            let (low, high) = (clip(&frame(), axis, at, true), clip(&frame(), axis, at, false));
            let parts = total(&pieces(&low)) + total(&pieces(&high));
            prop_assert!((parts - area(&frame())).abs() < 1e-13);
            let on = |p: &[DVec2]| {
                let mut found: Vec<u64> =
                    p.iter().filter(|p| axis.of(**p).0 == at).map(|p| axis.of(*p).1.to_bits()).collect();
                found.sort();
                found.dedup();
                found
            };
            prop_assert_eq!(on(&low), on(&high));
        }
    }
}
