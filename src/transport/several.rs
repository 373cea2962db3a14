//! The sources of a receiver, sorted: clusters of those that together matter little, single ones that matter little, and those to resolve.

use super::cluster::{Clusters, DRAWS};
use super::gather::{Points, Tolerance, norm};
use super::packet::{Packet, Shape};
use super::pair::{COARSE, Scratch, Task};
use super::receiver::Unresolved;
use super::share::Helpers;
use super::source::Source;
use super::{Oracle, Rules};
use crate::math::polygon;
use glam::{DVec2, DVec3};

/// Pairs that carry less than this share of the threshold are taken by one sample.
const COARSE_SHARE: f64 = 0.5;

/// What a cluster may bring, as a share of what a pair may bring that is taken by one sample: pairs of a few draws err more.
const CLUSTER_SHARE: f64 = 1.0;

/// Nodes over more packets than this are sorted by several if there are helpers.
const SHARED: usize = 64;

impl Clusters {
    /// Clusters pay from this many packets.
    pub const LEAST_PACKETS: usize = 16;

    /// The clusters of packets of which there are enough. Only the energy oracle knows what may be left out.
    pub fn of<const N: usize>(packets: &[Packet<N>], rules: &Rules) -> Option<Self> {
        let pays = rules.oracle == Oracle::Energy && packets.len() >= Self::LEAST_PACKETS;
        pays.then(|| Self::new(packets))
    }
}

/// Sources, sorted.
pub(super) struct Sorted<const N: usize> {
    /// Mean irradiance on the whole receiver of those that matter little, in W/m².
    pub light_w_m2: [f64; N],
    /// Sum of their squared link errors in W²/m².
    pub error_squared: f64,
    /// The same by how they were taken.
    pub unresolved: Unresolved,
    /// Cost of the longest chain of parts that wait for each other.
    pub span: u64,
    /// The others, by index, in order.
    pub resolved: Vec<usize>,
}

impl<const N: usize> Default for Sorted<N> {
    fn default() -> Self {
        let unresolved = Unresolved::default();
        Self { light_w_m2: [0.0; N], error_squared: 0.0, unresolved, span: 0, resolved: Vec::new() }
    }
}

impl<const N: usize> Sorted<N> {
    fn and(mut self, other: Self) -> Self {
        for n in 0..N {
            self.light_w_m2[n] += other.light_w_m2[n];
        }
        self.error_squared += other.error_squared;
        self.unresolved += other.unresolved;
        self.span += other.span;
        self.resolved.extend(other.resolved);
        self
    }
}

/// Sorts `sources` for a receiver of this shape and area, and takes those that matter little.
pub(super) fn sort<const N: usize, S: Source<N>>(
    task: Task<'_, N>,
    (sources, clusters): (&[S], Option<&Clusters>),
    (shape, area_m2): (Shape<&[DVec2]>, f64),
    scratch: &mut Scratch,
    helpers: &dyn Helpers,
) -> Sorted<N> {
    let (centre, radius) = task.patch.sphere();
    let middle = task.patch.frame.point(middle_of(shape));
    let sorting = Sorting { task, sources, area_m2, weight: task.weight(), centre, radius, middle };
    match clusters {
        None => (0..sources.len())
            .take_while(|_| (task.go_on)())
            .fold(Sorted::default(), |sorted, index| sorted.and(sorting.single(index, scratch))),
        Some(clusters) => {
            let node = |root| sorting.node(clusters, root, scratch, helpers);
            let mut sorted = clusters.root().map(node).unwrap_or_default();
            sorted.resolved.sort_unstable();
            sorted
        }
    }
}

/// What the sorting of a receiver's sources has in common.
#[derive(Clone, Copy)]
struct Sorting<'a, const N: usize, S> {
    task: Task<'a, N>,
    sources: &'a [S],
    area_m2: f64,
    weight: f64,
    /// A sphere around the receiver.
    centre: DVec3,
    radius: f64,
    /// The point that stands for it.
    middle: DVec3,
}

impl<const N: usize, S: Source<N>> Sorting<'_, N, S> {
    /// Sorts what is below a node. What it brings is summed node by node, so that it is the same whoever did it.
    fn node(
        &self,
        clusters: &Clusters,
        node: usize,
        scratch: &mut Scratch,
        helpers: &dyn Helpers,
    ) -> Sorted<N> {
        if !(self.task.go_on)() {
            return Sorted::default();
        }
        let (cluster, normal) = (clusters.node(node), self.task.patch.frame.normal);
        if cluster.cannot_reach(self.task.patch.corners[0], normal, self.centre, self.radius) {
            scratch.work.pairs_behind += cluster.len() as u64;
            return Sorted::default();
        }
        let [first, second] = match clusters.below(node) {
            Err(index) => return self.single(index, scratch),
            Ok(below) => below,
        };
        let allowed_w_m = CLUSTER_SHARE * COARSE_SHARE * self.task.rules.threshold_w_m;
        if cluster.len() > DRAWS
            && cluster.is_apart(self.centre, self.radius)
            && self.weight * self.area_m2.sqrt() * cluster.estimate_w_m2(self.centre, self.radius, normal)
                <= allowed_w_m
        {
            return self.draw(clusters, node, scratch);
        }
        if cluster.len() <= SHARED {
            let sorted = self.node(clusters, first, scratch, helpers);
            return sorted.and(self.node(clusters, second, scratch, helpers));
        }
        let (mut one, mut other) = (Sorted::default(), Sorted::default());
        let mut sort_one =
            |helpers: &dyn Helpers, scratch: &mut Scratch| one = self.node(clusters, first, scratch, helpers);
        let mut sort_other = |helpers: &dyn Helpers, scratch: &mut Scratch| {
            other = self.node(clusters, second, scratch, helpers)
        };
        if helpers.wanted() {
            helpers.both(scratch, &mut sort_one, &mut sort_other);
        } else {
            sort_one(helpers, scratch);
            sort_other(helpers, scratch);
        }
        let span = one.span.max(other.span);
        Sorted { span, ..one.and(other) }
    }

    /// Takes a source by one sample if it matters little; it is to be resolved if not.
    fn single(&self, index: usize, scratch: &mut Scratch) -> Sorted<N> {
        let (source, patch, rules) = (&self.sources[index], self.task.patch, self.task.rules);
        let mut sorted = Sorted::default();
        if source.surface() == patch.surface || source.face() == patch.face {
            return sorted;
        }
        if !source.reaches(patch.frame.normal, &patch.corners) {
            scratch.work.pairs_behind += 1;
            return sorted;
        }
        let estimate_w_m2 = source.estimate_w_m2(self.centre, self.radius, patch.frame.normal);
        let carried_w_m = self.weight * estimate_w_m2 * self.area_m2.sqrt();
        if carried_w_m > COARSE_SHARE * rules.threshold(source) || matches!(rules.oracle, Oracle::Uniform(_))
        {
            sorted.resolved.push(index);
            scratch.work.pairs_resolved += 1;
            return sorted;
        }
        let (before, rays) = (scratch.work.cost(), scratch.work.visibility_rays);
        sorted.light_w_m2 = self.sample(source, 0.5 * estimate_w_m2, scratch);
        sorted.span = scratch.work.cost() - before;
        self.count(rays, scratch);
        scratch.work.pairs_coarse += 1;
        scratch.work.coarse_cost += sorted.span;
        sorted.error_squared = self.missed_squared(&sorted.light_w_m2);
        sorted.unresolved.coarse = sorted.error_squared;
        sorted
    }

    /// Takes a cluster by a few of its members.
    fn draw(&self, clusters: &Clusters, node: usize, scratch: &mut Scratch) -> Sorted<N> {
        let (patch, before, rays) = (self.task.patch, scratch.work.cost(), scratch.work.visibility_rays);
        let mut drawn = [[0.0; N]; DRAWS];
        for ((index, times), light) in
            clusters.draw(node, self.centre, self.radius).into_iter().zip(&mut drawn)
        {
            let source = &self.sources[index];
            if source.reaches(patch.frame.normal, &[self.middle]) {
                let estimate_w_m2 = source.estimate_w_m2(self.middle, 0.0, patch.frame.normal);
                *light = self.sample(source, 0.5 * estimate_w_m2, scratch).map(|e| e * times);
            }
        }
        let span = scratch.work.cost() - before;
        self.count(rays, scratch);
        scratch.work.clusters += 1;
        scratch.work.clusters_cost += span;
        scratch.work.pairs_clustered += clusters.node(node).len() as u64;
        let light_w_m2 = std::array::from_fn(|n| drawn.iter().map(|light| light[n]).sum());
        // The variance of a sum of draws, and what a constant misses on the receiver, as for one pair.
        let draws = DRAWS as f64;
        let mean = light_w_m2.map(|e: f64| e / draws);
        let square = |light: &[f64; N]| -> f64 { (0..N).map(|n| (light[n] - mean[n]).powi(2)).sum() };
        let variance = draws / (draws - 1.0) * drawn.iter().map(square).sum::<f64>();
        let error_squared = self.area_m2 * self.weight.powi(2) * variance + self.missed_squared(&light_w_m2);
        let unresolved = Unresolved { clusters: error_squared, ..Unresolved::default() };
        Sorted { light_w_m2, error_squared, unresolved, span, resolved: Vec::new() }
    }

    /// Counts a transfer; so many rays had been cast before it.
    fn count(&self, rays: u64, scratch: &mut Scratch) {
        scratch.work.interactions += 1;
        scratch.work.interactions_without_rays += u64::from(scratch.work.visibility_rays == rays);
    }

    /// The irradiance at the point that stands for the receiver.
    fn sample(&self, source: &S, absolute_w_m2: f64, scratch: &mut Scratch) -> [f64; N] {
        let patch = self.task.patch;
        let point = [self.middle];
        let points = Points {
            position: &point,
            eye: &point,
            normal: patch.frame.normal,
            face: patch.face,
            hull: &point,
        };
        let tolerance = Tolerance { relative: COARSE, absolute_w_m2 };
        let mut light = [[0.0; N]];
        let (occluder, candidates) = (self.task.occluder, self.task.candidates());
        source.gather(&points, occluder, candidates, tolerance, &mut light, &mut [0.0], scratch);
        light[0]
    }

    /// What a constant may miss of such light on the receiver: squared link error in W²/m².
    fn missed_squared(&self, light_w_m2: &[f64; N]) -> f64 {
        0.1 * (self.weight * norm(light_w_m2)).powi(2) * self.area_m2
    }
}

/// A point of the surface that stands for it: the middle of the parallelogram, or of an outline the mean of its corners, or where that lies
/// outside, a point inside near to it.
fn middle_of(shape: Shape<&[DVec2]>) -> DVec2 {
    let Shape::Part(outline, _) = shape else { return DVec2::splat(0.5) };
    let mean = outline.iter().sum::<DVec2>() / outline.len() as f64;
    if polygon::contains(outline, mean) {
        mean
    } else {
        polygon::nearest_inside(outline, mean, |d| d.length_squared())
    }
}

#[cfg(test)]
mod tests {
    use ccnuma::Arena;
    use ccnuma::arena::Backend;

    use std::slice::from_ref;

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
            let mut lit = grow();
            // The floor, the shelf, and some of the little ones.
            for index in [400, 401, 0, 1, 2, 199] {
                let mut scratch = Scratch::default();
                let tree = &mut lit[index];
                let task = Task { patch: &tree.patch, occluder: &bvh, rules: &rules, go_on: &|| true };
                let all = (&*packets, clusters.as_ref());
                let found = task.shoot(all, &mut tree.root, &mut scratch, &alone);
                skipped += scratch.work.pairs_clustered;
                let fine = Rules { threshold_w_m: 1e-5, ..rules.clone() };
                let mut truth = 0.0;
                for packet in &packets {
                    let task = Task { rules: &fine, ..task };
                    let one = task.shoot((from_ref(packet), None), &mut tree.root, &mut scratch, &alone);
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
