//! Solids as faces that look outward. Faces that nothing can see, where a solid stands on something, are left off.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, dvec3};

use super::sketch::Polygon;

/// A side of a cuboid by the direction it looks in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Left,
    Right,
    Front,
    Back,
    Bottom,
    Top,
}

/// The ends of a cuboid along x.
pub(super) const ENDS: &[Side] = &[Side::Left, Side::Right];
/// What cannot be seen of a cuboid that stands on something.
pub(super) const STANDING: &[Side] = &[Side::Bottom];
/// What cannot be seen of a cuboid between something below and something above.
pub(super) const BETWEEN: &[Side] = &[Side::Bottom, Side::Top];

/// The cuboid from `low` to `high` without some sides; front is towards −y.
pub(super) fn cuboid(low: DVec3, high: DVec3, without: &[Side]) -> Vec<Polygon> {
    let (a, b) = (low, high);
    let all = [
        (Side::Left, [(a.x, b.y, a.z), (a.x, a.y, a.z), (a.x, a.y, b.z), (a.x, b.y, b.z)]),
        (Side::Right, [(b.x, a.y, a.z), (b.x, b.y, a.z), (b.x, b.y, b.z), (b.x, a.y, b.z)]),
        (Side::Front, [(a.x, a.y, a.z), (b.x, a.y, a.z), (b.x, a.y, b.z), (a.x, a.y, b.z)]),
        (Side::Back, [(b.x, b.y, a.z), (a.x, b.y, a.z), (a.x, b.y, b.z), (b.x, b.y, b.z)]),
        (Side::Bottom, [(a.x, b.y, a.z), (b.x, b.y, a.z), (b.x, a.y, a.z), (a.x, a.y, a.z)]),
        (Side::Top, [(a.x, a.y, b.z), (b.x, a.y, b.z), (b.x, b.y, b.z), (a.x, b.y, b.z)]),
    ];
    let kept = all.into_iter().filter(|(side, _)| !without.contains(side));
    kept.map(|(_, corners)| corners.map(DVec3::from).to_vec()).collect()
}

/// A block on a wall in the wall's coordinates (x right, y up, z out): no back.
pub(super) fn block(low: DVec3, high: DVec3, without: &[Side]) -> Vec<Polygon> {
    // In these coordinates the back of the block is what `cuboid` calls its bottom.
    let hidden: Vec<Side> = without.iter().copied().chain([Side::Bottom]).collect();
    cuboid(low, high, &hidden)
}

/// A prism over an outline that is counter-clockwise seen from +z, with or without its ends.
pub(super) fn prism(outline: &[DVec2], z0: f64, z1: f64, bottom: bool, top: bool) -> Vec<Polygon> {
    let at = |p: DVec2, z: f64| p.extend(z);
    let mut faces: Vec<Polygon> =
        edges(outline).map(|(p, q)| vec![at(p, z0), at(q, z0), at(q, z1), at(p, z1)]).collect();
    if bottom {
        faces.push(outline.iter().rev().map(|p| at(*p, z0)).collect());
    }
    if top {
        faces.push(outline.iter().map(|p| at(*p, z1)).collect());
    }
    faces
}

fn edges(outline: &[DVec2]) -> impl Iterator<Item = (DVec2, DVec2)> {
    (0..outline.len()).map(|i| (outline[i], outline[(i + 1) % outline.len()]))
}

/// A regular polygon around the z axis, two of its sides parallel to x if their number is even.
pub(super) fn ring(radius: f64, sides: usize) -> Vec<DVec2> {
    let step = TAU / sides as f64;
    (0..sides).map(|i| radius * DVec2::from_angle(step * (i as f64 + 0.5) - 0.5 * PI)).collect()
}

/// A solid of revolution around the z axis: the profile (radius, height) goes up on the outside (and down on an inside).
/// Its ends are closed by polygons if asked for.
pub(super) fn lathe(profile: &[(f64, f64)], sides: usize, bottom: bool, top: bool) -> Vec<Polygon> {
    let mut faces = Vec::new();
    for pair in profile.windows(2) {
        let [lower, upper] = [pair[0], pair[1]].map(|(r, z)| (ring(r, sides), z));
        for i in 0..sides {
            let j = (i + 1) % sides;
            let mut face = vec![lower.0[i].extend(lower.1)];
            if pair[0].0 > 0.0 {
                face.push(lower.0[j].extend(lower.1));
            }
            face.push(upper.0[j].extend(upper.1));
            if pair[1].0 > 0.0 {
                face.push(upper.0[i].extend(upper.1));
            }
            faces.push(face);
        }
    }
    if let (true, Some((r, z))) = (bottom, profile.first()) {
        faces.push(disc(*r, *z, sides).into_iter().rev().collect());
    }
    if let (true, Some((r, z))) = (top, profile.last()) {
        faces.push(disc(*r, *z, sides));
    }
    faces
}

/// A horizontal polygon around the z axis that looks up.
pub(super) fn disc(radius: f64, z: f64, sides: usize) -> Polygon {
    ring(radius, sides).into_iter().map(|p| p.extend(z)).collect()
}

/// A moulding along a wall, in the wall's coordinates, from `x0` to `x1`: the profile (out, up) starts and ends at the wall and
/// goes upward. Both ends are closed.
pub(super) fn moulding(profile: &[(f64, f64)], x0: f64, x1: f64) -> Vec<Polygon> {
    let at = |x: f64, (out, up): (f64, f64)| dvec3(x, up, out);
    let mut faces: Vec<Polygon> =
        profile.windows(2).map(|s| vec![at(x0, s[0]), at(x1, s[0]), at(x1, s[1]), at(x0, s[1])]).collect();
    faces.push(profile.iter().map(|p| at(x0, *p)).collect());
    faces.push(profile.iter().rev().map(|p| at(x1, *p)).collect());
    faces
}

/// A moulding around the inside of a square court of which the wall is one side, from corner to corner, mitred.
pub(super) fn mitred(profile: &[(f64, f64)], half: f64) -> Vec<Polygon> {
    let at = |sign: f64, (out, up): (f64, f64)| dvec3(sign * (half - out), up, out);
    let strip = |s: &[(f64, f64)]| vec![at(-1.0, s[0]), at(1.0, s[0]), at(1.0, s[1]), at(-1.0, s[1])];
    profile.windows(2).map(strip).collect()
}

/// A profile that swells from (out, up) `from` to `to` in a quarter of an ellipse: a cyma's half, an ovolo.
pub(super) fn swell(from: (f64, f64), to: (f64, f64), segments: usize) -> Vec<(f64, f64)> {
    let at = |i: usize| {
        let (sin, cos) = (0.5 * PI * i as f64 / segments as f64).sin_cos();
        (from.0 + (to.0 - from.0) * (1.0 - cos), from.1 + (to.1 - from.1) * sin)
    };
    (0..=segments).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    /// Volume by the divergence theorem.
    fn volume(faces: &[Polygon]) -> f64 {
        let fan = |f: &Polygon| (1..f.len() - 1).map(|i| f[0].dot(f[i].cross(f[i + 1])) / 6.0).sum::<f64>();
        faces.iter().map(fan).sum()
    }

    /// Every edge is walked once in each direction.
    fn is_closed(faces: &[Polygon]) -> bool {
        let key = |p: DVec3| (1e6 * p).round().to_array().map(|c| c as i64);
        let mut edges = HashMap::new();
        for face in faces {
            for i in 0..face.len() {
                let (a, b) = (key(face[i]), key(face[(i + 1) % face.len()]));
                *edges.entry((a.min(b), a.max(b))).or_insert(0) += if a < b { 1 } else { -1 };
            }
        }
        edges.values().all(|balance| *balance == 0)
    }

    #[test]
    fn solids_are_closed_and_look_outward() {
        let square = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)].map(DVec2::from);
        let n = 7;
        let area = |r: f64| 0.5 * n as f64 * r * r * (TAU / n as f64).sin();
        let cases = [
            (cuboid(DVec3::ONE, dvec3(2.0, 3.0, 4.0), &[]), 6.0),
            (prism(&square, 1.0, 4.0, true, true), 6.0),
            (lathe(&[(1.0, 0.0), (1.0, 2.0)], n, true, true), 2.0 * area(1.0)),
            (
                lathe(
                    &[(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.5, 2.0), (0.5, 1.0), (0.0, 1.0)],
                    n,
                    false,
                    false,
                ),
                2.0 * area(1.0) - area(0.5),
            ),
            (lathe(&[(0.0, 0.0), (1.0, 1.0), (0.0, 2.0)], n, false, false), 2.0 / 3.0 * area(1.0)),
        ];
        for (faces, expected) in cases {
            assert!(is_closed(&faces));
            assert!((volume(&faces) - expected).abs() < 1e-12, "{} {expected}", volume(&faces));
        }
    }

    #[test]
    fn what_stands_on_a_wall_is_closed_by_the_wall() {
        let back = |x1: f64, y0: f64, y1: f64| {
            vec![dvec3(0.0, y0, 0.0), dvec3(0.0, y1, 0.0), dvec3(x1, y1, 0.0), dvec3(x1, y0, 0.0)]
        };
        let mut faces = block(DVec3::ZERO, dvec3(3.0, 2.0, 1.0), &[]);
        faces.push(back(3.0, 0.0, 2.0));
        assert!(is_closed(&faces) && (volume(&faces) - 6.0).abs() < 1e-12);
        let mut profile = vec![(0.0, 0.0)];
        profile.extend(swell((0.1, 0.0), (0.5, 0.4), 3));
        profile.push((0.0, 0.4));
        let mut faces = moulding(&profile, 0.0, 3.0);
        faces.push(back(3.0, 0.0, 0.4));
        assert!(is_closed(&faces) && volume(&faces) > 0.1);
    }
}
