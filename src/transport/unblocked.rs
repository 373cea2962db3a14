//! The visible part of an emitter cell, exactly: the cell less the projections of the blockers, as seen from one point.
//!
//! Every edge of a blocker spans a plane with the eye. A fragment of the cell loses the part inside all of a blocker's planes; what lies outside
//! of one stays as a fragment of its own. No sampling noise, so that receivers see a smooth function in penumbrae. Meant for few blockers.

use glam::DVec3;

/// Corners of a fragment, relative to the eye.
const MAX_CORNERS: usize = 16;
/// Fragments, at most; beyond them the caller samples instead.
const MAX_FRAGMENTS: usize = 48;

/// Fragments of the call at hand, kept between calls.
#[derive(Clone, Debug, Default)]
pub struct Fragments {
    whole: Vec<Fragment>,
    kept: Vec<Fragment>,
    /// The part of a blocker that lies between.
    between: Fragment,
}

/// A polygon seen from the eye.
#[derive(Clone, Copy, Debug, Default)]
pub struct Fragment {
    count: usize,
    corners: [DVec3; MAX_CORNERS],
}

impl Fragment {
    /// Makes it this polygon; `None` when that has too many corners.
    fn fill(&mut self, corners: impl Iterator<Item = DVec3>) -> Option<()> {
        self.count = 0;
        for corner in corners {
            self.push(corner)?;
        }
        Some(())
    }

    fn push(&mut self, corner: DVec3) -> Option<()> {
        *self.corners.get_mut(self.count)? = corner;
        self.count += 1;
        Some(())
    }

    /// Its corners relative to the eye.
    pub fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    /// Keeps the part with `normal · v ≥ d`; `None` when it has too many corners.
    fn clip(&mut self, normal: DVec3, d: f64) -> Option<()> {
        if self.corners().iter().all(|v| normal.dot(*v) >= d) {
            return Some(());
        }
        let mut out = Self { count: 0, corners: [DVec3::ZERO; MAX_CORNERS] };
        let mut a = self.corners()[self.count - 1];
        let mut height_a = normal.dot(a) - d;
        for &b in self.corners() {
            let height_b = normal.dot(b) - d;
            if (height_a > 0.0 && height_b < 0.0) || (height_a < 0.0 && height_b > 0.0) {
                out.push(a + (b - a) * (height_a / (height_a - height_b)))?;
            }
            if height_b >= 0.0 {
                out.push(b)?;
            }
            (a, height_a) = (b, height_b);
        }
        *self = out;
        Some(())
    }

    /// Whether it reaches to the side `normal · v > 0` by more than rounding.
    fn reaches(&self, normal: DVec3, margin: f64) -> bool {
        self.corners().iter().any(|v| normal.dot(*v) > margin)
    }
}

/// The fragments, relative to `eye` (on a plane with unit normal `n`), of the polygon `emitter` (front normal `n_emitter`) that convex
/// `blockers` leave visible. `None` where they become too many to follow.
pub fn visible_fragments<'a, 'b>(
    eye: DVec3,
    n: DVec3,
    emitter: impl Iterator<Item = DVec3> + Clone,
    n_emitter: DVec3,
    blockers: impl Iterator<Item = &'a [DVec3]>,
    fragments: &'b mut Fragments,
) -> Option<&'b [Fragment]> {
    let Fragments { whole: left, kept, between } = fragments;
    left.resize(1, Fragment::default());
    left[0].fill(emitter.map(|p| p - eye))?;
    let d_emitter = n_emitter.dot(left[0].corners[0]);
    for blocker in blockers {
        // Only what lies between counts: above the eye's horizon and in front of the emitter.
        between.fill(blocker.iter().map(|p| *p - eye))?;
        between.clip(n, 0.0)?;
        between.clip(n_emitter, d_emitter)?;
        if between.count < 3 {
            continue;
        }
        let Some(planes) = Planes::new(between) else { continue };
        kept.clear();
        for fragment in left.iter() {
            planes.subtract(fragment, kept)?;
        }
        std::mem::swap(left, kept);
        if left.is_empty() {
            break;
        }
    }
    Some(left)
}

/// The planes through the eye and a blocker's edges, normals inward.
struct Planes {
    count: usize,
    normals: [DVec3; MAX_CORNERS],
}

impl Planes {
    /// `None` for a blocker seen edge-on.
    fn new(blocker: &Fragment) -> Option<Self> {
        let corners = blocker.corners();
        let centre: DVec3 = corners.iter().sum();
        let area: DVec3 =
            (0..corners.len()).map(|i| corners[i].cross(corners[(i + 1) % corners.len()])).sum();
        let facing = area.dot(centre);
        if facing.abs() <= 1e-12 * area.length() * centre.length() {
            return None;
        }
        let mut planes = Self { count: 0, normals: [DVec3::ZERO; MAX_CORNERS] };
        for (i, a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % corners.len()];
            let normal = a.cross(b);
            let length = normal.length();
            // An edge that runs towards the eye, or has no length, bounds nothing.
            if length > 1e-12 * a.length() * b.length() {
                planes.normals[planes.count] = normal * (facing.signum() / length);
                planes.count += 1;
            }
        }
        Some(planes)
    }

    /// Appends the parts of `fragment` outside of the blocker to `kept`.
    fn subtract(&self, fragment: &Fragment, kept: &mut Vec<Fragment>) -> Option<()> {
        let margin = 1e-12 * fragment.corners[0].length();
        let mut keep = |part: &Fragment| {
            kept.push(*part);
            (kept.len() <= MAX_FRAGMENTS).then_some(())
        };
        let normals = &self.normals[..self.count];
        if normals.iter().any(|normal| !fragment.reaches(*normal, margin)) {
            return keep(fragment);
        }
        let mut rest = *fragment;
        for &normal in normals {
            if rest.reaches(-normal, margin) {
                let mut outside = rest;
                outside.clip(-normal, 0.0)?;
                if outside.count >= 3 {
                    keep(&outside)?;
                }
                rest.clip(normal, 0.0)?;
                if rest.count < 3 {
                    break;
                }
            }
        }
        Some(())
    }
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
        Some(visible.iter().map(|f| factor(f.corners())).sum::<f64>() / factor(source))
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
}
