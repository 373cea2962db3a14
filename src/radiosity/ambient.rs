//! The ambient correction: what is still to arrive, spread as interreflection so far has spread.
//!
//! Of the unshot power U a share κ (received over shot so far) arrives, of that a share ρ̄ is reflected again, and so on:
//! `F = κU/(1 − κρ̄)` in all. Where it is known how much light leaves, none or little, all else must arrive, also what transport has lost on the
//! way: with what is missing, A, the power that all surfaces send less what leaves and what they receive, `F = A/(1 − ρ̄)`, after which sent
//! and received are the same. What is lost counts for little where walls are dark, and a thousand times where they reflect 0.999. Surfaces
//! get F in proportion to what they received by interreflection, so that a dark room beside a bright one stays dark.

use super::state::Tree;

/// Adds the correction to all trees, per band: `shot_w` is the power sent by interreflection so far, `missing_w` what is missing
/// in all where that is known.
pub fn add_ambient<const N: usize>(trees: &mut [Tree<N>], shot_w: &[f64; N], missing_w: Option<&[f64; N]>) {
    let mut unshot_w = [0.0; N];
    let mut indirect_w = [0.0; N];
    let mut reflected_w = [0.0; N];
    for tree in trees.iter() {
        let unshot = tree.unshot_by_band_w();
        for n in 0..N {
            unshot_w[n] += unshot[n];
            indirect_w[n] += tree.indirect_w[n].max(0.0);
            reflected_w[n] += tree.patch.reflectance[n] * tree.indirect_w[n].max(0.0);
        }
    }
    let scale: [f64; N] = std::array::from_fn(|n| {
        if shot_w[n] <= 0.0 || indirect_w[n] <= 0.0 {
            return 0.0;
        }
        let reflectance = reflected_w[n] / indirect_w[n];
        let (captured, missing_w) = match missing_w {
            Some(missing_w) => (1.0, missing_w[n]),
            None => {
                let captured = (indirect_w[n] / shot_w[n]).min(1.0);
                (captured, captured * unshot_w[n])
            }
        };
        missing_w / (1.0 - captured * reflectance) / indirect_w[n]
    });
    for tree in trees.iter_mut() {
        let ambient = std::array::from_fn(|n| scale[n] * tree.indirect_w[n].max(0.0) / tree.area_m2);
        tree.root.add_ambient(ambient);
    }
}
