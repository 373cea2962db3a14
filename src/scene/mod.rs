//! Scenes: planar polygons with a reflectance and an exitance, lights, cameras. Lengths in metres, W/m².

pub mod model;
pub mod read;
pub mod surface;

pub use model::{Camera, Face, Finding, Findings, Light, Material, Projection, Scene, Sides};
pub use surface::{Frame, Surface};
