//! The kernel `K(x, y) = cosθ cosθ' / (π r²)` in 1/m², zero where either side faces away. Visibility is not in it.

use std::f64::consts::FRAC_1_PI;

use glam::DVec3;

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
