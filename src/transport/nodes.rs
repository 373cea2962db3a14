//! Quadrature on emitter cells: Gauss nodes, with fitted weights where a polygon's edge cuts the cell (numerics §5).

use std::any::Any;
use std::cell::OnceCell;
use std::fmt::{Debug, Formatter};
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::packet::{EmitterCell, Packet};
use super::recent::Recent;
use crate::math::Cell;
use crate::math::basis::{Basis, MAX_FUNCTIONS, legendre};
use crate::math::lanes::LANES;
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
        let mut functions = [[0.0; 4]; 3];
        let (mut along_u, mut along_v) = ([DVec3::ZERO; 3], [DVec3::ZERO; 3]);
        for i in 0..n {
            let uv = emitter.cell.to_surface(DVec2::splat(abscissae[i]));
            functions[i] = legendre(abscissae[i]);
            (along_u[i], along_v[i]) = (frame.origin + uv.x * frame.u, uv.y * frame.v);
        }
        for i in 0..n {
            for j in 0..n {
                let q = i * n + j;
                nodes.position[q] = along_u[i] + along_v[j];
                nodes.eye[q] = nodes.position[q];
                let mut weight = weights[i] * weights[j];
                if let (Some((weights, moments)), Some(outline)) = (&moments, &emitter.outline) {
                    let local = DVec2::new(abscissae[i], abscissae[j]);
                    let uv = emitter.cell.to_surface(local);
                    let phi = weights.evaluate(local);
                    weight *= (0..weights.len()).map(|a| phi[a] * moments[a]).sum::<f64>();
                    if !polygon::contains(outline, uv) {
                        let near = polygon::nearest_inside(outline, uv, |d| frame.square_m2(d));
                        nodes.eye[q] = frame.point(near);
                    }
                }
                nodes.area[q] = weight * area;
                let value = value(basis, &emitter.coefficients, &functions[i], &functions[j]);
                nodes.weighted[q] = value.map(|b| b * nodes.area[q]);
            }
        }
        nodes
    }

    /// All of them, as a bit mask.
    pub fn all(&self) -> u32 {
        (1 << self.count) - 1
    }
}

/// Ends of the stretches of [0, 1] that n Gauss nodes stand for: each as long as its node's weight.
const STRETCHES: [[f64; 4]; 3] =
    [[0.0, 1.0, 1.0, 1.0], [0.0, 0.5, 1.0, 1.0], [0.0, 5.0 / 18.0, 13.0 / 18.0, 1.0]];

/// Steps of the sequence that spreads points most evenly over a square: powers of the reciprocal of the root of x³ = x + 1.
const EVEN_STEPS: DVec2 = DVec2::new(0.754_877_666_246_692_8, 0.569_840_290_998_053_3);

/// Where point number `p` of a bundle looks at a cell that emits as a whole, instead of at its n × n nodes: as far along in the stretches that
/// these stand for as no other point of the bundle.
pub fn spread(frame: &Frame, cell: &Cell, n: usize, p: usize) -> [DVec3; 9] {
    let along = (DVec2::splat(0.5) + p as f64 * EVEN_STEPS).fract();
    let stretches = STRETCHES[n - 1];
    let at = |i: usize, along: f64| stretches[i] + (stretches[i + 1] - stretches[i]) * along;
    let mut targets = [DVec3::ZERO; 9];
    for i in 0..n {
        for j in 0..n {
            targets[i * n + j] = frame.point(cell.to_surface(DVec2::new(at(i, along.x), at(j, along.y))));
        }
    }
    targets
}

/// Registers that nine nodes take.
pub const NODE_LANES: usize = 9usize.div_ceil(LANES);

/// The nodes of one cell, made when asked for; those of a packet's root are kept in the packet, others among those that a worker made lately.
#[derive(Default)]
pub struct CellNodes<const N: usize>([OnceCell<Arc<Nodes<N>>>; 3]);

impl<const N: usize> CellNodes<N> {
    /// The n × n nodes of `emitter`, the cell that this was made for.
    pub fn get<'a>(
        &'a self,
        packet: &'a Packet<N>,
        emitter: &EmitterCell<N>,
        n: usize,
        recent: &mut RecentNodes,
    ) -> &'a Nodes<N> {
        match emitter.node {
            Some(0) => packet.root_nodes(n),
            _ => self.0[n - 1].get_or_init(|| recent.get(packet, emitter, n)),
        }
    }
}

/// Nodes that a worker made lately, of 0.7 KB each in three bands, as many bands as the run has.
#[derive(Default)]
pub struct RecentNodes(Option<Box<dyn Any + Send>>);

impl RecentNodes {
    fn get<const N: usize>(
        &mut self,
        packet: &Packet<N>,
        emitter: &EmitterCell<N>,
        n: usize,
    ) -> Arc<Nodes<N>> {
        let nodes = self.recent().get((packet.id(), emitter.cell, n), |other| {
            let made = Nodes::of_cell(packet, emitter, n);
            let Some(mut place) = other else { return Arc::new(made) };
            // Where nobody looks at what is forgotten, it is written over.
            match Arc::get_mut(&mut place) {
                Some(nodes) => *nodes = made,
                None => place = Arc::new(made),
            }
            place
        });
        Arc::clone(nodes)
    }

    fn recent<const N: usize>(&mut self) -> &mut Recent<Arc<Nodes<N>>> {
        if !self.0.as_ref().is_some_and(|recent| recent.is::<Recent<Arc<Nodes<N>>>>()) {
            self.0 = Some(Box::new(Recent::<Arc<Nodes<N>>>::default()));
        }
        let recent = self.0.as_mut().and_then(|recent| recent.downcast_mut());
        recent.unwrap_or_else(|| unreachable!("places of this type were just made"))
    }
}

impl Debug for RecentNodes {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RecentNodes").finish_non_exhaustive()
    }
}

/// The function of these coefficients at a point of the cell's unit square.
pub fn value_at<const N: usize>(
    basis: Basis,
    coefficients: &[[f64; N]; MAX_FUNCTIONS],
    local: DVec2,
) -> [f64; N] {
    value(basis, coefficients, &legendre(local.x), &legendre(local.y))
}

/// The same where the functions of either coordinate are known.
fn value<const N: usize>(
    basis: Basis,
    coefficients: &[[f64; N]; MAX_FUNCTIONS],
    x: &[f64; 4],
    y: &[f64; 4],
) -> [f64; N] {
    // With the order known the loops unroll.
    match basis {
        Basis::Haar => sum::<N, 1>(coefficients, x, y),
        Basis::M2 => sum::<N, 2>(coefficients, x, y),
        Basis::M3 | Basis::Auto => sum::<N, 3>(coefficients, x, y),
    }
}

#[inline(always)]
fn sum<const N: usize, const K: usize>(
    coefficients: &[[f64; N]; MAX_FUNCTIONS],
    x: &[f64; 4],
    y: &[f64; 4],
) -> [f64; N] {
    let mut sum = [0.0; N];
    for i in 0..K {
        for j in 0..K {
            let phi = x[i] * y[j];
            for n in 0..N {
                sum[n] += phi * coefficients[i * K + j][n];
            }
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::packet::PacketNode;
    use crate::transport::recent::REMEMBERED;
    use crate::transport::samples::MAX_SAMPLES;

    #[test]
    fn points_together_look_everywhere_and_each_evenly() {
        let frame = Frame { origin: DVec3::ZERO, u: DVec3::X, v: DVec3::Y, normal: DVec3::Z, area_m2: 1.0 };
        for n in 1..=3 {
            let (_, weights) = gauss(n);
            let mut seen = vec![[0; 9]; n * n];
            for p in 0..MAX_SAMPLES {
                let targets = spread(&frame, &Cell::UNIT, n, p);
                for (q, seen) in seen.iter_mut().enumerate() {
                    // How far along in the stretch of its node, which is as long as that weighs.
                    let along = [(q / n, targets[q].x), (q % n, targets[q].y)]
                        .map(|(i, at)| (at - weights[..i].iter().sum::<f64>()) / weights[i]);
                    assert!(
                        along.iter().all(|a| (0.0..1.0).contains(a)),
                        "{n}, node {q}, point {p}: {along:?}"
                    );
                    seen[3 * (3.0 * along[0]) as usize + (3.0 * along[1]) as usize] += 1;
                }
            }
            assert!(seen.as_flattened().iter().all(|count| *count > 0), "{n}: {seen:?}");
        }
    }

    /// A packet of a square, of this radiosity in all bands.
    fn packet<const N: usize>(radiosity: f64) -> Packet<N> {
        let frame = Frame { origin: DVec3::ZERO, u: DVec3::X, v: DVec3::Y, normal: DVec3::Z, area_m2: 1.0 };
        let mut coefficients = [[0.0; N]; MAX_FUNCTIONS];
        coefficients[0] = [radiosity; N];
        let node = PacketNode { coefficients, detail: Default::default(), children: None };
        Packet::new(0, 0, frame, None, Basis::M2, vec![node])
    }

    fn agree<const N: usize>(packet: &Packet<N>, recent: &mut RecentNodes) {
        let mut cells = vec![packet.root()];
        for index in 0..REMEMBERED {
            let parent = cells[index / 4].clone();
            cells.extend(packet.child(&parent, packet.split_of(&parent), index % 4, &mut Default::default()));
        }
        // Forwards and backwards, so that some are remembered and others not.
        for cell in cells.iter().chain(cells.iter().rev()) {
            for n in 1..=3 {
                let (found, made) = (recent.get(packet, cell, n), Nodes::of_cell(packet, cell, n));
                assert_eq!(
                    (found.count, found.position, found.weighted),
                    (made.count, made.position, made.weighted)
                );
            }
        }
    }

    #[test]
    fn what_is_remembered_is_what_would_be_made() {
        let mut recent = RecentNodes::default();
        agree(&packet::<3>(1.0), &mut recent);
        agree(&packet::<3>(2.0), &mut recent);
        agree(&packet::<1>(1.0), &mut recent);
        let copied = packet::<1>(3.0);
        assert_eq!(copied.id(), copied.clone().id());
        assert_ne!(copied.id(), packet::<1>(3.0).id());
    }
}
