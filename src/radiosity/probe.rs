//! Probes: what the solution says at points, on surfaces and in free space.
//!
//! A probe within [`ON_SURFACE`] of the scene's size of a surface whose front faces the probe's normal reads the solution there. Any other
//! is a sensor: its irradiance is gathered from the radiosity of all surfaces and from the lamps, with visibility.

use glam::{DVec2, DVec3};

use super::emission::field_packet;
use super::solution::Solution;
use super::state::extent_m;
use crate::math::polygon;
use crate::transport::candidates::Candidates;
use crate::transport::gather::{Points, Tolerance};
use crate::transport::lamp::Lamp;
use crate::transport::{Packet, Scratch, Source};
use crate::visibility::Occluder;

/// How near to a surface a probe counts as on it, as a share of the scene's diameter.
pub const ON_SURFACE: f64 = 1e-4;

/// Error of a sensor's irradiance that gathering may add, as a share of the brightest contribution's estimate.
const SENSOR_ERROR: f64 = 1e-3;

/// Where to read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Where, in metres.
    pub position: DVec3,
    /// Unit normal of the sensor.
    pub normal: DVec3,
}

/// What was read, one value per band.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Irradiance in W/m².
    pub irradiance_w_m2: Vec<f64>,
    /// Radiosity in W/m²; `None` in free space.
    pub radiosity_w_m2: Option<Vec<f64>>,
}

/// Reads `probes` off `solution`; `occluder` holds the scene's faces. Same order.
pub fn read_probes(solution: &Solution, occluder: &dyn Occluder, probes: &[Probe]) -> Vec<Reading> {
    match solution.scene.bands.len() {
        1 => Reader::<1>::new(solution, occluder).read_all(probes),
        2 => Reader::<2>::new(solution, occluder).read_all(probes),
        _ => Reader::<3>::new(solution, occluder).read_all(probes),
    }
}

struct Reader<'a, const N: usize> {
    solution: &'a Solution,
    occluder: &'a dyn Occluder,
    reach_m: f64,
    /// Radiosity of all surfaces, made when the first sensor asks.
    packets: Option<Vec<Packet<N>>>,
    lamps: Vec<Lamp<N>>,
}

impl<'a, const N: usize> Reader<'a, N> {
    fn new(solution: &'a Solution, occluder: &'a dyn Occluder) -> Self {
        let extent = extent_m(&solution.scene);
        let lamps = solution.scene.lights.iter().map(|light| Lamp::new(light, extent)).collect();
        Self { solution, occluder, reach_m: ON_SURFACE * extent, packets: None, lamps }
    }

    fn read_all(mut self, probes: &[Probe]) -> Vec<Reading> {
        probes.iter().map(|probe| self.read(probe)).collect()
    }

    fn read(&mut self, probe: &Probe) -> Reading {
        if let Some((index, uv)) = self.surface_at(probe) {
            let mut irradiance = vec![0.0; N];
            let mut radiosity = vec![0.0; N];
            self.solution.fields[index].irradiance(uv, &mut irradiance);
            self.solution.radiosity(index, uv, &mut radiosity);
            return Reading { irradiance_w_m2: irradiance, radiosity_w_m2: Some(radiosity) };
        }
        Reading { irradiance_w_m2: self.sense(probe).to_vec(), radiosity_w_m2: None }
    }

    /// The nearest surface within reach that faces the probe's way, and the parameters there.
    fn surface_at(&self, probe: &Probe) -> Option<(usize, DVec2)> {
        let mut best: Option<(f64, usize, DVec2)> = None;
        for (index, surface) in self.solution.surfaces.iter().enumerate() {
            let height = surface.frame.normal.dot(probe.position - surface.frame.origin);
            if surface.frame.normal.dot(probe.normal) < 0.99 || height.abs() > self.reach_m {
                continue;
            }
            let mut uv = surface.frame.uv(probe.position);
            let mut distance = height.abs();
            if !polygon::contains(&surface.outline, uv) {
                let (near, beside) = surface.nearest_on_boundary(uv);
                distance = distance.hypot(beside);
                uv = near;
            }
            if distance <= self.reach_m && best.is_none_or(|(least, ..)| distance < least) {
                best = Some((distance, index, uv));
            }
        }
        best.map(|(_, index, uv)| (index, uv))
    }

    fn sense(&mut self, probe: &Probe) -> [f64; N] {
        let solution = self.solution;
        let packets = self.packets.get_or_insert_with(|| {
            (0..solution.surfaces.len()).map(|index| radiosity_packet(solution, index)).collect()
        });
        let point = [probe.position];
        let points =
            Points { position: &point, eye: &point, normal: probe.normal, face: u32::MAX, hull: &point };
        let mut irradiance = [[0.0; N]];
        let mut scratch = Scratch::default();
        let mut add = |source: &dyn Source<N>, tolerance: Tolerance| {
            if source.reaches(probe.normal, &point) {
                let all = Candidates::Scene;
                source.gather(
                    &points,
                    self.occluder,
                    all,
                    tolerance,
                    &mut irradiance,
                    &mut [0.0],
                    &mut scratch,
                );
            }
        };
        let estimate = |packet: &Packet<N>| packet.estimate_w_m2(probe.position, 0.0, probe.normal);
        let brightest = packets.iter().map(estimate).fold(0.0, f64::max);
        let tolerance = Tolerance { relative: SENSOR_ERROR, absolute_w_m2: SENSOR_ERROR * brightest };
        for packet in packets.iter().filter(|packet| estimate(packet) > 0.0) {
            add(packet, tolerance);
        }
        for lamp in &self.lamps {
            add(lamp, tolerance);
        }
        irradiance[0]
    }
}

/// The radiosity `M + ρE` of one surface as a packet.
fn radiosity_packet<const N: usize>(solution: &Solution, index: usize) -> Packet<N> {
    let surface = &solution.surfaces[index];
    field_packet(index, surface, &solution.fields[index], |function, band, irradiance| {
        let emitted = if function == 0 { surface.exitance_w_m2[band] } else { 0.0 };
        emitted + surface.reflectance[band] * irradiance
    })
}
