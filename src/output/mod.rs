//! Results for people and programs: meshes, pictures, saved solutions, reports.

mod atomic;
pub mod colour;
mod convex;
mod error;
mod glb;
mod kind;
pub mod mesh;
mod ply;
mod tiling;
mod vtu;

pub use atomic::write_atomically;
pub use error::Error;
pub use glb::write_glb;
pub use kind::OutputKind;
pub use mesh::Mesh;
pub use ply::write_ply;
pub use vtu::write_vtu;

#[cfg(test)]
use crate as lib;
#[cfg(test)]
#[path = "../../tests/support/rooms.rs"]
mod rooms;
