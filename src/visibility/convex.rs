//! Scenes in which nothing can stand between: no plane of a face has the scene, lights included, on both of
//! its sides, so a segment between two faces crosses none.

use glam::DVec3;

use super::opaque::unit_normal;
use crate::scene::{Light, Scene};

/// Distances from a plane below this share of the scene's extent are rounding.
const ROUNDING: f64 = 1e-9;
/// Products of faces and corners beyond which the question is not worth its time.
const MAX_TESTS: usize = 100_000_000;

/// Whether no face can block a segment between two points on faces or between a light and a face. `false`
/// where that was not found out.
pub fn nothing_between(scene: &Scene) -> bool {
    let mut points: Vec<DVec3> = scene.faces.iter().flat_map(|face| face.vertices.iter().copied()).collect();
    for light in &scene.lights {
        match light {
            Light::Point { position, .. } | Light::Spot { position, .. } => points.push(*position),
            // It comes from infinity, through the faces that turn their backs on it.
            Light::Directional { .. } => return false,
        }
    }
    if points.len().saturating_mul(scene.faces.len()) > MAX_TESTS {
        return false;
    }
    let low = points.iter().fold(DVec3::INFINITY, |a, b| a.min(*b));
    let high = points.iter().fold(DVec3::NEG_INFINITY, |a, b| a.max(*b));
    let tolerance = ROUNDING * (high - low).length();
    scene.faces.iter().all(|face| {
        let normal = unit_normal(&face.vertices);
        let (mut in_front, mut behind) = (false, false);
        normal != DVec3::ZERO
            && points.iter().all(|point| {
                let distance = normal.dot(point - face.vertices[0]);
                in_front |= distance > tolerance;
                behind |= distance < -tolerance;
                !(in_front && behind)
            })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Face, Material, Sides};

    /// A box with its faces towards the inside.
    fn cube(low: DVec3, size: f64) -> Vec<Face> {
        let corner =
            |i: usize| low + size * DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2 & 1) as f64);
        let quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
        quads.map(|q| Face { vertices: q.map(corner).to_vec(), material: 0, sides: Sides::One }).to_vec()
    }

    fn scene(faces: Vec<Face>, lights: Vec<Light>) -> Scene {
        let grey = Material { reflectance: vec![0.5], exitance_w_m2: vec![1.0] };
        Scene { faces, lights, materials: vec![grey], bands: vec!["grey".into()], ..Scene::default() }
    }

    #[test]
    fn only_convex_scenes_have_nothing_in_between() {
        let room = cube(DVec3::ZERO, 2.0);
        assert!(nothing_between(&scene(room.clone(), vec![])));
        let lamp = |position| Light::Point { position, intensity_w_sr: vec![1.0] };
        assert!(nothing_between(&scene(room.clone(), vec![lamp(DVec3::ONE)])));
        assert!(!nothing_between(&scene(room.clone(), vec![lamp(DVec3::splat(3.0))])));
        let sun = Light::Directional { direction: DVec3::NEG_Z, irradiance_w_m2: vec![1.0] };
        assert!(!nothing_between(&scene(room.clone(), vec![sun])));
        let furnished = [room, cube(DVec3::splat(0.5), 0.5)].concat();
        assert!(!nothing_between(&scene(furnished, vec![])));
    }
}
