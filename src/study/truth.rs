//! What is taken for true, and how far a solution is from it: irradiance at reference probes, and at points spread over all surfaces on which
//! a finer solution says what is true.
//!
//! Values of several bands lie side by side, band fastest.

use glam::DVec2;
use rand_pcg::Pcg32;
use rand_pcg::rand_core::SeedableRng;
use serde::Serialize;

use super::statistics::Spread;
use crate::math::Cell;
use crate::math::chance::uniform;
use crate::radiosity::Solution;
use crate::radiosity::probe::{Probe, read_probes};
use crate::scene::Surface;
use crate::visibility::Occluder;

/// Seed of the points: the same in every study.
const SEED: u64 = 1998;

/// A point on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Which surface.
    pub surface: usize,
    /// Where on its parallelogram.
    pub uv: DVec2,
}

/// Irradiance that somebody else has computed.
#[derive(Clone, Debug)]
pub struct Reference {
    /// Where.
    pub probes: Vec<Probe>,
    /// Irradiance in W/m² at each, per band.
    pub irradiance_w_m2: Vec<f64>,
    /// RMS of its standard errors over its own RMS; `None` where these are not told.
    pub noise: Option<f64>,
}

/// How far values are from the truth, as shares of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Deviation {
    /// `RMS |e − t| / RMS t` over all points and bands.
    pub rms: f64,
    /// Median over the points of the greatest `|e − t|` of the bands, over the mean of `t`.
    pub median: f64,
}

impl Deviation {
    /// Of values from the truth; of nothing, or in the dark, there is none.
    pub fn new(bands: usize, values: &[f64], truth: &[f64]) -> Self {
        let share = |part: f64, whole: f64| if part == 0.0 { 0.0 } else { part / whole };
        let square: f64 = values.iter().zip(truth).map(|(e, t)| (e - t) * (e - t)).sum();
        let norm: f64 = truth.iter().map(|t| t * t).sum();
        let mean = truth.iter().sum::<f64>() / truth.len().max(1) as f64;
        let worst =
            |(e, t): (&[f64], &[f64])| e.iter().zip(t).map(|(e, t)| (e - t).abs()).fold(0.0, f64::max);
        let worst: Vec<f64> = values.chunks(bands).zip(truth.chunks(bands)).map(worst).collect();
        let median = Spread::of(&worst).map_or(0.0, |spread| spread.median);
        Self { rms: share(square, norm).sqrt(), median: share(median, mean) }
    }
}

/// `count` points spread evenly over the surfaces by area: each stands for the same share of it.
pub fn spread(surfaces: &[Surface], count: usize) -> Vec<Point> {
    let mut random = Pcg32::seed_from_u64(SEED);
    let step = surfaces.iter().map(|s| s.area_m2).sum::<f64>() / count as f64;
    let mut points = Vec::with_capacity(count);
    let mut end = 0.0;
    for (surface, of) in surfaces.iter().enumerate() {
        end += of.area_m2;
        // One in each step of the accumulated area, at the step's middle.
        while points.len() < count && (points.len() as f64 + 0.5) * step < end {
            let uv = of.point_in(&Cell::UNIT, || uniform(&mut random)).unwrap_or(of.outline[0]);
            points.push(Point { surface, uv });
        }
    }
    points
}

/// Irradiance of a solution at points of its surfaces.
pub fn irradiance(solution: &Solution, points: &[Point]) -> Vec<f64> {
    let bands = solution.scene.bands.len();
    let mut values = vec![0.0; bands * points.len()];
    for (point, value) in points.iter().zip(values.chunks_mut(bands)) {
        solution.fields[point.surface].irradiance(point.uv, value);
    }
    values
}

/// What of irradiance at points is reflected.
pub fn reflected(surfaces: &[Surface], points: &[Point], irradiance: &[f64]) -> Vec<f64> {
    let rho = points.iter().flat_map(|point| &surfaces[point.surface].reflectance);
    rho.zip(irradiance).map(|(rho, e)| rho * e).collect()
}

impl Reference {
    /// How far a solution is from this.
    pub fn deviation(&self, solution: &Solution, occluder: &dyn Occluder) -> Deviation {
        let readings = read_probes(solution, occluder, &self.probes);
        let values: Vec<f64> = readings.into_iter().flat_map(|reading| reading.irradiance_w_m2).collect();
        Deviation::new(solution.scene.bands.len(), &values, &self.irradiance_w_m2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::polygon;
    use crate::scene;

    /// A square of 3 m² in three quarters of its parallelogram, and one of 1 m².
    const TWO: &str = "#Inventor V2.1 ascii
        Separator { Material { emissiveColor 1 1 1 } Coordinate3 { point [ 0 0 0, 2 0 0, 2 1 0, 1 1 0, 1 2 0, 0 2 0 ] }
        IndexedFaceSet { coordIndex [ 0, 1, 2, 3, 4, 5, -1 ] } }
        Separator { ShapeHints { vertexOrdering COUNTERCLOCKWISE shapeType SOLID }
        Coordinate3 { point [ 0 0 5, 1 0 5, 1 1 5, 0 1 5 ] } IndexedFaceSet { coordIndex [ 0, 1, 2, 3, -1 ] } }";

    #[test]
    fn points_are_spread_by_area_and_lie_on_their_surfaces() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), TWO).unwrap();
        let scene = scene::read::read_file(file.path()).unwrap();
        let surfaces = scene::surfaces(&scene);
        let points = spread(&surfaces, 1000);
        assert_eq!((points.len(), &points), (1000, &spread(&surfaces, 1000)));
        let area: f64 = surfaces.iter().map(|surface| surface.area_m2).sum();
        for (index, surface) in surfaces.iter().enumerate() {
            let here: Vec<&Point> = points.iter().filter(|point| point.surface == index).collect();
            assert!((here.len() as f64 / 1000.0 - surface.area_m2 / area).abs() < 0.0011);
            assert!(here.iter().all(|point| polygon::contains(&surface.outline, point.uv)));
            let left = here.iter().filter(|point| point.uv.x < 0.5).count() as f64 / here.len() as f64;
            assert!((0.4..0.75).contains(&left), "{left}");
        }
    }

    #[test]
    fn deviations_are_shares_of_the_truth() {
        let truth = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0];
        let deviation = Deviation::new(2, &[1.1, 1.0, 1.0, 0.7, 1.2, 1.0], &truth);
        assert!((deviation.rms - (0.14f64 / 6.0).sqrt()).abs() < 1e-12);
        assert!((deviation.median - 0.2).abs() < 1e-12, "of 0.1, 0.3 and 0.2");
        assert_eq!(Deviation::new(1, &[0.0, 0.0], &[0.0, 0.0]), Deviation { rms: 0.0, median: 0.0 });
        assert_eq!(Deviation::new(3, &[], &[]), Deviation { rms: 0.0, median: 0.0 });
    }
}
