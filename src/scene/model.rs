//! The scene as readers deliver it and every other room sees it: flat, in world coordinates, validated.
//!
//! Invariants (established by `scene::validate`): every face has at least three finite, distinct vertices in one plane, its area is
//! positive, and its normal by the right-hand rule is its front; reflectance lies in [0, 1), exitance is finite and ≥ 0.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A scene in world coordinates.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Scene {
    /// The name for people: the file's stem.
    pub name: String,
    /// Names of the spectral bands, `["r", "g", "b"]` for RGB scenes. Every spectrum below has this length.
    pub bands: Vec<String>,
    /// Planar polygons, in the order of the file.
    pub faces: Vec<Face>,
    /// What the faces are made of; indexed by [`Face::material`].
    pub materials: Vec<Material>,
    /// Lights without area.
    pub lights: Vec<Light>,
    /// Cameras, in the order of the file.
    pub cameras: Vec<Camera>,
    /// What was skipped, repaired or refused while reading.
    pub findings: Findings,
}

/// A planar polygon; concave ones and ones with holes joined by a bridge edge stay whole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Face {
    /// Corners in metres, counter-clockwise seen from the front (right-hand rule). The last one is not repeated.
    pub vertices: Vec<DVec3>,
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// Which sides take part in the exchange of light.
    pub sides: Sides,
}

/// Which sides of a face reflect and emit; every face is opaque from both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Sides {
    /// The front only: the back is black.
    One,
    /// Both alike.
    Two,
}

/// A diffuse material; one value per band.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// Share of the irradiance that is reflected, in [0, 1).
    pub reflectance: Vec<f64>,
    /// Emitted exitance in W/m².
    pub exitance_w_m2: Vec<f64>,
}

/// A light without area.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Light {
    /// Shines alike in all directions.
    Point {
        /// Where, in metres.
        position: DVec3,
        /// Radiant intensity per band in W/sr.
        intensity_w_sr: Vec<f64>,
    },
    /// Shines within a cone, with `cos(θ)^exponent` inside it.
    Spot {
        /// Where, in metres.
        position: DVec3,
        /// Unit axis of the cone, away from the light.
        direction: DVec3,
        /// Radiant intensity on the axis per band in W/sr.
        intensity_w_sr: Vec<f64>,
        /// Half angle of the cone in radians.
        cutoff_rad: f64,
        /// Exponent of the falloff from the axis.
        exponent: f64,
    },
    /// Shines from infinity.
    Directional {
        /// Unit direction in which the light travels.
        direction: DVec3,
        /// Irradiance per band on a plane facing the light, in W/m².
        irradiance_w_m2: Vec<f64>,
    },
}

/// A camera in world coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Its `DEF` name, or `camera1`, `camera2`, …
    pub name: String,
    /// The eye.
    pub position: DVec3,
    /// Unit viewing direction.
    pub direction: DVec3,
    /// Unit up direction, perpendicular to `direction`.
    pub up: DVec3,
    /// How depth maps to the picture.
    pub projection: Projection,
    /// Width over height as the file states it.
    pub aspect: f64,
}

/// Perspective or parallel projection.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Projection {
    /// The full vertical opening angle in radians.
    Perspective(f64),
    /// The height of the view volume in metres.
    Orthographic(f64),
}

/// What a reader met besides clean input: shown by `wrad info`, counted in the report.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Findings {
    /// Node or feature types that carry no meaning for radiosity or are not read, with how often they occurred.
    pub skipped: BTreeMap<String, u64>,
    /// Repairs and refusals by the rule that was applied.
    pub repairs: BTreeMap<String, Finding>,
}

/// One kind of repair.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// How often.
    pub count: u64,
    /// The first occurrence: file, line and what was found.
    pub first: String,
}

impl Findings {
    /// Counts a skipped node or feature.
    pub fn skip(&mut self, what: &str) {
        *self.skipped.entry(what.to_owned()).or_default() += 1;
    }

    /// Counts a repair by rule; `place` is only called for the first.
    pub fn repair(&mut self, rule: &str, place: impl FnOnce() -> String) {
        let finding = self.repairs.entry(rule.to_owned()).or_default();
        if finding.count == 0 {
            finding.first = place();
        }
        finding.count += 1;
    }
}

impl Scene {
    /// The corners (least, greatest) of the box around all faces; `None` for a scene without faces.
    pub fn bounds_m(&self) -> Option<(DVec3, DVec3)> {
        let mut vertices = self.faces.iter().flat_map(|face| &face.vertices);
        let first = *vertices.next()?;
        Some(vertices.fold((first, first), |(low, high), v| (low.min(*v), high.max(*v))))
    }
}
