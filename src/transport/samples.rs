//! Where a receiver element is sampled: the `(k+1)²` Gauss nodes that carry the projection, and test points that are not nodes.
//!
//! The trap (numerics §3): an error estimate taken at the nodes of an interpolating projection is identically zero. With `k+1` nodes per
//! dimension for k functions the next higher coefficients are known too, which shows how fast the expansion converges and in which
//! direction; a function that vanishes at all nodes is caught by the test points.

use glam::DVec2;

use crate::math::Basis;
use crate::math::basis::{MAX_FUNCTIONS, legendre};
use crate::math::quadrature::gauss;

/// The most sample points of any rule.
pub const MAX_SAMPLES: usize = 20;

/// Test points in the element's unit square, staggered so that they share no line with each other or with Gauss nodes.
const TESTS: [(f64, f64); 4] = [(0.30, 0.02), (0.98, 0.30), (0.70, 0.98), (0.02, 0.70)];

/// The sampling of receiver elements for one basis.
#[derive(Clone, Debug)]
pub struct SampleRule {
    /// The basis projected onto.
    pub basis: Basis,
    /// Share of the threshold up to which a link's error is believed.
    pub trusted: f64,
    /// How much more of an element's light shadows between the points may take than between those of the full rule.
    pub unseen: f64,
    /// Sample points in the element's unit square: nodes first.
    pub points: Vec<DVec2>,
    /// How many of them are nodes.
    pub nodes: usize,
    /// `projection[a][q]` = `w_q φ_a(ξ_q)`: coefficients from values at the nodes; empty for functions that are left out.
    projection: Vec<Vec<f64>>,
    /// The same for the coefficients of order k in u and of order k in v, which the basis leaves out.
    beyond_u: Vec<Vec<f64>>,
    beyond_v: Vec<Vec<f64>>,
    /// `functions[p][a]` = `φ_a(ξ_p)` at every sample point.
    functions: Vec<[f64; MAX_FUNCTIONS]>,
}

/// The rules of a run.
#[derive(Clone, Debug)]
pub struct SampleRules {
    /// For light that matters.
    pub full: SampleRule,
    /// For light that matters little.
    pub modest: SampleRule,
    /// For light that nothing shades, where orders are not fixed; what it finds rough, the full one is asked about.
    pub lean: Option<SampleRule>,
}

impl SampleRules {
    /// The rules for `basis`.
    pub fn new(basis: Basis) -> Self {
        let lean = (basis == Basis::Auto).then(|| SampleRule::lean(basis));
        Self { full: SampleRule::new(basis), modest: SampleRule::modest(basis), lean }
    }
}

/// A projection and what it leaves out.
pub struct Projected<const N: usize> {
    /// Coefficients; entries from the basis' length on are zero.
    pub coefficients: [[f64; N]; MAX_FUNCTIONS],
    /// RMS over the element of the part left out that varies along u, and of the one along v.
    pub beyond: (f64, f64),
}

impl SampleRule {
    /// The rule that keeps all of `basis`.
    fn new(basis: Basis) -> Self {
        let k = basis.order();
        Self::with(basis, (k, k + 1), &TESTS, (1.0, 1.0))
    }

    /// All of `basis` from as few nodes as carry it.
    fn lean(basis: Basis) -> Self {
        let k = basis.order();
        Self::with(basis, (k, k), &TESTS, (0.5, 1.0))
    }

    /// The mean and, where the basis has them, slopes, from four nodes and one test.
    fn modest(basis: Basis) -> Self {
        Self::with(basis, (basis.order().min(2), 2), &[(0.5, 0.5)], (1.0, 8.0))
    }

    /// A rule that keeps the first `k` functions per dimension of `basis`, from `n × n` nodes, `n ≥ k`; nothing beyond is known if `n = k`.
    fn with(
        basis: Basis,
        (k, n): (usize, usize),
        tests: &[(f64, f64)],
        (trusted, unseen): (f64, f64),
    ) -> Self {
        let (nodes, weights) = gauss(n);
        let grid: Vec<(usize, usize)> = (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).collect();
        let row = |a: usize, b: usize| -> Vec<f64> {
            let entry = |(i, j): &(usize, usize)| {
                weights[*i] * weights[*j] * legendre(nodes[*i])[a] * legendre(nodes[*j])[b]
            };
            grid.iter().map(entry).collect()
        };
        let kept = |a: usize| basis.order_of(a) <= k;
        let both = |a: usize| row(a / basis.order(), a % basis.order());
        let beyond = if n > k { k + 1 } else { 0 };
        let mut points: Vec<DVec2> = grid.iter().map(|(i, j)| DVec2::new(nodes[*i], nodes[*j])).collect();
        points.extend(tests.iter().map(|(x, y)| DVec2::new(*x, *y)));
        Self {
            basis,
            trusted,
            unseen,
            nodes: grid.len(),
            projection: (0..basis.len()).map(|a| if kept(a) { both(a) } else { Vec::new() }).collect(),
            beyond_u: (0..beyond).map(|b| row(k, b)).collect(),
            beyond_v: (0..beyond.saturating_sub(1)).map(|a| row(a, k)).collect(),
            functions: points.iter().map(|p| basis.evaluate(*p)).collect(),
            points,
        }
    }

    /// Projects values at the sample points (only the nodes count).
    pub fn project<const N: usize>(&self, values: &[[f64; N]]) -> Projected<N> {
        let apply = |row: &[f64]| {
            let mut sum = [0.0; N];
            for (w, value) in row.iter().zip(values) {
                for n in 0..N {
                    sum[n] += w * value[n];
                }
            }
            sum
        };
        let mut coefficients = [[0.0; N]; MAX_FUNCTIONS];
        for (a, row) in self.projection.iter().enumerate() {
            coefficients[a] = apply(row);
        }
        let energy = |rows: &[Vec<f64>]| {
            rows.iter().map(|row| apply(row).iter().map(|c| c * c).sum::<f64>()).sum::<f64>().sqrt()
        };
        Projected { coefficients, beyond: (energy(&self.beyond_u), energy(&self.beyond_v)) }
    }

    /// The weights of the nodes in coefficient `a`; none if that is left out.
    pub fn projection(&self, a: usize) -> &[f64] {
        &self.projection[a]
    }

    /// Squared residual `Σ_bands (projected − value)²` at sample point `p`.
    pub fn residual_squared<const N: usize>(
        &self,
        p: usize,
        coefficients: &[[f64; N]; MAX_FUNCTIONS],
        value: &[f64; N],
    ) -> f64 {
        let phi = &self.functions[p];
        (0..N)
            .map(|n| {
                let projected: f64 = (0..self.basis.len()).map(|a| phi[a] * coefficients[a][n]).sum();
                let d = projected - value[n];
                d * d
            })
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_function_of_the_space_is_kept_and_leaves_nothing() {
        for basis in [Basis::Haar, Basis::M2, Basis::M3] {
            let rule = SampleRule::new(basis);
            assert!(rule.points.len() <= MAX_SAMPLES);
            let exact: Vec<f64> = (0..basis.len()).map(|a| 1.0 / (a + 1) as f64).collect();
            let at = |p: &DVec2| basis.evaluate(*p).iter().zip(&exact).map(|(f, c)| f * c).sum::<f64>();
            let values: Vec<[f64; 1]> = rule.points.iter().map(|p| [at(p)]).collect();
            let projected = rule.project(&values);
            for (a, c) in exact.iter().enumerate() {
                assert!((projected.coefficients[a][0] - c).abs() < 1e-14);
            }
            assert!(projected.beyond.0 < 1e-14 && projected.beyond.1 < 1e-14);
            for (p, value) in values.iter().enumerate() {
                assert!(rule.residual_squared(p, &projected.coefficients, value) < 1e-26);
            }
        }
    }

    #[test]
    fn a_function_that_vanishes_at_the_nodes_is_caught_by_the_test_points() {
        for basis in [Basis::Haar, Basis::M2, Basis::M3] {
            let rule = SampleRule::new(basis);
            let (nodes, _) = gauss(basis.order() + 1);
            let ripple = |x: f64| nodes.iter().map(|n| 4.0 * (x - n)).product::<f64>();
            let values: Vec<[f64; 1]> = rule.points.iter().map(|p| [ripple(p.x)]).collect();
            let projected = rule.project(&values);
            let worst = (rule.nodes..rule.points.len())
                .map(|p| rule.residual_squared(p, &projected.coefficients, &values[p]))
                .fold(0.0, f64::max);
            assert!(worst > 1e-2, "{basis:?}: {worst}");
        }
    }
}
