//! How far a solution is from what is known at probes.

use std::path::Path;

use glam::DVec3;
use wavelet_radiosity::radiosity::Solution;
use wavelet_radiosity::radiosity::probe::{Probe, read_probes};
use wavelet_radiosity::visibility::Occluder;

use super::probes;

/// `RMS |E − E*| / RMS E*` over all bands and the probes of a file, each of which must lie on a surface.
pub fn deviation(solution: &Solution, occluder: &dyn Occluder, file: &Path) -> f64 {
    let known = probes::read(file);
    let probe = |[at, normal, ..]: [[f64; 3]; 4]| Probe { position: at.into(), normal: DVec3::from(normal) };
    let places: Vec<Probe> = known.iter().map(|(_, row)| probe(*row)).collect();
    let (mut square, mut norm) = (0.0, 0.0);
    for (reading, (face, [.., irradiance, _])) in read_probes(solution, occluder, &places).iter().zip(&known)
    {
        assert!(reading.radiosity_w_m2.is_some(), "a probe of {face} lies on no surface");
        for (e, t) in reading.irradiance_w_m2.iter().zip(irradiance) {
            assert!(e.is_finite());
            square += (e - t) * (e - t);
            norm += t * t;
        }
    }
    (square / norm).sqrt()
}
