//! Several packets and one receiver: clusters of those that together matter little, one by one those that matter.

use super::candidates::Candidates;
use super::cluster::{Clusters, DRAWS};
use super::gather::{Points, Tolerance, norm};
use super::packet::Packet;
use super::pair::{COARSE, COARSE_SHARE, GoOn, Scratch, go_down, middle_of, shoot_first};
use super::receiver::{Deposited, Patch, Receiver};
use super::share::Helpers;
use super::source::Source;
use super::{Oracle, Rules};
use crate::math::basis::MAX_FUNCTIONS;
use crate::visibility::Occluder;

/// What a cluster may bring, as a share of what a pair may bring that is taken by one sample: pairs of a few draws err more.
const CLUSTER_SHARE: f64 = 1.0;

/// Clusters pay from this many packets.
const LEAST_PACKETS: usize = 16;

/// Packets that are shot together.
#[derive(Clone, Copy, Debug)]
pub struct Packets<'a, const N: usize> {
    /// The packets, to be shot in this order where they do not cluster.
    pub packets: &'a [Packet<N>],
    /// How they cluster, where they do.
    pub clusters: Option<&'a Clusters>,
}

impl Clusters {
    /// The clusters of packets of which there are enough. Only the energy oracle knows what may be left out.
    pub fn of<const N: usize>(packets: &[Packet<N>], rules: &Rules) -> Option<Self> {
        let pays = rules.oracle == Oracle::Energy && packets.len() >= LEAST_PACKETS;
        pays.then(|| Self::new(packets))
    }
}

impl<const N: usize> Packets<'_, N> {
    /// Transports their light to one receiver, until told to stop; `helpers` as in [`shoot`](super::shoot).
    #[allow(clippy::too_many_arguments)]
    pub fn shoot<R: Receiver<N>>(
        &self,
        patch: &Patch<N>,
        receiver: &mut R,
        occluder: &dyn Occluder,
        rules: &Rules,
        scratch: &mut Scratch,
        helpers: &dyn Helpers,
        go_on: GoOn<'_>,
    ) -> Deposited<N> {
        let mut deposited = Deposited::default();
        let mut waiting = Vec::new();
        let mut one = |index: usize, receiver: &mut R, scratch: &mut Scratch| {
            let packet = &self.packets[index];
            let mut taken = shoot_first(packet, patch, receiver, occluder, rules, scratch, helpers, go_on);
            let links = std::mem::take(&mut taken.waiting);
            if !links.is_empty() {
                waiting.push((packet, links));
            }
            taken
        };
        match self.clusters {
            None => {
                for index in (0..self.packets.len()).take_while(|_| go_on()) {
                    deposited.add_after(one(index, receiver, scratch));
                }
            }
            Some(clusters) => {
                let weight = patch.weight(rules.least_reflectance);
                let area_m2 = patch.frame.area_m2 * receiver.shape().share();
                let (centre, radius) = patch.sphere();
                let allowed_w_m2 =
                    CLUSTER_SHARE * COARSE_SHARE * rules.threshold_w_m / (weight * area_m2.sqrt());
                let mut open: Vec<usize> = clusters.root().into_iter().collect();
                while let Some(node) = open.pop().filter(|_| go_on()) {
                    let cluster = clusters.node(node);
                    if cluster.cannot_reach(patch.corners[0], patch.frame.normal, centre, radius) {
                        scratch.work.pairs_behind += cluster.len() as u64;
                        continue;
                    }
                    match clusters.below(node) {
                        Err(index) => deposited.add_after(one(index, receiver, scratch)),
                        Ok(_)
                            if cluster.len() > DRAWS
                                && cluster.is_apart(centre, radius)
                                && cluster.estimate_w_m2(centre, radius, patch.frame.normal)
                                    <= allowed_w_m2 =>
                        {
                            deposited.add_after(
                                self.draw(
                                    clusters, node, patch, receiver, occluder, weight, area_m2, scratch,
                                ),
                            );
                        }
                        Ok([first, second]) => open.extend([second, first]),
                    }
                }
            }
        }
        for (packet, links) in waiting.iter().take_while(|_| go_on()) {
            deposited.add_after(go_down(*packet, links, patch, receiver, occluder, rules, scratch, helpers));
        }
        deposited
    }

    /// Takes a cluster by a few of its members, at one point of the receiver.
    #[allow(clippy::too_many_arguments)]
    fn draw<R: Receiver<N>>(
        &self,
        clusters: &Clusters,
        node: usize,
        patch: &Patch<N>,
        receiver: &mut R,
        occluder: &dyn Occluder,
        weight: f64,
        area_m2: f64,
        scratch: &mut Scratch,
    ) -> Deposited<N> {
        let point = [patch.frame.point(middle_of(receiver.shape()))];
        let normal = patch.frame.normal;
        let points = Points { position: &point, eye: &point, normal, face: patch.face, hull: &point };
        let before = scratch.work.cost();
        let mut drawn = [[0.0; N]; DRAWS];
        for ((packet, times), light) in clusters.draw(node, patch.surface).into_iter().zip(&mut drawn) {
            let packet = &self.packets[packet];
            if packet.reaches(normal, &point) {
                let estimate = packet.estimate_w_m2(point[0], 0.0, normal);
                let tolerance = Tolerance { relative: COARSE, absolute_w_m2: 0.5 * estimate };
                let mut one = [[0.0; N]];
                packet.gather(&points, occluder, Candidates::Scene, tolerance, &mut one, &mut [0.0], scratch);
                *light = one[0].map(|e| e * times);
            }
        }
        let mut coefficients = [[0.0; N]; MAX_FUNCTIONS];
        coefficients[0] = std::array::from_fn(|n| drawn.iter().map(|light| light[n]).sum());
        receiver.deposit(&coefficients);
        let mut deposited = Deposited { span: scratch.work.cost() - before, ..Deposited::default() };
        deposited.take(patch, &coefficients, area_m2);
        scratch.work.interactions += 1;
        scratch.work.clusters += 1;
        scratch.work.pairs_clustered += clusters.node(node).len() as u64;
        // The variance of a sum of draws, and what a constant misses on the receiver, as for one pair.
        let mean = coefficients[0].map(|e| e / DRAWS as f64);
        let square = |light: &[f64; N]| -> f64 { (0..N).map(|n| (light[n] - mean[n]).powi(2)).sum() };
        let draws = DRAWS as f64;
        let variance = draws / (draws - 1.0) * drawn.iter().map(square).sum::<f64>();
        let carried = weight * norm(&coefficients[0]);
        deposited.error_squared = area_m2 * (weight * weight * variance + 0.1 * carried * carried);
        deposited
    }
}

#[cfg(test)]
mod tests {
    use ccnuma::Arena;
    use ccnuma::arena::Backend;

    use super::*;
    use crate::math::Basis;
    use crate::radiosity::{Tree, trees};
    use crate::scene::{read::inventor, surfaces};
    use crate::transport::{Alone, SampleRules};
    use crate::visibility::{Bvh, OpaqueFaces};

    /// A floor under a cloud of little squares that look down, up and sideways, and a shelf that shades a part of it.
    fn cloud() -> String {
        let mut text =
            "#Inventor V2.1 ascii\nSeparator { Material { diffuseColor .5 .5 .5 emissiveColor 1 1 1 }\n"
                .to_owned();
        for i in 0..400 {
            let (x, y) = ((i % 20) as f64 * 0.5, (i / 20) as f64 * 0.5);
            let z = 3.0 + 0.1 * ((i * 7) % 10) as f64;
            let (a, b) = [("0.1 0 0", "0 -0.1 0"), ("0.1 0 0", "0 0.1 0"), ("0 0.1 0", "0 0 0.1")][i % 3];
            let corner = |s: &str, t: &str| {
                let add = |k: usize| {
                    let number = |v: &str| v.split(' ').nth(k).map_or(0.0, |n| n.parse::<f64>().unwrap());
                    number(s) + number(t)
                };
                format!("{} {} {}", x + add(0), y + add(1), z + add(2))
            };
            text += &format!(
                "Separator {{ ShapeHints {{ vertexOrdering COUNTERCLOCKWISE shapeType SOLID }} \
                 Coordinate3 {{ point [ {}, {}, {}, {} ] }} FaceSet {{ numVertices 4 }} }}\n",
                corner("0 0 0", "0 0 0"),
                corner(a, "0 0 0"),
                corner(a, b),
                corner("0 0 0", b)
            );
        }
        text + "Material { diffuseColor .5 .5 .5 emissiveColor 0 0 0 } \
                ShapeHints { vertexOrdering COUNTERCLOCKWISE shapeType SOLID } \
                Coordinate3 { point [ 4 4 0, 6 4 0, 6 6 0, 4 6 0, 5 5 1, 9 5 1, 9 9 1, 5 9 1 ] } \
                FaceSet { numVertices [ 4, 4 ] } }"
    }

    #[test]
    fn clusters_bring_what_their_members_bring_within_the_error_they_state() {
        let scene = inventor::parse(&cloud(), std::path::Path::new("cloud.iv")).unwrap();
        let surfaces = surfaces(&scene);
        let bvh = Bvh::new(OpaqueFaces::new(&scene));
        let arena = Arena::new(Backend::Malloc);
        let (alone, grow) = (Alone(&arena), || trees::<1>(&surfaces, Basis::M2, &arena));
        let dark = grow();
        let packets: Vec<Packet<1>> =
            dark.iter().filter(|t| t.exitance_w_m2[0] > 0.0).map(Tree::exitance_packet).collect();
        assert_eq!(packets.len(), 400);
        let (mut skipped, mut misses) = (0, Vec::new());
        for threshold_w_m in [3e-1, 3e-2, 3e-3] {
            let rules = Rules {
                oracle: Oracle::Energy,
                threshold_w_m,
                reference_w_m2: 1.0,
                least_reflectance: 0.5,
                point_w_m2: f64::INFINITY,
                samples: SampleRules::new(Basis::M2),
            };
            let clusters = Clusters::of(&packets, &rules);
            let together = Packets { packets: &packets, clusters: clusters.as_ref() };
            let mut lit = grow();
            // The floor, the shelf, and some of the little ones.
            for index in [400, 401, 0, 1, 2, 199] {
                let mut scratch = Scratch::default();
                let tree = &mut lit[index];
                let found =
                    together.shoot(&tree.patch, &mut tree.root, &bvh, &rules, &mut scratch, &alone, &|| true);
                skipped += scratch.work.pairs_clustered;
                let fine = Rules { threshold_w_m: 1e-5, ..rules.clone() };
                let mut truth = 0.0;
                for packet in &packets {
                    let one = crate::transport::shoot(
                        packet,
                        &tree.patch,
                        &mut tree.root,
                        &bvh,
                        &fine,
                        &mut scratch,
                        &alone,
                    );
                    truth += one.received_w[0];
                }
                let miss = 0.5 * (found.received_w[0] - truth).abs() / tree.area_m2.sqrt();
                misses.push((miss / found.error_squared.sqrt().max(1e-9), threshold_w_m, index));
            }
        }
        assert!(skipped > 2000, "only {skipped} pairs were taken in clusters");
        misses.sort_by(|a, b| a.0.total_cmp(&b.0));
        assert!(misses[misses.len() - 1].0 < 3.0, "beyond three of the errors stated: {misses:?}");
        assert!(misses[misses.len() / 2].0 < 1.0, "beyond one in the median: {misses:?}");
    }
}
