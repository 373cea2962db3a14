//! Borders of elements as thin lines of constant width on the screen.
//!
//! Each side of a border draws half of the line: the distance to it in pixels follows from how the
//! parameters change from pixel to pixel, so lines are smooth without extra samples. Cells of few pixels
//! fade out instead of turning the picture grey.

use glam::DVec2;

use super::shade::Hit;
use super::view::View;
use crate::math::polygon::edges;
use crate::radiosity::Solution;
use crate::scene::Surface;

/// Half the width of a line in pixels.
const HALF_WIDTH: f64 = 0.55;
/// Below this size in pixels cells begin to fade.
const FADE: f64 = 7.0;

/// The drawable outlines of all surfaces.
pub(super) struct Borders<'a> {
    solution: &'a Solution,
    outlines: Vec<Vec<(DVec2, DVec2)>>,
}

impl<'a> Borders<'a> {
    pub fn new(solution: &'a Solution) -> Borders<'a> {
        Borders { solution, outlines: solution.surfaces.iter().map(outline).collect() }
    }

    /// How much of a line covers the point `at` (in pixels) where `hit` is seen: 0 to 1.
    pub fn coverage(&self, view: &View, at: DVec2, hit: Hit) -> f64 {
        let index = hit.surface as usize;
        let Some((du, dv)) = gradients(&self.solution.surfaces[index], view, at, hit.uv) else { return 0.0 };
        let Some(leaf) = self.solution.fields[index].leaf_at(hit.uv) else { return 0.0 };
        let (low, high) = (leaf.cell.low, leaf.cell.low + leaf.cell.size);
        let across = |distance: f64, gradient: DVec2| distance / gradient.length();
        let in_u = line(across((hit.uv.x - low.x).min(high.x - hit.uv.x), du));
        let in_v = line(across((hit.uv.y - low.y).min(high.y - hit.uv.y), dv));
        let fade = |size: f64, gradient: DVec2| (across(size, gradient) / FADE).powi(2).min(1.0);
        let cells = (in_u * fade(leaf.cell.size.x, du)).max(in_v * fade(leaf.cell.size.y, dv));
        self.outlines[index].iter().fold(cells, |most, (a, b)| {
            let (edge, offset) = (*b - *a, hit.uv - *a);
            let along = offset.dot(edge) / edge.length_squared();
            // The distance to the edge's line is affine in the parameters, so its gradient is exact.
            let gradient = edge.x * dv - edge.y * du;
            let distance = edge.perp_dot(offset).abs() / gradient.length();
            if (0.0..=1.0).contains(&along) { most.max(line(distance)) } else { most }
        })
    }
}

/// The edges of a polygon that is not its whole parallelogram, without the bridges to holes, which run
/// there and back.
fn outline(surface: &Surface) -> Vec<(DVec2, DVec2)> {
    if surface.full {
        return Vec::new();
    }
    let all: Vec<(DVec2, DVec2)> = edges(&surface.outline).collect();
    all.iter().filter(|(a, b)| !all.contains(&(*b, *a))).copied().collect()
}

/// Coverage at a distance from the middle of a line, both in pixels.
fn line(distance: f64) -> f64 {
    (HALF_WIDTH + 0.5 - distance).clamp(0.0, 1.0)
}

/// How u and v change per pixel to the right and down; `None` where the surface is seen edge on.
fn gradients(surface: &Surface, view: &View, at: DVec2, uv: DVec2) -> Option<(DVec2, DVec2)> {
    let frame = &surface.frame;
    let moved = |step: DVec2| {
        let (origin, direction) = view.ray(at + step);
        let t = (frame.origin - origin).dot(frame.normal) / direction.dot(frame.normal);
        (t.is_finite() && t > 0.0).then(|| frame.uv(origin + t * direction) - uv)
    };
    let (x, y) = (moved(DVec2::X)?, moved(DVec2::Y)?);
    Some((DVec2::new(x.x, y.x), DVec2::new(x.y, y.y)))
}
