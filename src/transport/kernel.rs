//! The kernel `K(x, y) = cosθ cosθ' / (π r²)` in 1/m², zero where either side faces away. Visibility is not in it.

use std::f64::consts::FRAC_1_PI;

use glam::DVec3;
use wide::f64x4;

use crate::math::lanes::DVec3x4;

/// `K` between `x` with unit normal `n_x` and `y` with unit normal `n_y`; 0 where the points coincide.
#[inline]
pub fn kernel(x: DVec3, n_x: DVec3, y: DVec3, n_y: DVec3) -> f64 {
    let r = y - x;
    let r2 = r.length_squared();
    let (cos_x, cos_y) = (n_x.dot(r), -n_y.dot(r));
    if cos_x <= 0.0 || cos_y <= 0.0 {
        return 0.0;
    }
    cos_x * cos_y * FRAC_1_PI / (r2 * r2)
}

/// As [`kernel`], for four pairs of points.
#[inline(always)]
pub fn kernels(x: &DVec3x4, n_x: &DVec3x4, y: &DVec3x4, n_y: &DVec3x4) -> f64x4 {
    let r = *y - *x;
    let r2 = r.length_squared();
    let (cos_x, cos_y) = (n_x.dot(&r), -n_y.dot(&r));
    let in_front = cos_x.simd_gt(f64x4::ZERO) & cos_y.simd_gt(f64x4::ZERO);
    (cos_x * cos_y * f64x4::splat(FRAC_1_PI) / (r2 * r2)) & in_front
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn four_pairs_are_as_one_at_a_time(places in proptest::array::uniform24(-1.0..1.0f64), same in 0..4usize) {
            let mut at: Vec<DVec3> = places.chunks(3).map(DVec3::from_slice).collect();
            at[4 + same] = at[same];
            let n = DVec3::new(0.48, 0.6, 0.64);
            let side_by_side = kernels(
                &DVec3x4::new(&at[..4]), &DVec3x4::splat(n), &DVec3x4::new(&at[4..]), &DVec3x4::splat(-n),
            );
            for (i, k) in side_by_side.to_array().into_iter().enumerate() {
                prop_assert_eq!(k, kernel(at[i], n, at[4 + i], -n));
            }
        }
    }
}
