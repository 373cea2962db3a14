//! The light of one emitter cell on one point, once it is judged how to take it ([`super::gather`]): by quadrature, by Lambert's closed form, or
//! from the fragments that blockers leave visible.

use std::cell::OnceCell;
use std::ops::Range;

use glam::{DVec2, DVec3};
use wide::f64x4;

use super::candidates::{Candidates, LIST_LIMIT};
use super::gather::{Gather, norm, points_of};
use super::judge::{GROUPS, How};
use super::kernel::{kernel, kernels};
use super::lambert::form_factor;
use super::nodes::{CellNodes, NODE_LANES, Nodes, value_at};
use super::packet::{EmitterCell, Packet};
use super::pair::Scratch;
use super::samples::MAX_SAMPLES;
use super::unblocked::visible_fragments;
use crate::math::basis::MAX_FUNCTIONS;
use crate::math::lanes::{DVec3x4, LANES, side_by_side};
use crate::scene::Frame;

/// Quadrature on a cell, made once for all points that take it.
#[derive(Default)]
pub(super) struct Ready<const N: usize> {
    pub nodes: CellNodes<N>,
    /// The same where the cell sends the functions of its node.
    pub unit: [OnceCell<Box<Nodes<MAX_FUNCTIONS>>>; 3],
    /// Where visibility is taken from, side by side.
    eyes: [OnceCell<[DVec3x4; NODE_LANES]>; 3],
    corners: OnceCell<DVec3x4>,
}

impl<const N: usize> Ready<N> {
    /// Where visibility is taken from for these nodes of the cell, side by side.
    pub fn eyes(&self, nodes: &Nodes<N>) -> &[DVec3x4; NODE_LANES] {
        self.eyes[nodes.count.isqrt() - 1].get_or_init(|| side_by_side(&nodes.eye[..nodes.count]))
    }

    /// The corners of the cell, side by side.
    pub fn corners(&self, frame: &Frame, emitter: &EmitterCell<N>) -> &DVec3x4 {
        self.corners.get_or_init(|| DVec3x4::new(&emitter.hull(frame)))
    }
}

impl<const N: usize> Gather<'_, N> {
    /// Takes the light of a whole cell to these points, none of which is recorded; those that cast rays see these of its nodes.
    pub(super) fn take(
        &mut self,
        points: u32,
        emitter: &EmitterCell<N>,
        ready: &Ready<N>,
        how: &How,
        visible: &[u32; MAX_SAMPLES],
    ) {
        for n in 1..=3 {
            let points = points & how.nodes[n - 1];
            for p in points_of(points & how.closed_form) {
                let packet = self.packet;
                let nodes = |scratch: &mut Scratch| ready.nodes.get(packet, emitter, n, &mut scratch.nodes);
                let light = self.near(self.points.position[p], emitter, nodes, how.constant & 1 << p != 0);
                let share = self.share_seen(p, emitter, ready, how, norm(&light), visible[p]);
                self.brighten(p, &light, &share);
            }
            let far = points & !how.closed_form;
            if far == 0 {
                continue;
            }
            let nodes = ready.nodes.get(self.packet, emitter, n, &mut self.scratch.nodes);
            self.scratch.work.kernel_evaluations += nodes.count as u64 * u64::from(far.count_ones());
            for group in 0..GROUPS {
                let of_group = far & 0b1111 << (LANES * group);
                if of_group == 0 {
                    continue;
                }
                let light = self.far_side_by_side(group, nodes);
                let square = light.iter().fold(f64x4::ZERO, |sum, light| sum + *light * *light);
                let (light, norms) = (light.map(f64x4::to_array), square.sqrt().to_array());
                for p in points_of(of_group) {
                    let share = self.share_seen(p, emitter, ready, how, norms[p % LANES], visible[p]);
                    self.brighten(p, &light.map(|lanes| lanes[p % LANES]), &share);
                }
            }
        }
    }

    /// The share per band of a whole cell's light that point `p` sees; where rays tell, the light is uncertain.
    pub(super) fn share_seen(
        &mut self,
        p: usize,
        emitter: &EmitterCell<N>,
        ready: &Ready<N>,
        how: &How,
        light_w_m2: f64,
        visible: u32,
    ) -> [f64; N] {
        let rays = how.rays_of(p);
        if rays == 0 {
            return [1.0; N];
        }
        self.uncertain[p] += light_w_m2;
        if visible == 0 {
            return [0.0; N];
        }
        let targets = ready.nodes.get(self.packet, emitter, rays, &mut self.scratch.nodes);
        if visible == targets.all() {
            return [1.0; N];
        }
        self.visible_share(self.points.position[p], targets, visible)
    }

    /// Adds to point `p` the share of each band that it sees.
    pub(super) fn brighten(&mut self, p: usize, light: &[f64; N], share: &[f64; N]) {
        for n in 0..N {
            self.irradiance[p][n] += share[n] * light[n];
        }
    }

    /// The light of a cell seen in part by point `p`, and the form factor of the whole cell; `None` where that cannot be followed.
    pub(super) fn visible_light(
        &mut self,
        p: usize,
        emitter: &EmitterCell<N>,
        candidates: Candidates,
        constant: bool,
    ) -> Option<([f64; N], f64)> {
        if let Some(unit) = self.unit(p, emitter) {
            let (row, whole) = self.of_fragments(p, &unit.sent, candidates, constant)?;
            return Some((self.by_row(unit, row), whole));
        }
        self.of_fragments(p, emitter, candidates, constant)
    }

    /// The light of a cell seen in part by point `p`, from the fragments that its blockers leave, and the form factor of the whole cell.
    /// Each fragment: its form factor times the radiosity at its middle as the kernel weighs it, and what varies about that by quadrature.
    fn of_fragments<const M: usize>(
        &mut self,
        p: usize,
        emitter: &EmitterCell<M>,
        candidates: Candidates,
        constant: bool,
    ) -> Option<([f64; M], f64)> {
        let Candidates::List(start, end) = candidates else { return None };
        let faces = self.occluder.faces();
        self.scratch.work.exact_visibilities += 1;
        self.sort_by_distance(start..end);
        let (eye, n_x, n_y) = (self.points.eye[p], self.points.normal, self.packet.frame.normal);
        let visible = visible_fragments(
            eye,
            n_x,
            emitter.corners(&self.packet.frame),
            n_y,
            self.scratch.candidates[start..end].iter().flat_map(|f| faces.pieces(*f)),
            &mut self.scratch.fragments,
        )?;
        let x = self.points.position[p];
        let shift = eye - x;
        self.scratch.work.lambert_evaluations += 1 + visible.len() as u64;
        let whole = form_factor(x, n_x, emitter.corners(&self.packet.frame));
        let mut light = [0.0; M];
        let packet = self.packet;
        let radiosity = |y: DVec3| nearest_radiosity(packet, emitter, x + y);
        for corners in visible.iter() {
            // Relative to the point that the light falls on, which beyond a cut polygon's edge is not the eye.
            let factor = form_factor(DVec3::ZERO, n_x, corners.iter().map(|c| *c + shift));
            if constant {
                for n in 0..M {
                    light[n] += factor * emitter.coefficients[0][n];
                }
                continue;
            }
            let triangles = || {
                (1..corners.len() - 1).map(|i| {
                    let (a, b, c) = (corners[0] + shift, corners[i] + shift, corners[i + 1] + shift);
                    let middle = (a + b + c) / 3.0;
                    (middle, kernel(DVec3::ZERO, n_x, middle, n_y) * 0.5 * (b - a).cross(c - a).dot(n_y))
                })
            };
            let (middle, weight) = triangles().fold((DVec3::ZERO, 0.0), |(m, w), (y, k)| (m + y * k, w + k));
            if weight <= 0.0 {
                continue;
            }
            let mean = radiosity(middle / weight);
            for n in 0..M {
                light[n] += factor * mean[n];
            }
            for (y, k) in triangles() {
                let value = radiosity(y);
                for n in 0..M {
                    light[n] += k * (value[n] - mean[n]);
                }
            }
        }
        Some((light, whole))
    }

    /// Sorts candidates by their distance from a point of the bundle's hull that lies on none of its axes of symmetry. Which fragments are
    /// left hangs on the blockers' order, and rays leave the one in which they were hit.
    fn sort_by_distance(&mut self, list: Range<usize>) {
        let (faces, hull) = (self.occluder.faces(), self.points.hull);
        let weights = [0.43, 0.27, 0.11, 0.19];
        let (sum, weight) =
            hull.iter().zip(weights).fold((DVec3::ZERO, 0.0), |(s, w), (p, k)| (s + *p * k, w + k));
        let from = sum / weight;
        let distance = |face: &u32| {
            let corners = faces.vertices(*face);
            (corners.iter().sum::<DVec3>() / corners.len() as f64).distance_squared(from)
        };
        let list = &mut self.scratch.candidates[list];
        let mut order = [(0, 0, 0); LIST_LIMIT];
        let order = &mut order[..list.len()];
        for (place, (index, face)) in order.iter_mut().zip(list.iter().enumerate()) {
            // Bits of numbers that are not negative are in their order.
            *place = (distance(face).to_bits(), index as u32, *face);
        }
        order.sort_unstable();
        for (face, (_, _, sorted)) in list.iter_mut().zip(order) {
            *face = *sorted;
        }
    }

    /// The share of a cell's light per band that the rays to these of its nodes find unblocked.
    fn visible_share(&self, x: DVec3, targets: &Nodes<N>, visible: u32) -> [f64; N] {
        let (mut seen, mut total) = ([0.0; N], [0.0; N]);
        for q in 0..targets.count {
            let k = kernel(x, self.points.normal, targets.position[q], self.packet.frame.normal);
            for n in 0..N {
                let light = k * targets.weighted[q][n].max(0.0);
                total[n] += light;
                if visible & (1 << q) != 0 {
                    seen[n] += light;
                }
            }
        }
        let votes = visible.count_ones() as f64 / targets.count as f64;
        std::array::from_fn(|n| if total[n] > 0.0 { seen[n] / total[n] } else { votes })
    }

    /// Product quadrature for four points.
    fn far_side_by_side(&self, group: usize, nodes: &Nodes<N>) -> [f64x4; N] {
        let (n_x, n_y) = (DVec3x4::splat(self.points.normal), DVec3x4::splat(self.packet.frame.normal));
        let mut sum = [f64x4::ZERO; N];
        for q in 0..nodes.count {
            let k = kernels(&self.lanes[group], &n_x, &DVec3x4::splat(nodes.position[q]), &n_y);
            for n in 0..N {
                sum[n] += k * f64x4::splat(nodes.weighted[q][n]);
            }
        }
        sum
    }

    /// Product quadrature.
    pub(super) fn far<const M: usize>(&mut self, x: DVec3, nodes: &Nodes<M>) -> [f64; M] {
        self.scratch.work.kernel_evaluations += nodes.count as u64;
        let mut sum = [0.0; M];
        for q in 0..nodes.count {
            let k = kernel(x, self.points.normal, nodes.position[q], self.packet.frame.normal);
            for n in 0..M {
                sum[n] += k * nodes.weighted[q][n];
            }
        }
        sum
    }

    /// Lambert's closed form, with singularity subtraction where the radiosity varies.
    pub(super) fn near<'n, const M: usize>(
        &mut self,
        x: DVec3,
        emitter: &EmitterCell<M>,
        nodes: impl FnOnce(&mut Scratch) -> &'n Nodes<M>,
        constant: bool,
    ) -> [f64; M] {
        let (n_x, n_y) = (self.points.normal, self.packet.frame.normal);
        self.scratch.work.lambert_evaluations += 1;
        let factor = form_factor(x, n_x, emitter.corners(&self.packet.frame));
        if constant {
            return emitter.coefficients[0].map(|c| c * factor);
        }
        let nodes = nodes(self.scratch);
        self.scratch.work.kernel_evaluations += nodes.count as u64;
        let nearest = nearest_radiosity(self.packet, emitter, x);
        let mut light = nearest.map(|b| b * factor);
        for q in 0..nodes.count {
            let k = kernel(x, n_x, nodes.position[q], n_y);
            for n in 0..M {
                light[n] += k * (nodes.weighted[q][n] - nodes.area[q] * nearest[n]);
            }
        }
        light
    }
}

/// The radiosity of a packet's cell at its point nearest to `x`.
fn nearest_radiosity<const N: usize, const M: usize>(
    packet: &Packet<N>,
    emitter: &EmitterCell<M>,
    x: DVec3,
) -> [f64; M] {
    let local = emitter.cell.to_local(packet.frame.uv(x)).clamp(DVec2::ZERO, DVec2::ONE);
    value_at(packet.basis, &emitter.coefficients, local)
}
