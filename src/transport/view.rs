//! How a point sees an emitter cell: estimates on the safe side that decide how its light is taken.

use glam::DVec3;

use super::packet::EmitterCell;
use crate::scene::Frame;

/// An emitter cell as seen from a point.
pub struct View {
    /// Longest side over distance to the cell's middle.
    pub ratio: f64,
    /// Longest side over distance to the cell.
    pub nearest: f64,
    /// Estimate, on the safe side, of the form factor.
    pub form_factor: f64,
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

    /// How a point sees the cell; `None` where no light can pass.
    pub fn view(&self, normal: DVec3, x: DVec3) -> Option<View> {
        let between = self.middle - x;
        let above = -self.normal.dot(between);
        let ahead = normal.dot(between) + self.half;
        if above <= 0.0 || ahead <= 0.0 {
            return None;
        }
        let distance = between.length();
        let gap = (distance - self.half).max(above);
        let (cos_x, cos_y) = ((ahead / gap).min(1.0), above / gap);
        let square = std::f64::consts::PI * 0.5 * (distance * distance + gap * gap);
        Some(View {
            ratio: self.size / distance,
            nearest: self.size / gap,
            form_factor: (cos_x * cos_y * self.area_m2 / (square + self.area_m2)).min(1.0),
        })
    }
}
