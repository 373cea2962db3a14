//! How each point of a bundle takes the light of an emitter cell: judged for four points side by side from what they may lose by it.

use wide::f64x4;

use super::gather::Tolerance;
use super::packet::Detail;
use super::samples::MAX_SAMPLES;
use super::view::Views;
use crate::math::lanes::LANES;

/// Relative error of n × n Gauss quadrature over a cell of size s seen from distance d: `ERROR[n − 1] (s/d)^(2n)`; fitted to the table
/// of numerics §2, doubled for oblique pairs.
const QUADRATURE_ERROR: [f64; 3] = [5.0, 1.5, 0.5];

/// Error of the singularity-subtracted rule per unit of radiosity variation and form factor (measured: numerics §4).
const SUBTRACTION_ERROR: f64 = 0.02;

/// Share of a cell's light that n × n rays may misjudge when they disagree, and when they agree, n from 1 on.
const MIXED_ERROR: [f64; 3] = [0.5, 0.2, 0.1];
const UNANIMOUS_ERROR: [f64; 3] = [0.3, 0.06, 0.02];

/// Candidates from which on rays that agree are believed the less the more there are: each may stand between them for itself, and an object
/// shows several faces. Believed whatever stood in between, furniture left rooms too bright: by 0.24 % at 0.005 (results/accuracy).
const BLOCKERS: f64 = 3.0;

/// Error of the light of visible fragments per unit of radiosity variation and form factor, far from the cell and near it.
const FRAGMENT_ERROR: [f64; 2] = [0.03, 0.1];

/// Registers that a bundle's points take.
pub(super) const GROUPS: usize = MAX_SAMPLES.div_ceil(LANES);

/// What there is to know of a cell and of what its light may lose, irradiances and radiosities in W/m².
pub(super) struct Judge {
    /// Norm of the mean, and of the part that varies.
    pub strength: (f64, f64),
    pub detail: Detail,
    /// Order of the basis.
    pub order: usize,
    pub tolerance: Tolerance,
    /// Whether parts of the cell may be looked at.
    pub splittable: bool,
    /// How many faces may stand in between.
    pub blockers: usize,
}

/// How points take the light of a cell; sets of points are bit masks.
#[derive(Default)]
pub(super) struct How {
    /// For these it must be divided.
    pub divided: u32,
    /// These take it, by Gauss nodes per dimension of the quadrature, from 1 on.
    pub nodes: [u32; 3],
    /// Of these, those that need Lambert's closed form, and those for which the radiosity is as good as constant.
    pub closed_form: u32,
    pub constant: u32,
    /// Those that judge visibility by rays, by rays per dimension, from 1 on; the others need none.
    pub rays: [u32; 3],
    /// What those do that see it in part: they compute the visible part exactly, if few faces stand in between, or divide it; the others believe
    /// the rays.
    pub exact: u32,
    pub split: u32,
    /// For these even a unanimous vote of the rays leaves too much in doubt.
    pub doubt: u32,
    /// Size of the cell over its distance.
    nearest: [f64x4; GROUPS],
}

impl How {
    /// Those that take it.
    pub fn taken(&self) -> u32 {
        self.nodes[0] | self.nodes[1] | self.nodes[2]
    }

    /// Rays per dimension that point `p` judges visibility by; none where it is certain.
    pub fn rays_of(&self, p: usize) -> usize {
        number(&self.rays, p)
    }

    /// Gauss nodes per dimension by which point `p` takes it.
    pub fn nodes_of(&self, p: usize) -> usize {
        number(&self.nodes, p)
    }

    /// Size of the cell over its distance from point `p`.
    pub fn nearest(&self, p: usize) -> f64 {
        self.nearest[p / LANES].to_array()[p % LANES]
    }
}

/// Which of these sets point `p` is in, from 1 on; 0 where in none.
fn number(sets: &[u32; 3], p: usize) -> usize {
    (1..=3).find(|n| sets[n - 1] & 1 << p != 0).unwrap_or(0)
}

/// Share of a cell's light that n × n rays may misjudge when they agree, with so many candidates in between: never more than when they disagree.
fn unanimous_error(n: usize, blockers: usize) -> f64 {
    (UNANIMOUS_ERROR[n - 1] * (blockers as f64 / BLOCKERS).max(1.0)).min(MIXED_ERROR[n - 1])
}

impl Judge {
    /// Judges for those four points of a group that are `active`, a bit mask from the bundle's first point on.
    #[inline]
    pub fn judge(&self, group: usize, views: &Views, active: u32, how: &mut How) {
        let set = |lanes: f64x4| lanes.to_bitmask() << (LANES * group) & active;
        let (relative, absolute) =
            (f64x4::splat(self.tolerance.relative), f64x4::splat(self.tolerance.absolute_w_m2));
        let (mean, variation) = self.strength;
        let estimate = f64x4::splat(mean + variation) * views.form_factor;
        let variation = f64x4::splat(variation) * views.form_factor;
        let allowed = (relative * estimate).fast_max(absolute);
        let half = f64x4::splat(0.5) * allowed;
        let mut taken = active
            & !set((self.detail.seen_w_m2(views.nearest, self.order) * views.form_factor).simd_gt(half));
        let constant = set(variation.simd_le(f64x4::splat(0.1) * allowed)) & taken;

        let ratio2 = views.ratio * views.ratio;
        let ratio4 = ratio2 * ratio2;
        let powers = [ratio2, ratio4, ratio2 * ratio4];
        let smooth =
            |n: usize| set((f64x4::splat(QUADRATURE_ERROR[n]) * powers[n] * estimate).simd_le(half)) & taken;
        let one = smooth(0) & constant;
        let two = smooth(1) & if self.order <= 2 { taken } else { constant } & !one;
        let three = smooth(2) & !(one | two);
        let rough = taken & !(one | two | three);
        if self.splittable {
            taken &= !(rough & !constant & set((f64x4::splat(SUBTRACTION_ERROR) * variation).simd_gt(half)));
        }
        let rough = rough & taken;
        how.divided |= active & !taken;
        how.nodes[0] |= one | rough & constant;
        how.nodes[1] |= two;
        how.nodes[2] |= three | rough & !constant;
        how.closed_form |= rough;
        how.constant |= constant;
        how.nearest[group] = views.nearest;
        if self.blockers > 0 {
            self.shade(set, views, (estimate, variation), (taken, rough), how);
        }
    }

    /// Which rays those cast that take the cell, and what they do where these disagree.
    #[inline]
    fn shade(
        &self,
        set: impl Fn(f64x4) -> u32,
        views: &Views,
        (estimate, variation): (f64x4, f64x4),
        (taken, closed_form): (u32, u32),
        how: &mut How,
    ) {
        let absolute = f64x4::splat(self.tolerance.absolute_w_m2);
        let within = |error: f64, light: f64x4| set((f64x4::splat(error) * light).simd_le(absolute)) & taken;
        let hidden = [1, 2, 3].map(|n| unanimous_error(n, self.blockers));
        // Where a shadow's edge crosses the cell, its detail does not fade: it may well have that edge too, and then all such cells
        // err to the same side.
        let detail = f64x4::splat(self.detail.rms_w_m2) * views.form_factor;
        let edged = set(detail.simd_gt(f64x4::splat(0.05) * absolute)) & taken;
        // Enough rays that a unanimous vote is safe to believe.
        let one = within(hidden[0], estimate) & !edged;
        let two = within(hidden[1], estimate) & !one;
        let doubt = taken & !(one | two | within(hidden[2], estimate));
        let rays = [one, two, taken & !(one | two)];
        let believed = (0..3).map(|n| rays[n] & within(MIXED_ERROR[n], estimate)).sum::<u32>();
        let fragments = if self.splittable {
            let smooth = FRAGMENT_ERROR.map(|error| within(error, variation));
            smooth[0] & !closed_form | smooth[1] & closed_form
        } else {
            taken
        };
        let exact = fragments & !(edged | believed);
        let split = if self.splittable { taken & !(believed | exact) } else { 0 };
        (0..3).for_each(|n| how.rays[n] |= rays[n]);
        how.exact |= exact;
        how.split |= edged | split;
        how.doubt |= doubt;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What one point does: Gauss nodes and rays per dimension, closed form, constant, exact, split, doubt; `None` where it divides.
    type One = Option<(usize, usize, [bool; 5])>;

    /// The rules for one point, one after the other.
    fn alone(judge: &Judge, ratio: f64, nearest: f64, form_factor: f64) -> One {
        let (mean, variation) = judge.strength;
        let (estimate, variation) = ((mean + variation) * form_factor, variation * form_factor);
        let absolute = judge.tolerance.absolute_w_m2;
        let allowed = (judge.tolerance.relative * estimate).max(absolute);
        let Detail { rms_w_m2, max_w_m2 } = judge.detail;
        let detail = (rms_w_m2 * nearest.max(1.0)).min(max_w_m2) * nearest.min(1.0).powi(judge.order as i32);
        let constant = variation <= 0.1 * allowed;
        let smooth = (if constant { 1 } else { judge.order.max(2) }..=3)
            .find(|n| QUADRATURE_ERROR[n - 1] * ratio.powi(2 * *n as i32) * estimate <= 0.5 * allowed);
        let varies = judge.splittable && !constant && SUBTRACTION_ERROR * variation > 0.5 * allowed;
        if detail * form_factor > 0.5 * allowed || smooth.is_none() && varies {
            return None;
        }
        let nodes = smooth.unwrap_or(if constant { 1 } else { 3 });
        if judge.blockers == 0 {
            return Some((nodes, 0, [smooth.is_none(), constant, false, false, false]));
        }
        let edged = rms_w_m2 * form_factor > 0.05 * absolute;
        let enough =
            (1 + edged as usize..=3).find(|n| unanimous_error(*n, judge.blockers) * estimate <= absolute);
        let rays = enough.unwrap_or(3);
        let believed = MIXED_ERROR[rays - 1] * estimate <= absolute;
        let fragments = FRAGMENT_ERROR[smooth.is_none() as usize] * variation <= absolute;
        let exact = !edged && !believed && (fragments || !judge.splittable);
        let split = edged || !believed && !exact && judge.splittable;
        Some((nodes, rays, [smooth.is_none(), constant, exact, split, enough.is_none()]))
    }

    proptest! {
        #[test]
        fn four_points_are_judged_as_one_at_a_time(
            seen in proptest::array::uniform4((-3.0..3.0f64, -3.0..3.0f64, -5.0..0.0f64)),
            (mean, variation, rms, max) in (-1.0..3.0f64, -3.0..2.0f64, -4.0..1.0f64, -4.0..1.0f64),
            (relative, absolute) in (-4.0..-1.0f64, -5.0..1.0f64),
            order in 1..=3usize,
            splittable in proptest::bool::ANY,
            blockers in 0..10usize,
            active in 0..16u32,
        ) {
            let power = |x: f64| 10f64.powf(x);
            let judge = Judge {
                strength: (power(mean), power(variation)),
                detail: Detail { rms_w_m2: power(rms), max_w_m2: power(max) },
                order,
                tolerance: Tolerance { relative: power(relative), absolute_w_m2: power(absolute) },
                splittable,
                blockers,
            };
            let (ratio, nearest) = (seen.map(|s| power(s.0)), seen.map(|s| power(s.1)));
            let form_factor = seen.map(|s| power(s.2));
            let views = Views {
                seen: active,
                ratio: f64x4::from(ratio),
                nearest: f64x4::from(nearest),
                form_factor: f64x4::from(form_factor),
            };
            let mut how = How::default();
            judge.judge(1, &views, active << LANES, &mut how);
            prop_assert_eq!((how.taken() | how.divided) >> LANES, active);
            for i in (0..LANES).filter(|i| active >> i & 1 != 0) {
                let p = LANES + i;
                let is = |set: u32| set >> p & 1 != 0;
                let flags = [how.closed_form, how.constant, how.exact, how.split, how.doubt].map(is);
                let found = (!is(how.divided)).then(|| (how.nodes_of(p), how.rays_of(p), flags));
                prop_assert_eq!(found, alone(&judge, ratio[i], nearest[i], form_factor[i]));
                prop_assert_eq!(how.nearest(p), nearest[i]);
            }
        }
    }
}
