//! How many functions light needs: the least basis that holds it, but for a part that does not count.
//!
//! Where orders are not fixed ([`Basis::Auto`]), what a surface sends and its finished field are kept in that. A surface whose light is even
//! then sends a constant, which far fewer nodes integrate, and a field that is linear has four coefficients to an element instead of nine.

use crate::math::Basis;

use super::solution::{Field, Node};

/// The least basis that holds functions given by coefficients in `basis`, band fastest, up to an RMS of `spare_w_m2` on every cell, all bands;
/// `basis` itself where orders are fixed.
pub(super) fn least<'a>(
    basis: Basis,
    bands: usize,
    cells: impl Iterator<Item = &'a [f64]>,
    spare_w_m2: f64,
) -> Basis {
    if basis != Basis::Auto {
        return basis;
    }
    // The largest square on a cell of what each order adds.
    let mut added = [0.0f64; 3];
    for coefficients in cells {
        let mut here = [0.0; 3];
        for (a, function) in coefficients.chunks_exact(bands).take(basis.len()).enumerate() {
            here[basis.order_of(a) - 1] += function.iter().map(|c| c * c).sum::<f64>();
        }
        (0..3).for_each(|k| added[k] = added[k].max(here[k]));
    }
    let spare = spare_w_m2 * spare_w_m2;
    if added[1] + added[2] <= spare {
        Basis::Haar
    } else if added[2] <= spare {
        Basis::M2
    } else {
        Basis::M3
    }
}

/// Takes from coefficients in one basis, band fastest, those of a lesser one to their front, and clears the rest.
pub(super) fn restrict(from: Basis, to: Basis, coefficients: &mut [f64], bands: usize) {
    if from.order() == to.order() {
        return;
    }
    let kept = (0..from.len()).filter(|a| from.order_of(*a) <= to.order());
    for (place, a) in kept.enumerate() {
        coefficients.copy_within(a * bands..(a + 1) * bands, place * bands);
    }
    coefficients[to.len() * bands..].fill(0.0);
}

impl Field {
    /// The field in the least basis that holds it up to an RMS of `spare_w_m2` on every leaf, if its order is not fixed.
    pub fn in_least_basis(mut self, spare_w_m2: f64) -> Self {
        let (bands, from) = (self.bands, self.basis);
        let cells = self.coefficients.chunks_exact(from.len() * bands);
        let basis = least(from, bands, cells.clone(), spare_w_m2);
        if basis.order() < from.order() {
            let lesser = |cell: &[f64]| {
                let mut cell = cell.to_vec();
                restrict(from, basis, &mut cell, bands);
                cell.truncate(basis.len() * bands);
                cell
            };
            self.coefficients = cells.flat_map(lesser).collect();
            for node in &mut self.nodes {
                if let Node::Leaf(start) = node {
                    *start = *start / from.len() as u32 * basis.len() as u32;
                }
            }
        }
        self.basis = basis;
        self
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::math::Split;

    /// Two leaves with coefficients in all functions up to an order, and less than that of the others.
    fn field(order: usize, less: f64) -> Field {
        let value = |i: usize| {
            let (a, scale) = (i / 2 % 9, 1.0 + i as f64 / 36.0);
            if Basis::Auto.order_of(a) <= order { scale } else { less * scale }
        };
        let nodes = vec![Node::Inner(Split::U, 1), Node::Leaf(0), Node::Leaf(18)];
        Field::new(Basis::Auto, 2, nodes, (0..36).map(value).collect())
    }

    #[test]
    fn a_field_has_the_order_it_needs_and_stays_what_it_is() {
        for (order, basis) in [(1, Basis::Haar), (2, Basis::M2), (3, Basis::M3)] {
            let whole = field(order, 0.0);
            let least = whole.clone().in_least_basis(1e-9);
            assert_eq!((least.basis, least.leaves()), (basis, 2));
            for i in 0..20 {
                let uv = DVec2::new(i as f64 / 19.0, (i * 7 % 20) as f64 / 19.0);
                let (mut a, mut b) = ([0.0; 2], [0.0; 2]);
                whole.irradiance(uv, &mut a);
                least.irradiance(uv, &mut b);
                assert_eq!(a, b);
            }
        }
    }

    #[test]
    fn what_counts_stays_and_fixed_orders_do() {
        let rms = |less: f64| field(1, less).in_least_basis(0.1).basis;
        assert_eq!((rms(0.01), rms(0.04)), (Basis::Haar, Basis::M3));
        let fixed = Field { basis: Basis::M3, ..field(1, 0.0) };
        assert_eq!(fixed.in_least_basis(1.0).basis, Basis::M3);
    }
}
