//! One entry for all formats.

use std::path::Path;

use super::image::{Caster, ImageOptions, write_exr, write_png};
use super::solution_file::write_solution;
use super::{Error, Mesh, OutputKind, write_atomically, write_glb, write_ply, write_vtu};
use crate::radiosity::Solution;

/// Writes a solution in the format of `path`'s extension, whole or not at all. `cast` is only called for
/// pictures.
///
/// # Errors
/// An unknown extension, options that do not fit the scene, or what the file system says; each names the
/// remedy.
pub fn write(solution: &Solution, path: &Path, options: &ImageOptions, cast: &Caster) -> Result<(), Error> {
    let kind = OutputKind::from_path(path)?;
    match kind {
        OutputKind::Glb | OutputKind::Ply | OutputKind::Vtu => {
            let mesh = Mesh::new(solution)?;
            write_atomically(path, |out| match kind {
                OutputKind::Glb => write_glb(&mesh, &solution.scene.name, out),
                OutputKind::Ply => write_ply(&mesh, out),
                _ => write_vtu(&mesh, out),
            })
        }
        OutputKind::Png => {
            options.check(&solution.scene)?;
            write_atomically(path, |out| write_png(solution, options, cast, out))
        }
        OutputKind::Exr => {
            options.check(&solution.scene)?;
            write_atomically(path, |out| write_exr(solution, options, cast, out))
        }
        OutputKind::Wrad => write_atomically(path, |out| write_solution(solution, out)),
    }
}
