//! Transform nodes → matrices.
//!
//! Inventor multiplies row vectors from the left (`p' = p M`) and writes matrices by rows; here vectors are
//! columns, so a written matrix is read by columns, and a node's matrix multiplies the state's from the
//! right: `state ← state · node`.

use glam::{DMat4, DQuat, DVec3};

use super::document::Node;
use super::schema::Kind;
use super::state::State;

/// Applies a transform node to the state; other nodes leave it alone.
pub fn apply(node: &Node, state: &mut State) {
    let matrix = match node.kind {
        Kind::Transform => transform(node),
        Kind::Translation => DMat4::from_translation(node.vector("translation", DVec3::ZERO)),
        Kind::Rotation => rotation(node, "rotation"),
        Kind::RotationXyz => {
            let angle = node.number("angle", 0.0);
            match node.word("axis", "X") {
                "X" => DMat4::from_rotation_x(angle),
                "Y" => DMat4::from_rotation_y(angle),
                _ => DMat4::from_rotation_z(angle),
            }
        }
        Kind::Scale => DMat4::from_scale(node.vector("scaleFactor", DVec3::ONE)),
        Kind::MatrixTransform => {
            node.numbers("matrix").map_or(DMat4::IDENTITY, |numbers| matrix_from_rows(numbers))
        }
        Kind::ResetTransform => {
            if !node.ignores("whatToReset")
                && (node.field("whatToReset").is_none() || node.has_bit("whatToReset", "TRANSFORM"))
            {
                state.matrix = DMat4::IDENTITY;
            }
            return;
        }
        Kind::Units => {
            if node.ignores("units") {
                return;
            }
            let metres = metres_per_unit(node.word("units", "METERS"));
            let factor = metres / state.metres_per_unit;
            state.metres_per_unit = metres;
            DMat4::from_scale(DVec3::splat(factor))
        }
        _ => return,
    };
    state.matrix *= matrix;
}

/// Sixteen numbers by rows of a matrix for row vectors; the identity when there are fewer.
pub fn matrix_from_rows(numbers: &[f64]) -> DMat4 {
    numbers.get(..16).map_or(DMat4::IDENTITY, DMat4::from_cols_slice)
}

/// Scale about `center` along axes turned by `scaleOrientation`, then rotate about `center`, then translate.
fn transform(node: &Node) -> DMat4 {
    let center = node.vector("center", DVec3::ZERO);
    let scale = node.vector("scaleFactor", node.vector("scale", DVec3::ONE));
    let axes = rotation(node, "scaleOrientation");
    DMat4::from_translation(node.vector("translation", DVec3::ZERO) + center)
        * rotation(node, "rotation")
        * axes
        * DMat4::from_scale(scale)
        * axes.transpose()
        * DMat4::from_translation(-center)
}

/// A rotation given as axis and angle; a zero axis turns nothing.
pub fn rotation(node: &Node, field: &str) -> DMat4 {
    DMat4::from_quat(orientation(node, field))
}

/// The rotation of [`rotation`] as a quaternion.
pub fn orientation(node: &Node, field: &str) -> DQuat {
    let Some(&[x, y, z, angle]) = node.numbers(field).map(|numbers| &**numbers) else {
        return DQuat::IDENTITY;
    };
    match DVec3::new(x, y, z).try_normalize() {
        Some(axis) => DQuat::from_axis_angle(axis, angle),
        None => DQuat::IDENTITY,
    }
}

fn metres_per_unit(units: &str) -> f64 {
    match units {
        "CENTIMETERS" => 1e-2,
        "MILLIMETERS" => 1e-3,
        "MICROMETERS" | "MICRONS" => 1e-6,
        "NANOMETERS" => 1e-9,
        "ANGSTROMS" => 1e-10,
        "KILOMETERS" => 1e3,
        "FEET" => 0.3048,
        "INCHES" => 0.0254,
        // A printer's point, 1/72 inch.
        "POINTS" => 0.0254 / 72.0,
        "YARDS" => 0.9144,
        "MILES" => 1609.344,
        "NAUTICAL_MILES" => 1852.0,
        _ => 1.0,
    }
}
