//! `wrad info`: the scene in numbers, its problems, and the plan: what will be computed, what skipped, and why.

use std::fmt::Write as _;
use std::path::Path;

use glam::DVec3;

use crate::output::units::{count, percent};
use crate::scene::{self, Cut, Scene, Sides, Surface, describe};
use crate::transport::Clusters;
use crate::transport::candidates::LIST_LIMIT;
use crate::visibility::{OpaqueFaces, nothing_between};

use super::bands::Collapsed;
use super::{Error, Status, print};

/// Above this many tests of a corner against a plane, pairs are not counted.
const MAX_PAIR_TESTS: usize = 200_000_000;
/// Above this mean reflectance light goes round for long.
const BRIGHT: f64 = 0.9;

/// Prints what is known of the scene in `path`.
pub(super) fn run(path: &Path) -> Result<Status, Error> {
    let scene = scene::read::read_file(path)?;
    let cut = scene::cut(&scene);
    let surfaces = &cut.surfaces;
    let mut text = describe(&scene);
    for problem in problems(&scene, surfaces) {
        let _ = writeln!(text, "problem    {problem}");
    }
    for line in plan(&scene, &cut) {
        let _ = writeln!(text, "plan       {line}");
    }
    print(&text);
    Ok(Status::Done)
}

/// What stands in the way of a useful solution.
fn problems(scene: &Scene, surfaces: &[Surface]) -> Vec<String> {
    let mut problems = Vec::new();
    if surfaces.is_empty() {
        problems.push("the scene has no faces: there is nothing to solve".to_owned());
    } else if !surfaces.iter().any(emits) && scene.lights.is_empty() {
        problems.push("nothing emits light: the solution will be dark".to_owned());
    }
    let reflectance = mean_reflectance(surfaces);
    if reflectance > BRIGHT {
        let mean = percent(reflectance);
        problems.push(format!("the mean reflectance is {mean}: interreflection converges slowly"));
    }
    problems
}

/// What `wrad solve` will do, a line per decision.
fn plan(scene: &Scene, cut: &Cut) -> Vec<String> {
    let surfaces = &cut.surfaces[..];
    if surfaces.is_empty() {
        return Vec::new();
    }
    let mut lines = vec![bands(scene, surfaces), direct(scene, surfaces), interreflection(surfaces)];
    let one_sided = scene.faces.iter().filter(|face| face.sides == Sides::One).count();
    if one_sided > 0 {
        lines.push(format!(
            "backs: {} black, without elements: they block light and neither receive nor reflect it",
            of(one_sided, scene.faces.len(), "face")
        ));
    }
    lines.extend(contacts(cut));
    lines.push(behind(scene, surfaces));
    lines.push(small_pairs(surfaces));
    match nothing_between(scene) {
        true => {
            lines.push("visibility: no rays: the scene is convex, nothing can stand in between".to_owned())
        }
        false => lines.extend(visibility(scene)),
    }
    lines
}

/// What becomes of pairs that matter little.
fn small_pairs(surfaces: &[Surface]) -> String {
    let number = |which: fn(&Surface) -> bool| surfaces.iter().filter(|s| which(s)).count();
    let (emit, reflect, least) = (number(emits), number(reflects), Clusters::LEAST_PACKETS);
    let crowded: Vec<String> = [("direct light", emit), ("interreflection", reflect)]
        .into_iter()
        .filter(|(_, number)| *number >= least)
        .map(|(stage, number)| format!("{} in {stage}", count(number as u64)))
        .collect();
    let clusters = match crowded.is_empty() {
        true => format!("no clusters: {emit} emit and {reflect} reflect, and {least} must shoot at once"),
        false => format!("four for a cluster where {least} shoot at once (at most {})", crowded.join(", ")),
    };
    format!("small pairs: one sample each; {clusters}")
}

/// How rays are avoided where something may stand in between.
fn visibility(scene: &Scene) -> [String; 2] {
    let faces = OpaqueFaces::new(scene);
    let convex = (0..faces.len() as u32).filter(|face| faces.piece_count(*face) == 1).count();
    let most = match faces.len() <= LIST_LIMIT {
        true => String::new(),
        false => format!(" if at most {LIST_LIMIT} of {}", count(faces.len() as u64)),
    };
    [
        "visibility: rays only where a face lies in the shaft between two elements".to_owned(),
        format!(
            "blockers: what lies in a shaft is listed{most}; smaller elements inherit the list; \
             {} convex and may hide a pair alone",
            of(convex, faces.len(), "face")
        ),
    ]
}

fn bands(scene: &Scene, surfaces: &[Surface]) -> String {
    let (names, total) = (scene.bands.join(" "), scene.bands.len());
    match Collapsed::new(scene, surfaces).map(|collapsed| collapsed.count()) {
        Some(count) => format!(
            "bands: {count} computed for {names}: others are reflected alike and shine in proportion, {} skipped",
            total - count
        ),
        None => format!("bands: {total} computed ({names}) with one kernel evaluation for all"),
    }
}

fn direct(scene: &Scene, surfaces: &[Surface]) -> String {
    let emitters = surfaces.iter().filter(|s| emits(s)).count();
    let lights = scene.lights.len();
    match emitters + lights {
        0 => "direct light: skipped: nothing emits".to_owned(),
        _ => format!(
            "direct light: from {} and {}",
            plural(emitters, "emitting surface"),
            plural(lights, "light without area")
        ),
    }
}

fn interreflection(surfaces: &[Surface]) -> String {
    let black = surfaces.iter().filter(|s| !reflects(s)).count();
    if black == surfaces.len() {
        return "interreflection: skipped: no surface reflects".to_owned();
    }
    let mean = percent(mean_reflectance(surfaces));
    let computed =
        format!("interreflection: shooting until the bound on what is left, reflectance {mean} on average");
    match black {
        0 => computed,
        _ => format!(
            "{computed}; {} black: they receive and never shoot",
            of(black, surfaces.len(), "surface")
        ),
    }
}

/// What became of the sides that other faces stand on.
fn contacts(cut: &Cut) -> Option<String> {
    let mut facts = Vec::new();
    if cut.cut_sides > 0 {
        let sides = plural(cut.cut_sides, "lit side");
        facts.push(format!("{sides} cut along the lines on which other faces stand"));
    }
    if cut.covered > 0 {
        facts
            .push(format!("{} without surface: something stands on it", plural(cut.covered, "covered part")));
    }
    (!facts.is_empty()).then(|| format!("contacts: {}", facts.join("; ")))
}

/// How many pairs of surfaces cannot exchange light because one lies behind the other.
fn behind(scene: &Scene, surfaces: &[Surface]) -> String {
    let corners: usize = surfaces.iter().map(|s| s.outline.len()).sum();
    if corners.saturating_mul(surfaces.len()) > MAX_PAIR_TESTS {
        return "pairs behind each other: skipped, too many surfaces to count them here".to_owned();
    }
    let tolerance = 1e-9 * scene.bounds_m().map_or(0.0, |(low, high)| (high - low).length());
    let points: Vec<Vec<DVec3>> =
        surfaces.iter().map(|s| s.outline.iter().map(|uv| s.frame.point(*uv)).collect()).collect();
    let in_front = |of: usize, other: usize| {
        let frame = &surfaces[of].frame;
        points[other].iter().any(|p| frame.normal.dot(*p - frame.origin) > tolerance)
    };
    let n = surfaces.len();
    let facing =
        (0..n).map(|i| (i + 1..n).filter(|j| in_front(i, *j) && in_front(*j, i)).count()).sum::<usize>();
    let all = n * (n - 1) / 2;
    format!(
        "pairs: {} of {} skipped: one surface lies behind the other",
        count((all - facing) as u64),
        count(all as u64)
    )
}

fn emits(surface: &Surface) -> bool {
    surface.exitance_w_m2.iter().any(|m| *m > 0.0)
}

fn reflects(surface: &Surface) -> bool {
    surface.reflectance.iter().any(|rho| *rho > 0.0)
}

/// Weighted by area, mean of the bands.
fn mean_reflectance(surfaces: &[Surface]) -> f64 {
    let area: f64 = surfaces.iter().map(|s| s.area_m2).sum();
    let mean = |s: &Surface| s.reflectance.iter().sum::<f64>() / s.reflectance.len().max(1) as f64;
    if area > 0.0 { surfaces.iter().map(|s| s.area_m2 * mean(s)).sum::<f64>() / area } else { 0.0 }
}

fn plural(number: usize, what: &str) -> String {
    match (number, what.split_once(' ')) {
        (1, _) => format!("1 {what}"),
        (n, Some((noun @ "light", rest))) => format!("{n} {noun}s {rest}"),
        (n, _) => format!("{n} {what}s"),
    }
}

fn of(number: usize, total: usize, what: &str) -> String {
    let verb = if number == 1 { "is" } else { "are" };
    format!("{number} of {} {verb}", plural(total, what))
}
