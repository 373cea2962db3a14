//! Surfaces: one side of a face, with the parallelogram that carries its function space (numerics after Holzschuch,
//! Cuny, Alonso 2000: the function lives on the parallelogram P, emission is restricted to the polygon S).

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// A parallelogram in space: `origin + a·u + b·v` for (a, b) in the unit square.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// The corner (0, 0), in metres.
    pub origin: DVec3,
    /// The edge along the first parameter, in metres.
    pub u: DVec3,
    /// The edge along the second parameter, in metres.
    pub v: DVec3,
    /// Unit normal of the front: `u × v`, normalised.
    pub normal: DVec3,
    /// Area of the whole parallelogram.
    pub area_m2: f64,
}

impl Frame {
    /// The point of parameters `uv`.
    pub fn point(&self, uv: DVec2) -> DVec3 {
        self.origin + uv.x * self.u + uv.y * self.v
    }

    /// The parameters of a point's projection onto the plane.
    pub fn uv(&self, point: DVec3) -> DVec2 {
        let d = point - self.origin;
        let (uu, uv, vv) = (self.u.dot(self.u), self.u.dot(self.v), self.v.dot(self.v));
        let (du, dv) = (d.dot(self.u), d.dot(self.v));
        DVec2::new(du * vv - dv * uv, dv * uu - du * uv) / (uu * vv - uv * uv)
    }
}

/// One side of a face that takes part in the exchange of light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Surface {
    /// Index into [`super::Scene::faces`].
    pub face: u32,
    /// Whether this is the back of the face.
    pub back: bool,
    /// The enclosing parallelogram, its normal pointing to this side.
    pub frame: Frame,
    /// The polygon in the parameters of `frame`, counter-clockwise.
    pub outline: Vec<DVec2>,
    /// Whether the polygon is the whole parallelogram.
    pub full: bool,
    /// Area of the polygon.
    pub area_m2: f64,
    /// Share of the irradiance that is reflected, per band.
    pub reflectance: Vec<f64>,
    /// Emitted exitance per band in W/m².
    pub exitance_w_m2: Vec<f64>,
}
