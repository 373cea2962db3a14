//! Numbers drawn at random.

use rand_pcg::rand_core::Rng;

/// A number uniform in [0, 1).
pub fn uniform(random: &mut impl Rng) -> f64 {
    f64::from(random.next_u32()) / 2f64.powi(32)
}
