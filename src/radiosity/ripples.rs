//! Ripples: where the edge of a shadow crosses an element that is not divided any more, its polynomial rises above the light beside it and falls
//! below the darkness. What is kept stays, and with it the energy; what is read is held within limits.
//!
//! Irradiance is never below zero. Where light is smooth the polynomials of neighbours meet, and there is no other limit. Where they do not, it is
//! read within the means of the elements around it and a little more.

use glam::DVec2;

use super::solution::{Field, Leaf};
use crate::math::Basis;

/// An element has limits where it differs at its border from what is beyond by this share of the brightest mean around. On the reference scenes
/// that leaves errors at the probes what they are; half of it costs the first digit there, and twice as much lets ripples of a quarter pass.
const TROUBLED: f64 = 0.2;

/// So much more than the range of the means around may be read.
const WIDER: f64 = 0.1;

/// Places on the border, in an element's unit square, and the direction outwards: corners, and between them three on each side.
const BORDER: [((f64, f64), (f64, f64)); 16] = [
    ((0.0, 0.0), (-1.0, -1.0)),
    ((0.1, 0.0), (0.0, -1.0)),
    ((0.5, 0.0), (0.0, -1.0)),
    ((0.9, 0.0), (0.0, -1.0)),
    ((1.0, 0.0), (1.0, -1.0)),
    ((1.0, 0.1), (1.0, 0.0)),
    ((1.0, 0.5), (1.0, 0.0)),
    ((1.0, 0.9), (1.0, 0.0)),
    ((1.0, 1.0), (1.0, 1.0)),
    ((0.9, 1.0), (0.0, 1.0)),
    ((0.5, 1.0), (0.0, 1.0)),
    ((0.1, 1.0), (0.0, 1.0)),
    ((0.0, 1.0), (-1.0, 1.0)),
    ((0.0, 0.9), (-1.0, 0.0)),
    ((0.0, 0.5), (-1.0, 0.0)),
    ((0.0, 0.1), (-1.0, 0.0)),
];

/// How far beyond the border neighbours are looked for, in sizes of the element.
const BEYOND: f64 = 1e-6;

/// What may be read of an element in one band, in W/m².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Not less.
    pub low_w_m2: f64,
    /// Not more.
    pub high_w_m2: f64,
}

/// Irradiance is not negative; more is not known.
const FREE: Limits = Limits { low_w_m2: 0.0, high_w_m2: f64::INFINITY };

/// The limits of all leaves of a field: for each node its bands.
pub(super) fn limits(field: &Field) -> Vec<Limits> {
    let mut limits = vec![FREE; field.nodes.len() * field.bands];
    if field.basis != Basis::Haar {
        field.for_each_node(&mut |node, leaf| {
            set_limits(field, &leaf, &mut limits[node * field.bands..(node + 1) * field.bands]);
        });
    }
    limits
}

/// What is found about a band on the way round an element's border.
#[derive(Clone)]
struct Round {
    /// The range of the means, its own and those around.
    means: (f64, f64),
    jump: f64,
}

fn set_limits(field: &Field, leaf: &Leaf<'_>, limits: &mut [Limits]) {
    let bands = field.bands;
    let start = |mean: &f64| Round { means: (*mean, *mean), jump: 0.0 };
    let mut rounds: Vec<Round> = leaf.coefficients[..bands].iter().map(start).collect();
    let (mut own, mut theirs) = (vec![0.0; bands], vec![0.0; bands]);
    for (local, outwards) in BORDER {
        let at = leaf.cell.to_surface(DVec2::from(local));
        let beyond = at + BEYOND * DVec2::from(outwards) * leaf.cell.size;
        if beyond.min_element() < 0.0 || beyond.max_element() > 1.0 {
            continue;
        }
        let Some((_, neighbour)) = field.leaf_at_bare(beyond) else { continue };
        leaf.polynomial(field.basis, at, &mut own);
        neighbour.polynomial(field.basis, at, &mut theirs);
        for (n, Round { means: (low, high), jump }) in rounds.iter_mut().enumerate() {
            let mean = neighbour.coefficients[n];
            (*low, *high) = (low.min(mean), high.max(mean));
            *jump = jump.max((own[n] - theirs[n]).abs());
        }
    }
    for (limits, Round { means: (low, high), jump }) in limits.iter_mut().zip(rounds) {
        if jump > TROUBLED * high {
            let wider = WIDER * (high - low);
            *limits = Limits { low_w_m2: (low - wider).max(0.0), high_w_m2: (high + wider).max(0.0) };
        }
    }
}
