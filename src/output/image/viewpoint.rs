//! A view for scenes without a camera: of many candidates, from the corners inside and from around outside,
//! the one that sees the most lit area and fills the picture best.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_8, PI};

use glam::{DVec2, DVec3};

use super::shade::{Hit, Shade};
use super::view::View;
use crate::output::colour::quantile;
use crate::scene::{Camera, Light, Projection, Scene};

/// Rays per candidate: enough to rank views.
const RAYS: (u32, u32) = (32, 24);
/// Opening angles in radians: wide inside a room, longer from outside.
const ANGLE_INSIDE: f64 = 1.2;
const ANGLE_OUTSIDE: f64 = 0.7;

/// The best of the candidates.
pub(super) fn choose(shade: &Shade) -> Camera {
    let scene = &shade.solution.scene;
    let (low, high) = scene.bounds_m().unwrap_or((DVec3::NEG_ONE, DVec3::ONE));
    let up = up(scene, high - low);
    let mut cameras = inside(low, high, up);
    cameras.extend(outside(low, high, up));
    let seen: Vec<Vec<Sight>> = cameras.iter().map(|c| look(shade, c)).collect();
    let mut luminances: Vec<f64> = seen.iter().flatten().map(|s| s.luminance).collect();
    let typical = quantile(&mut luminances, 0.5);
    let scores: Vec<f64> = seen.iter().map(|s| score(shade, s, typical)).collect();
    let best = (0..cameras.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b])).unwrap_or(0);
    cameras.swap_remove(best)
}

/// A piece of surface seen by one ray.
struct Sight {
    surface: u32,
    area_m2: f64,
    luminance: f64,
}

fn look(shade: &Shade, camera: &Camera) -> Vec<Sight> {
    let view = View::new(camera, RAYS.0, RAYS.1);
    let Projection::Perspective(angle) = camera.projection else { return Vec::new() };
    let pixel = 2.0 * (0.5 * angle).tan() / f64::from(RAYS.1);
    let mut scratch = shade.scratch();
    let mut sights = Vec::new();
    for y in 0..RAYS.1 {
        for x in 0..RAYS.0 {
            let (origin, direction) = view.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            let Some(hit @ Hit { surface, uv }) = shade.hit(origin, direction) else { continue };
            let frame = &shade.solution.surfaces[surface as usize].frame;
            let distance_squared = (frame.point(uv) - origin).length_squared();
            // Grazing views show little of what they cover: count them for at most five times what they fill.
            let cosine = direction.dot(frame.normal).abs().max(0.2);
            let area_m2 = pixel * pixel * distance_squared * camera.direction.dot(direction).powi(3) / cosine;
            sights.push(Sight { surface, area_m2, luminance: shade.luminance(hit, &mut scratch) });
        }
    }
    sights
}

/// Lit area in view, no surface for more than its area, times the root of the share of the picture that
/// shows something.
fn score(shade: &Shade, sights: &[Sight], typical: f64) -> f64 {
    let mut areas: HashMap<u32, (f64, f64)> = HashMap::new();
    for sight in sights {
        let (all, lit) = areas.entry(sight.surface).or_default();
        *all += sight.area_m2;
        if sight.luminance > 0.0 {
            *lit += sight.area_m2 * sight.luminance / (sight.luminance + 0.2 * typical);
        }
    }
    let mut lit: Vec<f64> = areas
        .iter()
        .map(|(surface, (all, lit))| {
            lit * (shade.solution.surfaces[*surface as usize].area_m2 / all).min(1.0)
        })
        .collect();
    // In a fixed order: a sum must not depend on the hash.
    lit.sort_by(f64::total_cmp);
    let filled = sights.len() as f64 / f64::from(RAYS.0 * RAYS.1);
    lit.iter().sum::<f64>() * filled.sqrt()
}

/// Up is where light comes from, if it mostly comes from one axis' direction; else along the shortest
/// extent, +Y when in doubt.
fn up(scene: &Scene, extent: DVec3) -> DVec3 {
    let (mut travels, mut total) = (DVec3::ZERO, 0.0);
    for face in &scene.faces {
        let power: f64 = scene.materials[face.material as usize].exitance_w_m2.iter().sum();
        if power > 0.0 && face.sides == crate::scene::Sides::One {
            let n = face.vertices.len();
            let corner = |i: usize| face.vertices[i % n] - face.vertices[0];
            let area: DVec3 = (0..n).map(|i| 0.5 * corner(i).cross(corner(i + 1))).sum();
            travels += power * area;
            total += power * area.length();
        }
    }
    if total == 0.0 {
        for light in &scene.lights {
            if let Light::Spot { direction, .. } | Light::Directional { direction, .. } = light {
                travels += *direction;
                total += 1.0;
            }
        }
    }
    let strongest = [DVec3::Y, DVec3::Z, DVec3::X]
        .into_iter()
        .flat_map(|a| [a, -a])
        .max_by(|a, b| a.dot(-travels).total_cmp(&b.dot(-travels)).then(a.y.total_cmp(&b.y)));
    match strongest {
        Some(axis) if axis.dot(-travels) > 0.6 * total && total > 0.0 => axis,
        _ if extent.z < 0.7 * extent.y && extent.z <= extent.x => DVec3::Z,
        _ => DVec3::Y,
    }
}

/// Two directions perpendicular to `up` and to each other, along axes.
fn horizontals(up: DVec3) -> (DVec3, DVec3) {
    let first = if up.x.abs() > 0.5 { DVec3::Y } else { DVec3::X };
    (first, up.cross(first))
}

fn camera(position: DVec3, target: DVec3, up: DVec3, angle: f64) -> Camera {
    let direction = (target - position).normalize_or(DVec3::NEG_Z);
    let right = direction.cross(up).normalize_or(direction.any_orthonormal_vector());
    let (up, projection) = (right.cross(direction), Projection::Perspective(angle));
    Camera { name: "automatic".to_owned(), position, direction, up, projection, aspect: 4.0 / 3.0 }
}

/// From near the corners and the middles of the sides, at two heights, towards the middle.
fn inside(low: DVec3, high: DVec3, up: DVec3) -> Vec<Camera> {
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let (a, b) = horizontals(up);
    let along = |direction: DVec3, share: f64| direction * share * (direction.abs().dot(half));
    let mut out = Vec::new();
    for height in [0.15, 0.6] {
        for (i, j) in [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, 0), (1, 0), (0, -1), (0, 1)]
            .map(|(i, j)| (i as f64, j as f64))
        {
            let position = middle + along(a, 0.88 * i) + along(b, 0.88 * j) + along(up, height);
            // Not to the very middle: a little past it and down, so that the far walls and the floor are in
            // view.
            let target = middle - along(a, 0.2 * i) - along(b, 0.2 * j) - along(up, 0.15);
            out.push(camera(position, target, up, ANGLE_INSIDE));
        }
    }
    out
}

/// From all around, level to steep, at the distance from which the whole scene just fits.
fn outside(low: DVec3, high: DVec3, up: DVec3) -> Vec<Camera> {
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let (a, b) = horizontals(up);
    let tangent = (0.5 * ANGLE_OUTSIDE).tan();
    let mut out = Vec::new();
    for elevation in [0.0, 0.45, 0.9f64] {
        for step in 0..16 {
            let (sin, cos) = (f64::from(step) * FRAC_PI_8 + 0.5 * PI).sin_cos();
            let away = elevation.cos() * (cos * a + sin * b) + elevation.sin() * up;
            let aimed = camera(middle + away, middle, up, ANGLE_OUTSIDE);
            let right = aimed.direction.cross(aimed.up);
            let distance = (0..8).fold(0.0f64, |most, corner| {
                let sign = |bit: u32| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
                let q = half * DVec3::new(sign(0), sign(1), sign(2));
                let wide = q.dot(right).abs() / (tangent * 4.0 / 3.0);
                let tall = q.dot(aimed.up).abs() / tangent;
                most.max(wide.max(tall) - q.dot(aimed.direction))
            });
            out.push(Camera { position: middle + 1.06 * distance * away, ..aimed });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Basis;
    use crate::output::rooms;

    #[test]
    fn a_closed_room_is_seen_from_inside_and_a_block_from_outside() {
        for (solution, expect_inside) in
            [(rooms::gallery(Basis::M2, 2, 0), true), (rooms::block(Basis::M2, 2, 0), false)]
        {
            let cast = |origin, direction| rooms::cast(&solution, origin, direction);
            let camera = choose(&Shade::new(&solution, &cast));
            let (low, high) = solution.scene.bounds_m().unwrap();
            let is_inside = camera.position.cmpgt(low).all() && camera.position.cmplt(high).all();
            assert_eq!(is_inside, expect_inside, "{} {camera:?}", solution.scene.name);
        }
    }

    #[test]
    fn up_is_where_the_lamps_are() {
        let solution = rooms::gallery(Basis::Haar, 0, 0);
        assert_eq!(up(&solution.scene, DVec3::ONE), DVec3::Z);
        assert_eq!(up(&Scene::default(), DVec3::new(5.0, 3.0, 5.0)), DVec3::Y);
        assert_eq!(up(&Scene::default(), DVec3::new(9.0, 7.0, 2.5)), DVec3::Z);
    }
}
