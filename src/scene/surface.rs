//! Surfaces: one side of a face, with the parallelogram that carries its function space (numerics after Holzschuch,
//! Cuny, Alonso 2000: the function lives on the parallelogram P, emission is restricted to the polygon S).

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::math::{Cell, polygon};

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

    /// The squared length in m² of a difference of parameters.
    pub fn square_m2(&self, d: DVec2) -> f64 {
        (d.x * self.u + d.y * self.v).length_squared()
    }

    /// The parameters of a point's projection onto the plane.
    pub fn uv(&self, point: DVec3) -> DVec2 {
        let d = point - self.origin;
        let (uu, uv, vv) = (self.u.dot(self.u), self.u.dot(self.v), self.v.dot(self.v));
        let (du, dv) = (d.dot(self.u), d.dot(self.v));
        DVec2::new(du * vv - dv * uv, dv * uu - du * uv) / (uu * vv - uv * uv)
    }
}

/// One side of a face that takes part in the exchange of light, or a part of it.
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

/// Tries to hit a polygon in a cell; a polygon that is missed so often takes next to nothing of it.
const TRIES: usize = 1000;

impl Surface {
    /// A point of the polygon in a cell, in the parameters of the frame, from numbers that are uniform in [0, 1); `None` where the polygon is missed
    /// again and again.
    pub fn point_in(&self, cell: &Cell, mut uniform: impl FnMut() -> f64) -> Option<DVec2> {
        let mut tries = (0..TRIES).map(|_| cell.to_surface(DVec2::new(uniform(), uniform())));
        tries.find(|uv| self.full || polygon::contains(&self.outline, *uv))
    }

    /// The point of the polygon's boundary nearest to the parameters `uv`, and how far it is in metres.
    pub fn nearest_on_boundary(&self, uv: DVec2) -> (DVec2, f64) {
        let near = polygon::nearest_on_boundary(&self.outline, uv, |d| self.frame.square_m2(d));
        (near, self.frame.square_m2(near - uv).sqrt())
    }
}

/// The surfaces of each face, to find the one at a point.
pub struct OfFaces<'a> {
    surfaces: &'a [Surface],
    /// The fronts, then the backs of each face.
    indices: Vec<[Vec<u32>; 2]>,
}

impl<'a> OfFaces<'a> {
    /// Sorts surfaces by face.
    pub fn new(surfaces: &'a [Surface]) -> OfFaces<'a> {
        let faces = surfaces.iter().map(|surface| surface.face as usize + 1).max().unwrap_or(0);
        let mut indices = vec![[Vec::new(), Vec::new()]; faces];
        for (index, surface) in surfaces.iter().enumerate() {
            indices[surface.face as usize][usize::from(surface.back)].push(index as u32);
        }
        OfFaces { surfaces, indices }
    }

    /// The surface of a side of a face that holds `point`, which lies on the face, and the parameters there;
    /// the nearest where none holds it; `None` for a side without surfaces.
    pub fn at(&self, face: u32, back: bool, point: DVec3) -> Option<(u32, DVec2)> {
        let indices = &self.indices.get(face as usize)?[usize::from(back)];
        let uv = |index: u32| self.surfaces[index as usize].frame.uv(point);
        if let [only] = indices[..] {
            return Some((only, uv(only)));
        }
        let holds = |index: &&u32| polygon::contains(&self.surfaces[**index as usize].outline, uv(**index));
        if let Some(index) = indices.iter().find(holds) {
            return Some((*index, uv(*index)));
        }
        let nearest = |index: &u32| (*index, self.surfaces[*index as usize].nearest_on_boundary(uv(*index)));
        let nearest = indices.iter().map(nearest).min_by(|a, b| a.1.1.total_cmp(&b.1.1));
        nearest.map(|(index, (uv, _))| (index, uv))
    }
}
