//! What a link may miss between the sample points of its element: light that a near source casts on a spot, and light behind whose horizon
//! all sample points lie.

use glam::{DVec2, DVec3};

use super::candidates::Candidates;
use super::gather::{Tolerance, norm};
use super::link::Link;
use super::nodes::value_at;
use super::packet::{Shape, cell_corners};
use super::pair::COARSE;
use super::source::Source;
use crate::math::basis::MAX_FUNCTIONS;
use crate::math::polygon;
use crate::scene::Frame;

/// Light from a source nearer than this share of a cell's side may change between the sample points. Not 1/8: from that far cells of halved sides
/// see each other, and rounding would decide.
const SPOT: f64 = 0.12;

/// Nearer than this share of the surface's side a source touches it: along a common edge light does not peak, and elements are graded. Told from
/// the surface, as corners far out are off by 1e-10 of it, which is more of its cells.
const TOUCHING: f64 = 1e-9;

/// Parts that reach less than this share of the surface's side before a source's plane lie in it: corners far out are off by 1e-10, and planes
/// tilted by more.
const HORIZON: f64 = 1e-6;

/// Corners are looked at this far inside, as shares of the sides.
const MARGIN: f64 = 1.0 / 32.0;

/// Share of an element that lies between its sample points.
const BETWEEN: f64 = 0.05;

/// RMS over a polygon of what grows from nothing with the distance to one side, over its value in the middle: √(4/3) for a strip, √(3/2) for a
/// triangle.
const FADING: f64 = 1.2;

impl<const N: usize, S: Source<N>> Link<'_, '_, N, S> {
    /// What the projected `light` may lack between the sample points, in W/m of radiosity: on a spot, and beyond the horizon of a dark element.
    pub(super) fn missed_w_m(&mut self, light: &[[f64; N]; MAX_FUNCTIONS]) -> (f64, f64) {
        // What is dark in a shadow is not asked.
        let free = self.candidates == Candidates::Free;
        let beyond_w_m =
            if free && light.iter().flatten().all(|c| *c == 0.0) { self.beyond_horizon_w_m() } else { 0.0 };
        (self.on_spot_w_m(light), beyond_w_m)
    }

    /// What falls on the part of a dark element that lies before the source's plane, in W/m of radiosity: it fades to nothing at the plane, so that
    /// its RMS is little more than what the middle of the part sees.
    fn beyond_horizon_w_m(&mut self) -> f64 {
        let (source, plane) = self.aim.source.hull(&self.element.hull);
        let Some(normal) = plane else { return 0.0 };
        let frame = &self.task.patch.frame;
        let height_m = |uv: DVec2| normal.dot(frame.point(uv) - source[0]);
        let corners = cell_corners(&self.element.cell);
        let outline = match self.element.shape {
            Shape::Part(outline, _) => outline,
            _ => &corners[..],
        };
        let least_m = HORIZON * longer_m(frame);
        if !outline.iter().any(|c| height_m(*c) > least_m) {
            return 0.0;
        }
        let before = polygon::clip_half_plane(outline, height_m);
        let area = polygon::area(&before);
        if area == 0.0 {
            return 0.0;
        }
        let area_m2 = area.abs() * frame.u.cross(frame.v).length();
        let light_w_m2 = self.light_at(&[frame.point(polygon::centroid(&before, area))])[0];
        self.weight * FADING * norm(&light_w_m2) * area_m2.sqrt()
    }

    /// What the projected `light` may lack on a spot, in W/m of radiosity. Where a source is near, light changes within a distance
    /// as short as its own; what falls on the point next to it, and on the corners of the cell, is compared with the projection.
    fn on_spot_w_m(&mut self, light: &[[f64; N]; MAX_FUNCTIONS]) -> f64 {
        let Some((_, reach_m)) = self.aim.source.place() else { return 0.0 };
        let (frame, cell) = (&self.task.patch.frame, self.element.cell);
        let clamped = |point: DVec3| cell.to_local(frame.uv(point)).clamp(DVec2::ZERO, DVec2::ONE);
        let at = |local: DVec2| frame.point(cell.to_surface(local));
        let (mut next, mut near_m) = (DVec2::splat(0.5), 0.0);
        // Each is the nearest point to the other, or nearly so.
        for _ in 0..3 {
            let Some(source) = self.aim.source.nearest(at(next)) else { return 0.0 };
            next = clamped(source);
            near_m = at(next).distance(source);
        }
        let (u_m, v_m) = self.sides_m();
        let least_m = TOUCHING * longer_m(frame);
        if !(least_m..SPOT * u_m.max(v_m)).contains(&near_m) {
            return 0.0;
        }
        let shape = self.element.shape;
        let on_polygon = |local: &DVec2| match shape {
            Shape::Part(outline, _) => polygon::contains(outline, cell.to_surface(*local)),
            _ => true,
        };
        let (mut locals, mut count) = ([DVec2::ZERO; 5], 0);
        let corners = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y].map(inwards);
        for local in std::iter::once(next).chain(corners).filter(on_polygon) {
            (locals[count], count) = (local, count + 1);
        }
        if count == 0 {
            return 0.0;
        }
        let points = locals.map(at);
        let there = self.light_at(&points[..count]);
        let basis = self.task.rules.samples.full.basis;
        let missing = |(local, there): (&DVec2, &[f64; N])| {
            let projected = value_at(basis, light, *local);
            norm(&std::array::from_fn::<_, N, _>(|n| there[n] - projected[n]))
        };
        let most_w_m2 = locals[..count].iter().zip(&there).map(missing).fold(0.0, f64::max);
        let spot_m = near_m.max(reach_m);
        let spot_m2 = (std::f64::consts::PI * spot_m * spot_m).min(BETWEEN * self.element.area_m2);
        self.weight * most_w_m2 * spot_m2.sqrt()
    }

    /// The irradiance at up to five points of the element in W/m², roughly.
    fn light_at(&mut self, points: &[DVec3]) -> [[f64; N]; 5] {
        let quarter_w_m2 = 0.25 * self.aim.source.strength();
        let tolerance = Tolerance { relative: COARSE, absolute_w_m2: COARSE * quarter_w_m2 };
        let (candidates, element, n) = (self.candidates, self.element, points.len());
        let mut light = [[0.0; N]; 5];
        self.gather(
            (points, points, &element.hull),
            candidates,
            tolerance,
            &mut light[..n],
            &mut [0.0; 5][..n],
        );
        light
    }
}

/// The longer side of a surface's parallelogram in metres.
fn longer_m(frame: &Frame) -> f64 {
    frame.u.length().max(frame.v.length())
}

/// A point of the unit square, kept off its sides.
fn inwards(local: DVec2) -> DVec2 {
    local.clamp(DVec2::splat(MARGIN), DVec2::splat(1.0 - MARGIN))
}
