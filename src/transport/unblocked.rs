//! The visible part of an emitter cell, exactly: the cell less the projections of the blockers, as seen from one point.
//!
//! Every edge of a blocker spans a plane with the eye. A fragment of the cell loses the part inside all of a blocker's planes; what lies outside
//! of one stays as a fragment of its own. No sampling noise, so that receivers see a smooth function in penumbrae. Meant for few blockers.

use glam::DVec3;

/// Corners of a fragment, relative to the eye.
const MAX_CORNERS: usize = 16;
/// Heights over a plane below this share of the distance to the emitter's furthest corner count as none: corners that lie on a plane but for
/// rounding must be cut alike whatever the rounding, or fragments divide, and their light is integrated, differently.
const LEAST_HEIGHT: f64 = 1e-9;
/// Fragments, at most; beyond them the caller samples instead.
const MAX_FRAGMENTS: usize = 48;

/// Working memory, kept between calls.
#[derive(Clone, Debug, Default)]
pub struct Fragments {
    left: Polygons,
    kept: Polygons,
    /// What is being cut, and what is left of it.
    whole: Vec<DVec3>,
    part: Vec<DVec3>,
    planes: Vec<DVec3>,
}

/// Polygons seen from the eye, one after the other.
#[derive(Clone, Debug, Default)]
pub struct Polygons {
    corners: Vec<DVec3>,
    ends: Vec<usize>,
}

impl Polygons {
    fn clear(&mut self) {
        self.corners.clear();
        self.ends.clear();
    }

    /// Counts the corners that were added as a polygon; `None` where that is one too many.
    fn close(&mut self) -> Option<()> {
        self.ends.push(self.corners.len());
        (self.ends.len() <= MAX_FRAGMENTS).then_some(())
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// The corners of each, relative to the eye.
    pub fn iter(&self) -> impl Iterator<Item = &[DVec3]> {
        let starts = std::iter::once(&0).chain(&self.ends);
        starts.zip(&self.ends).map(|(start, end)| &self.corners[*start..*end])
    }
}

/// Replaces `inside` by the part of `polygon` with `normal · v ≥ d`, and adds the rest to `outside`; `None` where either has too many corners.
/// Corners within `margin` of the plane lie on it.
fn cut(
    polygon: &[DVec3],
    (normal, d, margin): (DVec3, f64, f64),
    inside: &mut Vec<DVec3>,
    mut outside: Option<&mut Vec<DVec3>>,
) -> Option<()> {
    inside.clear();
    let before = outside.as_ref().map_or(0, |outside| outside.len());
    let mut add_outside = |corner: DVec3| outside.iter_mut().for_each(|outside| outside.push(corner));
    let height = |corner: DVec3| {
        let height = normal.dot(corner) - d;
        if height.abs() <= margin { 0.0 } else { height }
    };
    let mut a = *polygon.last()?;
    let mut height_a = height(a);
    for &b in polygon {
        let height_b = height(b);
        if (height_a > 0.0 && height_b < 0.0) || (height_a < 0.0 && height_b > 0.0) {
            let corner = a + (b - a) * (height_a / (height_a - height_b));
            inside.push(corner);
            add_outside(corner);
        }
        if height_b >= 0.0 {
            inside.push(b);
        }
        if height_b <= 0.0 {
            add_outside(b);
        }
        (a, height_a) = (b, height_b);
    }
    let added = outside.as_ref().map_or(0, |outside| outside.len()) - before;
    (inside.len() <= MAX_CORNERS && added <= MAX_CORNERS).then_some(())
}

/// Leaves of `part` what lies above a plane; `None` where that has too many corners.
fn keep(plane: (DVec3, f64, f64), part: &mut Vec<DVec3>, whole: &mut Vec<DVec3>) -> Option<()> {
    std::mem::swap(whole, part);
    cut(whole, plane, part, None)
}

/// Whether a polygon reaches to the side `normal · v > 0` by more than rounding.
fn reaches(polygon: &[DVec3], normal: DVec3, margin: f64) -> bool {
    polygon.iter().any(|v| normal.dot(*v) > margin)
}

/// The fragments, relative to `eye` (on a plane with unit normal `n`), of the polygon `emitter` (front normal `n_emitter`) that convex
/// `blockers` leave visible. `None` where they become too many to follow.
#[inline(never)]
pub fn visible_fragments<'a, 'b>(
    eye: DVec3,
    n: DVec3,
    emitter: impl Iterator<Item = DVec3> + Clone,
    n_emitter: DVec3,
    blockers: impl Iterator<Item = &'a [DVec3]>,
    fragments: &'b mut Fragments,
) -> Option<&'b Polygons> {
    let Fragments { left, kept, whole, part, planes } = fragments;
    left.clear();
    left.corners.extend(emitter.map(|p| p - eye));
    left.close()?;
    let d_emitter = n_emitter.dot(*left.corners.first()?);
    let margin = LEAST_HEIGHT * left.corners.iter().map(|p| p.length_squared()).fold(0.0, f64::max).sqrt();
    if left.corners.len() > MAX_CORNERS {
        return None;
    }
    for blocker in blockers {
        // Only what lies between counts: above the eye's horizon and in front of the emitter.
        part.clear();
        part.extend(blocker.iter().map(|p| *p - eye));
        keep((n, 0.0, margin), part, whole)?;
        if !part.is_empty() {
            keep((n_emitter, d_emitter, margin), part, whole)?;
        }
        if part.len() < 3 || !set_planes(part, planes) {
            continue;
        }
        kept.clear();
        for fragment in left.iter() {
            subtract((&*planes, margin), fragment, kept, (&mut *whole, &mut *part))?;
        }
        std::mem::swap(left, kept);
        if left.is_empty() {
            break;
        }
    }
    Some(left)
}

/// Makes `planes` the normals, pointing inward, of the planes through the eye and a blocker's edges; `false` for a blocker seen edge-on.
fn set_planes(corners: &[DVec3], planes: &mut Vec<DVec3>) -> bool {
    let next = |i: usize| if i + 1 < corners.len() { corners[i + 1] } else { corners[0] };
    let centre: DVec3 = corners.iter().sum();
    planes.clear();
    planes.extend((0..corners.len()).map(|i| corners[i].cross(next(i))));
    let area: DVec3 = planes.iter().sum();
    let facing = area.dot(centre);
    if facing.abs() <= LEAST_HEIGHT * area.length() * centre.length() {
        return false;
    }
    let sign = facing.signum();
    let mut edge = 0;
    planes.retain_mut(|normal| {
        let (a, b) = (corners[edge], next(edge));
        edge += 1;
        // An edge that runs towards the eye, or has no length, bounds nothing.
        let length = normal.length();
        let bounds = length > 1e-12 * a.length() * b.length();
        *normal *= sign / length;
        bounds
    });
    true
}

/// Appends the parts of `fragment` outside of the blocker with these planes to `kept`.
fn subtract(
    (planes, margin): (&[DVec3], f64),
    fragment: &[DVec3],
    kept: &mut Polygons,
    (rest, spare): (&mut Vec<DVec3>, &mut Vec<DVec3>),
) -> Option<()> {
    if planes.iter().any(|normal| !reaches(fragment, *normal, margin)) {
        kept.corners.extend_from_slice(fragment);
        return kept.close();
    }
    rest.clear();
    rest.extend_from_slice(fragment);
    for &normal in planes {
        if reaches(rest, -normal, margin) {
            let start = kept.corners.len();
            cut(rest, (normal, 0.0, margin), spare, Some(&mut kept.corners))?;
            std::mem::swap(rest, spare);
            if kept.corners.len() - start >= 3 {
                kept.close()?;
            } else {
                kept.corners.truncate(start);
            }
            if rest.len() < 3 {
                break;
            }
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::lambert::form_factor;
    use proptest::prelude::*;

    fn rectangle(low: (f64, f64), high: (f64, f64), z: f64) -> [DVec3; 4] {
        [(low.0, low.1), (low.0, high.1), (high.0, high.1), (high.0, low.1)].map(|(x, y)| DVec3::new(x, y, z))
    }

    /// The share of the form factor that the blockers leave.
    fn visible_share<'a>(source: &[DVec3; 4], blockers: impl Iterator<Item = &'a [DVec3]>) -> Option<f64> {
        let factor = |p: &[DVec3]| form_factor(DVec3::ZERO, DVec3::Z, p.iter().copied());
        let mut fragments = Fragments::default();
        let corners = source.iter().copied();
        let visible =
            visible_fragments(DVec3::ZERO, DVec3::Z, corners, DVec3::NEG_Z, blockers, &mut fragments)?;
        Some(visible.iter().map(factor).sum::<f64>() / factor(source))
    }

    proptest! {
        /// Numerics §8: a rectangle as occluder parallel to a rectangular source.
        #[test]
        fn a_parallel_rectangle_takes_its_projection_from_the_source(
            x in -1.0..1.0f64, y in -1.0..1.0f64, w in 0.05..1.5f64, h in 0.05..1.5f64, z in 0.1..0.9f64,
        ) {
            let source = rectangle((-1.0, -1.0), (1.0, 1.0), 1.0);
            let blocker = rectangle((x, y), (x + w, y + h), z);
            let (low, high) = ((x / z).clamp(-1.0, 1.0), (y / z).clamp(-1.0, 1.0));
            let corner = (((x + w) / z).clamp(-1.0, 1.0), ((y + h) / z).clamp(-1.0, 1.0));
            let shadow = rectangle((low, high), corner, 1.0);
            let factor = |p: &[DVec3; 4]| form_factor(DVec3::ZERO, DVec3::Z, p.iter().copied());
            let exact = 1.0 - factor(&shadow) / factor(&source);
            for reversed in [false, true] {
                let mut corners = blocker;
                if reversed {
                    corners.reverse();
                }
                let share = visible_share(&source, [&corners[..], &corners[..]].into_iter());
                prop_assert!((share.unwrap() - exact).abs() < 1e-12, "{:?} against {}", share, exact);
            }
        }
    }

    #[test]
    fn a_blocker_behind_the_source_or_below_the_horizon_takes_nothing() {
        let source = rectangle((-1.0, -1.0), (1.0, 1.0), 1.0);
        let share = |z: f64| {
            let blocker = rectangle((-0.5, -0.5), (0.5, 0.5), z);
            visible_share(&source, [&blocker[..]].into_iter())
        };
        assert_eq!((share(1.5), share(-0.5)), (Some(1.0), Some(1.0)));
    }

    #[test]
    fn fragments_are_the_same_whichever_way_corners_on_planes_are_rounded() {
        // The blocker stands on the eye's horizon and reaches up to the source's plane.
        let source = rectangle((1.0, -1.0), (3.0, 1.0), 2.0);
        let fragments = |rounding: [f64; 4]| {
            let corners = [(-0.5, 0.0), (0.5, 0.0), (0.5, 2.0), (-0.5, 2.0)];
            let blocker: Vec<DVec3> =
                corners.iter().zip(rounding).map(|((y, z), up)| DVec3::new(0.9, *y, z + up)).collect();
            let (mut fragments, source) = (Fragments::default(), source.iter().copied());
            let down = DVec3::NEG_Z;
            let blockers = std::iter::once(&blocker[..]);
            let left = visible_fragments(DVec3::ZERO, DVec3::Z, source, down, blockers, &mut fragments);
            left.map(|left| left.iter().map(<[DVec3]>::to_vec).collect::<Vec<_>>()).unwrap()
        };
        let exact = fragments([0.0; 4]);
        for up in 0..16 {
            let rounded = fragments([1, 2, 4, 8].map(|bit| if up & bit != 0 { 1e-15 } else { -1e-15 }));
            let corners = |all: &[Vec<DVec3>]| all.iter().map(Vec::len).collect::<Vec<_>>();
            assert_eq!(corners(&rounded), corners(&exact), "{up:b}");
            for (a, b) in rounded.iter().flatten().zip(exact.iter().flatten()) {
                assert!(a.distance(*b) < 1e-12, "{up:b}: {rounded:?} and {exact:?}");
            }
        }
    }
}
