//! Scenes: planar polygons with a reflectance and an exitance, lights, cameras. Lengths in metres, W/m².

pub mod describe;
pub mod model;
pub mod pieces;
pub mod planar;
pub mod procedural;
pub mod read;
pub mod split;
pub mod surface;
pub mod validate;

pub use describe::describe;
pub use model::{Camera, Face, Finding, Findings, Light, Material, Projection, Scene, Sides};
pub use split::surfaces;
pub use surface::{Frame, Surface};
pub use validate::validate;
