//! Parts of buildings: columns, balustrades, vases, glazing bars.

use glam::{DVec3, dvec3};

use super::sketch::Polygon;
use super::solids::{ENDS, STANDING, Side, block, cuboid, lathe};

/// A column on the origin with a square plinth below and a square slab above, whose top may be hidden by what it carries;
/// `segments` follow the swelling of its shaft.
pub(super) fn column(
    height: f64,
    radius: f64,
    [sides, segments]: [usize; 2],
    hidden: &[Side],
) -> Vec<Polygon> {
    let (r, half) = (radius, 1.4 * radius);
    let (foot, head) = (0.5 * r, height - 0.4 * r);
    let mut faces = cuboid(dvec3(-half, -half, 0.0), dvec3(half, half, foot), STANDING);
    let (low, high) = (foot + 0.5 * r, head - 1.5 * r);
    let mut profile = vec![(1.25 * r, foot), (1.35 * r, foot + 0.15 * r), (1.25 * r, foot + 0.3 * r)];
    profile.extend((0..=segments).map(|i| {
        let t = i as f64 / segments as f64;
        (r * (1.0 - 0.17 * t * t), low + t * (high - low))
    }));
    profile.extend([
        (0.97 * r, high + 0.1 * r),
        (0.9 * r, high + 0.3 * r),
        (0.97 * r, high + 0.8 * r),
        (1.3 * r, head),
    ]);
    faces.extend(lathe(&profile, sides, false, false));
    faces.extend(cuboid(dvec3(-half, -half, head), dvec3(half, half, height), hidden));
    faces
}

/// A balustrade from `x0` to `x1` above the x axis, between things that hide its ends.
pub(super) fn balustrade(x0: f64, x1: f64, height: f64, balusters: usize, sides: usize) -> Vec<Polygon> {
    let (low, high) = (0.12 * height, 0.86 * height);
    let hidden = [ENDS, STANDING].concat();
    let half = 0.13;
    let mut faces = cuboid(dvec3(x0, -half, 0.0), dvec3(x1, half, low), &hidden);
    let width = high - low;
    let profile = [(0.08, 0.0), (0.05, 0.12), (0.1, 0.35), (0.05, 0.75), (0.08, 1.0)]
        .map(|(r, t)| (r, low + t * width));
    for i in 0..balusters {
        let x = x0 + (x1 - x0) * (i as f64 + 0.5) / balusters as f64;
        faces.extend(moved(lathe(&profile, sides, false, false), dvec3(x, 0.0, 0.0)));
    }
    faces.extend(cuboid(dvec3(x0, -half, high), dvec3(x1, half, height), ENDS));
    faces
}

/// A vase on a foot on the origin.
pub(super) fn vase(height: f64, sides: usize) -> Vec<Polygon> {
    let shape = [
        (0.2, 0.0),
        (0.2, 0.08),
        (0.08, 0.15),
        (0.1, 0.25),
        (0.34, 0.5),
        (0.38, 0.68),
        (0.2, 0.8),
        (0.26, 0.9),
        (0.08, 1.0),
    ];
    lathe(&shape.map(|(r, z)| (r * height, z * height)), sides, false, true)
}

/// Glazing bars on a pane at depth `z` behind the wall, in the wall's coordinates; what surrounds the pane hides their ends.
pub(super) fn bars([x0, x1, y0, y1]: [f64; 4], z: f64, columns: usize, rows: usize) -> Vec<Polygon> {
    let (half, depth) = (0.025, 0.05);
    let x = |i: usize| x0 + (x1 - x0) * i as f64 / columns as f64;
    let y = |i: usize| y0 + (y1 - y0) * i as f64 / rows as f64;
    let mut faces = Vec::new();
    for i in 1..columns {
        let (low, high) = (dvec3(x(i) - half, y0, z), dvec3(x(i) + half, y1, z + depth));
        faces.extend(block(low, high, &[Side::Front, Side::Back]));
    }
    for i in 0..columns {
        let left = if i == 0 { x0 } else { x(i) + half };
        let right = if i + 1 == columns { x1 } else { x(i + 1) - half };
        for j in 1..rows {
            faces.extend(block(dvec3(left, y(j) - half, z), dvec3(right, y(j) + half, z + depth), ENDS));
        }
    }
    faces
}

/// Faces moved up.
pub(super) fn raised(faces: Vec<Polygon>, by: f64) -> Vec<Polygon> {
    moved(faces, dvec3(0.0, 0.0, by))
}

/// Faces moved.
pub(super) fn moved(mut faces: Vec<Polygon>, by: DVec3) -> Vec<Polygon> {
    faces.iter_mut().flatten().for_each(|vertex| *vertex += by);
    faces
}
