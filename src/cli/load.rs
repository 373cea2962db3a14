//! Scenes and saved solutions made ready: surfaces, the visibility structure, and rays for pictures.

use std::path::Path;
use std::time::Instant;

use glam::{DVec2, DVec3};

use crate::scene::{self, OfFaces, Scene, Surface};
use crate::visibility::{Bsp, Bvh, Occluder, OpaqueFaces};

use super::Error;
use super::plan::Visibility;

/// A scene that can be solved.
pub(super) struct Loaded {
    pub scene: Scene,
    pub surfaces: Vec<Surface>,
    /// What tells which faces stand in between.
    pub occluder: Box<dyn Occluder + Send>,
    pub load_s: f64,
    pub build_s: f64,
}

impl Loaded {
    /// Reads a scene and prepares it: a partition where one is asked for, else a hierarchy, which pictures and probes need in any case.
    ///
    /// # Errors
    /// A file that cannot be read, or that holds nothing to solve.
    pub fn read(path: &Path, visibility: Visibility) -> Result<Loaded, Error> {
        let start = Instant::now();
        let scene = scene::read::read_file(path)?;
        let load_s = start.elapsed().as_secs_f64();
        if scene.faces.is_empty() {
            return Err(Error::Input(format!(
                "{}: the scene has no faces, so there is nothing to solve; `wrad info` lists what was skipped",
                path.display()
            )));
        }
        let start = Instant::now();
        let surfaces = scene::surfaces(&scene);
        let faces = OpaqueFaces::new(&scene);
        let occluder: Box<dyn Occluder + Send> = match visibility {
            Visibility::Bsp => Box::new(Bsp::new(faces)),
            _ => Box::new(Bvh::new(faces)),
        };
        Ok(Loaded { scene, surfaces, occluder, load_s, build_s: start.elapsed().as_secs_f64() })
    }

    /// What a user should know before the result: one line each.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let is_lit = self.surfaces.iter().any(|s| s.exitance_w_m2.iter().any(|m| *m > 0.0));
        if !is_lit && self.scene.lights.is_empty() {
            warnings.push("nothing in the scene emits light: the solution is dark".to_owned());
        }
        warnings
    }
}

/// Rays into a scene for [`crate::output::image`]: the nearest face, as a surface of its front if it has one.
pub(super) fn caster<'a>(
    surfaces: &'a [Surface],
    occluder: &'a dyn Occluder,
) -> impl Fn(DVec3, DVec3) -> Option<(u32, DVec2)> + Sync + 'a {
    let of_faces = OfFaces::new(surfaces);
    move |origin, direction| {
        let (face, distance) = occluder.first_hit(origin, direction)?;
        let point = origin + distance * direction;
        of_faces.at(face, false, point).or_else(|| of_faces.at(face, true, point))
    }
}
