//! Gauss–Legendre quadrature on [0, 1]: exact for polynomials of degree 2n − 1, weights summing to 1.

const NODES: [&[f64]; 5] = [
    &[0.5],
    &[0.211_324_865_405_187_13, 0.788_675_134_594_812_9],
    &[0.112_701_665_379_258_3, 0.5, 0.887_298_334_620_741_7],
    &[0.069_431_844_202_973_71, 0.330_009_478_207_571_87, 0.669_990_521_792_428_1, 0.930_568_155_797_026_3],
    &[0.046_910_077_030_668, 0.230_765_344_947_158_45, 0.5, 0.769_234_655_052_841_5, 0.953_089_922_969_332],
];

const WEIGHTS: [&[f64]; 5] = [
    &[1.0],
    &[0.5, 0.5],
    &[0.277_777_777_777_777_8, 0.444_444_444_444_444_4, 0.277_777_777_777_777_8],
    &[0.173_927_422_568_726_93, 0.326_072_577_431_273_07, 0.326_072_577_431_273_07, 0.173_927_422_568_726_93],
    &[
        0.118_463_442_528_094_54,
        0.239_314_335_249_683_23,
        0.284_444_444_444_444_45,
        0.239_314_335_249_683_23,
        0.118_463_442_528_094_54,
    ],
];

/// Nodes and weights of the rule with `n` nodes, 1 ≤ n ≤ 5.
pub fn gauss(n: usize) -> (&'static [f64], &'static [f64]) {
    (NODES[n - 1], WEIGHTS[n - 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrates_monomials_up_to_degree_2n_minus_1() {
        for n in 1..=5 {
            let (nodes, weights) = gauss(n);
            for degree in 0..2 * n {
                let sum: f64 = nodes.iter().zip(weights).map(|(x, w)| w * x.powi(degree as i32)).sum();
                assert!((sum - 1.0 / (degree as f64 + 1.0)).abs() < 1e-15, "n {n} degree {degree}: {sum}");
            }
        }
    }
}
