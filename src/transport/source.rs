//! Where light comes from, as a pair task sees it.

use glam::{DVec2, DVec3};

use super::candidates::Candidates;
use super::gather::{Gather, Points, Tolerance, norm};
use super::packet::{Packet, cell_corners};
use super::pair::Scratch;
use crate::math::Cell;
use crate::visibility::Occluder;

/// Where light comes from.
pub trait Source<const N: usize>: Sync {
    /// Index of the emitting surface; `u32::MAX` for a lamp.
    fn surface(&self) -> u32;
    /// The face it lies on; `u32::MAX` for a lamp.
    fn face(&self) -> u32;
    /// Corners around the source as seen from a receiver, and its plane's normal if it has a plane.
    fn hull(&self, receiver: &[DVec3]) -> ([DVec3; 4], Option<DVec3>);
    /// Whether any light can reach the front of a plane polygon.
    fn reaches(&self, normal: DVec3, corners: &[DVec3]) -> bool;
    /// Estimate, on the safe side, of the irradiance norm on a sphere with this normal.
    fn estimate_w_m2(&self, centre: DVec3, radius: f64, normal: DVec3) -> f64;
    /// Its middle, and how far it reaches from there at most, in metres; none if it is infinitely far away.
    fn place(&self) -> Option<(DVec3, f64)>;
    /// The point of it (of a polygon's parallelogram) that is nearest to `point`; none if it is infinitely far away.
    fn nearest(&self, point: DVec3) -> Option<DVec3>;
    /// The largest exitance or intensity it has: what the geometry oracle divides by.
    fn strength(&self) -> f64;
    /// Adds the irradiance at `points`, each to about `tolerance`.
    #[allow(clippy::too_many_arguments)]
    fn gather(
        &self,
        points: &Points<'_>,
        occluder: &dyn Occluder,
        candidates: Candidates,
        tolerance: Tolerance,
        irradiance: &mut [[f64; N]],
        uncertain: &mut [f64],
        scratch: &mut Scratch,
    );
}

impl<const N: usize> Source<N> for Packet<N> {
    fn surface(&self) -> u32 {
        self.surface
    }

    fn face(&self) -> u32 {
        self.face
    }

    fn hull(&self, _receiver: &[DVec3]) -> ([DVec3; 4], Option<DVec3>) {
        (cell_corners(&Cell::UNIT).map(|c| self.frame.point(c)), Some(self.frame.normal))
    }

    fn reaches(&self, normal: DVec3, corners: &[DVec3]) -> bool {
        let size = self.frame.u.length() + self.frame.v.length();
        let in_front = |n: DVec3, origin: DVec3, p: DVec3| n.dot(p - origin) > 1e-9 * size;
        let Some(at) = corners.first() else { return false };
        let receiver_sees = match &self.outline {
            None => cell_corners(&Cell::UNIT).iter().any(|c| in_front(normal, *at, self.frame.point(*c))),
            Some(outline) => outline.iter().any(|c| in_front(normal, *at, self.frame.point(*c))),
        };
        receiver_sees && corners.iter().any(|p| in_front(self.frame.normal, self.frame.origin, *p))
    }

    fn estimate_w_m2(&self, centre: DVec3, radius: f64, normal: DVec3) -> f64 {
        let (middle, half) = self.sphere();
        let between = middle - centre;
        let distance = between.length();
        let gap = (distance - radius - half).max(0.0);
        let cosine = |height: f64| if gap > 0.0 { (height / gap).clamp(0.0, 1.0) } else { 1.0 };
        let cos_x = cosine(normal.dot(between) + radius + half);
        let cos_y = cosine(-self.frame.normal.dot(between) + radius + half);
        let area = self.frame.area_m2;
        self.strength() * (cos_x * cos_y * area / (std::f64::consts::PI * gap * gap + area))
    }

    fn place(&self) -> Option<(DVec3, f64)> {
        Some(self.sphere())
    }

    fn nearest(&self, point: DVec3) -> Option<DVec3> {
        Some(self.frame.point(self.frame.uv(point).clamp(DVec2::ZERO, DVec2::ONE)))
    }

    fn strength(&self) -> f64 {
        let root = &self.nodes[0];
        root.coefficients.iter().map(norm).sum::<f64>() + root.detail.rms_w_m2
    }

    fn gather(
        &self,
        points: &Points<'_>,
        occluder: &dyn Occluder,
        candidates: Candidates,
        tolerance: Tolerance,
        irradiance: &mut [[f64; N]],
        uncertain: &mut [f64],
        scratch: &mut Scratch,
    ) {
        Gather::new(self, points, occluder, irradiance, uncertain, scratch).run(candidates, tolerance);
    }
}
