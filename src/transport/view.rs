//! How points see an emitter cell, four side by side: estimates on the safe side that decide how its light is taken.

use std::f64::consts::PI;

use glam::DVec3;
use wide::f64x4;

use crate::math::Cell;
use crate::math::lanes::DVec3x4;
use crate::scene::Frame;

/// Points no higher over a cell's plane than this share of its size lie in it but for rounding, and see nothing of it.
const LEAST_HEIGHT: f64 = 1e-9;

/// Where a cell's longer side is more than so many times the shorter one, its distance is that to a line, not to its middle.
const SLENDER: f64 = 3.0;

/// An emitter cell as seen from four points.
pub struct Views {
    /// The points that light can reach, as a bit mask; what follows holds for these.
    pub seen: u32,
    /// Longest side over distance to the cell's middle.
    pub ratio: f64x4,
    /// Longest side over distance to the cell.
    pub nearest: f64x4,
    /// Estimate, on the safe side, of the form factor.
    pub form_factor: f64x4,
}

/// Where an emitter cell lies.
pub struct Geometry {
    middle: DVec3,
    normal: DVec3,
    /// Half the longer diagonal, and the longer side.
    half: f64,
    size: f64,
    area_m2: f64,
    /// Along the longer side, and how far a slender cell reaches both ways beyond one that is not.
    along: DVec3,
    reach: f64,
}

impl Geometry {
    /// The geometry of an emitter cell on a surface with this frame.
    pub fn new(frame: &Frame, cell: &Cell) -> Self {
        let (u, v) = (frame.u * cell.size.x, frame.v * cell.size.y);
        let (long, short) = if u.length() > v.length() { (u, v) } else { (v, u) };
        let (size, width) = (long.length(), short.length());
        Self {
            middle: frame.point(cell.centre()),
            normal: frame.normal,
            half: 0.5 * (u + v).length().max((u - v).length()),
            size,
            area_m2: frame.area_m2 * cell.area(),
            along: long / size,
            reach: 0.5 * (size - SLENDER * width).max(0.0),
        }
    }

    /// Whether no light can pass from the cell to a sphere with this normal.
    pub fn faces_away(&self, normal: DVec3, centre: DVec3, radius: f64) -> bool {
        let between = self.middle - centre;
        radius <= self.normal.dot(between) || normal.dot(between) + radius + self.half <= 0.0
    }

    /// Squared distance to the axis of a slender cell from points that lie so far off its middle.
    fn axis_squared(&self, between: &DVec3x4) -> f64x4 {
        let along = DVec3x4::splat(self.along);
        let reach = f64x4::splat(self.reach);
        let beside = between.dot(&along).fast_min(reach).fast_max(-reach);
        (*between - along * beside).length_squared()
    }

    /// How points on a plane with this normal see the cell.
    #[inline]
    pub fn views(&self, normal: DVec3, x: &DVec3x4) -> Views {
        let (half, size, area_m2) =
            (f64x4::splat(self.half), f64x4::splat(self.size), f64x4::splat(self.area_m2));
        let between = DVec3x4::splat(self.middle) - *x;
        let above = -DVec3x4::splat(self.normal).dot(&between);
        let ahead = DVec3x4::splat(normal).dot(&between) + half;
        let distance = between.length_squared().sqrt();
        let gap = (distance - half).fast_max(above);
        let (cos_x, cos_y) = ((ahead / gap).fast_min(f64x4::ONE), above / gap);
        let away_squared = if self.reach > 0.0 { self.axis_squared(&between) } else { distance * distance };
        let square = f64x4::splat(PI * 0.5) * (away_squared + gap * gap);
        Views {
            seen: (above.simd_gt(f64x4::splat(LEAST_HEIGHT * self.size)) & ahead.simd_gt(f64x4::ZERO))
                .to_bitmask(),
            ratio: size / distance,
            nearest: size / gap,
            form_factor: (cos_x * cos_y * area_m2 / (square + area_m2)).fast_min(f64x4::ONE),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;
    use proptest::prelude::*;

    use super::*;
    use crate::transport::lambert;

    /// The estimate of the form factor from a point to a rectangle in the plane z = 1 that shines down, and the exact one.
    fn seen(length: f64, width: f64, point: DVec3, normal: DVec3) -> (f64, f64) {
        let (origin, u, v) = (DVec3::Z, DVec3::Y * width, DVec3::X * length);
        let frame = Frame { origin, u, v, normal: -DVec3::Z, area_m2: length * width };
        let geometry = Geometry::new(&frame, &Cell::UNIT);
        let views = geometry.views(normal, &DVec3x4::splat(point));
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        let corners = corners.map(|(x, y)| frame.point(DVec2::new(x, y)));
        let exact = lambert::form_factor(point, normal, corners.into_iter());
        (if views.seen & 1 == 0 { 0.0 } else { views.form_factor.to_array()[0] }, exact)
    }

    proptest! {
        #[test]
        fn form_factors_are_not_underrated_however_slender_the_cell(
            (slenderness, height) in (0.0..6.0f64, -7.0..1.0f64),
            (x, y) in (-0.5..1.5f64, -3.0..3.0f64),
            (tilt, turn) in (0.0..1.5f64, 0.0..6.3f64),
        ) {
            let (width, height) = (10f64.powf(-slenderness), 10f64.powf(height));
            let aside = y * height.max(width);
            let normal = DVec3::new(tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos());
            let (estimate, exact) = seen(1.0, width, DVec3::new(x, aside, 1.0 - height), normal);
            // It is least at the corners of cells that are just not slender: 3/(3 + 5π/4).
            prop_assert!(estimate >= 0.4 * exact, "{estimate} for {exact}");
        }
    }
}
