//! Tensor Legendre multiwavelet bases on the unit square: Haar (k = 1), M2 (k = 2), M3 (k = 3).
//!
//! `φ_i(x) = √(2i+1) P_i(2x−1)`, and `φ_a(x, y) = φ_i(x) φ_j(y)` with `a = i·k + j`. Normalised so that the mean of
//! `φ_a φ_b` over the square is `δ_ab`: coefficient 0 is the mean. The two-scale relation
//! `φ_i(x) = Σ_j P^s_ij φ_j(2x−s)` carries coefficients between a cell and its halves.

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::cell::Split;

/// The most functions a cell can have (M3: 3 × 3).
pub const MAX_FUNCTIONS: usize = 9;

/// A multiwavelet basis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Basis {
    /// Piecewise constant, k = 1.
    Haar,
    /// Piecewise bilinear, k = 2.
    M2,
    /// Piecewise biquadratic, k = 3.
    M3,
    /// The functions of M3, of which only those are used that the light asks for.
    Auto,
}

impl Basis {
    /// Functions per dimension, k.
    pub const fn order(self) -> usize {
        match self {
            Basis::Haar => 1,
            Basis::M2 => 2,
            Basis::M3 | Basis::Auto => 3,
        }
    }

    /// Functions per cell, k².
    #[allow(clippy::len_without_is_empty)]
    pub const fn len(self) -> usize {
        self.order() * self.order()
    }

    /// Number of functions of the first `k` per dimension that function `a` needs: 1, 2 or 3.
    pub const fn order_of(self, a: usize) -> usize {
        let (i, j) = (a / self.order(), a % self.order());
        1 + if i > j { i } else { j }
    }

    /// All functions at a point of the unit square; entries from [`Basis::len`] on are zero.
    pub fn evaluate(self, local: DVec2) -> [f64; MAX_FUNCTIONS] {
        let k = self.order();
        let (x, y) = (legendre(local.x), legendre(local.y));
        let mut values = [0.0; MAX_FUNCTIONS];
        for i in 0..k {
            for j in 0..k {
                values[i * k + j] = x[i] * y[j];
            }
        }
        values
    }
}

/// `√(2i+1) P_i(2x−1)` for i = 0 … 3.
pub fn legendre(x: f64) -> [f64; 4] {
    let t = 2.0 * x - 1.0;
    [
        1.0,
        3f64.sqrt() * t,
        5f64.sqrt() * 0.5 * (3.0 * t * t - 1.0),
        7f64.sqrt() * 0.5 * (5.0 * t * t - 3.0) * t,
    ]
}

/// The two-scale matrices P⁰ of M3; the ones of Haar and M2 are their upper left corners. `P¹_ij = (−1)^(i+j) P⁰_ij`.
const P0: [[f64; 3]; 3] =
    [[1.0, 0.0, 0.0], [-0.866_025_403_784_438_6, 0.5, 0.0], [0.0, -0.968_245_836_551_854_3, 0.25]];

/// `P^s_ij`, or the identity where the child spans its parent.
fn two_scale(side: Option<usize>, i: usize, j: usize) -> f64 {
    match side {
        None => (i == j) as u8 as f64,
        Some(s) => {
            if s == 1 && (i + j) % 2 == 1 {
                -P0[i][j]
            } else {
                P0[i][j]
            }
        }
    }
}

impl Basis {
    /// Push: the child's coefficients `b_st = P^sᵀ b P^t` of the same function; one row of bands per function.
    pub fn push<const N: usize>(self, split: Split, child: usize, parent: &[[f64; N]], out: &mut [[f64; N]]) {
        let k = self.order();
        let (s, t) = split.children()[child];
        let mut half = [[0.0; N]; MAX_FUNCTIONS];
        for i in 0..k {
            for j in 0..k {
                for l in i..k {
                    let p = two_scale(s, l, i);
                    for n in 0..N {
                        half[i * k + j][n] += p * parent[l * k + j][n];
                    }
                }
            }
        }
        for i in 0..k {
            for j in 0..k {
                let mut sum = [0.0; N];
                for l in j..k {
                    let p = two_scale(t, l, j);
                    for n in 0..N {
                        sum[n] += p * half[i * k + l][n];
                    }
                }
                out[i * k + j] = sum;
            }
        }
    }

    /// Pull: adds this child's share to the parent's coefficients, `b += (1/c) P^s b_st P^tᵀ` with c the number of children.
    pub fn pull_add<const N: usize>(
        self,
        split: Split,
        child: usize,
        coefficients: &[[f64; N]],
        parent: &mut [[f64; N]],
    ) {
        let k = self.order();
        let (s, t) = split.children()[child];
        let share = 1.0 / split.children().len() as f64;
        let mut half = [[0.0; N]; MAX_FUNCTIONS];
        for i in 0..k {
            for j in 0..k {
                for l in 0..=i {
                    let p = two_scale(s, i, l);
                    for n in 0..N {
                        half[i * k + j][n] += p * coefficients[l * k + j][n];
                    }
                }
            }
        }
        for i in 0..k {
            for j in 0..k {
                for l in 0..=j {
                    let p = share * two_scale(t, j, l);
                    for n in 0..N {
                        parent[i * k + j][n] += p * half[i * k + l][n];
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BASES: [Basis; 3] = [Basis::Haar, Basis::M2, Basis::M3];
    const SPLITS: [Split; 3] = [Split::U, Split::V, Split::Both];

    fn value(basis: Basis, coefficients: &[[f64; 1]], local: DVec2) -> f64 {
        let phi = basis.evaluate(local);
        (0..basis.len()).map(|a| coefficients[a][0] * phi[a]).sum()
    }

    proptest! {
        #[test]
        fn push_keeps_the_function_and_pull_inverts_it(
            values in proptest::collection::vec(-1.0..1.0f64, MAX_FUNCTIONS), x in 0.0..1.0f64, y in 0.0..1.0f64,
        ) {
            for basis in BASES {
                for split in SPLITS {
                    let parent: Vec<[f64; 1]> = values.iter().map(|v| [*v]).collect();
                    let mut back = [[0.0]; MAX_FUNCTIONS];
                    for child in 0..split.children().len() {
                        let mut pushed = [[0.0]; MAX_FUNCTIONS];
                        basis.push(split, child, &parent, &mut pushed);
                        let cell = crate::math::Cell::UNIT.child(split, child);
                        let local = DVec2::new(x, y);
                        let (a, b) = (value(basis, &pushed, local), value(basis, &parent, cell.to_surface(local)));
                        prop_assert!((a - b).abs() < 1e-13, "{basis:?} {split:?} {child}: {a} against {b}");
                        basis.pull_add(split, child, &pushed, &mut back);
                    }
                    for a in 0..basis.len() {
                        prop_assert!((back[a][0] - parent[a][0]).abs() < 2e-15 * 10.0);
                    }
                }
            }
        }
    }

    #[test]
    fn functions_are_orthonormal() {
        let (nodes, weights) = crate::math::quadrature::gauss(4);
        for basis in BASES {
            for a in 0..basis.len() {
                for b in 0..basis.len() {
                    let mut sum = 0.0;
                    for (x, wx) in nodes.iter().zip(weights) {
                        for (y, wy) in nodes.iter().zip(weights) {
                            let phi = basis.evaluate(DVec2::new(*x, *y));
                            sum += wx * wy * phi[a] * phi[b];
                        }
                    }
                    assert!((sum - (a == b) as u8 as f64).abs() < 1e-14, "{basis:?} {a} {b}: {sum}");
                }
            }
        }
    }
}
