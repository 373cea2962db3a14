//! Items judged against closed forms of single transfers (numerics §8), and the degenerate ones.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};
use wavelet_radiosity::math::Basis;
use wavelet_radiosity::scene::{Light, Scene};

use crate::Form;
use crate::judge::{Case, Truth, What};
use crate::scenes::*;

const BASES: [Basis; 4] = [Basis::Haar, Basis::M2, Basis::M3, Basis::Auto];

/// From a point to a parallel rectangle of a × b at height h above one of its corners.
fn above_corner(a: f64, b: f64, h: f64) -> f64 {
    let half = |a: f64, b: f64| a / a.hypot(h) * (b / a.hypot(h)).atan();
    (half(a, b) + half(b, a)) / TAU
}

/// From a point to a parallel square of side `s` around the z axis at height h: a sum over its corners, signed.
fn below_square(p: DVec3, s: f64, h: f64) -> f64 {
    let corner = |x: f64, y: f64| above_corner(x.abs(), y.abs(), h).copysign(x * y);
    let (l, r) = (-0.5 * s - p.x, 0.5 * s - p.x);
    let (d, u) = (-0.5 * s - p.y, 0.5 * s - p.y);
    corner(r, u) - corner(l, u) - corner(r, d) + corner(l, d)
}

/// From a point to a parallel disc of radius r at height h, `a` off its axis.
fn below_disc(a: f64, r: f64, h: f64) -> f64 {
    let z = a * a + h * h + r * r;
    0.5 * (1.0 - (z - 2.0 * r * r) / (z * z - 4.0 * r * r * a * a).sqrt())
}

/// From a point at distance c of a wall, l before one of its ends, to the part of it on that side, 1 high.
fn beside(l: f64, c: f64) -> f64 {
    ((l / c).atan() - c / 1f64.hypot(c) * (l / 1f64.hypot(c)).atan()) / TAU
}

fn around_origin(side: f64) -> Vec<DVec2> {
    rectangle((-0.5 * side, -0.5 * side), (0.5 * side, 0.5 * side))
}

/// A black square lamp over a square floor, both around the z axis.
fn lamp_over_floor(lamp: f64, floor: f64, height: f64) -> (Scene, Truth) {
    let draft = Draft::default().one([down(&around_origin(lamp), height)], 0.0, 1.0).one(
        [up(&around_origin(floor), 0.0)],
        0.5,
        0.0,
    );
    (draft.0, Box::new(move |s, p| (s.reflectance[0] > 0.0).then(|| below_square(p, lamp, height))))
}

/// The same over a floor of 1 m whose middle is elsewhere.
fn lamp_aside(lamp: f64, height: f64) -> (Scene, Truth) {
    let floor = rectangle((-0.512, -0.4), (0.488, 0.6));
    let (_, truth) = lamp_over_floor(lamp, 1.0, height);
    let draft = Draft::default().one([down(&around_origin(lamp), height)], 0.0, 1.0);
    (draft.one([up(&floor, 0.0)], 0.5, 0.0).0, truth)
}

/// A black panel above a floor whose plane cuts off a corner of it; the truth is summed over 10,000 parts of the panel.
fn panel_by_a_corner(corner: DVec3, along: DVec3, height_m: f64) -> (Scene, Truth) {
    let up_m = DVec3::Z * height_m;
    let panel = vec![corner, corner + along, corner + along + up_m, corner + up_m];
    let (normal, parts) = (along.cross(up_m), 100);
    let draft = Draft::default().one([panel], 0.0, 1.0);
    let truth = move |p: DVec3| {
        let part = |i: usize| {
            let at = |k: usize| (k as f64 + 0.5) / parts as f64;
            let away = p - (corner + at(i % parts) * along + at(i / parts) * up_m);
            let square = away.length_squared();
            normal.dot(away).max(0.0) * (-away.z) / (PI * square * square)
        };
        (0..parts * parts).map(part).sum::<f64>() / (parts * parts) as f64
    };
    let draft = draft.one([up(&square(), 0.0)], 0.5, 0.0);
    (draft.0, Box::new(move |s, p| (s.reflectance[0] > 0.0).then(|| truth(p))))
}

/// A black wall on the edge of a floor.
fn wall_on_floor() -> (Scene, Truth) {
    let wall = walls(&square(), 0.0, 1.0)[0].clone();
    let draft = Draft::default().one([wall], 0.0, 1.0).one([up(&square(), 0.0)], 0.5, 0.0);
    (draft.0, Box::new(|s, p| (s.reflectance[0] > 0.0).then(|| beside(p.x, p.y) + beside(1.0 - p.x, p.y))))
}

fn held(
    item: &'static str,
    name: impl Into<String>,
    (scene, truth): (Scene, Truth),
    basis: Basis,
    error: f64,
) -> Case {
    Case::new(item, name, scene).solved(basis, error).demand(What::Truth(truth), error)
}

pub fn areas_apart(form: Form) -> Vec<Case> {
    let item = "emitters 1e-8 of the receiver's area and the reverse";
    let settings: &[(Basis, f64)] = match form {
        Form::Short => &[(Basis::M3, 0.03)],
        Form::Long => &[(Basis::Haar, 0.1), (Basis::M2, 0.03), (Basis::M3, 0.03), (Basis::M3, 0.003)],
    };
    let pairs = [
        ("small lamp", 1e-4, 1.0, 1.0),
        ("small lamp close by", 1e-4, 1.0, 1e-3),
        ("small receiver", 1.0, 1e-4, 1.0),
        ("small receiver close by", 1.0, 1e-4, 1e-3),
    ];
    let of = |(basis, error): &(Basis, f64)| {
        let held = |(name, lamp, floor, height): &(&str, f64, f64, f64)| {
            held(item, *name, lamp_over_floor(*lamp, *floor, *height), *basis, *error)
        };
        pairs.iter().map(held).collect::<Vec<_>>()
    };
    settings.iter().flat_map(of).collect()
}

pub fn disc(_: Form) -> Vec<Case> {
    // As large as the disc of radius 0.5.
    let corners = 2000;
    let radius = 0.5 * (TAU / corners as f64 / (TAU / corners as f64).sin()).sqrt();
    let lamp = down(&star(corners, &[radius]), 0.5);
    let draft = Draft::default().one([lamp], 0.0, 1.0).one([up(&around_origin(1.0), 0.0)], 0.5, 0.0);
    let truth: Truth =
        Box::new(|s, p| (s.reflectance[0] > 0.0).then(|| below_disc(p.truncate().length(), 0.5, 0.5)));
    vec![held("polygons", "lamp of 2000 corners", (draft.0, truth), Basis::M3, 0.03)]
}

/// Every basis at every error, on a smooth transfer, a singular one, and a furnace.
pub fn sweep(form: Form) -> Vec<Case> {
    let item = "every basis and error";
    let mut cases = Vec::new();
    for basis in BASES {
        let errors: &[f64] = match (form, basis) {
            (Form::Short, Basis::Haar) => &[0.1, 0.01],
            (Form::Short, _) => &[0.1, 0.01, 1e-3],
            (Form::Long, Basis::Haar) => &[0.1, 0.03, 0.01, 3e-3],
            (Form::Long, _) => &[0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4],
        };
        for error in errors {
            cases.push(held(item, "opposed squares", lamp_over_floor(1.0, 1.0, 1.0), basis, *error));
            cases.push(held(item, "shared edge", wall_on_floor(), basis, *error));
            // What the furnace takes minutes for is left out.
            let least = match (form, basis) {
                (Form::Short, Basis::Haar) => 0.1,
                (Form::Long, Basis::Haar) => 0.01,
                (Form::Short, Basis::M2) => 0.01,
                (Form::Long, Basis::M2) => 3e-4,
                _ => 0.0,
            };
            if *error >= least {
                let cube = furnace(room(&square(), 0.0, 1.0), 0.5).0;
                cases.push(held(item, "furnace", (cube, Box::new(|_, _| Some(2.0))), basis, *error));
            }
        }
    }
    cases
}

pub fn decades(_: Form) -> Vec<Case> {
    let item = "radiosities over 15 decades";
    let beside =
        |m: f64| moved(room(&square(), 0.0, 1.0), move |p| p + DVec3::X * if m < 1.0 { 3.0 } else { 0.0 });
    let faint = 1e-15;
    let two = Draft::default().one(beside(1.0), 0.5, 1.0).one(beside(faint), 0.5, faint);
    let truth: Truth = Box::new(move |s, _| Some(2.0 * s.exitance_w_m2[0]));
    let alone: Truth = Box::new(move |s, _| (s.exitance_w_m2[0] < 1.0).then_some(2.0 * faint));
    let cube = room(&square(), 0.0, 1.0).into_iter().enumerate();
    let six =
        cube.fold(Draft::default(), |draft, (i, face)| draft.one([face], 0.7, 1000f64.powi(-(i as i32))));
    vec![
        held(item, "two furnaces", (two.0.clone(), truth), Basis::M3, 0.03),
        // The error is one of the whole scene: the faint furnace alone may be anything up to that.
        Case::new(item, "the faint one of two furnaces", two.0).demand(What::Truth(alone), 1.0),
        Case::new(item, "six faces of a room", six.0).demand(What::Balance, 1e-4).demand(What::Lost, 0.03),
    ]
}

pub fn degenerate(_: Form) -> Vec<Case> {
    let item = "zero light and one surface";
    let room = room(&square(), 0.0, 1.0);
    let pillar = solid(&square(), 0.0, 1.0);
    vec![
        Case::new(item, "no face", Draft::default().one([], 0.5, 1.0).0).demand(What::Dark, 0.0),
        Case::new(item, "no light", Draft::default().one(room, 0.5, 0.0).0).demand(What::Dark, 0.0),
        Case::new(item, "one surface", furnace([up(&square(), 0.0)], 0.5).0).demand(What::Dark, 0.0),
        Case::new(item, "surfaces that do not see each other", furnace(pillar, 0.5).0)
            .demand(What::Dark, 0.0),
        Case::new(
            item,
            "faces without area",
            furnace([vec![DVec3::ZERO; 4], vec![DVec3::ZERO, DVec3::X]], 0.5).0,
        )
        .demand(What::Dark, 0.0),
    ]
}

/// Refinement ends: at cells of 2⁻²⁰ of a surface, or long before.
pub fn deep(form: Form) -> Vec<Case> {
    let item = "deep refinement";
    let (scene, truth) = wall_on_floor();
    let error = if form == Form::Short { 1e-3 } else { 1e-4 };
    let mut cases = vec![
        Case::new(item, "shared edge", scene)
            .solved(Basis::M3, error)
            .demand(What::Truth(truth), error)
            .demand(What::Elements, 1e5),
    ];
    // All of the lamp's power falls on the floor, about as far around its foot as it is high.
    let heights: &[f64] = if form == Form::Short { &[1e-2, 1e-4] } else { &[1e-2, 1e-3, 1e-4, 1e-5, 1e-6] };
    for h in heights {
        let (scene, _) = lamp_over_floor(*h, 1.0, *h);
        let lamp = Case::new(item, format!("lamp of {h:e} m at {h:e} m over the floor"), scene)
            .solved(Basis::M3, 0.1)
            .demand(What::Received(h * h), 0.1);
        cases.push(lamp.demand(What::Elements, 1e5));
    }
    // All of the light falls on a spot that no sample point meets; where elements cannot become as small, that is told.
    for (lamp, h) in [(0.04, 8e-4), (1e-4, 1e-3), (1e-4, 1e-5), (1e-6, 1e-6)] {
        let (scene, truth) = lamp_aside(lamp, h);
        let small = Case::new(item, format!("lamp of {lamp:e} m at {h:e} m aside"), scene);
        cases.push(small.demand(What::Truth(truth), 0.03).demand(What::Elements, 1e3));
    }
    // Panels whose planes cut the floor light no more than one of its corners.
    let panels = [
        ("panel by a corner", DVec3::new(-0.031, 0.1265, 0.004), DVec3::new(0.021, -0.0125, 0.0), 0.024),
        ("corner before a panel", DVec3::new(-2.365, 0.56, 0.088), DVec3::new(2.76, -0.614, 0.0), 3.3),
    ];
    for (name, corner, along, height_m) in panels {
        let (scene, truth) = panel_by_a_corner(corner, along, height_m);
        cases.push(Case::new(item, name, scene).demand(What::Truth(truth), 0.03));
    }
    for h in [1e-7, 1e-8] {
        let (scene, _) = lamp_aside(h, h);
        let least = Case::new(item, format!("lamp of {h:e} m at {h:e} m aside"), scene);
        cases.push(least.demand(What::Stated(h * h), 1.0).demand(What::Elements, 1e3));
    }
    cases
}

/// Lights without area where they should not be.
pub fn lamps(_: Form) -> Vec<Case> {
    let item = "lights without area";
    let room = room(&square(), 0.0, 1.0);
    let lit = |rho: f64, at: DVec3| Draft::default().one(room.clone(), rho, 0.0).lamp(at, 1.0).0;
    let places = [
        ("1e-3 from a wall", DVec3::new(1e-3, 0.4, 0.6)),
        ("1e-9 from a wall", DVec3::new(1e-9, 0.4, 0.6)),
        ("in a wall", DVec3::new(0.0, 0.4, 0.6)),
        ("in a corner", DVec3::ZERO),
        ("outside", DVec3::new(0.5, 0.5, 2.0)),
    ];
    let mut cases: Vec<Case> = places
        .into_iter()
        .map(|(name, at)| Case::new(item, name, lit(0.5, at)).solved(Basis::M3, 0.1))
        .collect();
    let middle = Case::new(item, "in the middle", lit(0.5, DVec3::splat(0.5)));
    cases.push(middle.demand(What::Received(8.0 * PI), 0.03));
    let mut grazing = furnace([up(&square(), 0.0)], 0.5).0;
    grazing.lights.push(Light::Directional { direction: DVec3::X, irradiance_w_m2: vec![1.0] });
    cases.push(Case::new(item, "along the floor", grazing).demand(What::Dark, 1e-12));
    cases
}
