//! Is a solution that came from outside consistent? What passes here cannot make another room panic, loop
//! or read beyond its data.

use glam::{DVec2, DVec3};

use crate::math::polygon;
use crate::radiosity::{Field, Node, Solution};
use crate::scene::{Camera, Light, Projection, Scene, Surface};

/// Cells deeper than this are smaller than the spacing of numbers near 1.
const MAX_DEPTH: u32 = 104;

/// `Err` says what is wrong.
pub(super) fn check(solution: &Solution) -> Result<(), String> {
    let scene = &solution.scene;
    check_scene(scene)?;
    if solution.surfaces.len() != solution.fields.len() {
        let (surfaces, fields) = (solution.surfaces.len(), solution.fields.len());
        return Err(format!("{surfaces} surfaces but {fields} irradiance fields"));
    }
    for (i, (surface, field)) in solution.surfaces.iter().zip(&solution.fields).enumerate() {
        check_surface(surface, scene).map_err(|problem| format!("surface {i}: {problem}"))?;
        check_field(field, scene.bands.len())
            .map_err(|problem| format!("irradiance of surface {i}: {problem}"))?;
    }
    all_finite([solution.error_target, solution.error_estimate], "the error")
}

fn all_finite(values: impl IntoIterator<Item = f64>, what: &str) -> Result<(), String> {
    match values.into_iter().all(f64::is_finite) {
        true => Ok(()),
        false => Err(format!("{what} is not a finite number")),
    }
}

fn coordinates(points: &[DVec3]) -> impl Iterator<Item = f64> + '_ {
    points.iter().flat_map(|p| p.to_array())
}

/// One value per band, each finite and not negative.
fn check_spectrum(values: &[f64], bands: usize, what: &str) -> Result<(), String> {
    if values.len() != bands {
        return Err(format!("{what} has {} values for {bands} bands", values.len()));
    }
    match values.iter().all(|v| v.is_finite() && *v >= 0.0) {
        true => Ok(()),
        false => Err(format!("{what} has a value that is negative or not finite")),
    }
}

fn check_scene(scene: &Scene) -> Result<(), String> {
    let bands = scene.bands.len();
    if bands == 0 {
        return Err("the scene has no spectral bands".to_owned());
    }
    for (i, face) in scene.faces.iter().enumerate() {
        if face.material as usize >= scene.materials.len() {
            let count = scene.materials.len();
            return Err(format!("face {i} is made of material {}, but there are {count}", face.material));
        }
        if face.vertices.len() < 3 {
            return Err(format!("face {i} has {} corners", face.vertices.len()));
        }
        all_finite(coordinates(&face.vertices), &format!("a corner of face {i}"))?;
    }
    for (i, material) in scene.materials.iter().enumerate() {
        check_spectrum(&material.reflectance, bands, &format!("the reflectance of material {i}"))?;
        check_spectrum(&material.exitance_w_m2, bands, &format!("the exitance of material {i}"))?;
    }
    for (i, light) in scene.lights.iter().enumerate() {
        check_light(light, bands).map_err(|problem| format!("light {i}: {problem}"))?;
    }
    scene.cameras.iter().try_for_each(check_camera)
}

fn check_light(light: &Light, bands: usize) -> Result<(), String> {
    match light {
        Light::Point { position, intensity_w_sr } => {
            all_finite(position.to_array(), "its position")?;
            check_spectrum(intensity_w_sr, bands, "its intensity")
        }
        Light::Spot { position, direction, intensity_w_sr, cutoff_rad, exponent } => {
            all_finite(coordinates(&[*position, *direction]), "its position or direction")?;
            all_finite([*cutoff_rad, *exponent], "its cone")?;
            check_spectrum(intensity_w_sr, bands, "its intensity")
        }
        Light::Directional { direction, irradiance_w_m2 } => {
            all_finite(direction.to_array(), "its direction")?;
            check_spectrum(irradiance_w_m2, bands, "its irradiance")
        }
    }
}

fn check_camera(camera: &Camera) -> Result<(), String> {
    let (Projection::Perspective(extent) | Projection::Orthographic(extent)) = camera.projection;
    let vectors = [camera.position, camera.direction, camera.up];
    let what = format!("a number of camera '{}'", camera.name);
    all_finite(coordinates(&vectors).chain([extent, camera.aspect]), &what)
}

fn check_surface(surface: &Surface, scene: &Scene) -> Result<(), String> {
    if surface.face as usize >= scene.faces.len() {
        return Err(format!("it belongs to face {}, but there are {}", surface.face, scene.faces.len()));
    }
    let frame = &surface.frame;
    let vectors = [frame.origin, frame.u, frame.v, frame.normal];
    all_finite(coordinates(&vectors).chain([frame.area_m2, surface.area_m2]), "its frame")?;
    let spanned = frame.u.cross(frame.v).length();
    if !(spanned > 0.0 && frame.area_m2 > 0.0 && surface.area_m2 > 0.0) {
        return Err("its parallelogram has no area".to_owned());
    }
    if surface.outline.len() < 3 || !surface.outline.iter().all(|p| p.is_finite()) {
        return Err("its outline is not a polygon of finite corners".to_owned());
    }
    let near = |p: &DVec2| p.cmpgt(DVec2::splat(-0.01)).all() && p.cmplt(DVec2::splat(1.01)).all();
    if !surface.outline.iter().all(near) || polygon::area(&surface.outline) <= 0.0 {
        return Err("its outline does not lie counter-clockwise in its parallelogram".to_owned());
    }
    check_spectrum(&surface.reflectance, scene.bands.len(), "its reflectance")?;
    check_spectrum(&surface.exitance_w_m2, scene.bands.len(), "its exitance")
}

/// A tree: every node but the root is the child of exactly one node before it, and none is too deep.
fn check_field(field: &Field, bands: usize) -> Result<(), String> {
    if field.bands != bands {
        return Err(format!("it has {} bands, the scene {bands}", field.bands));
    }
    if field.nodes.is_empty() {
        return Err("it has no nodes".to_owned());
    }
    let leaf_length = field.basis.len() * bands;
    let mut depth: Vec<Option<u32>> = vec![None; field.nodes.len()];
    depth[0] = Some(0);
    for (i, node) in field.nodes.iter().enumerate() {
        let Some(own) = depth[i] else { return Err(format!("node {i} has no parent before it")) };
        match *node {
            Node::Outside => {}
            Node::Leaf(start) => {
                let end = (start as usize).checked_add(leaf_length);
                if end.is_none_or(|end| end > field.coefficients.len()) {
                    let count = field.coefficients.len();
                    return Err(format!("leaf {i} starts at coefficient {start}, of {count}"));
                }
            }
            Node::Inner(split, first) => {
                let children = first as usize..first as usize + split.children().len();
                if first as usize <= i || children.end > depth.len() {
                    return Err(format!(
                        "the children of node {i} would be {children:?}, of {}",
                        depth.len()
                    ));
                }
                if own >= MAX_DEPTH {
                    return Err(format!("node {i} is deeper than {MAX_DEPTH} levels"));
                }
                for child in &mut depth[children] {
                    if child.replace(own + 1).is_some() {
                        return Err(format!("a child of node {i} has another parent, too"));
                    }
                }
            }
        }
    }
    all_finite(field.coefficients.iter().copied(), "a coefficient")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Basis, Split};
    use crate::output::rooms;

    #[test]
    fn each_contradiction_is_named() {
        type Change = fn(&mut Solution);
        let changes: [(Change, &str); 9] = [
            (|s| s.fields[2].nodes[0] = Node::Inner(Split::U, 0), "children of node 0"),
            (|s| s.fields[2].nodes[1] = Node::Inner(Split::U, u32::MAX), "children of node 1"),
            (|s| s.fields[0].nodes[0] = Node::Leaf(0), "no parent"),
            (|s| s.fields[0].coefficients[3] = f64::NAN, "coefficient is not a finite"),
            (|s| s.fields[0].coefficients.clear(), "starts at coefficient"),
            (|s| s.surfaces[1].reflectance.push(0.1), "4 values for 3 bands"),
            (|s| s.surfaces[1].frame.v = s.surfaces[1].frame.u, "no area"),
            (|s| s.scene.faces[0].material = 77, "material 77"),
            (|s| drop(s.fields.pop()), "fields"),
        ];
        for (change, expected) in changes {
            let mut solution = rooms::gallery(Basis::M2, 3, 9);
            check(&solution).unwrap();
            change(&mut solution);
            let problem = check(&solution).unwrap_err();
            assert!(problem.contains(expected), "{problem}");
        }
    }

    #[test]
    fn shared_children_are_refused_for_they_make_exponential_trees() {
        let mut solution = rooms::gallery(Basis::Haar, 0, 9);
        let both = |first| Node::Inner(Split::U, first);
        solution.fields[0].nodes = vec![both(1), both(3), both(3), Node::Leaf(0), Node::Leaf(0)];
        let problem = check(&solution).unwrap_err();
        assert!(problem.contains("another parent"), "{problem}");
    }
}
