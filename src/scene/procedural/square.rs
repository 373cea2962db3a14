//! What stands on a square: a statue on steps, lanterns, benches.

use glam::dvec3;

use super::Detail;
use super::sketch::{Paint, Part, matt, part};
use super::solids::{STANDING, Side, cuboid, lathe, prism, ring};

const STONE: Paint = matt(0.58, 0.56, 0.52);
const BRONZE: Paint = matt(0.22, 0.2, 0.14);
const IRON: Paint = matt(0.1, 0.1, 0.1);
const WOOD: Paint = matt(0.35, 0.24, 0.14);

/// A figure on a pedestal on steps, 9 m high, on the origin.
pub(super) fn statue(detail: Detail) -> Vec<Part> {
    let sides = detail.count(6, 0.5, 32);
    let steps: Vec<_> = (0..3)
        .flat_map(|i| {
            prism(&ring(4.0 - 0.5 * f64::from(i), 8), 0.2 * f64::from(i), 0.2 * f64::from(i + 1), false, true)
        })
        .collect();
    let mut pedestal = cuboid(dvec3(-1.4, -1.4, 0.6), dvec3(1.4, 1.4, 1.2), STANDING);
    pedestal.extend(cuboid(dvec3(-1.1, -1.1, 1.2), dvec3(1.1, 1.1, 4.2), &[Side::Bottom, Side::Top]));
    pedestal.extend(cuboid(dvec3(-1.3, -1.3, 4.2), dvec3(1.3, 1.3, 4.6), &[]));
    // Robe, waist, shoulders, neck, head.
    let figure = [
        (0.75, 4.6),
        (0.7, 5.2),
        (0.55, 6.0),
        (0.42, 6.6),
        (0.48, 7.2),
        (0.55, 7.7),
        (0.4, 7.95),
        (0.16, 8.05),
        (0.16, 8.2),
        (0.26, 8.4),
        (0.27, 8.65),
        (0.18, 8.85),
    ];
    vec![
        part("steps", STONE, steps),
        part("pedestal", STONE, pedestal),
        part("figure", BRONZE, lathe(&figure, sides, false, true)),
    ]
}

/// An unlit lantern on a post.
pub(super) fn lantern(detail: Detail) -> Vec<Part> {
    let sides = detail.count(5, 0.4, 24);
    let post = [
        (0.25, 0.0),
        (0.22, 0.5),
        (0.09, 0.7),
        (0.07, 2.0),
        (0.1, 2.1),
        (0.06, 2.2),
        (0.05, 3.6),
        (0.14, 3.7),
    ];
    let head = [(0.14, 3.7), (0.24, 4.2), (0.3, 4.25), (0.12, 4.5), (0.03, 4.7)];
    vec![
        part("post", IRON, lathe(&post, sides, false, false)),
        part("head", BRONZE, lathe(&head, sides, false, true)),
    ]
}

/// A bench along x.
pub(super) fn bench(detail: Detail) -> Vec<Part> {
    let slats = detail.count(1, 0.3, 8);
    let width = 0.5 / slats as f64;
    let slat = |i: usize| {
        let y = -0.25 + width * i as f64;
        cuboid(dvec3(-0.9, y + 0.01, 0.42), dvec3(0.9, y + width - 0.01, 0.47), &[])
    };
    let foot =
        |x: f64| cuboid(dvec3(x - 0.05, -0.22, 0.0), dvec3(x + 0.05, 0.22, 0.42), &[Side::Bottom, Side::Top]);
    vec![
        part("slats", WOOD, (0..slats).flat_map(slat).collect()),
        part("feet", IRON, [-0.7, 0.7].into_iter().flat_map(foot).collect()),
    ]
}
