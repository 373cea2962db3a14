//! Lights without area: point, spot and directional. They illuminate directly through the same pair task as surfaces.

use glam::DVec3;

use super::candidates::Candidates;
use super::gather::{Points, Tolerance, norm};
use super::pair::Scratch;
use super::source::Source;
use crate::scene::Light;
use crate::visibility::Occluder;

/// A light of the scene, `N` bands.
#[derive(Clone, Debug)]
pub struct Lamp<const N: usize> {
    light: Light,
    spectrum: [f64; N],
    /// Further away than any face, in metres: where directional light is taken to come from.
    far_m: f64,
}

impl<const N: usize> Lamp<N> {
    /// Prepares `light`; `extent_m` is the diameter of the scene including the light.
    pub fn new(light: &Light, extent_m: f64) -> Self {
        let spectrum = match light {
            Light::Point { intensity_w_sr, .. } | Light::Spot { intensity_w_sr, .. } => intensity_w_sr,
            Light::Directional { irradiance_w_m2, .. } => irradiance_w_m2,
        };
        let spectrum = std::array::from_fn(|n| spectrum[n]);
        Self { light: light.clone(), spectrum, far_m: 2.0 * extent_m }
    }

    /// Where the light that falls on `x` comes from.
    fn origin(&self, x: DVec3) -> DVec3 {
        match &self.light {
            Light::Point { position, .. } | Light::Spot { position, .. } => *position,
            Light::Directional { direction, .. } => x - self.far_m * *direction,
        }
    }

    /// Irradiance per unit of spectrum at `x` with unit normal `n`.
    fn geometry(&self, x: DVec3, n: DVec3) -> f64 {
        match &self.light {
            Light::Directional { direction, .. } => (-n.dot(*direction)).max(0.0),
            Light::Point { position, .. } => falloff(*position - x, n),
            Light::Spot { position, direction, cutoff_rad, exponent, .. } => {
                let to_light = *position - x;
                let cosine = -to_light.dot(*direction) / to_light.length();
                if cosine <= 0.0 || cosine < cutoff_rad.cos() {
                    return 0.0;
                }
                falloff(to_light, n) * cosine.powf(*exponent)
            }
        }
    }
}

/// `cosθ / r²`, 0 where x faces away or lies at the light.
fn falloff(to_light: DVec3, n: DVec3) -> f64 {
    let r2 = to_light.length_squared();
    if r2 > 0.0 { (n.dot(to_light) / (r2 * r2.sqrt())).max(0.0) } else { 0.0 }
}

impl<const N: usize> Source<N> for Lamp<N> {
    fn surface(&self) -> u32 {
        u32::MAX
    }

    fn face(&self) -> u32 {
        u32::MAX
    }

    fn hull(&self, receiver: &[DVec3]) -> ([DVec3; 4], Option<DVec3>) {
        (std::array::from_fn(|i| self.origin(receiver[i.min(receiver.len() - 1)])), None)
    }

    fn reaches(&self, normal: DVec3, corners: &[DVec3]) -> bool {
        corners.first().is_some_and(|c| normal.dot(self.origin(*c) - *c) > 0.0)
    }

    fn place(&self) -> Option<(DVec3, f64)> {
        match &self.light {
            Light::Point { position, .. } | Light::Spot { position, .. } => Some((*position, 0.0)),
            Light::Directional { .. } => None,
        }
    }

    fn nearest(&self, _point: DVec3) -> Option<DVec3> {
        self.place().map(|(position, _)| position)
    }

    fn estimate_w_m2(&self, centre: DVec3, radius: f64, _normal: DVec3) -> f64 {
        match &self.light {
            Light::Directional { .. } => norm(&self.spectrum),
            Light::Point { position, .. } | Light::Spot { position, .. } => {
                let gap = (position.distance(centre) - radius).max(1e-3 * radius);
                norm(&self.spectrum) / (gap * gap)
            }
        }
    }

    fn strength(&self) -> f64 {
        norm(&self.spectrum)
    }

    fn gather(
        &self,
        points: &Points<'_>,
        occluder: &dyn Occluder,
        candidates: Candidates,
        _tolerance: Tolerance,
        irradiance: &mut [[f64; N]],
        uncertain: &mut [f64],
        scratch: &mut Scratch,
    ) {
        for p in 0..points.position.len() {
            let x = points.position[p];
            scratch.work.kernel_evaluations += 1;
            let geometry = self.geometry(x, points.normal);
            if geometry == 0.0 {
                continue;
            }
            let (from, to) = (points.eye[p], self.origin(points.eye[p]));
            let blocked = match candidates {
                Candidates::Free => false,
                Candidates::Hidden => true,
                Candidates::List(start, end) => scratch.candidates[start..end]
                    .iter()
                    .any(|f| occluder.faces().blocks(*f, from, to - from)),
                Candidates::Scene => occluder.blocker(from, to, [points.face, u32::MAX]).is_some(),
            };
            if candidates == Candidates::Free {
                scratch.work.sights_free += 1;
            } else {
                scratch.work.visibility_rays += 1;
                scratch.work.rays_listed += u64::from(matches!(candidates, Candidates::List(..)));
                scratch.work.sights_by_rays += 1;
                uncertain[p] += geometry * norm(&self.spectrum);
            }
            if !blocked {
                for n in 0..N {
                    irradiance[p][n] += geometry * self.spectrum[n];
                }
            }
        }
    }
}
