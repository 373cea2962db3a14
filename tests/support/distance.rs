//! How far two solutions of a scene are from each other.

use glam::DVec2;
use wavelet_radiosity::math::polygon;
use wavelet_radiosity::radiosity::Field;
use wavelet_radiosity::scene::{Scene, Surface};
use wavelet_radiosity::schedule::Outcome;

/// `‖B − B'‖ / ‖B'‖` of reflected radiosity, at 32 × 32 points a surface.
pub fn distance(of: (&Scene, &[Surface]), found: &Outcome, expected: &Outcome) -> f64 {
    apart(of, irradiance(&found.solution.fields), irradiance(&expected.solution.fields))
}

/// The irradiance on surface number `.0` at `.1`, band by band.
pub fn irradiance(fields: &[Field]) -> impl Fn(usize, DVec2, &mut [f64]) {
    |index, uv, light| fields[index].irradiance(uv, light)
}

/// The same of irradiance given by functions.
pub fn apart(
    (scene, surfaces): (&Scene, &[Surface]),
    found: impl Fn(usize, DVec2, &mut [f64]),
    expected: impl Fn(usize, DVec2, &mut [f64]),
) -> f64 {
    let (mut difference, mut norm) = (0.0, 0.0);
    let bands = scene.bands.len();
    let (mut a, mut b) = (vec![0.0; bands], vec![0.0; bands]);
    for (index, surface) in surfaces.iter().enumerate() {
        for point in 0..32 * 32 {
            let uv = (DVec2::new((point % 32) as f64, (point / 32) as f64) + 0.5) / 32.0;
            if !surface.full && !polygon::contains(&surface.outline, uv) {
                continue;
            }
            found(index, uv, &mut a);
            expected(index, uv, &mut b);
            for band in 0..bands {
                let weight = surface.frame.area_m2 * surface.reflectance[band].powi(2);
                difference += weight * (a[band] - b[band]).powi(2);
                norm += weight * b[band].powi(2);
            }
        }
    }
    (difference / norm).sqrt()
}
