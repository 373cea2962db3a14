//! Light and camera nodes → world coordinates.

use glam::{DMat4, DVec3};

use super::document::Node;
use super::schema::Kind;
use super::transforms::orientation;
use crate::scene::{Camera, Light, Projection};

/// The light of a node; `None` when it is switched off.
///
/// `intensity · color` is a radiant intensity in W/sr for lights with a place, an irradiance in W/m² for
/// directional ones.
pub fn light(node: &Node, matrix: &DMat4) -> Option<Light> {
    if !node.flag("on", true) {
        return None;
    }
    let power = (node.number("intensity", 1.0) * node.vector("color", DVec3::ONE)).to_array().to_vec();
    let position = matrix.project_point3(node.vector("location", DVec3::Z));
    let direction = matrix.transform_vector3(node.vector("direction", DVec3::NEG_Z)).normalize();
    Some(match node.kind {
        Kind::DirectionalLight => Light::Directional { direction, irradiance_w_m2: power },
        Kind::SpotLight => Light::Spot {
            position,
            direction,
            intensity_w_sr: power,
            cutoff_rad: node.number("cutOffAngle", std::f64::consts::FRAC_PI_4),
            // Inventor maps a rate of 1 to OpenGL's greatest exponent, 128.
            exponent: 128.0 * node.number("dropOffRate", 0.0),
        },
        _ => Light::Point { position, intensity_w_sr: power },
    })
}

/// The camera of a node; `number` names it when it has no name.
pub fn camera(node: &Node, matrix: &DMat4, number: usize) -> Camera {
    let turn = orientation(node, "orientation");
    let direction = matrix.transform_vector3(turn * DVec3::NEG_Z).normalize();
    let up = matrix.transform_vector3(turn * DVec3::Y);
    let projection = match node.kind {
        Kind::OrthographicCamera => Projection::Orthographic(node.number("height", 2.0) * up.length()),
        _ => Projection::Perspective(node.number("heightAngle", std::f64::consts::FRAC_PI_4)),
    };
    Camera {
        name: node.name.as_deref().map_or_else(|| format!("camera{number}"), str::to_owned),
        position: matrix.project_point3(node.vector("position", DVec3::Z)),
        direction,
        up: up.reject_from_normalized(direction).normalize(),
        projection,
        aspect: node.number("aspectRatio", 1.0),
    }
}
