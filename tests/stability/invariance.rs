//! Items judged by invariance: scale, motion, order of the faces, power.

use std::path::Path;
use std::rc::Rc;

use glam::{DAffine3, DQuat, DVec3};
use wavelet_radiosity::math::Basis;
use wavelet_radiosity::math::chance::mix;
use wavelet_radiosity::scene::{Light, Scene, read};

use crate::Form;
use crate::judge::{Case, Twin, What, run};
use crate::scenes::{irregular, many_lamps};

/// What is demanded between two runs that differ by rounding alone.
const SAME: f64 = 1e-5;

/// A scene with its own solution.
struct Original {
    name: &'static str,
    scene: Scene,
    solution: Rc<wavelet_radiosity::radiosity::Solution>,
    basis: Basis,
    error: f64,
    size_m: f64,
}

impl Original {
    fn new(name: &'static str, scene: &Scene, basis: Basis, error: f64) -> Self {
        let (low, high) = scene.bounds_m().expect("it has faces");
        let solution = Rc::new(run(scene, basis, error).solution);
        Self { name, scene: scene.clone(), solution, basis, error, size_m: (high - low).length() }
    }
}

/// The Cornell box, full of ties, and a room without any.
fn originals(form: Form) -> Vec<Original> {
    let cornell = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box.iv");
    let mut cornell = read::read_file(&cornell).expect("a scene of ours");
    cornell.bands.truncate(1);
    for material in &mut cornell.materials {
        material.reflectance.truncate(1);
        material.exitance_w_m2.truncate(1);
    }
    let settings: &[(Basis, f64)] = match form {
        Form::Short => &[(Basis::M3, 0.1)],
        Form::Long => &[
            (Basis::Haar, 0.1),
            (Basis::M2, 0.03),
            (Basis::M3, 0.1),
            (Basis::M3, 0.03),
            (Basis::M3, 0.01),
            (Basis::Auto, 0.03),
        ],
    };
    let mut all = Vec::new();
    for (basis, error) in settings {
        for (name, scene) in [("cornell box", &cornell), ("irregular room", &irregular())] {
            all.push(Original::new(name, scene, *basis, *error));
        }
    }
    all
}

/// So many lamps that clusters are drawn from.
fn clustered(form: Form) -> Vec<Original> {
    let settings: &[(Basis, f64)] = match form {
        Form::Short => &[(Basis::M3, 0.1)],
        Form::Long => &[(Basis::Haar, 0.1), (Basis::M2, 0.1), (Basis::M3, 0.1), (Basis::Auto, 0.03)],
    };
    let scene = many_lamps();
    let work = run(&scene, Basis::M3, 0.1).statistics.direct;
    assert!(work.clusters > 0, "no cluster is drawn from: {work:?}");
    settings.iter().map(|(basis, error)| Original::new("room of 64 lamps", &scene, *basis, *error)).collect()
}

impl Original {
    /// Moved and scaled; `light` times as bright.
    fn under(&self, item: &'static str, name: String, motion: DAffine3, light: f64) -> Case {
        let mut scene = self.scene.clone();
        for vertex in scene.faces.iter_mut().flat_map(|face| &mut face.vertices) {
            *vertex = motion.transform_point3(*vertex);
        }
        for m in scene.materials.iter_mut().flat_map(|material| &mut material.exitance_w_m2) {
            *m *= light;
        }
        assert!(scene.lights.iter().all(|light| matches!(light, Light::Directional { .. })));
        let motion = Box::new(move |p| motion.transform_point3(p));
        self.case(item, name, scene, Twin { reference: self.solution.clone(), motion, faces: vec![], light })
    }

    /// The faces in an order drawn from `seed`.
    fn reordered(&self, seed: u64) -> Case {
        let mut order: Vec<usize> = (0..self.scene.faces.len()).collect();
        order.sort_by_key(|i| mix(mix(seed, 0), *i as u64));
        let mut scene = self.scene.clone();
        scene.faces = order.iter().map(|i| self.scene.faces[*i].clone()).collect();
        let mut faces = vec![0; order.len()];
        order.iter().enumerate().for_each(|(new, old)| faces[*old] = new as u32);
        let twin = Twin { reference: self.solution.clone(), motion: Box::new(|p| p), faces, light: 1.0 };
        self.case("reordered faces", format!("seed {seed}"), scene, twin)
    }

    fn case(&self, item: &'static str, name: String, scene: Scene, twin: Twin) -> Case {
        let name = format!("{} {name}", self.name);
        Case::new(item, name, scene).solved(self.basis, self.error).demand(What::Same(twin), SAME)
    }
}

pub fn scale(form: Form) -> Vec<Case> {
    let scales: &[f64] = match form {
        Form::Short => &[1e-6, 1e6],
        Form::Long => &[1e-6, 1e-4, 1e-2, 0.5, 1e2, 1e4, 1e6],
    };
    let scaled = |o: &Original, s: f64| {
        o.under("scale", format!("times {s:e}"), DAffine3::from_scale(DVec3::splat(s)), 1.0)
    };
    let originals = originals(form).into_iter().chain(clustered(form));
    originals.flat_map(|o| scales.iter().map(|s| scaled(&o, *s)).collect::<Vec<_>>()).collect()
}

pub fn translation(form: Form) -> Vec<Case> {
    let sizes: &[f64] = match form {
        Form::Short => &[1e6],
        Form::Long => &[1.0, 1e2, 1e4, 1e6],
    };
    let shifted = |o: &Original, by: f64| {
        let shift = by * o.size_m * DVec3::new(0.36, -0.48, 0.8);
        let case = o.under("translation", format!("by {by:e} sizes"), DAffine3::from_translation(shift), 1.0);
        // So far out a corner is off by 1e-10 of the scene, no mere rounding: decisions may differ.
        if by < 1e6 { case } else { case.all_today(1e-3, "corners far out have fewer digits") }
    };
    originals(form).iter().flat_map(|o| sizes.iter().map(|s| shifted(o, *s)).collect::<Vec<_>>()).collect()
}

pub fn rotation(form: Form) -> Vec<Case> {
    let seeds = if form == Form::Short { 2 } else { 8 };
    let rotated = |o: &Original, seed: u32| {
        let angle = f64::from(seed);
        let axis = DVec3::new((1.7 * angle).sin(), (2.3 * angle).cos(), (0.9 * angle).sin() + 0.1);
        let turn = DQuat::from_axis_angle(axis.normalize(), 0.4 + angle);
        o.under("rotation", format!("seed {seed}"), DAffine3::from_quat(turn), 1.0)
    };
    originals(form).iter().flat_map(|o| (1..=seeds).map(|s| rotated(o, s)).collect::<Vec<_>>()).collect()
}

pub fn order(form: Form) -> Vec<Case> {
    let seeds = if form == Form::Short { 2 } else { 8 };
    let originals = originals(form).into_iter().chain(clustered(form));
    originals.flat_map(|o| (1..=seeds).map(|s| o.reordered(s)).collect::<Vec<_>>()).collect()
}

pub fn power(form: Form) -> Vec<Case> {
    let bright = |o: &Original, light: f64| {
        o.under("radiosities over 15 decades", format!("times {light:e}"), DAffine3::IDENTITY, light)
    };
    originals(form).iter().flat_map(|o| [1e-9, 1e6].map(|light| bright(o, light))).collect()
}
