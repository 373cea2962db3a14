//! Numbers drawn at random, and numbers that look random but follow from what they are for.

use rand_pcg::rand_core::Rng;

/// A number uniform in [0, 1).
pub fn uniform(random: &mut impl Rng) -> f64 {
    f64::from(random.next_u32()) / 2f64.powi(32)
}

/// Takes `part` into a hash: both halves of a product with the golden ratio's digits, so that all bits depend on all of them.
#[inline]
pub fn mix(hash: u64, part: u64) -> u64 {
    let product = u128::from(hash ^ part) * 0x9e37_79b9_7f4a_7c15;
    product as u64 ^ (product >> 64) as u64
}

/// A ratio to be mixed or compared, coarser than by what rounding may change it. The steps are binary, so that fractions such as thirds or
/// hundredths do not lie between two of them.
pub fn coarse(ratio: f64) -> i64 {
    (ratio * f64::from(1 << 20)).round() as i64
}

/// A number of [0, 1) that looks random, for a thing of these ratios: the same wherever it stands, however large it is, whatever its number.
pub fn fraction(ratios: impl IntoIterator<Item = f64>) -> f64 {
    (seed(ratios) >> 11) as f64 / 2f64.powi(53)
}

/// The same as a seed.
pub fn seed(ratios: impl IntoIterator<Item = f64>) -> u64 {
    ratios.into_iter().fold(SEED, |hash, ratio| mix(hash, coarse(ratio) as u64))
}

/// Where hashes of ratios start.
const SEED: u64 = 0xbf58_476d_1ce4_e5b9;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_are_uniform_and_neighbours_have_nothing_to_do_with_each_other() {
        let (mut counts, mut product, n) = ([0u32; 16], 0.0, 10_000);
        let of = |i: i32| fraction([1.5 + f64::from(i % 100) * 1e-4, f64::from(i / 100) * 1e-3]);
        for i in 0..n {
            counts[(16.0 * of(i)) as usize] += 1;
            product += (of(i) - 0.5) * (of(i + 1) - 0.5);
        }
        let expected = f64::from(n) / 16.0;
        let chi_squared: f64 = counts.iter().map(|c| (f64::from(*c) - expected).powi(2) / expected).sum();
        assert!(chi_squared < 40.0, "{chi_squared}: {counts:?}");
        // A correlation: 1/12 is the variance.
        assert!((12.0 * product / f64::from(n)).abs() < 0.04, "{product}");
    }

    #[test]
    fn rounding_does_not_change_what_ratios_make() {
        for ratio in [1.0 / 3.0, 0.1, 0.25, 0.7, 12.34, 1.0 / 128.0] {
            let near = [1.0 - 1e-13, 1.0, 1.0 + 1e-13].map(|by| seed([ratio * by, 2.0]));
            assert!(near[0] == near[1] && near[1] == near[2], "{ratio}");
        }
        assert_ne!(seed([0.1, 0.2]), seed([0.2, 0.1]));
    }
}
