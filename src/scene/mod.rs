//! Scenes: planar polygons with a reflectance and an exitance, lights, cameras. Lengths in metres, W/m².

mod arrangement;
mod boxes;
mod contact;
pub mod describe;
mod graph;
pub mod model;
pub mod pieces;
pub mod planar;
pub mod procedural;
pub mod read;
mod rim;
pub mod split;
pub mod surface;
pub mod validate;
mod walks;

pub use describe::describe;
pub use model::{Camera, Face, Finding, Findings, Light, Material, Projection, Scene, Sides};
pub use split::{Cut, cut, surfaces};
pub use surface::{Frame, OfFaces, Surface};
pub use validate::validate;
