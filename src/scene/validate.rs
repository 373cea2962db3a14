//! The rules by which scenes are repaired, each counted in the findings with its first place.
//!
//! * Reflectance: not a number or below 0 becomes 0; [`MAX_REFLECTANCE`] and above becomes just that, because
//!   the equation has no solution at 1. Exitance and light intensities: not finite or below 0 become 0.
//! * Faces: corners that repeat their predecessor, and spikes (there and straight back), are dropped; so are
//!   faces with unusable coordinates, without area, or drawn twice. Nearly planar faces are flattened, others
//!   split ([`super::planar`], [`super::pieces`]); a face that overlaps itself is replaced by what it covers.
//! * Lights and cameras with unusable numbers are dropped.
//!
//! Validating a valid scene changes nothing.

use std::collections::HashMap;

use glam::DVec3;

use super::pieces::{Cover, cover, split};
use super::planar::{PLANARITY, Plane, diameter, is_convex, plane};
use super::{Camera, Face, Findings, Light, Projection, Scene, Sides};

/// The greatest reflectance.
pub const MAX_REFLECTANCE: f64 = 0.999;
/// Corners nearer to each other than this share of the face's diameter are one: the rounding of single
/// precision.
const COINCIDENT: f64 = 1e-7;
/// A face has no area when it is narrower than this share of its length: its normal would be rounding noise.
const NARROW: f64 = 1e-7;
/// Deviations from the plane below this share of the diameter are rounding and not worth a finding.
const ROUNDING: f64 = 1e-6;
/// Corners already this near to the plane stay as they are, so that validation is idempotent.
const EXACT: f64 = 1e-12;
/// Coordinates beyond this are refused, so that no product of them overflows.
const FARTHEST_M: f64 = 1e30;
/// Faces smaller than this share of their distance from the origin are refused: rounding has eaten their
/// shape.
const RESOLVED: f64 = 1e-10;
/// Faces with more corners are refused: the time to split and enclose them grows with the square.
const MAX_CORNERS: usize = 8192;

const UNLIKE: &str = "coincident faces of unlike materials kept";

/// Repairs a scene by the rules above.
pub fn validate(scene: &mut Scene) {
    validate_at(scene, &|face| format!("face {face}"));
}

/// [`validate`], where `place` tells the place of a face in its file.
pub(super) fn validate_at(scene: &mut Scene, place: &dyn Fn(usize) -> String) {
    materials(scene);
    let findings = &mut scene.findings;
    scene.lights.retain_mut(|light| is_usable_light(light, findings));
    scene.cameras.retain(|camera| is_usable_camera(camera, findings));
    // Counted once, however often a scene is validated.
    let coincident = findings.repairs.remove(UNLIKE);
    let mut seen = HashMap::new();
    let mut valid = Vec::with_capacity(scene.faces.len());
    for (i, face) in std::mem::take(&mut scene.faces).into_iter().enumerate() {
        let mut repair = Repair { findings, place: &|| place(i) };
        repair.face(face, &mut seen, &mut valid);
    }
    scene.faces = valid;
    if let Some(coincident) = coincident {
        scene.findings.repairs.insert(UNLIKE.to_owned(), coincident);
    }
}

fn materials(scene: &mut Scene) {
    let findings = &mut scene.findings;
    for (i, material) in scene.materials.iter_mut().enumerate() {
        for rho in &mut material.reflectance {
            let (repaired, rule) = match *rho {
                r if r.is_nan() => (0.0, "reflectance that is not a number set to 0"),
                r if r < 0.0 => (0.0, "reflectance below 0 set to 0"),
                r if r > MAX_REFLECTANCE => (MAX_REFLECTANCE, "reflectance above 0.999 set to 0.999"),
                _ => continue,
            };
            findings.repair(rule, || format!("material {i}: {rho}"));
            *rho = repaired;
        }
        non_negative(&mut material.exitance_w_m2, "exitance", &format!("material {i}"), findings);
    }
}

fn non_negative(values: &mut [f64], what: &str, place: &str, findings: &mut Findings) {
    for value in values {
        if !value.is_finite() || *value < 0.0 {
            let why = if value.is_finite() { "below 0" } else { "that is not a finite number" };
            findings.repair(&format!("{what} {why} set to 0"), || format!("{place}: {value}"));
            *value = 0.0;
        }
    }
}

fn is_usable(point: DVec3) -> bool {
    // Written so that NaN is unusable.
    point.abs().max_element() <= FARTHEST_M && point.is_finite()
}

fn is_usable_light(light: &mut Light, findings: &mut Findings) -> bool {
    let (power, usable) = match light {
        Light::Point { position, intensity_w_sr } => (intensity_w_sr, is_usable(*position)),
        Light::Spot { position, direction, intensity_w_sr, cutoff_rad, exponent } => {
            let usable =
                is_usable(*position) && is_usable(*direction) && *cutoff_rad > 0.0 && *exponent >= 0.0;
            (intensity_w_sr, usable && cutoff_rad.is_finite() && exponent.is_finite())
        }
        Light::Directional { direction, irradiance_w_m2 } => (irradiance_w_m2, is_usable(*direction)),
    };
    non_negative(power, "intensity", "light", findings);
    if !usable {
        findings.repair("light with unusable numbers dropped", || format!("{light:?}"));
    }
    usable
}

fn is_usable_camera(camera: &Camera, findings: &mut Findings) -> bool {
    let opening = match camera.projection {
        Projection::Perspective(angle) => angle > 0.0 && angle < std::f64::consts::PI,
        Projection::Orthographic(height) => height > 0.0 && height <= FARTHEST_M,
    };
    let usable = opening
        && [camera.position, camera.direction, camera.up].into_iter().all(is_usable)
        && camera.aspect > 0.0
        && camera.aspect.is_finite();
    if !usable {
        findings.repair("camera with unusable numbers dropped", || camera.name.clone());
    }
    usable
}

/// Faces seen so far, by their corners from a canonical start: how each was drawn.
type Seen = HashMap<Vec<[u64; 3]>, Vec<(u32, Sides)>>;

struct Repair<'a> {
    findings: &'a mut Findings,
    place: &'a dyn Fn() -> String,
}

impl Repair<'_> {
    fn count(&mut self, rule: &str) {
        self.findings.repair(rule, self.place);
    }

    /// Repairs one face into none, one or several in `valid`.
    fn face(&mut self, mut face: Face, seen: &mut Seen, valid: &mut Vec<Face>) {
        if !face.vertices.iter().all(|v| is_usable(*v)) {
            return self.count("face with a coordinate that is not a number or beyond 1e30 m dropped");
        }
        if face.vertices.len() > MAX_CORNERS {
            return self.count("face with more than 8192 corners dropped");
        }
        let extent = self.tidy(&mut face.vertices);
        let distance = face.vertices.iter().map(|v| v.abs().max_element()).fold(0.0, f64::max);
        if extent < RESOLVED * distance {
            return self.count("face too small for its distance from the origin dropped");
        }
        let Some(plane) = plane_with_area(&face.vertices, extent) else {
            return self.count("face without area dropped");
        };
        let deviation = plane.deviation(&face.vertices);
        if deviation <= PLANARITY * extent {
            if deviation > EXACT * extent {
                plane.flatten(&mut face.vertices);
            }
            if deviation > ROUNDING * extent {
                self.count("slightly non-planar face flattened");
            }
            return self.planar(face, &plane, seen, valid);
        }
        self.count("non-planar face split into planar pieces");
        for mut vertices in split(&face.vertices, &plane) {
            if let Some(plane) = super::planar::plane(&vertices) {
                plane.flatten(&mut vertices);
                self.planar(Face { vertices, ..face }, &plane, seen, valid);
            }
        }
    }

    /// Takes a planar face in, or what it covers if it overlaps itself: the exchange of light would count
    /// that twice.
    fn planar(&mut self, face: Face, plane: &Plane, seen: &mut Seen, valid: &mut Vec<Face>) {
        let cover = match is_convex(&face.vertices, plane) {
            true => Cover::Once,
            false => cover(&face.vertices, plane),
        };
        match cover {
            Cover::Once => self.keep(face, seen, valid),
            Cover::Tangle => self.count("face that crosses itself more often than it has corners dropped"),
            Cover::By(pieces) => {
                self.count("face that overlaps itself replaced by what it covers");
                for vertices in pieces {
                    self.keep(Face { vertices, ..face }, seen, valid);
                }
            }
        }
    }

    /// Takes a planar face in, unless it was there before. Flattening and splitting may have made new
    /// repeated corners and slivers.
    fn keep(&mut self, mut face: Face, seen: &mut Seen, valid: &mut Vec<Face>) {
        let extent = self.tidy(&mut face.vertices);
        if plane_with_area(&face.vertices, extent).is_none() {
            self.count("face without area dropped");
        } else if self.is_drawn_twice(&face, extent, seen) {
            self.count("face drawn twice dropped");
        } else {
            valid.push(face);
        }
    }

    /// Drops corners that repeat their predecessor, and spikes, in one pass around the polygon; returns its
    /// diameter.
    fn tidy(&mut self, vertices: &mut Vec<DVec3>) -> f64 {
        let extent = diameter(vertices);
        let tolerance = COINCIDENT * extent;
        let mut kept: Vec<DVec3> = Vec::with_capacity(vertices.len());
        for vertex in vertices.iter() {
            self.push(&mut kept, *vertex, tolerance);
        }
        // The seam: the last corners against the first.
        let mut first = 0;
        while kept.len() - first >= 2 {
            let n = kept.len();
            let near = |a: usize, b: usize| kept[a].distance(kept[b]) <= tolerance;
            if near(n - 1, first) {
                kept.pop();
                self.count("repeated corner dropped");
            } else if n - first >= 3 && near(n - 2, first) {
                kept.truncate(n - 2);
                self.count("spike dropped");
            } else if n - first >= 3 && near(n - 1, first + 1) {
                first += 1;
                kept.pop();
                self.count("spike dropped");
            } else {
                break;
            }
        }
        kept.drain(..first);
        *vertices = kept;
        extent
    }

    fn push(&mut self, kept: &mut Vec<DVec3>, vertex: DVec3, tolerance: f64) {
        match kept[..] {
            [.., last] if last.distance(vertex) <= tolerance => self.count("repeated corner dropped"),
            [.., before, _] if before.distance(vertex) <= tolerance => {
                kept.pop();
                self.count("spike dropped");
            }
            _ => kept.push(vertex),
        }
    }

    /// Whether the same face was there before: same corners in the same sense (either sense if both show both
    /// sides), material and sides. Coincident faces that differ in those are kept and counted.
    fn is_drawn_twice(&mut self, face: &Face, extent: f64, seen: &mut Seen) -> bool {
        // On a grid finer than anything seen but coarser than the rounding of flattening.
        let grid = (1e-9 * extent).log2().floor().exp2();
        // `+ 0.0` makes −0 and 0 alike.
        let cell = |v: &DVec3| ((*v / grid).round() + 0.0).to_array().map(f64::to_bits);
        let mut key = least_rotation(face.vertices.iter().map(cell).collect());
        if face.sides == Sides::Two {
            let reversed = least_rotation(face.vertices.iter().rev().map(cell).collect());
            key = key.min(reversed);
        }
        let drawn = seen.entry(key).or_default();
        let twice = drawn.contains(&(face.material, face.sides));
        if !twice {
            if !drawn.is_empty() {
                self.findings.repair(UNLIKE, self.place);
            }
            drawn.push((face.material, face.sides));
        }
        twice
    }
}

/// The plane of corners that are not a sliver.
fn plane_with_area(vertices: &[DVec3], extent: f64) -> Option<Plane> {
    plane(vertices).filter(|plane| plane.area_m2 > NARROW * extent * extent)
}

/// The rotation of a cyclic sequence that is least in lexicographic order, in linear time (two candidates
/// race; the loser skips what it has matched).
fn least_rotation<T: Ord + Clone>(mut items: Vec<T>) -> Vec<T> {
    let n = items.len();
    let (mut i, mut j, mut k) = (0, 1, 0);
    while i < n && j < n && k < n {
        match items[(i + k) % n].cmp(&items[(j + k) % n]) {
            std::cmp::Ordering::Equal => k += 1,
            order => {
                if order == std::cmp::Ordering::Greater {
                    i += k + 1;
                } else {
                    j += k + 1;
                }
                if i == j {
                    j += 1;
                }
                k = 0;
            }
        }
    }
    items.rotate_left(i.min(j).min(n.saturating_sub(1)));
    items
}
