//! Who receives light: a surface's patch, its tree of elements, and what a pair task brought to it.

use ccnuma::Arena;
use glam::{DVec2, DVec3};

use super::gather::norm;
use super::packet::Shape;
use super::stored::Links;
use crate::math::Split;
use crate::math::basis::MAX_FUNCTIONS;
use crate::scene::{Frame, Surface};

/// What a pair task needs to know of the receiving surface.
#[derive(Clone, Debug)]
pub struct Patch<const N: usize> {
    /// Index of the surface.
    pub surface: u32,
    /// Its face.
    pub face: u32,
    /// The parallelogram.
    pub frame: Frame,
    /// Reflectance per band.
    pub reflectance: [f64; N],
    /// Corners of the polygon in metres.
    pub corners: Box<[DVec3]>,
}

impl<const N: usize> Patch<N> {
    /// The patch of a surface with `N` bands.
    pub fn new(index: u32, surface: &Surface) -> Self {
        Self {
            surface: index,
            face: surface.face,
            frame: surface.frame,
            reflectance: std::array::from_fn(|n| surface.reflectance[n]),
            corners: surface.outline.iter().map(|p| surface.frame.point(*p)).collect(),
        }
    }
}

impl<const N: usize> Patch<N> {
    /// A sphere around the polygon.
    pub(super) fn sphere(&self) -> (DVec3, f64) {
        let centre = self.corners.iter().sum::<DVec3>() / self.corners.len() as f64;
        (centre, self.corners.iter().map(|c| c.distance(centre)).fold(0.0, f64::max))
    }

    /// What an error of irradiance counts: the largest reflectance, or the least one that counts if that is more.
    pub(super) fn weight(&self, least_reflectance: f64) -> f64 {
        self.reflectance.iter().copied().fold(least_reflectance, f64::max)
    }

    /// Bound on the mean radiosity that irradiance with these coefficients causes, a norm over bands as errors are: `Σ ‖ρ b_l‖ ∫|φ_l|`.
    pub fn reflected_w_m2(&self, light: &[[f64; N]; MAX_FUNCTIONS]) -> f64 {
        // ∫|φ_l| is 1 for the mean and at most 0.87 for the others.
        let reflected =
            |c: &[f64; N]| norm(&std::array::from_fn::<f64, N, _>(|n| self.reflectance[n] * c[n]));
        reflected(&light[0]) + 0.87 * light[1..].iter().map(reflected).sum::<f64>()
    }
}

/// A receiving element, which owns the elements below it.
pub trait Receiver<const N: usize>: Send {
    /// How the cell lies to the surface's polygon.
    fn shape(&self) -> Shape<&[DVec2]>;
    /// How it is divided, if it is.
    fn split(&self) -> Option<Split>;
    /// Divides it; `shapes` are those of the children, which live in `arena`.
    fn subdivide(&mut self, split: Split, shapes: &[Shape], arena: &Arena);
    /// The children of a divided element, else none.
    fn children_mut(&mut self) -> &mut [Self]
    where
        Self: Sized;
    /// Adds irradiance in W/m², given by its coefficients.
    fn deposit(&mut self, irradiance: &[[f64; N]; MAX_FUNCTIONS]);
}

/// Link errors of light that was not resolved, which are among all: squared, in W²/m², or what they come to in a solution.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Unresolved {
    /// Of pairs that were taken by one sample.
    pub coarse: f64,
    /// Of pairs that were taken in clusters.
    pub clusters: f64,
    /// Of links that err by more than they may, because their elements are as small as elements get.
    pub cut_short: f64,
}

impl Unresolved {
    /// These, where what was added to `first` counts so many times.
    pub fn grown_since(self, first: Self, times: f64) -> Self {
        let grown = |all: f64, first: f64| first + times * (all - first).max(0.0);
        Self {
            coarse: grown(self.coarse, first.coarse),
            clusters: grown(self.clusters, first.clusters),
            cut_short: grown(self.cut_short, first.cut_short),
        }
    }

    /// Each of them changed alike.
    pub fn map(self, change: impl Fn(f64) -> f64) -> Self {
        let Self { coarse, clusters, cut_short } = self;
        Self { coarse: change(coarse), clusters: change(clusters), cut_short: change(cut_short) }
    }
}

impl std::ops::AddAssign for Unresolved {
    fn add_assign(&mut self, o: Self) {
        self.coarse += o.coarse;
        self.clusters += o.clusters;
        self.cut_short += o.cut_short;
    }
}

/// What a pair task brought to a receiver.
#[derive(Clone, Debug)]
pub struct Deposited<const N: usize> {
    /// Power received, per band, in W.
    pub received_w: [f64; N],
    /// Bound on the power to reflect, all bands, in W: `Σ ‖ρ b_l‖ ∫|φ_l|` over the coefficients.
    pub to_reflect_w: f64,
    /// Sum of squared link errors `(ρ δ)² A`, W²/m².
    pub error_squared: f64,
    /// Those of light that was not resolved.
    pub unresolved: Unresolved,
    /// Cost of the longest chain of parts that wait for each other: from the whole receiver down to one of its leaves.
    pub span: u64,
    /// Links that were recorded.
    pub links: Links,
}

impl<const N: usize> Default for Deposited<N> {
    fn default() -> Self {
        let (received_w, unresolved, links) = ([0.0; N], Unresolved::default(), Links::default());
        Self { received_w, to_reflect_w: 0.0, error_squared: 0.0, unresolved, span: 0, links }
    }
}

impl<const N: usize> Deposited<N> {
    /// Counts irradiance that a part of the receiver takes.
    pub(super) fn take(&mut self, patch: &Patch<N>, light: &[[f64; N]; MAX_FUNCTIONS], area_m2: f64) {
        self.to_reflect_w += area_m2 * patch.reflected_w_m2(light);
        for n in 0..N {
            self.received_w[n] += area_m2 * light[0][n];
        }
    }

    /// Adds what was brought after these.
    pub(super) fn add_after(&mut self, o: Self) {
        let span = self.span + o.span;
        self.add_beside(o);
        self.span = span;
    }

    /// Adds what another part brought that waits for none of these.
    pub(super) fn add_beside(&mut self, o: Self) {
        for n in 0..N {
            self.received_w[n] += o.received_w[n];
        }
        self.to_reflect_w += o.to_reflect_w;
        self.error_squared += o.error_squared;
        self.unresolved += o.unresolved;
        self.span = self.span.max(o.span);
        self.links.append(o.links);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_added_first_counts_once_when_the_rest_grows() {
        let of = |coarse, clusters, cut_short| Unresolved { coarse, clusters, cut_short };
        let (first, all) = (of(1.0, 4.0, 0.0), of(3.0, 3.0, 2.0));
        assert_eq!(all.grown_since(first, 10.0), of(21.0, 4.0, 20.0));
    }
}
