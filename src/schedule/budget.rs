//! The error budget: how the error asked for is divided, and how what links and unshot power lose adds up. Norms and errors in W/m
//! (W/m² · √m²), all bands.
//!
//! | part | share of the target | why |
//! |---|---|---|
//! | links | 0.97, in squares with the next | they cost nearly all the time, so that they get nearly all of the error |
//! | power left unshot | 0.2 | each further tenth costs a few batches of dim shooters only; `0.97² + 0.2² ≈ 1` |
//! | a link that shows at a point | 0.003 | what several bring to a corner is smooth in sum only, and sums are exact on the same elements |
//! | detail of packets left out | 0.02 | far below what links may lose, and it keeps packets small |
//!
//! Errors of links on different elements add up in squares exactly; what they come to in the solution is that root times a calibration,
//! since light is reflected on. All constants were measured on the reference scenes, furnaces and manufactured solutions.

use crate::math::Basis;

/// Share of the error that links may use.
const LINK_SHARE: f64 = 0.97;
/// What the first, second and further passes after a pilot aim at, as shares of what links may lose: one that misses by a little is followed by
/// a whole one, and where links err by more than was predicted once, they may again.
const AIM: [f64; 3] = [0.96, 0.85, 0.75];
/// Share of the error that power left unshot may cause.
const UNSHOT_SHARE: f64 = 0.2;
/// Share of the error, taken as a deviation at a point, above which a link goes down to elements that others have made.
const POINT_SHARE: f64 = 0.003;
/// Share of the error below which detail of packets is averaged. It is not booked: left out, it moved the probes of the three scenes in
/// `scenes/` at errors of 0.03 and 0.01 by 0.01 to 0.05 of the error (once by 0.14), and saved 0.3 to 1.5 % of the evaluations.
const PRUNE_SHARE: f64 = 0.02;
/// Light that is still to come does not spread evenly: RMS over mean.
const SPREAD: f64 = 1.5;
/// The root of the sum of squared link errors, times this, is the error of the solution in dark scenes (calibrated on the reference scenes), in
/// M2 and in other bases.
const LINK_CALIBRATION: (f64, f64) = (0.87, 1.05);
/// Link errors are reflected on. Those of all signs grow with the root of the gain `ρ/(1 − ρ)`, their small mean with the gain itself
/// (calibrated on furnaces and manufactured solutions at ρ 0.5 to 0.999).
const REFLECTED: (f64, f64) = (0.51, 0.165);
/// Below one percent, errors that no sample shows (contacts, thin shadows) fall slower than those of links: the calibration grows with this
/// power of the target under 0.01.
const UNSEEN_GROWTH: f64 = 0.2;
/// In a pilot many shots, each projected for itself, sum up to so many times more than their links show in M2 and M3 (on the reference scenes
/// their estimates at 0.1 were 0.6 to 0.65 of the true error without it, in a room of 200 walls at 0.03 as much).
const SHOT_BY_SHOT: f64 = 1.65;
/// A pilot may err by so many times the target, within these limits.
const PILOT: (f64, f64, f64) = (4.0, 0.02, 0.3);
/// A target at or above this may be met by the pilot. Finer ones want a pass that carries every surface's light once.
const PILOT_ONLY: f64 = 0.1;
/// A pilot whose direct light errs by at most this share of the target is to meet it.
const HOPEFUL: f64 = 0.7;
/// A pilot whose direct light errs by more than this many times the target's share of the direct light's norm will not meet it: interreflection
/// adds to the norm, but errors of its own too.
const HOPELESS: f64 = 1.2;
/// How much coarser its links may then become: what coarser ones lose, they do not see.
const COARSEST: f64 = 64.0;

/// The budget of a run.
#[derive(Clone, Copy, Debug)]
pub(super) struct Budget {
    /// Relative L2 error of reflected radiosity asked for.
    pub target: f64,
    pub basis: Basis,
    /// `ρ/(1 − ρ)` of the RMS reflectance: how much reflected light a watt causes.
    pub gain: f64,
    /// Root of the scene's area, in m.
    pub root_area_m: f64,
}

impl Budget {
    /// Relative error of a pilot.
    pub fn pilot_error(&self) -> f64 {
        (PILOT.0 * self.target).clamp(PILOT.1, PILOT.2)
    }

    /// The threshold to begin with, where the norm is a guess; links are the more the more surfaces there are.
    pub fn first_threshold_w_m(&self, guess_w_m: f64, surfaces: usize) -> f64 {
        self.pilot_error() * guess_w_m / (32.0 * (surfaces.max(1) as f64).powf(0.25))
    }

    /// Whether a pilot may be all that the target takes.
    pub fn pilot_may_suffice(&self) -> bool {
        self.target >= PILOT_ONLY
    }

    /// What to multiply the threshold of a pilot that is to meet the target by after its direct light, for that to be computed again; `None`
    /// where it may do. Interreflection takes many times as long, and would have to be repeated too.
    pub fn again(&self, direct_error_w_m: f64, norm_w_m: f64) -> Option<f64> {
        let most = HOPELESS * self.target * norm_w_m;
        (direct_error_w_m > most).then(|| (most / direct_error_w_m).powf(1.0 / self.growth()))
    }

    /// How much coarser the links of a pilot that is to meet the target may become after its direct light, whose error is known; `None`
    /// where it is not to.
    pub fn coarser(&self, direct_error_w_m: f64, norm_w_m: f64) -> Option<f64> {
        let wanted = self.target * norm_w_m;
        let hopeful = wanted > 0.0 && direct_error_w_m <= HOPEFUL * wanted;
        hopeful.then(|| (wanted / direct_error_w_m).powf(1.0 / self.growth()).clamp(1.0, COARSEST))
    }

    /// What to multiply the threshold by after so many passes, so that link errors fall to what they may be, and a little below; they fall with
    /// this power of it.
    pub fn finer(&self, passes: usize, link_error_w_m: f64, norm_w_m: f64, growth: f64) -> f64 {
        let aim = AIM[passes.clamp(1, AIM.len()) - 1] * LINK_SHARE * self.target * norm_w_m;
        (aim / link_error_w_m).min(1.0).powf(1.0 / growth).max(1e-4)
    }

    /// Link errors grow with this power of the threshold, which depends on the order.
    pub fn growth(&self) -> f64 {
        match self.basis {
            Basis::Haar => 0.5,
            Basis::M2 => 0.6,
            Basis::M3 | Basis::Auto => 0.65,
        }
    }

    /// What links whose squared errors sum up to this in W²/m² come to in the solution.
    pub fn link_error_w_m(&self, error_squared: f64) -> f64 {
        let unseen = (0.01 / self.target).max(1.0).powf(UNSEEN_GROWTH);
        let reflected = (REFLECTED.0 * self.gain.sqrt()).hypot(REFLECTED.1 * self.gain);
        let calibration = if self.basis == Basis::M2 { LINK_CALIBRATION.0 } else { LINK_CALIBRATION.1 };
        calibration * reflected.hypot(1.0) * unseen * error_squared.sqrt()
    }

    /// How many times what its links come to a pilot errs by.
    pub fn shot_by_shot(&self) -> f64 {
        if self.basis == Basis::Haar { 1.0 } else { SHOT_BY_SHOT }
    }

    /// Whether link errors are small enough.
    pub fn links_suffice(&self, link_error_w_m: f64, norm_w_m: f64) -> bool {
        link_error_w_m <= LINK_SHARE * self.target * norm_w_m
    }

    /// What leaving this power unshot costs.
    pub fn unshot_error_w_m(&self, unshot_w: f64) -> f64 {
        SPREAD * unshot_w * self.gain / self.root_area_m
    }

    /// Whether a pass that erred by this much by links and by power left unshot meets the target.
    pub fn is_met(&self, link_error_w_m: f64, unshot_error_w_m: f64, norm_w_m: f64) -> bool {
        link_error_w_m.hypot(unshot_error_w_m) <= self.target * norm_w_m
    }

    /// The power in W that a pass may leave unshot that may err by `allowed_w_m`.
    pub fn stop_w(&self, allowed_w_m: f64) -> f64 {
        UNSHOT_SHARE * allowed_w_m * self.root_area_m / (SPREAD * self.gain.max(1e-9))
    }

    /// Detail of packets below this is averaged, in W/m².
    pub fn prune_w_m2(&self, allowed_w_m: f64) -> f64 {
        PRUNE_SHARE * allowed_w_m / self.root_area_m
    }

    /// Deviation at a point in W/m² above which a link goes down to finer elements.
    pub fn point_w_m2(&self, allowed_w_m: f64) -> f64 {
        match self.basis {
            // Constants deviate everywhere: all links would go down all the way.
            Basis::Haar => f64::INFINITY,
            Basis::M2 | Basis::M3 | Basis::Auto => POINT_SHARE * allowed_w_m / self.root_area_m,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_add_up_to_the_target_and_inverses_are_inverse() {
        for (target, gain) in [(0.3, 0.5), (0.01, 1.0), (0.001, 9.0)] {
            let budget = Budget { target, basis: Basis::M3, gain, root_area_m: 4.0 };
            let (norm, allowed) = (2.5, target * 2.5);
            let unshot = budget.unshot_error_w_m(budget.stop_w(allowed));
            let most = LINK_SHARE * allowed;
            let links = 0.9999 * most;
            assert!(budget.links_suffice(links, norm) && !budget.links_suffice(1.01 * links, norm));
            assert!((links.hypot(unshot) / allowed - 1.0).abs() < 0.01);
            assert!(budget.is_met(links, unshot, norm) && budget.is_met(allowed, 0.0, norm));
            assert!(!budget.is_met(links, 1.3 * unshot, norm) && !budget.is_met(1.001 * allowed, 0.0, norm));
            assert_eq!(budget.finer(1, 0.5 * links, norm, budget.growth()), 1.0, "good links stay");
            for (passes, aim) in [(1, AIM[0]), (2, AIM[1]), (9, AIM[2])] {
                let finer = budget.finer(passes, 3.0 * most, norm, budget.growth());
                assert!((finer.powf(budget.growth()) * 3.0 - aim).abs() < 1e-12);
            }
            assert_eq!(budget.again(allowed, norm), None);
            let again = budget.again(2.0 * HOPELESS * allowed, norm).unwrap();
            assert!((again.powf(budget.growth()) - 0.5).abs() < 1e-12);
            assert_eq!(budget.coarser(allowed, norm), None);
            assert!(budget.coarser(0.1 * allowed, norm).unwrap() > 1.0);
        }
    }
}
