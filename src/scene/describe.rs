//! A scene in words and numbers: the first part of what `wrad info` prints.

use std::fmt::Write;

use super::planar::plane;
use super::{Face, Light, Projection, Scene, Sides};

/// Counts, extents, emitted power, lights, cameras and findings of a scene, some lines of text.
pub fn describe(scene: &Scene) -> String {
    // Writing to a string cannot fail.
    let mut out = String::new();
    let surfaces: usize = scene.faces.iter().map(lit_sides).sum();
    let concave = scene.faces.iter().filter(|face| is_concave(face)).count();
    let _ = writeln!(out, "scene      {}", scene.name);
    let _ = writeln!(out, "bands      {}", scene.bands.join(" "));
    let _ = writeln!(
        out,
        "faces      {} ({concave} concave), {surfaces} lit sides, {} corners",
        scene.faces.len(),
        scene.faces.iter().map(|face| face.vertices.len()).sum::<usize>()
    );
    let emitters = scene.faces.iter().filter(|face| emits(scene, face)).count();
    let _ = writeln!(out, "materials  {}; {emitters} faces emit", scene.materials.len());
    if let Some((low, high)) = scene.bounds_m() {
        let size = high - low;
        let _ = writeln!(
            out,
            "extent     {:.4} × {:.4} × {:.4} m from ({:.4}, {:.4}, {:.4})",
            size.x, size.y, size.z, low.x, low.y, low.z
        );
    }
    let area: f64 = scene.faces.iter().map(|face| face_area(face) * lit_sides(face) as f64).sum();
    let _ = writeln!(out, "area       {area:.4} m² of lit sides");
    let power: Vec<String> = emitted_power_w(scene).iter().map(|watts| format!("{watts:.4}")).collect();
    let _ = writeln!(out, "emission   {} W from faces", power.join(" "));
    for light in &scene.lights {
        let _ = writeln!(out, "light      {}", light_line(light));
    }
    for camera in &scene.cameras {
        let projection = match camera.projection {
            Projection::Perspective(angle) => format!("perspective, {:.1}°", angle.to_degrees()),
            Projection::Orthographic(height) => format!("orthographic, {height} m"),
        };
        let _ = writeln!(out, "camera     {} ({projection})", camera.name);
    }
    for (what, count) in &scene.findings.skipped {
        let _ = writeln!(out, "skipped    {count} × {what}");
    }
    for (rule, finding) in &scene.findings.repairs {
        let _ = writeln!(out, "repaired   {} × {rule}; first {}", finding.count, finding.first);
    }
    out
}

/// Power emitted by all lit sides of all faces, W per band.
pub fn emitted_power_w(scene: &Scene) -> Vec<f64> {
    let mut power = vec![0.0; scene.bands.len()];
    for face in &scene.faces {
        let area = face_area(face) * lit_sides(face) as f64;
        let exitance = &scene.materials[face.material as usize].exitance_w_m2;
        for (sum, m) in power.iter_mut().zip(exitance) {
            *sum += area * m;
        }
    }
    power
}

fn light_line(light: &Light) -> String {
    match light {
        Light::Point { position, intensity_w_sr } => format!("point at {position}, {intensity_w_sr:?} W/sr"),
        Light::Spot { position, intensity_w_sr, cutoff_rad, .. } => {
            format!("spot at {position}, {intensity_w_sr:?} W/sr within {:.1}°", cutoff_rad.to_degrees())
        }
        Light::Directional { direction, irradiance_w_m2 } => {
            format!("directional along {direction:.4}, {irradiance_w_m2:?} W/m²")
        }
    }
}

fn emits(scene: &Scene, face: &Face) -> bool {
    scene.materials[face.material as usize].exitance_w_m2.iter().any(|m| *m > 0.0)
}

fn lit_sides(face: &Face) -> usize {
    match face.sides {
        Sides::One => 1,
        Sides::Two => 2,
    }
}

fn face_area(face: &Face) -> f64 {
    plane(&face.vertices).map_or(0.0, |plane| plane.area_m2)
}

/// Whether a corner turns against the sense of its face by more than rounding.
fn is_concave(face: &Face) -> bool {
    let Some(plane) = plane(&face.vertices) else { return false };
    let n = face.vertices.len();
    (0..n).any(|i| {
        let [a, b, c] = [i, i + 1, i + 2].map(|k| face.vertices[k % n]);
        let (arriving, leaving) = (b - a, c - b);
        plane.normal.dot(arriving.cross(leaving)) < -1e-6 * arriving.length() * leaving.length()
    })
}
