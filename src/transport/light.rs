//! The light of one emitter cell on one point, once it is judged how to take it ([`super::gather`]): by quadrature, by Lambert's closed form, or
//! from the fragments that blockers leave visible.
//!
//! Where links are recorded it is found as a row: what each function of the packet's node that holds the cell brings for a coefficient of 1.
//! The light is then the row times the node's coefficients, and the row holds for other coefficients too.

use std::cell::OnceCell;

use glam::{DVec2, DVec3};

use super::candidates::Candidates;
use super::gather::{Gather, How};
use super::kernel::kernel;
use super::lambert::form_factor;
use super::nodes::{CellNodes, Nodes, value_at};
use super::packet::{EmitterCell, Packet};
use super::recording::{Row, Unit};
use super::unblocked::visible_fragments;
use crate::math::basis::MAX_FUNCTIONS;

/// Quadrature on a cell, made once for all points that take it.
#[derive(Default)]
pub(super) struct Ready<const N: usize> {
    pub nodes: CellNodes<N>,
    /// The same where the cell sends the functions of its node.
    unit: [OnceCell<Box<Nodes<MAX_FUNCTIONS>>>; 3],
}

impl<const N: usize> Gather<'_, N> {
    /// The light of a whole cell on point `p`, per band in W/m².
    pub(super) fn whole_light(
        &mut self,
        p: usize,
        emitter: &EmitterCell<N>,
        ready: &Ready<N>,
        how: &How,
    ) -> [f64; N] {
        let x = self.points.position[p];
        if let Some(unit) = self.unit(p, emitter) {
            let (frame, basis) = (&self.packet.frame, self.packet.basis);
            let make = || Box::new(Nodes::new(frame, basis, &unit.sent, how.nodes));
            let row = self.of_cell(x, &unit.sent, ready.unit[how.nodes - 1].get_or_init(make), how);
            return self.by_row(unit, row);
        }
        self.of_cell(x, emitter, ready.nodes.get(self.packet, emitter, how.nodes), how)
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

    /// What sends to point `p` in place of the cell, if that is recorded.
    fn unit<'e>(&self, p: usize, emitter: &'e EmitterCell<N>) -> Option<&'e Unit> {
        emitter.unit.as_deref().filter(|_| p < self.scratch.recording.points)
    }

    /// The light that a row brings, which is kept for [`Gather::add`].
    fn by_row(&mut self, unit: &Unit, row: [f64; MAX_FUNCTIONS]) -> [f64; N] {
        let coefficients = &self.packet.nodes[unit.node as usize].coefficients;
        let mut light = [0.0; N];
        for (factor, coefficient) in row.iter().zip(coefficients) {
            for n in 0..N {
                light[n] += factor * coefficient[n];
            }
        }
        self.scratch.recording.row = row;
        light
    }

    /// Adds to point `p` what was just found of each band that share of it which is seen, and records it.
    pub(super) fn add(
        &mut self,
        p: usize,
        emitter: &EmitterCell<N>,
        light: &[f64; N],
        share: Option<[f64; N]>,
        how: &How,
    ) {
        let mut share = share.unwrap_or([1.0; N]);
        if let Some(unit) = self.unit(p, emitter) {
            share = [self.record(p, unit, light, &share, how); N];
        }
        for n in 0..N {
            self.irradiance[p][n] += share[n] * light[n];
        }
    }

    /// Records the row of the light just found, for all bands alike, and returns the share of it that stands for theirs.
    fn record(&mut self, p: usize, unit: &Unit, light: &[f64; N], share: &[f64; N], how: &How) -> f64 {
        let (lit, seen) = light
            .iter()
            .zip(share)
            .fold((0.0, 0.0), |(lit, seen), (light, share)| (lit + light.abs(), seen + share * light.abs()));
        let even = if lit > seen { seen / lit } else { share[0] };
        let node = &self.packet.nodes[unit.node as usize];
        let recording = &mut self.scratch.recording;
        recording.rows.push(Row {
            point: p,
            cell: unit.cell,
            strength_w_m2: node.strength_w_m2(),
            detail_w_m2: node.detail.rms_w_m2,
            fading: how.nearest.min(1.0).powi(self.packet.basis.order() as i32),
            factors: recording.row.map(|factor| even * factor),
        });
        even
    }

    /// The light of a whole cell on a point at `x`.
    fn of_cell<const M: usize>(
        &mut self,
        x: DVec3,
        emitter: &EmitterCell<M>,
        nodes: &Nodes<M>,
        how: &How,
    ) -> [f64; M] {
        if how.closed_form { self.near(x, emitter, nodes, how.constant) } else { self.far(x, nodes) }
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
        for fragment in visible {
            // Relative to the point that the light falls on, which beyond a cut polygon's edge is not the eye.
            let corners = fragment.corners();
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

    /// The share of a cell's light per band that the rays to these of its nodes find unblocked.
    pub(super) fn visible_share(&self, x: DVec3, targets: &Nodes<N>, visible: u32) -> [f64; N] {
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

    /// Product quadrature.
    fn far<const M: usize>(&mut self, x: DVec3, nodes: &Nodes<M>) -> [f64; M] {
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
    fn near<const M: usize>(
        &mut self,
        x: DVec3,
        emitter: &EmitterCell<M>,
        nodes: &Nodes<M>,
        constant: bool,
    ) -> [f64; M] {
        let (n_x, n_y) = (self.points.normal, self.packet.frame.normal);
        self.scratch.work.lambert_evaluations += 1;
        let factor = form_factor(x, n_x, emitter.corners(&self.packet.frame));
        if constant {
            return emitter.coefficients[0].map(|c| c * factor);
        }
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
