//! Mixing states of a run, so that light that is reflected a hundred times need not be followed reflection by reflection.
//!
//! Irradiance `E` and what of it is unshot, `U`, fit together in a *state*: `E = D + Tρ(E − U)`, with the direct irradiance `D` and the
//! transport `T` as it was computed. Weighted sums of states with weights that sum to one are states again, and so is `(D, D)`, where
//! nothing is shot yet. Hence `(1 + a)(E, U) − a(D, D)` is one too, for any `a`: no transport is computed and none is approximated.
//! Where light has filled a room and only fades, `U` is `E` in small, and with the right `a` hardly any of it is left.

use super::element::Element;
use super::state::Tree;
use crate::transport::{Receiver, Unresolved};

/// The direct irradiance of a tree, in the order of its elements, children after their parent.
#[derive(Clone, Debug)]
pub struct Direct<const N: usize> {
    divided: Vec<bool>,
    irradiance: Vec<[f64; N]>,
    /// What is reflected of it per band, in W.
    reflected_w: [f64; N],
    /// Squared link errors in W²/m².
    error_squared: f64,
    unresolved: Unresolved,
}

/// Where in a [`Direct`] an element stands.
#[derive(Default)]
struct Cursor {
    element: usize,
    function: usize,
}

/// What a surface has sent, has to send and would have had to at first, per band, in W.
#[derive(Clone, Copy, Debug)]
pub struct Power<const N: usize> {
    /// Unshot, with its sign.
    pub unshot_w: [f64; N],
    /// Of the direct irradiance.
    pub direct_w: [f64; N],
}

impl<const N: usize> Tree<N> {
    /// Keeps the irradiance, all of which is direct so far.
    pub fn keep_direct(&mut self) {
        let mut direct = Direct {
            divided: Vec::new(),
            irradiance: Vec::new(),
            reflected_w: [0.0; N],
            error_squared: self.error_squared,
            unresolved: self.unresolved,
        };
        keep(&self.root, &mut direct);
        let mean = self.root.mean_irradiance();
        direct.reflected_w = std::array::from_fn(|n| mean[n] * self.patch.reflectance[n] * self.area_m2);
        self.direct = Some(Box::new(direct));
    }

    /// Forgets what was kept.
    pub fn forget_direct(&mut self) {
        self.direct = None;
    }

    /// What the surface has to send and would have had to at first.
    pub fn power(&self) -> Power<N> {
        let direct_w = self.direct.as_ref().map_or([0.0; N], |direct| direct.reflected_w);
        Power { unshot_w: self.unshot_by_band_w(), direct_w }
    }

    /// Mixes the state with that of the direct irradiance, by one weight per band.
    pub fn mix(&mut self, weight: &[f64; N]) {
        let Some(direct) = self.direct.take() else { return };
        beside(&mut self.root, &direct, Some(&mut Cursor::default()), &|e, u, d| {
            for n in 0..N {
                e[n] += weight[n] * (e[n] - d[n]);
                u[n] += weight[n] * (u[n] - d[n]);
            }
        });
        let mut most = 0.0f64;
        for n in 0..N {
            self.indirect_w[n] *= 1.0 + weight[n];
            most = most.max((1.0 + weight[n]).powi(2));
        }
        let indirect = (self.error_squared - direct.error_squared).max(0.0);
        self.error_squared = direct.error_squared + most * indirect;
        self.unresolved = self.unresolved.grown_since(direct.unresolved, most);
        self.direct = Some(direct);
        self.measure_unshot();
    }

    /// Adds what was kept to a tree that has been made dark ([`Tree::restart`]): the reflected light comes next.
    pub fn restore_direct(&mut self) {
        let Some(direct) = &self.direct else { return };
        beside(&mut self.root, direct, Some(&mut Cursor::default()), &|e, u, d| {
            for n in 0..N {
                e[n] += d[n];
                u[n] += d[n];
            }
        });
        (self.error_squared, self.unresolved) = (direct.error_squared, direct.unresolved);
    }
}

fn keep<const N: usize>(element: &Element<N>, direct: &mut Direct<N>) {
    let children = element.children();
    direct.irradiance.extend(element.irradiance());
    direct.divided.push(children.is_some());
    for child in children.map_or(&[][..], |(_, children)| children) {
        keep(child, direct);
    }
}

/// Calls `each` on the coefficients of the subtree, irradiance and unshot, beside what was kept of them; a subtree was kept if there is a
/// cursor to it.
fn beside<const N: usize>(
    element: &mut Element<N>,
    direct: &Direct<N>,
    mut cursor: Option<&mut Cursor>,
    each: &impl Fn(&mut [f64; N], &mut [f64; N], &[f64; N]),
) {
    let (irradiance, unshot) = element.light_mut();
    let mut divided = false;
    let kept = cursor.as_deref_mut().map_or(&[][..], |cursor| {
        divided = direct.divided[cursor.element];
        let from = cursor.function;
        (cursor.element, cursor.function) = (cursor.element + 1, from + irradiance.len());
        &direct.irradiance[from..cursor.function]
    });
    for (a, (e, u)) in irradiance.iter_mut().zip(unshot).enumerate() {
        each(e, u, kept.get(a).unwrap_or(&[0.0; N]));
    }
    let mut cursor = cursor.filter(|_| divided);
    for child in element.children_mut() {
        beside(child, direct, cursor.as_deref_mut(), each);
    }
}
