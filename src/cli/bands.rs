//! Grey scenes: where all bands are alike, one is computed and copied.

use crate::radiosity::Solution;
use crate::scene::{Light, Scene, Surface};

/// The scene and its surfaces in one band, if all bands are alike and there are several.
pub(super) fn one_band(scene: &Scene, surfaces: &[Surface]) -> Option<(Scene, Vec<Surface>)> {
    if !is_grey(scene) {
        return None;
    }
    let (mut scene, mut surfaces) = (scene.clone(), surfaces.to_vec());
    scene.bands.truncate(1);
    for material in &mut scene.materials {
        material.reflectance.truncate(1);
        material.exitance_w_m2.truncate(1);
    }
    for light in &mut scene.lights {
        match light {
            Light::Point { intensity_w_sr: spectrum, .. }
            | Light::Spot { intensity_w_sr: spectrum, .. }
            | Light::Directional { irradiance_w_m2: spectrum, .. } => spectrum.truncate(1),
        }
    }
    for surface in &mut surfaces {
        surface.reflectance.truncate(1);
        surface.exitance_w_m2.truncate(1);
    }
    Some((scene, surfaces))
}

/// Whether the scene has several bands that are all alike.
pub(super) fn is_grey(scene: &Scene) -> bool {
    let alike = |spectrum: &Vec<f64>| spectrum.iter().all(|value| *value == spectrum[0]);
    scene.bands.len() > 1
        && scene.materials.iter().all(|m| alike(&m.reflectance) && alike(&m.exitance_w_m2))
        && scene.lights.iter().all(|light| match light {
            Light::Point { intensity_w_sr: spectrum, .. }
            | Light::Spot { intensity_w_sr: spectrum, .. }
            | Light::Directional { irradiance_w_m2: spectrum, .. } => alike(spectrum),
        })
}

/// Makes a solution in one band one of `scene`, whose bands are alike.
pub(super) fn in_all_bands(solution: &mut Solution, scene: &Scene, surfaces: &[Surface]) {
    let bands = scene.bands.len();
    solution.scene = scene.clone();
    solution.surfaces = surfaces.to_vec();
    for field in &mut solution.fields {
        field.bands = bands;
        field.coefficients = field.coefficients.iter().flat_map(|c| std::iter::repeat_n(*c, bands)).collect();
        for node in &mut field.nodes {
            if let crate::radiosity::Node::Leaf(start) = node {
                *start *= bands as u32;
            }
        }
    }
}
