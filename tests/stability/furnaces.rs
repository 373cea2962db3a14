//! Items judged in furnaces: every face of a closed scene emits 1 W/m² and reflects ρ, so `B = 1/(1 − ρ)` whatever the geometry.

use glam::{DQuat, DVec2, DVec3};
use wavelet_radiosity::scene::Sides;

use crate::Form;
use crate::judge::{Case, What};
use crate::scenes::*;

/// Reflectance where a case asks for no other.
const RHO: f64 = 0.6;

/// A furnace held to its truth and its balance.
fn held(item: &'static str, name: impl Into<String>, draft: Draft) -> Case {
    held_where(item, name, draft, |_| true)
}

/// A furnace held to its truth where `lit`.
fn held_where(
    item: &'static str,
    name: impl Into<String>,
    draft: Draft,
    lit: impl Fn(DVec3) -> bool + 'static,
) -> Case {
    let rho = draft.0.materials[0].reflectance[0];
    let case = Case::new(item, name, draft.0);
    let error = case.error;
    case.demand(What::Truth(Box::new(move |_, p| lit(p).then_some(1.0 / (1.0 - rho)))), error)
}

fn closed(item: &'static str, name: impl Into<String>, draft: Draft) -> Case {
    let case = held(item, name, draft);
    let error = case.error;
    case.demand(What::Balance, 1e-4).demand(What::Lost, error)
}

fn cube() -> Vec<Polygon> {
    room(&square(), 0.0, 1.0)
}

/// A cube of `size` that floats where nothing is symmetric.
fn floating(size: f64, at: DVec3) -> Vec<Polygon> {
    let tilt = DQuat::from_axis_angle(DVec3::new(0.3, 0.8, 0.5).normalize(), 0.9);
    let half = 0.5 * size;
    moved(solid(&rectangle((-half, -half), (half, half)), -half, half), move |p| tilt * p + at)
}

pub fn slivers(form: Form) -> Vec<Case> {
    let aspects: &[f64] = match form {
        Form::Short => &[1e3, 1e6],
        Form::Long => &[1e1, 1e2, 1e3, 1e4, 1e5, 1e6],
    };
    let item = "slivers";
    let mut cases = Vec::new();
    for aspect in aspects {
        let thin = 1.0 / aspect;
        let slit = room(&rectangle((0.0, 0.0), (1.0, thin)), 0.0, 1.0);
        cases.push(closed(item, format!("slit {aspect:e}"), furnace(slit, RHO)));
        let rod = room(&rectangle((0.0, 0.0), (thin, thin)), 0.0, 1.0);
        cases.push(closed(item, format!("rod {aspect:e}"), furnace(rod, RHO)));
        // The floor in two triangles and slivers between them.
        let mut faces = cube();
        let corner = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let fan = [1.0, 1.0 - thin, 1.0 - 2.0 * thin, 1.0 - 3.0 * thin];
        faces[0] = vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, fan[3])];
        faces.extend(fan.windows(2).map(|y| vec![corner(0.0, 0.0), corner(1.0, y[1]), corner(1.0, y[0])]));
        faces.push(vec![corner(0.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)]);
        cases.push(closed(item, format!("fan {aspect:e}"), furnace(faces, RHO)));
    }
    cases
}

pub fn areas(_: Form) -> Vec<Case> {
    let spots = [(0.3, 0.4, 0.6), (0.72, 0.31, 0.4), (0.5, 0.77, 0.52), (0.21, 0.68, 0.31)];
    let cubes = [0.2, 1e-2, 1e-4, 1e-6].into_iter().zip(spots.map(DVec3::from));
    let faces = cube().into_iter().chain(cubes.flat_map(|(size, at)| floating(size, at)));
    vec![closed("areas over 12 decades", "cubes of 1 m to 1 µm", furnace(faces, RHO))]
}

pub fn near_coplanar(form: Form) -> Vec<Case> {
    let gaps: &[f64] = match form {
        Form::Short => &[1e-9, 1e-6, 1e-4, 1e-2],
        Form::Long => &[1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2],
    };
    let item = "near-coplanar faces";
    let mut cases = Vec::new();
    for gap in gaps {
        let flat = room(&square(), 0.0, *gap);
        let flat = closed(item, format!("box {gap:e} high"), furnace(flat, RHO));
        cases.push(if *gap > 2e-9 { flat } else { flat.all_today(1.001, "nearer than 1e-9 faces nothing") });
        let sheet = up(&rectangle((0.23, 0.31), (0.64, 0.82)), *gap);
        let over = furnace(cube(), RHO).two([sheet], RHO, 1.0);
        let over = closed(item, format!("sheet {gap:e} over the floor"), over);
        cases.push(if *gap > 2e-5 {
            over
        } else {
            over.all_today(0.4, "nearer than 1e-6 touches: both shine")
        });
        let plate = solid(&rectangle((0.23, 0.31), (0.64, 0.82)), *gap, 0.1);
        cases.push(closed(
            item,
            format!("plate {gap:e} over the floor"),
            furnace(cube(), RHO).one(plate, RHO, 1.0),
        ));
    }
    cases
}

pub fn contacts(_: Form) -> Vec<Case> {
    let item = "touching and interpenetrating and duplicate faces";
    let base = rectangle((0.3, 0.35), (0.7, 0.62));
    let within = |base: &[DVec2], low: f64, high: f64| {
        let (a, b) = (base[0].extend(low), base[2].extend(high));
        move |p: DVec3| p.cmpgt(a - 1e-6).all() && p.cmplt(b + 1e-6).all()
    };
    let (block, other) = (solid(&base, 0.0, 0.4), rectangle((0.5, 0.2), (0.9, 0.5)));
    let under = within(&base, 0.0, 0.0);
    let standing = furnace(cube(), RHO).one(block.clone(), RHO, 1.0);
    let open = furnace(cube(), RHO).one(block[1..].iter().cloned(), RHO, 1.0);
    let (first, second) = (within(&base, 0.2, 0.5), within(&other, 0.3, 0.8));
    let crossing =
        furnace(cube(), RHO).one(solid(&base, 0.2, 0.5).into_iter().chain(solid(&other, 0.3, 0.8)), RHO, 1.0);
    let through = furnace(cube(), RHO).one(floating(0.5, DVec3::new(0.5, 0.4, 0.1)), RHO, 1.0);
    let inside = |p: DVec3| p.cmpge(DVec3::splat(-1e-9)).all();
    let tilt = DQuat::from_axis_angle(DVec3::new(0.3, 0.8, 0.5).normalize(), -0.9);
    let in_block = move |p: DVec3| (tilt * (p - DVec3::new(0.5, 0.4, 0.1))).abs().max_element() < 0.25 - 1e-6;
    let twice = furnace(cube().into_iter().chain(cube()), RHO);
    let mut both = furnace(cube(), RHO);
    both.0.faces.iter_mut().for_each(|face| face.sides = Sides::Two);
    let both = both.one([up(&base, 0.0)], RHO, 1.0);
    let unlike = furnace(cube(), RHO).one([cube()[0].clone()], 0.2, 2.0);
    vec![
        held_where(item, "block on the floor", standing, move |p| !under(p)),
        held_where(item, "block without a bottom", open, move |p| !under(p)),
        held_where(item, "blocks through each other", crossing, move |p| !(first(p) && second(p))),
        held_where(item, "block through the floor", through, move |p| inside(p) && !in_block(p)),
        closed(item, "every face twice", twice),
        // Nothing tells which is on top: both are lit and both shine, so that there is no truth.
        Case::new(item, "tile in the floor's plane", both.0),
        Case::new(item, "two unlike floors in one place", unlike.0),
    ]
}

pub fn corners(form: Form) -> Vec<Case> {
    let faces: &[usize] = if form == Form::Short { &[3, 6, 12] } else { &[3, 4, 5, 6, 7, 8, 9, 10, 11, 12] };
    faces
        .iter()
        .map(|n| closed("corners of 3 to 12 faces", format!("{n} faces"), furnace(pyramid(*n), RHO)))
        .collect()
}

pub fn dihedrals(form: Form) -> Vec<Case> {
    let angles: &[f64] = match form {
        Form::Short => &[1.0, 20.0, 90.0, 179.0, 181.0, 270.0, 359.0],
        Form::Long => &[
            1.0, 2.0, 5.0, 10.0, 20.0, 45.0, 90.0, 135.0, 170.0, 179.0, 181.0, 190.0, 225.0, 270.0, 315.0,
            350.0, 359.0,
        ],
    };
    let wedge =
        |a: f64| closed("dihedrals of 1° to 359°", format!("{a}°"), furnace(room(&pie(a), 0.0, 1.0), RHO));
    angles.iter().map(|a| wedge(*a)).collect()
}

pub fn shared_edges(_: Form) -> Vec<Case> {
    let item = "surfaces sharing an edge partly";
    // The floor in tiles whose edges meet nothing of the walls' and the ceiling's.
    let tiled = |tiles: &[[(f64, f64); 2]]| {
        let mut faces = cube();
        faces.remove(0);
        faces.extend(tiles.iter().map(|[low, high]| up(&rectangle(*low, *high), 0.0)));
        furnace(faces, RHO)
    };
    let two = [[(0.0, 0.0), (0.37, 1.0)], [(0.37, 0.0), (1.0, 1.0)]];
    let three = [[(0.0, 0.0), (0.37, 1.0)], [(0.37, 0.0), (1.0, 0.61)], [(0.37, 0.61), (1.0, 1.0)]];
    let apart = [[(0.0, 0.0), (0.37, 1.0)], [(0.37 + 1e-9, 0.0), (1.0, 1.0)]];
    vec![
        closed(item, "two tiles", tiled(&two)),
        closed(item, "three tiles in a T", tiled(&three)),
        closed(item, "two tiles 1e-9 apart", tiled(&apart)),
    ]
}

pub fn polygons(form: Form) -> Vec<Case> {
    let item = "polygons";
    let long = form == Form::Long;
    let prism = |name: String, base: &[DVec2]| closed(item, name, furnace(room(base, 0.0, 1.0), RHO));
    let mut cases: Vec<Case> = if long { &[3, 5, 8, 20, 60][..] } else { &[3, 8, 24] }
        .iter()
        .map(|n| prism(format!("room of {n} walls"), &star(*n, &[1.0])))
        .collect();
    cases.push(prism("star of 10 corners".into(), &star(10, &[1.0, 0.4])));
    cases.push(prism("comb of 3 teeth".into(), &comb(3)));
    // Floor and ceiling have 2,000 corners on lines; the walls are whole.
    let runs = divided(&square(), 500);
    let mut faces = walls(&square(), 0.0, 1.0);
    faces.extend([up(&runs, 0.0), down(&runs, 1.0)]);
    cases.push(closed(item, "2000 corners on straight lines", furnace(faces, RHO)));
    let mut spiked = square();
    spiked.splice(1..1, [DVec2::new(0.5, 0.0), DVec2::new(0.5, -3.0), DVec2::new(0.5, 0.0)]);
    let mut faces = cube();
    faces[0] = up(&spiked, 0.0);
    cases.push(closed(item, "spike in the floor", furnace(faces, RHO)));
    let hole = rectangle((0.33, 0.41), (0.58, 0.69));
    let floor = bridged(&square(), &hole);
    let mut faces = walls(&square(), 0.0, 1.0);
    faces.extend([up(&floor, 0.0), down(&floor, 1.0)].into_iter().chain(turned(walls(&hole, 0.0, 1.0))));
    cases.push(closed(item, "hole by a bridge", furnace(faces, RHO)));
    if long {
        cases.push(prism("room of 200 walls".into(), &star(200, &[1.0])));
        cases.push(prism("star of 30 corners".into(), &star(30, &[1.0, 0.4])));
        cases.push(prism("comb of 6 teeth".into(), &comb(6)));
    }
    cases
}

pub fn reflectances(_: Form) -> Vec<Case> {
    let item = "reflectance";
    let dark = Case::new(item, "0", furnace(cube(), 0.0).0).demand(What::Balance, 0.03);
    // Validation lowers what is above 0.999 to 0.999.
    let limited = |rho: f64| {
        let case = Case::new(item, format!("{rho}"), furnace(cube(), rho).0);
        let b = 1.0 / (1.0 - rho.min(0.999));
        case.demand(What::Truth(Box::new(move |_, _| Some(b))), 0.03)
            .demand(What::Balance, 1e-4)
            .demand(What::Lost, 1e-4)
    };
    let coarse = |case: Case| Case { error: 0.1, ..case };
    vec![dark, limited(0.5), limited(0.9), limited(0.99), coarse(limited(0.999_999))]
}

pub fn duplicates(form: Form) -> Vec<Case> {
    let item = "duplicates of a face";
    let many = |n: usize| cube().into_iter().chain(std::iter::repeat_n(cube()[0].clone(), n));
    let near = |n: usize| {
        let copy = |i: usize| up(&rectangle((0.3, 0.3), (0.7, 0.7)), 0.5 + 1e-8 * i as f64);
        furnace(cube(), RHO).one((0..n).map(copy), RHO, 1.0)
    };
    let stacked = if form == Form::Short { 5 } else { 20 };
    vec![
        closed(item, "100000 equal", furnace(many(100_000), RHO)),
        // A stack within 1e-6: no truth, all of them are lit or not by rounding.
        Case::new(item, format!("{stacked} within 1e-6"), near(stacked).0),
    ]
}
