//! Rules that skip pairs or take them coarsely, on and off, as a solved scene's light is gathered once more from all of
//! its surfaces.

use ccnuma::Arena;
use ccnuma::arena::Backend;
use glam::{DVec2, DVec3};
use wavelet_radiosity::math::Basis;
use wavelet_radiosity::radiosity::{Field, Solution, Tree, field_packet, trees};
use wavelet_radiosity::scene::{Scene, Surface};
use wavelet_radiosity::transport::candidates::Candidates;
use wavelet_radiosity::transport::gather::Tolerance;
use wavelet_radiosity::transport::{
    Alone, Clusters, Oracle, Packet, Points, Rules, SampleRules, Scratch, Source, Task, Work,
};
use wavelet_radiosity::visibility::{Bvh, Occluder};

use super::distance::{apart, irradiance};
use super::{ERROR, bvh, many, read, run};

/// What a receiver is told of a source.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Told {
    /// As it is.
    All,
    /// That it may be in front, wherever it is: no pair is told to be behind.
    InFront,
    /// That it may bring any light: no pair is too small to be resolved.
    Bright,
}

/// A packet, and what is told of it.
struct Teller<'a> {
    packet: &'a Packet<3>,
    told: Told,
}

impl Source<3> for Teller<'_> {
    fn surface(&self) -> u32 {
        Source::surface(self.packet)
    }

    fn face(&self) -> u32 {
        Source::face(self.packet)
    }

    fn hull(&self, receiver: &[DVec3]) -> ([DVec3; 4], Option<DVec3>) {
        self.packet.hull(receiver)
    }

    fn reaches(&self, normal: DVec3, corners: &[DVec3]) -> bool {
        self.told == Told::InFront || self.packet.reaches(normal, corners)
    }

    fn estimate_w_m2(&self, centre: DVec3, radius: f64, normal: DVec3) -> f64 {
        if self.told == Told::Bright {
            return f64::INFINITY;
        }
        self.packet.estimate_w_m2(centre, radius, normal)
    }

    fn place(&self) -> Option<(DVec3, f64)> {
        self.packet.place()
    }

    fn nearest(&self, point: DVec3) -> Option<DVec3> {
        self.packet.nearest(point)
    }

    fn strength(&self) -> f64 {
        self.packet.strength()
    }

    fn gather(
        &self,
        points: &Points<'_>,
        occluder: &dyn Occluder,
        candidates: Candidates,
        tolerance: Tolerance,
        irradiance: &mut [[f64; 3]],
        uncertain: &mut [f64],
        scratch: &mut Scratch,
    ) {
        self.packet.gather(points, occluder, candidates, tolerance, irradiance, uncertain, scratch);
    }
}

/// A solved scene, and what all of its surfaces send.
struct Lit {
    solution: Solution,
    occluder: Bvh,
    packets: Vec<Packet<3>>,
    /// Such that what is gathered errs by the error.
    rules: Rules,
}

/// What was gathered once.
struct Gathered {
    fields: Vec<Field>,
    norm_w_m: f64,
    error_w_m: f64,
    work: Work,
}

impl Lit {
    fn new(scene: &Scene) -> Self {
        let occluder = bvh(scene);
        let solution = run(scene, &occluder, false).solution;
        let rules = Rules {
            oracle: Oracle::Energy,
            threshold_w_m: f64::INFINITY,
            reference_w_m2: 1.0,
            least_reflectance: 0.5,
            point_w_m2: f64::INFINITY,
            samples: SampleRules::new(Basis::M2),
        };
        let packets = sent(&solution, true);
        let mut lit = Self { solution, occluder, packets, rules };
        lit.rules.threshold_w_m = 0.1 * ERROR * lit.gather(Told::All, true).norm_w_m;
        let errs = |found: &Gathered| found.error_w_m > ERROR * found.norm_w_m;
        while errs(&lit.gather(Told::All, true)) {
            lit.rules.threshold_w_m *= 0.5;
        }
        lit
    }

    fn surfaces(&self) -> (&Scene, &[Surface]) {
        (&self.solution.scene, &self.solution.surfaces)
    }

    fn gather(&self, told: Told, clustered: bool) -> Gathered {
        let arena = Arena::new(Backend::Malloc);
        let mut lit = trees::<3>(&self.solution.surfaces, Basis::M2, &arena);
        let sources: Vec<Teller<'_>> = self.packets.iter().map(|packet| Teller { packet, told }).collect();
        let clusters = Clusters::of(&self.packets, &self.rules).filter(|_| clustered);
        let (mut scratch, mut error_squared) = (Scratch::default(), 0.0);
        for tree in &mut lit {
            let patch = &tree.patch;
            let task = Task { patch, occluder: &self.occluder, rules: &self.rules, go_on: &|| true };
            let all = (&sources[..], clusters.as_ref());
            error_squared += task.shoot(all, &mut tree.root, &mut scratch, &Alone(&arena)).error_squared;
        }
        let norm_squared: f64 = lit.iter().map(Tree::reflected_norm_squared).sum();
        Gathered {
            fields: lit.iter().map(Tree::field).collect(),
            norm_w_m: norm_squared.sqrt(),
            error_w_m: error_squared.sqrt(),
            work: scratch.work,
        }
    }

    /// Shoots pairs that lie behind each other, each alone and told to be in front: how many, and what was done.
    fn shoot_behind(&self) -> (u64, Work) {
        let arena = Arena::new(Backend::Malloc);
        let mut dark = trees::<3>(&self.solution.surfaces, Basis::M2, &arena);
        let (mut scratch, mut pairs) = (Scratch::default(), 0);
        for tree in &mut dark {
            let patch = &tree.patch;
            let task = Task { patch, occluder: &self.occluder, rules: &self.rules, go_on: &|| true };
            let others = self.packets.iter().filter(|p| p.surface != patch.surface && p.face != patch.face);
            for packet in others.filter(|packet| !packet.reaches(patch.frame.normal, &patch.corners)) {
                let source = Teller { packet, told: Told::InFront };
                let alone = (std::slice::from_ref(&source), None);
                let found = task.shoot(alone, &mut tree.root, &mut scratch, &Alone(&arena));
                assert_eq!((found.received_w, found.to_reflect_w), ([0.0; 3], 0.0));
                pairs += 1;
            }
        }
        (pairs, scratch.work)
    }

    /// How far apart two gatherings are.
    fn apart(&self, a: &Gathered, b: &Gathered) -> f64 {
        apart(self.surfaces(), irradiance(&a.fields), irradiance(&b.fields))
    }
}

/// What the surfaces of a solution reflect, and emit if that is wanted.
fn sent(solution: &Solution, emitted: bool) -> Vec<Packet<3>> {
    let packet = |(index, field): (usize, &Field)| {
        let surface = &solution.surfaces[index];
        field_packet(index, surface, field, |function, band, light| {
            let exitance = if emitted && function == 0 { surface.exitance_w_m2[band] } else { 0.0 };
            surface.reflectance[band] * light + exitance
        })
    };
    solution.fields.iter().enumerate().map(packet).collect()
}

/// The scenes in `scenes/`.
fn scenes() -> impl Iterator<Item = (&'static str, Scene)> {
    ["cornell-box", "furnished-room", "l-gallery"].into_iter().map(|name| (name, read(name)))
}

/// Sources that come together see each other's elements, and are judged a few at a time, so that those behind change what
/// others refine.
#[test]
fn pairs_behind_each_other_exchange_nothing() {
    for (name, scene) in scenes() {
        let lit = Lit::new(&scene);
        let (pairs, alone) = lit.shoot_behind();
        let (with, without) = (lit.gather(Told::All, false), lit.gather(Told::InFront, false));
        let apart = lit.apart(&with, &without);
        let interactions = [with.work.interactions, without.work.interactions];
        println!(
            "{name}: {apart:.1e} apart; {pairs} pairs, {} evaluations alone; interactions {interactions:?}",
            alone.cost()
        );
        assert!(apart <= 0.5 * ERROR, "{name}: {apart}");
        assert_eq!((with.work.pairs_behind, without.work.pairs_behind), (pairs, 0), "{name}");
        assert!(pairs > 100 && alone.cost() > pairs, "{name}: {alone:?}");
        assert_eq!(alone.interactions + alone.pairs_hidden, pairs, "{name}: {alone:?}");
        assert!(interactions[0] < interactions[1], "{name}: {interactions:?}");
    }
}

/// Where nearly all pairs are small, what these lose is nearly all of the error.
#[test]
fn one_sample_of_small_pairs_changes_no_more_than_they_may_lose() {
    let scenes = scenes().map(|(name, scene)| (name, scene, 0.5, 1.03));
    for (name, scene, share, times) in scenes.chain([("many", many(), 1.0, 2.5)]) {
        let lit = Lit::new(&scene);
        let (with, without) = (lit.gather(Told::All, false), lit.gather(Told::Bright, false));
        let apart = lit.apart(&with, &without);
        let cost = without.work.cost() as f64 / with.work.cost() as f64;
        let coarse = with.work.pairs_coarse;
        println!("{name}: {apart:.1e} apart, {cost:.2} times the cost without; {coarse} pairs coarse");
        assert!(apart <= share * ERROR, "{name}: {apart}");
        assert!(cost > times && coarse > 0, "{name}: {cost}");
        assert_eq!(without.work.pairs_coarse, 0, "{name}");
    }
}

#[test]
fn clusters_of_emitters_gather_the_same_light() {
    for (name, scene, fewer) in [("furnished-room", read("furnished-room"), 1.1), ("many", many(), 1.8)] {
        let lit = Lit::new(&scene);
        let (with, without) = (lit.gather(Told::All, true), lit.gather(Told::All, false));
        let apart = lit.apart(&with, &without);
        let times = without.work.interactions as f64 / with.work.interactions as f64;
        let clustered = with.work.pairs_clustered;
        println!(
            "{name}: {apart:.1e} apart, {times:.2} times the interactions without; {clustered} clustered"
        );
        assert!(apart <= 0.5 * ERROR, "{name}: {apart}");
        assert!(times > fewer && clustered > 0, "{name}: {times}");
        assert!(with.work.cost() < without.work.cost() && without.work.pairs_clustered == 0, "{name}");
    }
}

/// Two solutions are compared here, each of which may err by the error.
#[test]
fn direct_light_alone_is_all_light_less_what_is_reflected() {
    for (name, scene) in scenes() {
        let mut lit = Lit::new(&scene);
        lit.packets = sent(&lit.solution, false);
        lit.rules.threshold_w_m *= 0.2;
        let reflected = lit.gather(Told::All, true);
        let direct = run(&scene, &lit.occluder, true);
        let whole = irradiance(&lit.solution.fields);
        let (one, other) = (irradiance(&direct.solution.fields), irradiance(&reflected.fields));
        let both = |index: usize, uv: DVec2, light: &mut [f64]| {
            let mut more = vec![0.0; light.len()];
            one(index, uv, light);
            other(index, uv, &mut more);
            light.iter_mut().zip(more).for_each(|(light, more)| *light += more);
        };
        let (apart, spared) =
            (apart(lit.surfaces(), both, &whole), super::distance::apart(lit.surfaces(), &one, &whole));
        println!("{name}: {apart:.1e} apart, {spared:.2} without reflected light");
        assert!(apart <= ERROR, "{name}: {apart}");
        assert!(spared > 0.3, "{name}: {spared}");
        assert_eq!(direct.statistics.interreflection, Work::default());
    }
}
