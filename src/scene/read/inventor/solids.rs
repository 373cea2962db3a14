//! Cube, sphere, cone and cylinder → planar polygons, counter-clockwise from outside.
//!
//! Curved ones are inscribed polyhedra: `n = 4 + 4·round(4·complexity)` sides around (12 at the default
//! complexity of 0.5, where a cylinder's side lacks 1.1 % of its area; 20 at most), `n/2` rings from pole to
//! pole. Every quadrilateral is an isosceles trapezoid or a rectangle, hence planar under any affine map.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::document::Node;
use super::schema::Kind;
use crate::scene::read::ReadError;

/// What is called for every polygon, with the number of its part; an error ends the shape.
type Visit<'a> = dyn FnMut(&[DVec3], usize) -> Result<(), ReadError> + 'a;

/// Calls `visit(corners, part)` for every polygon of a solid; stops at the first error.
pub fn for_each(node: &Node, complexity: f64, visit: &mut Visit) -> Result<(), ReadError> {
    let sides = sides(complexity);
    match node.kind {
        Kind::Cube => cube(node, visit),
        Kind::Sphere => sphere(node.number("radius", 1.0), sides, visit),
        Kind::Cone => cone(node, sides, visit),
        Kind::Cylinder => cylinder(node, sides, visit),
        _ => Ok(()),
    }
}

/// Sides around a curved shape.
fn sides(complexity: f64) -> usize {
    // A complexity that is not a number casts to 0.
    4 + 4 * (4.0 * complexity.clamp(0.0, 1.0)).round() as usize
}

/// Parts in Inventor's order: front, back, left, right, top, bottom.
fn cube(node: &Node, visit: &mut Visit) -> Result<(), ReadError> {
    let written =
        DVec3::new(node.number("width", 2.0), node.number("height", 2.0), node.number("depth", 2.0));
    let half = node.vector("size", written) * 0.5;
    let faces = [
        (DVec3::X, DVec3::Y, DVec3::Z),
        (DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z),
        (DVec3::Z, DVec3::Y, DVec3::NEG_X),
        (DVec3::NEG_Z, DVec3::Y, DVec3::X),
        (DVec3::X, DVec3::NEG_Z, DVec3::Y),
        (DVec3::X, DVec3::Z, DVec3::NEG_Y),
    ];
    for (part, (right, up, out)) in faces.into_iter().enumerate() {
        let corners = [-right - up, right - up, right + up, up - right].map(|corner| (corner + out) * half);
        visit(&corners, part)?;
    }
    Ok(())
}

fn sphere(radius: f64, sides: usize, visit: &mut Visit) -> Result<(), ReadError> {
    let rings = sides / 2;
    let ring = |i: usize| {
        let polar = PI * i as f64 / rings as f64;
        // Exactly zero at both poles, so that the triangles there share one point.
        let around = if i == 0 || i == rings { 0.0 } else { polar.sin() };
        (radius * around, radius * polar.cos())
    };
    for i in 0..rings {
        let ((upper_radius, upper), (lower_radius, lower)) = (ring(i), ring(i + 1));
        for j in 0..sides {
            let (a, b) = (around(j, sides), around(j + 1, sides));
            let (upper, lower) = (upper * DVec3::Y, lower * DVec3::Y);
            let corners = [
                upper + upper_radius * a,
                lower + lower_radius * a,
                lower + lower_radius * b,
                upper + upper_radius * b,
            ];
            match i {
                0 => visit(&corners[..3], 0)?,
                _ if i + 1 == rings => visit(&[corners[0], corners[1], corners[3]], 0)?,
                _ => visit(&corners, 0)?,
            }
        }
    }
    Ok(())
}

/// Parts: sides, bottom.
fn cone(node: &Node, sides: usize, visit: &mut Visit) -> Result<(), ReadError> {
    let radius = node.number("bottomRadius", 1.0);
    let apex = DVec3::Y * (0.5 * node.number("height", 2.0));
    if node.has_bit("parts", "SIDES") && node.flag("side", true) {
        for j in 0..sides {
            visit(&[apex, radius * around(j, sides) - apex, radius * around(j + 1, sides) - apex], 0)?;
        }
    }
    if node.has_bit("parts", "BOTTOM") && node.flag("bottom", true) {
        let corners: Vec<DVec3> = (0..sides).rev().map(|j| radius * around(j, sides) - apex).collect();
        visit(&corners, 1)?;
    }
    Ok(())
}

/// Parts: sides, top, bottom.
fn cylinder(node: &Node, sides: usize, visit: &mut Visit) -> Result<(), ReadError> {
    let radius = node.number("radius", 1.0);
    let top = DVec3::Y * (0.5 * node.number("height", 2.0));
    if node.has_bit("parts", "SIDES") && node.flag("side", true) {
        for j in 0..sides {
            let (a, b) = (radius * around(j, sides), radius * around(j + 1, sides));
            visit(&[a + top, a - top, b - top, b + top], 0)?;
        }
    }
    if node.has_bit("parts", "TOP") && node.flag("top", true) {
        let corners: Vec<DVec3> = (0..sides).map(|j| radius * around(j, sides) + top).collect();
        visit(&corners, 1)?;
    }
    if node.has_bit("parts", "BOTTOM") && node.flag("bottom", true) {
        let corners: Vec<DVec3> = (0..sides).rev().map(|j| radius * around(j, sides) - top).collect();
        visit(&corners, 2)?;
    }
    Ok(())
}

/// Corner `j` of `n` on the unit circle about Y, counter-clockwise from above; the last is exactly the first.
fn around(j: usize, n: usize) -> DVec3 {
    let angle = TAU * (j % n) as f64 / n as f64;
    DVec3::new(angle.sin(), 0.0, angle.cos())
}
