//! Results for people and programs: meshes, pictures, saved solutions, reports.

mod atomic;
mod balance;
pub mod colour;
mod convex;
mod error;
mod glb;
pub mod image;
mod kind;
pub mod machine;
pub mod mesh;
mod ply;
pub mod report;
pub mod solution_file;
pub mod study;
mod summary;
mod tiling;
pub mod units;
mod validate;
mod vtu;
mod write;

pub use atomic::write_atomically;
pub use balance::energy_balance;
pub use error::Error;
pub use glb::write_glb;
pub use image::ImageOptions;
pub use kind::OutputKind;
pub use mesh::Mesh;
pub use ply::write_ply;
pub use report::Report;
pub use summary::summary;
pub use vtu::write_vtu;
pub use write::write;

#[cfg(test)]
use crate as lib;
#[cfg(test)]
#[path = "../../tests/support/rooms.rs"]
mod rooms;
