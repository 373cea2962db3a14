//! What a ray sees of a solution.

use glam::{DVec2, DVec3};

use crate::output::colour::{ToRgb, luminance};
use crate::radiosity::Solution;
use crate::scene::OfFaces;

/// Finds the nearest surface along a ray (origin, unit direction): its index in [`Solution::surfaces`] and
/// the point's parameters. Of a face with surfaces on both sides either may be given; a face met from a
/// side without a surface gives the other side's, for it hides what is behind.
pub type Caster<'a> = dyn Fn(DVec3, DVec3) -> Option<(u32, DVec2)> + Sync + 'a;

/// A point seen from its lit side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    pub surface: u32,
    pub uv: DVec2,
}

/// A solution with what is needed to look at it.
pub(super) struct Shade<'a> {
    pub solution: &'a Solution,
    pub to_rgb: ToRgb,
    cast: &'a Caster<'a>,
    of_faces: OfFaces<'a>,
}

impl<'a> Shade<'a> {
    pub fn new(solution: &'a Solution, cast: &'a Caster<'a>) -> Shade<'a> {
        let of_faces = OfFaces::new(&solution.surfaces);
        Shade { solution, to_rgb: ToRgb::new(&solution.scene.bands), cast, of_faces }
    }

    /// The surface seen along a ray; `None` if there is none, or only the black back of one.
    pub fn hit(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        let (index, uv) = (self.cast)(origin, direction)?;
        let surface = &self.solution.surfaces[index as usize];
        if surface.frame.normal.dot(direction) < 0.0 {
            return Some(Hit { surface: index, uv });
        }
        let point = surface.frame.point(uv);
        self.of_faces.at(surface.face, !surface.back, point).map(|(surface, uv)| Hit { surface, uv })
    }

    /// Radiance in W/(m² sr) per band, written to `out`; overshoots of the polynomials below zero are cut
    /// off.
    pub fn radiance(&self, hit: Hit, out: &mut [f64]) {
        self.solution.radiosity(hit.surface as usize, hit.uv, out);
        for value in out {
            *value = value.max(0.0) / std::f64::consts::PI;
        }
    }

    /// Irradiance in W/m², the mean of the bands.
    pub fn mean_irradiance(&self, hit: Hit, scratch: &mut [f64]) -> f64 {
        self.solution.fields[hit.surface as usize].irradiance(hit.uv, scratch);
        scratch.iter().sum::<f64>().max(0.0) / scratch.len().max(1) as f64
    }

    /// Luminance of the radiance in W/(m² sr).
    pub fn luminance(&self, hit: Hit, scratch: &mut [f64]) -> f64 {
        self.radiance(hit, scratch);
        luminance(self.to_rgb.rgb(scratch))
    }

    /// One value per band, zeroed.
    pub fn scratch(&self) -> Vec<f64> {
        vec![0.0; self.solution.scene.bands.len()]
    }
}
