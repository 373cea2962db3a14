//! Clusters of emitters: a tree over the packets of a batch, so that a receiver looks only at those that matter to it one by one.
//!
//! A cluster that lies behind the receiver, or whose members all face away, is skipped whole. One whose members together cannot bring more
//! than a pair that is taken by one sample may bring is taken by a few of its members, drawn by their power, each standing for its share
//! (after the light cuts of Walter et al. 2005, with stratified draws instead of one representative). How far the drawn ones differ is the
//! error booked. What is left are pairs. The draws follow from how the receiver lies to the cluster, and the tree from where its members lie and
//! their order, whatever the numbers of surfaces and the scene's scale.

use std::f64::consts::PI;
use std::ops::Range;

use glam::DVec3;

use super::packet::Packet;
use super::source::Source;
use crate::math::chance::{coarse, fraction};

/// Members drawn from a cluster; one with no more is not worth drawing from.
pub(super) const DRAWS: usize = 4;

/// How many radii of a cluster and a receiver must lie between their centres: within, members differ too much in distance.
const SEPARATION: f64 = 1.05;

/// A turn of a normal by a right angle counts as this share of the cluster's extent where members are told apart.
const TURN: f64 = 0.5;

/// A node of the tree.
#[derive(Clone, Debug)]
pub(super) struct Cluster {
    low: DVec3,
    high: DVec3,
    /// Mean direction of the members' normals and the largest angle to it.
    axis: DVec3,
    spread: f64,
    /// Sum of the members' strengths times their areas, in W.
    power_w: f64,
    /// Members, as positions in [`Clusters::order`].
    members: Range<usize>,
    /// Position of the second child; the first follows its parent.
    second: Option<usize>,
}

/// A tree over packets.
#[derive(Clone, Debug)]
pub struct Clusters {
    nodes: Vec<Cluster>,
    /// Indices of packets.
    order: Vec<usize>,
    /// Sums of power along the order, one more than members.
    power_w: Vec<f64>,
}

/// A packet as clusters see it.
struct Member {
    index: usize,
    low: DVec3,
    high: DVec3,
    normal: DVec3,
    power_w: f64,
}

impl Clusters {
    /// The tree over those packets that have power; it may have no nodes.
    pub fn new<const N: usize>(packets: &[Packet<N>]) -> Self {
        let all = packets.iter().enumerate().map(|(index, packet)| Member::new(index, packet));
        let mut members: Vec<Member> = all.filter(|member| member.power_w > 0.0).collect();
        let mut nodes = Vec::with_capacity(2 * members.len());
        if !members.is_empty() {
            let count = members.len();
            divide(&mut nodes, &mut members, 0..count);
        }
        let mut power_w = vec![0.0];
        for member in &members {
            power_w.push(power_w[power_w.len() - 1] + member.power_w);
        }
        Self { nodes, order: members.iter().map(|member| member.index).collect(), power_w }
    }

    /// The root, if there is one.
    pub(super) fn root(&self) -> Option<usize> {
        (!self.nodes.is_empty()).then_some(0)
    }

    /// A node.
    pub(super) fn node(&self, node: usize) -> &Cluster {
        &self.nodes[node]
    }

    /// The children of a node, or the packet of a leaf.
    pub(super) fn below(&self, node: usize) -> Result<[usize; 2], usize> {
        match self.nodes[node].second {
            Some(second) => Ok([node + 1, second]),
            None => Err(self.order[self.nodes[node].members.start]),
        }
    }

    /// Packets drawn from a node for a receiver within this sphere, each with how many times its light stands for the node's.
    pub(super) fn draw(&self, node: usize, centre: DVec3, radius: f64) -> [(usize, f64); DRAWS] {
        let cluster = &self.nodes[node];
        let members = cluster.members.clone();
        let (from, to) = (self.power_w[members.start], self.power_w[members.end]);
        let offset = fraction([centre.distance(cluster.middle()), radius].map(|m| m / cluster.radius()));
        std::array::from_fn(|stratum| {
            let at = from + (to - from) * (stratum as f64 + offset) / DRAWS as f64;
            let sums = &self.power_w[members.start + 1..members.end];
            let member = (members.start + sums.partition_point(|sum| *sum <= at)).min(members.end - 1);
            let power = self.power_w[member + 1] - self.power_w[member];
            (self.order[member], (to - from) / (DRAWS as f64 * power))
        })
    }
}

impl Cluster {
    /// Number of members.
    pub fn len(&self) -> usize {
        self.members.len()
    }

    /// Whether no member sends light to the front of a polygon within this sphere, the first of whose corners is `corner`.
    pub fn cannot_reach(&self, corner: DVec3, normal: DVec3, centre: DVec3, radius: f64) -> bool {
        let size = (self.high - self.low).max_element();
        let foremost = DVec3::select(normal.cmpgt(DVec3::ZERO), self.high, self.low);
        normal.dot(foremost - corner) <= 1e-9 * size || self.largest_cosine(centre, radius) <= 0.0
    }

    /// Whether the members lie far enough from a sphere, compared with their own extent and its, to be alike.
    pub fn is_apart(&self, centre: DVec3, radius: f64) -> bool {
        self.middle().distance(centre) > SEPARATION * (self.radius() + radius)
    }

    /// Estimate, on the safe side, of the irradiance norm on a sphere with this normal that [is apart](Self::is_apart).
    pub fn estimate_w_m2(&self, centre: DVec3, radius: f64, normal: DVec3) -> f64 {
        let between = self.middle() - centre;
        let distance = between.length();
        let both = radius + self.radius();
        let gap = distance - both;
        let cos_x = ((normal.dot(between) + both) / distance).clamp(0.0, 1.0);
        let cos_y = self.largest_cosine(centre, radius).max(0.0);
        self.power_w * cos_x * cos_y / (PI * gap * gap)
    }

    fn middle(&self) -> DVec3 {
        0.5 * (self.low + self.high)
    }

    fn radius(&self) -> f64 {
        0.5 * self.low.distance(self.high)
    }

    /// Bound on the cosine at the emitters, over all members and all points of a sphere.
    fn largest_cosine(&self, centre: DVec3, radius: f64) -> f64 {
        let between = centre - self.middle();
        let (distance, both) = (between.length(), radius + self.radius());
        if distance <= both {
            return 1.0;
        }
        let least = self.axis.angle_between(between) - self.spread - (both / distance).asin();
        least.max(0.0).cos()
    }
}

impl Member {
    fn new<const N: usize>(index: usize, packet: &Packet<N>) -> Self {
        let root = packet.root();
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in root.corners(&packet.frame) {
            (low, high) = (low.min(corner), high.max(corner));
        }
        let normal = packet.frame.normal;
        Self { index, low, high, normal, power_w: packet.strength() * packet.frame.area_m2 }
    }
}

/// Makes the node over the members in `range`, and all below it. Those that differ by rounding alone count as equal, and then their order decides.
fn divide(nodes: &mut Vec<Cluster>, members: &mut [Member], range: Range<usize>) {
    let held = &mut members[range.clone()];
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for member in &*held {
        (low, high) = (low.min(member.low), high.max(member.high));
        (least, most) = (least.min(member.normal), most.max(member.normal));
    }
    let axis = held.iter().map(|member| member.normal).sum::<DVec3>().try_normalize().unwrap_or(DVec3::Z);
    let spread = held.iter().map(|member| axis.angle_between(member.normal)).fold(0.0, f64::max);
    let power_w = held.iter().map(|member| member.power_w).sum();
    let node = nodes.len();
    nodes.push(Cluster { low, high, axis, spread, power_w, members: range.clone(), second: None });
    if held.len() == 1 {
        return;
    }
    let size = (high - low).max_element();
    let told = |v: DVec3| DVec3::from(v.to_array().map(|x| coarse(x) as f64));
    let [extent, turn] = [(high - low) / size, TURN * (most - least)].map(told);
    let (axis, by_normal) = if turn.max_element() > extent.max_element() {
        (turn.max_position(), true)
    } else {
        (extent.max_position(), false)
    };
    let key = |member: &Member| {
        let middle = 0.5 * (member.low[axis] + member.high[axis]) - low[axis];
        (coarse(if by_normal { member.normal[axis] } else { middle / size }), member.index)
    };
    let half = held.len() / 2;
    held.select_nth_unstable_by_key(half, key);
    let half = range.start + half;
    divide(nodes, members, range.start..half);
    nodes[node].second = Some(nodes.len());
    divide(nodes, members, half..range.end);
}

#[cfg(test)]
mod tests {
    use ccnuma::Arena;
    use ccnuma::arena::Backend;

    use super::*;
    use crate::math::Basis;
    use crate::radiosity::{Tree, trees};
    use crate::scene::{read::read_file, surfaces};

    fn packets() -> Vec<Packet<3>> {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/furnished-room.iv");
        let arena = Arena::new(Backend::Malloc);
        let mut trees = trees::<3>(&surfaces(&read_file(&path).unwrap()), Basis::M2, &arena);
        for (i, tree) in trees.iter_mut().enumerate() {
            tree.exitance_w_m2 = [(i % 5) as f64, 1.0, 0.0];
        }
        trees.iter().map(Tree::exitance_packet).collect()
    }

    #[test]
    fn what_a_cluster_states_holds_for_all_its_members() {
        let packets = packets();
        let clusters = Clusters::new(&packets);
        let leaves = (0..clusters.nodes.len()).filter(|node| clusters.below(*node).is_err());
        assert_eq!(leaves.count(), packets.len());
        let (mut apart, mut unreachable) = (0, 0);
        for receiver in packets.iter().step_by(7) {
            let corners: Vec<DVec3> = receiver.root().corners(&receiver.frame).collect();
            let centre = corners.iter().sum::<DVec3>() / corners.len() as f64;
            let radius = corners.iter().map(|c| c.distance(centre)).fold(0.0, f64::max);
            let normal = receiver.frame.normal;
            for cluster in &clusters.nodes {
                let members = || clusters.order[cluster.members.clone()].iter().map(|i| &packets[*i]);
                if cluster.cannot_reach(corners[0], normal, centre, radius) {
                    unreachable += 1;
                    assert!(members().all(|packet| !packet.reaches(normal, &corners)));
                } else if cluster.is_apart(centre, radius) {
                    apart += 1;
                    let bound = cluster.estimate_w_m2(centre, radius, normal);
                    // What the members bring to the centre if nothing stands in between.
                    let brings = |packet: &Packet<3>| {
                        let middle = packet.frame.point(glam::DVec2::splat(0.5));
                        let d = middle - centre;
                        let cosines = normal.dot(d).max(0.0) * (-packet.frame.normal.dot(d)).max(0.0);
                        packet.strength() * packet.frame.area_m2 * cosines / (PI * d.length_squared().powi(2))
                    };
                    assert!(members().map(brings).sum::<f64>() <= bound * 1.001);
                }
            }
        }
        assert!(apart > 100 && unreachable > 100, "{apart} {unreachable}");
    }

    #[test]
    fn draws_stand_for_the_whole_on_average() {
        let packets = packets();
        let clusters = Clusters::new(&packets);
        let value =
            |packet: &Packet<3>| packet.strength() * packet.frame.area_m2 * (1.0 + packet.frame.normal.x);
        let truth: f64 = packets.iter().map(value).sum();
        let rounds = 4000;
        let drawn = (0..rounds).flat_map(|i| clusters.draw(0, 0.01 * f64::from(i) * DVec3::X, 1.0));
        let mean =
            drawn.map(|(packet, times)| times * value(&packets[packet])).sum::<f64>() / f64::from(rounds);
        assert!((mean / truth - 1.0).abs() < 0.01, "{mean} against {truth}");
    }
}
