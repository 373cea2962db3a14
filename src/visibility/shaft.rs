//! Shafts: the convex hull of an emitter's and a receiver's corners. A face outside of it blocks no segment between the two.
//!
//! After Haines and Wallace 1991, with planes through an edge of one side and a corner of the other instead of boxes, so that the
//! shaft is the hull itself wherever both sides are flat.

use glam::DVec3;

/// The most planes a shaft keeps: two per edge of each side and the planes of both sides.
const MAX_PLANES: usize = 18;

/// A convex region given by half-spaces `n·x ≤ d`, and its box.
#[derive(Clone, Debug)]
pub struct Shaft {
    planes: [(DVec3, f64); MAX_PLANES],
    count: usize,
    low: DVec3,
    high: DVec3,
}

impl Shaft {
    /// The shaft between two flat sides of at most four corners each. A side with a `normal` also bounds the shaft by its own
    /// plane: only what lies in front of it can block.
    pub fn between(a: &[DVec3], a_normal: Option<DVec3>, b: &[DVec3], b_normal: Option<DVec3>) -> Self {
        let points = || a.iter().chain(b).copied();
        let (low, high) = points().fold((a[0], a[0]), |(l, h), p| (l.min(p), h.max(p)));
        let extent = (high - low).max_element();
        let margin = extent * 1e-9;
        let mut shaft = Self { planes: [(DVec3::ZERO, 0.0); MAX_PLANES], count: 0, low, high };
        for (side, normal) in [(a, a_normal), (b, b_normal)] {
            if let Some(normal) = normal {
                shaft.push(-normal, -normal.dot(side[0]) - margin);
            }
        }
        for (side, other) in [(a, b), (b, a)] {
            for i in 0..side.len() {
                let (p, q) = (side[i], side[(i + 1) % side.len()]);
                for r in other {
                    let cross = (q - p).cross(*r - p);
                    let length = cross.length();
                    if length <= extent * extent * 1e-12 {
                        continue;
                    }
                    let normal = cross / length;
                    let d = normal.dot(p);
                    let (mut least, mut most) = (0.0f64, 0.0f64);
                    for x in points() {
                        let distance = normal.dot(x) - d;
                        least = least.min(distance);
                        most = most.max(distance);
                    }
                    if most <= margin {
                        shaft.push(normal, d - margin);
                    } else if least >= -margin {
                        shaft.push(-normal, -d - margin);
                    }
                }
            }
        }
        shaft
    }

    fn push(&mut self, normal: DVec3, d: f64) {
        let known = self.planes().iter().any(|(n, _)| n.dot(normal) > 1.0 - 1e-12);
        if !known && self.count < MAX_PLANES {
            self.planes[self.count] = (normal, d);
            self.count += 1;
        }
    }

    fn planes(&self) -> &[(DVec3, f64)] {
        &self.planes[..self.count]
    }

    /// Whether a convex or concave polygon may reach into the shaft; `false` is certain. One that only touches it does not reach in.
    pub fn may_hold(&self, polygon: &[DVec3]) -> bool {
        self.planes().iter().all(|(n, d)| polygon.iter().any(|v| n.dot(*v) < *d))
            && (0..3).all(|axis| {
                polygon.iter().any(|v| v[axis] <= self.high[axis])
                    && polygon.iter().any(|v| v[axis] >= self.low[axis])
            })
    }

    /// Whether a box may reach into the shaft; `false` is certain.
    pub fn may_hold_box(&self, low: DVec3, high: DVec3) -> bool {
        if low.cmpgt(self.high).any() || high.cmplt(self.low).any() {
            return false;
        }
        self.planes().iter().all(|(n, d)| {
            let nearest = DVec3::select(n.cmpge(DVec3::ZERO), low, high);
            n.dot(nearest) < *d
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(z: f64, half: f64) -> [DVec3; 4] {
        [(-half, -half), (half, -half), (half, half), (-half, half)].map(|(x, y)| DVec3::new(x, y, z))
    }

    #[test]
    fn holds_what_stands_between_and_nothing_beside_or_behind() {
        let (a, b) = (square(0.0, 1.0), square(4.0, 0.5));
        let shaft = Shaft::between(&a, Some(DVec3::Z), &b, Some(DVec3::NEG_Z));
        assert!(shaft.may_hold(&square(2.0, 0.1)));
        assert!(shaft.may_hold(&square(2.0, 9.0)));
        let beside = square(2.0, 0.2).map(|p| p + DVec3::X * 1.2);
        assert!(!shaft.may_hold(&beside), "the hull is 0.75 wide at this height");
        assert!(!shaft.may_hold(&square(-0.5, 0.3)) && !shaft.may_hold(&square(4.5, 0.3)));
        assert!(!shaft.may_hold(&a) && !shaft.may_hold(&b), "the sides themselves only touch");
    }
}
