//! Guesses of the norm of reflected radiosity, in W/m, before anything is known: by it the first pass knows how fine it must be.

use std::f64::consts::PI;

use ccnuma::WorkerPanic;

use super::crew::Crew;
use crate::radiosity::Tree;
use crate::scene::{Light, Surface};
use crate::transport::lamp::Lamp;
use crate::transport::{Packet, Scratch, Source};
use crate::visibility::Occluder;

/// Of more sources the light is taken to spread evenly.
const MOST_SOURCES: usize = 64;

/// Light that makes so many times the norm of evenly spread light does not spread evenly. Below that the guess is good enough, and a pass that
/// begins a little too fine costs less than one that must be repeated.
const UNEVEN: f64 = 2.0;

/// An integrating sphere with the scene's area, power, and gain `ρ/(1 − ρ)`.
pub(super) fn even_norm_w_m<const N: usize>(
    lights: &[Light],
    surfaces: &[Surface],
    emitters: &[Packet<N>],
    gain: f64,
) -> f64 {
    let area_m2: f64 = surfaces.iter().map(|s| s.area_m2).sum();
    if area_m2 == 0.0 {
        return 0.0;
    }
    let emitted = emitters.iter().map(|p| surfaces[p.surface as usize].area_m2 * p.strength());
    let lamps = lights.iter().map(|light| match light {
        Light::Point { intensity_w_sr, .. } => 4.0 * PI * length(intensity_w_sr),
        Light::Spot { intensity_w_sr, .. } => PI * length(intensity_w_sr),
        Light::Directional { irradiance_w_m2, .. } => 0.25 * area_m2 * length(irradiance_w_m2),
    });
    (emitted.sum::<f64>() + lamps.sum::<f64>()) * gain.min(4.0) / area_m2.sqrt()
}

/// The norm of the direct light that surfaces reflect if nothing shades them and their middles stand for them, or the spots next to sources
/// close by, where that is much more than `even_w_m`: in the open and close by, light stays near where it falls. Else `even_w_m`.
pub(super) fn norm_w_m<const N: usize>(
    even_w_m: f64,
    (lamps, emitters): (&[Lamp<N>], &[Packet<N>]),
    occluder: &dyn Occluder,
    trees: &mut [Tree<N>],
    crew: &mut Crew<'_>,
) -> Result<f64, WorkerPanic> {
    if lamps.len() + emitters.len() > MOST_SOURCES {
        return Ok(even_w_m);
    }
    let reflected_squared = |tree: &mut Tree<N>| {
        let (patch, scratch) = (&tree.patch, &mut Scratch::default());
        let of_lamps: f64 = lamps.iter().map(|lamp| patch.unshaded_w_m2(lamp, occluder, scratch)).sum();
        let of_surfaces: f64 =
            emitters.iter().map(|packet| patch.unshaded_w_m2(packet, occluder, scratch)).sum();
        let even_squared = tree.area_m2 * (of_lamps + of_surfaces).powi(2);
        let square = |spot_w_m: f64| spot_w_m * spot_w_m;
        let near_lamps: f64 =
            lamps.iter().map(|lamp| square(patch.unshaded_spot_w_m(lamp, occluder, scratch))).sum();
        let near_surfaces: f64 =
            emitters.iter().map(|packet| square(patch.unshaded_spot_w_m(packet, occluder, scratch))).sum();
        let reflectance = patch.reflectance.iter().copied().fold(0.0, f64::max);
        reflectance * reflectance * even_squared.max(near_lamps + near_surfaces)
    };
    let unshaded_w_m = crew.map(trees, |_| true, reflected_squared)?.iter().sum::<f64>().sqrt();
    Ok(if unshaded_w_m > UNEVEN * even_w_m { unshaded_w_m } else { even_w_m })
}

/// Euclidean norm over bands.
fn length(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>().sqrt()
}
