//! Quadrature on emitter cells: Gauss nodes, with fitted weights where a polygon's edge cuts the cell (numerics §5).

use std::cell::OnceCell;

use glam::{DVec2, DVec3};

use super::packet::{EmitterCell, Packet};
use crate::math::basis::{Basis, MAX_FUNCTIONS, legendre};
use crate::math::polygon;
use crate::math::quadrature::gauss;
use crate::scene::Frame;

/// Gauss nodes on an emitter cell.
#[derive(Clone, Debug)]
pub struct Nodes<const N: usize> {
    /// How many there are.
    pub count: usize,
    /// Positions in metres.
    pub position: [DVec3; 9],
    /// Where visibility is taken from: the same, or the nearest point of the emitting polygon.
    pub eye: [DVec3; 9],
    /// Weights in m²; on cut cells they may be negative.
    pub area: [f64; 9],
    /// Radiosity times weight in W.
    pub weighted: [[f64; N]; 9],
}

impl<const N: usize> Nodes<N> {
    /// The n × n nodes of a cell of a packet.
    pub fn of_cell(packet: &Packet<N>, emitter: &EmitterCell<N>, n: usize) -> Self {
        Self::new(&packet.frame, packet.basis, emitter, n)
    }

    /// The n × n nodes of a cell on a surface with this frame.
    pub fn new(frame: &Frame, basis: Basis, emitter: &EmitterCell<N>, n: usize) -> Self {
        let (abscissae, weights) = gauss(n);
        let area = frame.area_m2 * emitter.cell.area();
        let mut nodes = Self {
            count: n * n,
            position: [DVec3::ZERO; 9],
            eye: [DVec3::ZERO; 9],
            area: [0.0; 9],
            weighted: [[0.0; N]; 9],
        };
        let moments = emitter.outline.as_ref().map(|outline| {
            let local: Vec<DVec2> = outline.iter().map(|p| emitter.cell.to_local(*p)).collect();
            let weights = [Basis::Haar, Basis::M2, Basis::M3][n - 1];
            (weights, polygon::moments(&local, weights))
        });
        for i in 0..n {
            for j in 0..n {
                let q = i * n + j;
                let local = DVec2::new(abscissae[i], abscissae[j]);
                let uv = emitter.cell.to_surface(local);
                nodes.position[q] = frame.point(uv);
                nodes.eye[q] = nodes.position[q];
                let mut weight = weights[i] * weights[j];
                if let (Some((weights, moments)), Some(outline)) = (&moments, &emitter.outline) {
                    let phi = weights.evaluate(local);
                    weight *= (0..weights.len()).map(|a| phi[a] * moments[a]).sum::<f64>();
                    if !polygon::contains(outline, uv) {
                        let near = polygon::nearest_on_boundary(outline, uv, |d| {
                            (d.x * frame.u + d.y * frame.v).length_squared()
                        });
                        nodes.eye[q] = frame.point(near);
                    }
                }
                nodes.area[q] = weight * area;
                let value = value_at(basis, &emitter.coefficients, local);
                nodes.weighted[q] = value.map(|b| b * nodes.area[q]);
            }
        }
        nodes
    }
}

/// The nodes of one cell, made when asked for; those of a packet's root stand ready in the packet.
#[derive(Default)]
pub struct CellNodes<const N: usize>([OnceCell<Nodes<N>>; 3]);

impl<const N: usize> CellNodes<N> {
    /// The n × n nodes of `emitter`, the cell that this was made for.
    pub fn get<'a>(&'a self, packet: &'a Packet<N>, emitter: &EmitterCell<N>, n: usize) -> &'a Nodes<N> {
        match emitter.node {
            Some(0) => &packet.root_nodes[n - 1],
            _ => self.0[n - 1].get_or_init(|| Nodes::of_cell(packet, emitter, n)),
        }
    }
}

/// The function of these coefficients at a point of the cell's unit square.
pub fn value_at<const N: usize>(
    basis: Basis,
    coefficients: &[[f64; N]; MAX_FUNCTIONS],
    local: DVec2,
) -> [f64; N] {
    let k = basis.order();
    let (x, y) = (legendre(local.x), legendre(local.y));
    let mut sum = [0.0; N];
    for i in 0..k {
        for j in 0..k {
            let phi = x[i] * y[j];
            for n in 0..N {
                sum[n] += phi * coefficients[i * k + j][n];
            }
        }
    }
    sum
}
