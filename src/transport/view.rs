//! How points see an emitter cell, four side by side: estimates on the safe side that decide how its light is taken.

use std::f64::consts::PI;

use glam::DVec3;
use wide::f64x4;

use super::packet::EmitterCell;
use crate::math::lanes::DVec3x4;
use crate::scene::Frame;

/// Points no higher over a cell's plane than this share of its size lie in it but for rounding, and see nothing of it.
const LEAST_HEIGHT: f64 = 1e-9;

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
}

impl Geometry {
    /// The geometry of `emitter` on a surface with this frame.
    pub fn new<const N: usize>(frame: &Frame, emitter: &EmitterCell<N>) -> Self {
        let cell = &emitter.cell;
        let (u, v) = (frame.u * cell.size.x, frame.v * cell.size.y);
        Self {
            middle: frame.point(cell.centre()),
            normal: frame.normal,
            half: 0.5 * (u + v).length().max((u - v).length()),
            size: u.length().max(v.length()),
            area_m2: frame.area_m2 * cell.area(),
        }
    }

    /// Whether no light can pass from the cell to a sphere with this normal.
    pub fn faces_away(&self, normal: DVec3, centre: DVec3, radius: f64) -> bool {
        let between = self.middle - centre;
        radius <= self.normal.dot(between) || normal.dot(between) + radius + self.half <= 0.0
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
        let square = f64x4::splat(PI * 0.5) * (distance * distance + gap * gap);
        Views {
            seen: (above.simd_gt(f64x4::splat(LEAST_HEIGHT * self.size)) & ahead.simd_gt(f64x4::ZERO))
                .to_bitmask(),
            ratio: size / distance,
            nearest: size / gap,
            form_factor: (cos_x * cos_y * area_m2 / (square + area_m2)).fast_min(f64x4::ONE),
        }
    }
}
