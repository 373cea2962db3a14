//! Furniture: chairs, tables, shelves full of books, cabinets, bins, plants. Each stands on the origin with its front towards −y,
//! chairs with their back there.

use glam::{DVec2, DVec3, dvec3};

use super::Detail;
use super::dice::Dice;
use super::fittings::raised;
use super::placement::Placement;
use super::sketch::{Paint, Part, Polygon, matt, part};
use super::solids::{BETWEEN, ENDS, STANDING, Side, cuboid, lathe, prism, ring};

pub(super) const WOOD: Paint = matt(0.45, 0.31, 0.18);
pub(super) const METAL: Paint = matt(0.35, 0.36, 0.37);
pub(super) const DARK: Paint = matt(0.06, 0.06, 0.07);
const GREEN: Paint = matt(0.1, 0.25, 0.07);
const CLAY: Paint = matt(0.5, 0.26, 0.16);
const CLOTH: [Paint; 3] = [matt(0.12, 0.16, 0.3), matt(0.3, 0.1, 0.1), matt(0.15, 0.15, 0.16)];
const COVERS: [Paint; 6] = [
    matt(0.5, 0.12, 0.1),
    matt(0.1, 0.2, 0.42),
    matt(0.12, 0.35, 0.18),
    matt(0.6, 0.52, 0.3),
    matt(0.7, 0.68, 0.62),
    matt(0.2, 0.18, 0.2),
];

/// An office chair on five castors.
pub(super) fn chair(detail: Detail, dice: &mut Dice) -> Vec<Part> {
    let sides = detail.count(4, 0.3, 20);
    let mut base = lathe(&[(0.065, 0.04), (0.065, 0.12), (0.03, 0.14), (0.03, 0.44)], sides, true, false);
    for leg in 0..5 {
        let at = Placement::standing(DVec3::ZERO, 72.0 * f64::from(leg) + 10.0);
        base.extend(at.faces(cuboid(dvec3(0.04, -0.02, 0.06), dvec3(0.31, 0.02, 0.09), &[Side::Left])));
        let castor = lathe(&[(0.03, 0.0), (0.03, 0.055)], sides, false, true);
        base.extend(at.faces(castor.into_iter().map(|f| shifted(f, 0.27)).collect()));
    }
    let rounded: Vec<DVec2> =
        ring(0.27, 2 * sides).into_iter().map(|p| 0.85 * p + 0.15 * p.signum() * 0.3).collect();
    let arc = |r: f64, i: usize| {
        let angle = 0.9 * (i as f64 / sides as f64 - 0.5);
        DVec2::new(r * angle.sin(), 0.3 - r * angle.cos())
    };
    let back: Vec<DVec2> =
        (0..=sides).map(|i| arc(0.56, i)).chain((0..=sides).rev().map(|i| arc(0.53, i))).collect();
    let mut cloth = prism(&rounded, 0.44, 0.5, true, true);
    cloth.extend(prism(&back, 0.6, 1.0, true, true));
    let post = cuboid(dvec3(-0.03, -0.29, 0.47), dvec3(0.03, -0.265, 0.8), &[]);
    vec![part("base", METAL, base), part("cloth", dice.pick(&CLOTH), cloth), part("post", METAL, post)]
}

fn shifted(mut face: Polygon, x: f64) -> Polygon {
    face.iter_mut().for_each(|p| p.x += x);
    face
}

/// A table on four legs.
pub(super) fn table(length: f64, width: f64) -> Vec<Part> {
    let (a, b) = (0.5 * length, 0.5 * width);
    let top = cuboid(dvec3(-a, -b, 0.7), dvec3(a, b, 0.74), &[]);
    let leg = |(x, y): (f64, f64)| {
        let middle = dvec3(x * (a - 0.08), y * (b - 0.08), 0.0);
        let half = dvec3(0.03, 0.03, 0.0);
        cuboid(middle - half, middle + half + 0.7 * DVec3::Z, BETWEEN)
    };
    let legs = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].into_iter().flat_map(leg).collect();
    vec![part("top", WOOD, top), part("legs", METAL, legs)]
}

/// A bookcase 1 m wide and 2 m high; its back is 0.32 m behind its front.
pub(super) fn bookcase(detail: Detail, dice: &mut Dice) -> Vec<Part> {
    let (half, thick, depth, height) = (0.5, 0.025, 0.3, 2.0);
    let boards = detail.count(2, 0.3, 6);
    let pitch = (height - thick - 0.08) / boards as f64;
    let mut carcass = cuboid(dvec3(-half, 0.0, 0.0), dvec3(-half + thick, depth + 0.02, height), STANDING);
    carcass.extend(cuboid(dvec3(half - thick, 0.0, 0.0), dvec3(half, depth + 0.02, height), STANDING));
    let inner = half - thick;
    let hidden = [ENDS, STANDING].concat();
    carcass.extend(cuboid(dvec3(-inner, depth, 0.0), dvec3(inner, depth + 0.02, height), &hidden));
    let mut parts = Vec::new();
    for i in 0..=boards {
        let z = 0.08 + pitch * i as f64;
        let (low, high) = (dvec3(-inner, 0.01, z), dvec3(inner, depth, z + thick));
        carcass.extend(cuboid(low, high, &[Side::Left, Side::Right, Side::Back]));
        if i < boards {
            let books = books(inner, pitch - thick, detail, dice);
            parts.extend(
                books.into_iter().enumerate().map(|(j, (paint, faces))| {
                    part(&format!("book{i}_{j}"), paint, raised(faces, z + thick))
                }),
            );
        }
    }
    parts.insert(0, part("carcass", WOOD, carcass));
    parts
}

/// Books on a board from −`half` to `half`, with room left at its end.
fn books(half: f64, room: f64, detail: Detail, dice: &mut Dice) -> Vec<(Paint, Vec<Polygon>)> {
    let count = detail.count(1, 0.8, 40);
    let pitch = 2.0 * half / count as f64 * dice.between(0.75, 0.98);
    let mut x = -half + 0.004;
    let mut row = Vec::new();
    for _ in 0..count {
        let width = pitch * dice.between(0.6, 1.0);
        let (front, height) = (dice.between(0.04, 0.08), dice.between(0.6, 0.92) * room);
        let (low, high) = (dvec3(x, front, 0.0), dvec3(x + width - 0.004, 0.28, height));
        row.push((dice.pick(&COVERS), cuboid(low, high, STANDING)));
        x += width;
    }
    row
}

/// A cabinet with drawers, 0.45 m wide and deep.
pub(super) fn cabinet(detail: Detail) -> Vec<Part> {
    let drawers = detail.count(2, 0.15, 6);
    let body = cuboid(dvec3(-0.225, 0.0, 0.0), dvec3(0.225, 0.45, 1.3), STANDING);
    vec![part("body", METAL, body), part("drawers", METAL, fronts([-0.215, 0.215, 0.05, 1.28], 0.0, drawers))]
}

/// Drawer fronts with handles before the plane `y`; left, right, bottom, top.
pub(super) fn fronts([x0, x1, z0, z1]: [f64; 4], y: f64, drawers: usize) -> Vec<Polygon> {
    let pitch = (z1 - z0) / drawers as f64;
    let middle = 0.5 * (x0 + x1);
    let drawer = |i: usize| {
        let z = z0 + pitch * i as f64;
        let (low, high) = (dvec3(x0, y - 0.02, z + 0.005), dvec3(x1, y, z + pitch - 0.005));
        let mut faces = cuboid(low, high, &[Side::Back]);
        let (low, high) = (z + 0.7 * pitch, z + 0.7 * pitch + 0.015);
        faces.extend(cuboid(
            dvec3(middle - 0.06, y - 0.045, low),
            dvec3(middle + 0.06, y - 0.02, high),
            &[Side::Back],
        ));
        faces
    };
    (0..drawers).flat_map(drawer).collect()
}

/// A bin that stands open.
pub(super) fn bin(detail: Detail) -> Vec<Part> {
    let shape = [(0.12, 0.0), (0.16, 0.35), (0.15, 0.35), (0.11, 0.02)];
    vec![part("bin", DARK, lathe(&shape, detail.count(5, 0.4, 24), false, true))]
}

/// A plant in a pot, clipped to a ball.
pub(super) fn plant(detail: Detail) -> Vec<Part> {
    let sides = detail.count(5, 0.4, 24);
    let rings = detail.count(3, 0.3, 14);
    let pot = [(0.16, 0.0), (0.22, 0.38), (0.19, 0.38), (0.18, 0.33)];
    let ball: Vec<(f64, f64)> = (0..=rings)
        .map(|i| {
            let (sin, cos) = (0.1 + 2.94 * i as f64 / rings as f64).sin_cos();
            (0.36 * sin, 0.95 - 0.4 * cos)
        })
        .collect();
    vec![
        part("pot", CLAY, lathe(&pot, sides, false, true)),
        part("stem", WOOD, lathe(&[(0.02, 0.33), (0.02, 0.6)], sides, false, false)),
        part("leaves", GREEN, lathe(&ball, sides, true, true)),
    ]
}
