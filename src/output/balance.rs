//! The energy balance of a solution: `1 − Σ ∫E dA / Σ ∫B dA` over all surfaces and bands, `B = M + ρE`.
//!
//! What surfaces send out others receive, so it is 0 where no light can leave. In other scenes it is the share of the light that
//! leaves or falls on black backs.

use crate::radiosity::Solution;

use super::report::Known;

/// The balance, or why there is none.
pub fn energy_balance(solution: &Solution) -> Known<f64> {
    if solution.incomplete {
        return Known::unavailable("the run was cut short");
    }
    if !solution.scene.lights.is_empty() {
        return Known::unavailable("lights without area send from no surface");
    }
    let (mut received_w, mut sent_w) = (0.0, 0.0);
    for (index, surface) in solution.surfaces.iter().enumerate() {
        for (band, power_w) in solution.fields[index].power_w(surface).into_iter().enumerate() {
            received_w += power_w;
            sent_w += surface.area_m2 * surface.exitance_w_m2[band] + surface.reflectance[band] * power_w;
        }
    }
    match sent_w > 0.0 {
        true => Known::Value(1.0 - received_w / sent_w),
        false => Known::unavailable("no surface sends out light"),
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::math::Basis;
    use crate::output::rooms;

    /// Against a sum over a fine grid of points.
    #[test]
    fn power_on_whole_and_cut_surfaces_agrees_with_sampling() {
        let solution = rooms::gallery(Basis::M3, 3, 5);
        for (index, surface) in solution.surfaces.iter().enumerate() {
            let (n, mut sum, mut value) = (200, 0.0, vec![0.0; 3]);
            for i in 0..n * n {
                let uv = (DVec2::new((i % n) as f64, (i / n) as f64) + 0.5) / n as f64;
                if crate::math::polygon::contains(&surface.outline, uv) {
                    solution.fields[index].irradiance(uv, &mut value);
                    sum += value[1] * surface.frame.area_m2 / (n * n) as f64;
                }
            }
            let power = solution.fields[index].power_w(surface)[1];
            assert!((power - sum).abs() < 0.01 * sum, "surface {index}: {power} W, sampled {sum} W");
        }
    }

    /// `E = M/(1 − ρ)` everywhere in a furnace.
    #[test]
    fn a_furnace_is_in_balance() {
        let mut solution = rooms::gallery(Basis::Haar, 0, 0);
        for (surface, field) in solution.surfaces.iter_mut().zip(&mut solution.fields) {
            surface.exitance_w_m2 = vec![1.0; 3];
            surface.reflectance = vec![0.5; 3];
            field.coefficients.fill(2.0);
        }
        let balance = energy_balance(&solution);
        assert!(balance.as_result().is_ok_and(|b| b.abs() < 1e-12), "{balance:?}");
        solution.incomplete = true;
        assert!(energy_balance(&solution).as_result().is_err());
    }
}
