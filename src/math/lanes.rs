//! Vectors four side by side in double precision, by the operations of [`DVec3`] in their order and without fused ones, so that each lane
//! holds to the last bit what one vector alone would give.

use std::ops::{Add, Mul, Sub};

use glam::DVec3;
use wide::f64x4;

/// Vectors side by side.
pub const LANES: usize = 4;

/// Four vectors: x, y and z of each.
#[derive(Clone, Copy, Debug, Default)]
pub struct DVec3x4(pub [f64x4; 3]);

impl DVec3x4 {
    /// The same vector in all lanes.
    #[inline(always)]
    pub fn splat(v: DVec3) -> Self {
        Self([f64x4::splat(v.x), f64x4::splat(v.y), f64x4::splat(v.z)])
    }

    /// These vectors, of which there are one to four; the last one stands in the other lanes too.
    #[inline(always)]
    pub fn new(vectors: &[DVec3]) -> Self {
        let lane = |i: usize| vectors[i.min(vectors.len() - 1)];
        let (a, b, c, d) = (lane(0), lane(1), lane(2), lane(3));
        Self([[a.x, b.x, c.x, d.x], [a.y, b.y, c.y, d.y], [a.z, b.z, c.z, d.z]].map(f64x4::from))
    }

    /// As [`DVec3::dot`].
    #[inline(always)]
    pub fn dot(&self, other: &Self) -> f64x4 {
        self.0[0] * other.0[0] + self.0[1] * other.0[1] + self.0[2] * other.0[2]
    }

    /// As [`DVec3::cross`].
    #[inline(always)]
    pub fn cross(&self, other: &Self) -> Self {
        let ([x, y, z], [u, v, w]) = (self.0, other.0);
        Self([y * w - v * z, z * u - w * x, x * v - u * y])
    }

    /// As [`DVec3::length_squared`].
    #[inline(always)]
    pub fn length_squared(&self) -> f64x4 {
        self.dot(self)
    }

    /// The sum of the absolute components, in their order.
    #[inline(always)]
    pub fn absolute_sum(&self) -> f64x4 {
        self.0[0].abs() + self.0[1].abs() + self.0[2].abs()
    }
}

/// Vectors in as many registers as asked for, which must hold them all; lanes beyond them hold nothing of worth.
#[inline(always)]
pub fn side_by_side<const REGISTERS: usize>(vectors: &[DVec3]) -> [DVec3x4; REGISTERS] {
    let mut lanes = [DVec3x4::default(); REGISTERS];
    for (lanes, vectors) in lanes.iter_mut().zip(vectors.chunks(LANES)) {
        *lanes = DVec3x4::new(vectors);
    }
    lanes
}

impl Add for DVec3x4 {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self([self.0[0] + other.0[0], self.0[1] + other.0[1], self.0[2] + other.0[2]])
    }
}

impl Sub for DVec3x4 {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self([self.0[0] - other.0[0], self.0[1] - other.0[1], self.0[2] - other.0[2]])
    }
}

impl Mul<f64x4> for DVec3x4 {
    type Output = Self;

    #[inline(always)]
    fn mul(self, scale: f64x4) -> Self {
        Self([self.0[0] * scale, self.0[1] * scale, self.0[2] * scale])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn each_lane_is_what_one_vector_gives(a in proptest::array::uniform12(-9.0..9.0f64), b in proptest::array::uniform12(-9.0..9.0f64)) {
            let vectors = |c: &[f64; 12]| -> Vec<DVec3> { c.chunks(3).map(DVec3::from_slice).collect() };
            let (a, b) = (vectors(&a), vectors(&b));
            let (four_a, four_b) = (DVec3x4::new(&a), DVec3x4::new(&b[..3]));
            let scale = f64x4::from([2.3, -1.7, 0.0, 5.1]);
            let lane = |v: DVec3x4, i: usize| DVec3::from_array(v.0.map(|c| c.to_array()[i]));
            for i in 0..LANES {
                let (a, b, s) = (a[i], b[i.min(2)], scale.to_array()[i]);
                prop_assert_eq!(lane(four_a + four_b, i), a + b);
                prop_assert_eq!(lane(four_a - four_b, i), a - b);
                prop_assert_eq!(lane(four_a * scale, i), a * s);
                prop_assert_eq!(lane(four_a.cross(&four_b), i), a.cross(b));
                prop_assert_eq!(four_a.dot(&four_b).to_array()[i], a.dot(b));
                prop_assert_eq!(four_a.length_squared().to_array()[i], a.length_squared());
                prop_assert_eq!(four_a.absolute_sum().to_array()[i], a.abs().element_sum());
            }
        }
    }
}
