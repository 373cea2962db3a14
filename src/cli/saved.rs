//! What each rule spared that skipped something: counts of the run, and estimates by its own means.
//!
//! All estimates rest on one mean: the seconds of direct light and interreflection over their evaluations (of the kernel, of the closed form,
//! and rays, which take about the same time each), so that all else these phases do is spread over the evaluations. Where a rule spared
//! something that would have cost less than its like, the estimate is a bound; where nothing fair can be said, there is none.

use std::collections::BTreeMap;

use crate::output::report::{Bound, Saving};
use crate::scene::{Scene, Sides, Surface};
use crate::transport::{Unresolved, Work};

use super::solve::Solved;

/// The rules that spared anything.
pub(super) fn by_rule(
    scene: &Scene,
    surfaces: &[Surface],
    solved: &Solved,
    direct_only: bool,
) -> BTreeMap<String, Saving> {
    let time_s = solved.direct_s + solved.interreflection_s;
    let bands = (scene.bands.len(), solved.bands_computed);
    let outcome = &solved.outcome;
    let mut saved = of_work(&outcome.work, time_s, solved.unoccluded);
    if !outcome.solution.incomplete {
        saved = erring(saved, outcome.unresolved_errors);
    }
    saved.extend(of_bands(bands, time_s));
    saved.extend(of_scene(scene, surfaces, direct_only));
    let spared_any = |(_, saving): &(&str, Saving)| saving.spared > 0;
    saved.into_iter().filter(spared_any).map(|(rule, saving)| (rule.to_owned(), saving)).collect()
}

/// With the errors of pairs taken by one sample, and in clusters.
fn erring(saved: Vec<(&'static str, Saving)>, errors: Unresolved) -> Vec<(&'static str, Saving)> {
    let with_error = |(rule, saving): (&'static str, Saving)| match rule {
        "coarse" => (rule, saving.erring(errors.coarse)),
        "clusters" => (rule, saving.erring(errors.clusters)),
        _ => (rule, saving),
    };
    saved.into_iter().map(with_error).collect()
}

/// `over` nothing is nothing.
fn mean(sum: u64, over: u64) -> f64 {
    if over == 0 { 0.0 } else { sum as f64 / over as f64 }
}

/// What rules spared that look at pairs.
fn of_work(work: &Work, time_s: f64, unoccluded: bool) -> Vec<(&'static str, Saving)> {
    // Where nothing stands in between, rays are asked for and not cast.
    let cost = work.cost() - if unoccluded { work.visibility_rays } else { 0 };
    let evaluation_s = if cost == 0 { 0.0 } else { time_s / cost as f64 };
    let resolved = cost.saturating_sub(work.coarse_cost + work.clusters_cost);
    let pair = mean(resolved, work.pairs_resolved);
    let transfer = mean(resolved, work.interactions.saturating_sub(work.pairs_coarse + work.clusters));
    let coarse = mean(work.coarse_cost, work.pairs_coarse);
    let facing = mean(cost, work.pairs_resolved + work.pairs_coarse + work.pairs_clustered);
    let estimate = |bound, evaluations: f64, how| (bound, evaluation_s * evaluations.max(0.0), how);
    let times = |count: u64, each: f64| count as f64 * each;
    vec![
        (
            "behind",
            Saving::of(
                work.pairs_behind,
                "pairs",
                estimate(
                    Bound::About,
                    times(work.pairs_behind, facing),
                    "pairs × mean time of a pair of surfaces that face each other, whether resolved, coarse or in a cluster",
                ),
            ),
        ),
        (
            "hidden",
            Saving::of(
                work.pairs_hidden,
                "pairs",
                estimate(
                    Bound::About,
                    times(work.pairs_hidden, transfer),
                    "pairs of an element and an emitter × mean time of a transfer that was resolved",
                ),
            ),
        ),
        (
            "coarse",
            Saving::of(
                work.pairs_coarse,
                "pairs",
                estimate(
                    Bound::AtMost,
                    times(work.pairs_coarse, pair - coarse),
                    "pairs × (mean time of a pair of surfaces that was resolved − mean time of one sample)",
                ),
            ),
        ),
        ("clusters", of_clusters(work, evaluation_s, coarse)),
        of_rays(work, evaluation_s, unoccluded),
        ("hidden_cells", of_sights(work.sights_hidden, work, evaluation_s)),
        (
            "short_lists",
            Saving::uncertain(
                if unoccluded { 0 } else { work.rays_listed },
                "rays",
                "what these would take by the whole structure is not timed apart",
            ),
        ),
        (
            "stored_links",
            Saving::of(
                work.links_reused,
                "transfers",
                estimate(
                    Bound::About,
                    times(work.links_reused, transfer),
                    "transfers by stored links × mean time of a transfer that was resolved",
                ),
            ),
        ),
    ]
}

fn of_clusters(work: &Work, evaluation_s: f64, coarse: f64) -> Saving {
    if work.pairs_coarse == 0 {
        return Saving::uncertain(
            work.pairs_clustered,
            "pairs",
            "no pair was taken by one sample, so what these would have taken is unknown",
        );
    }
    let evaluations = work.pairs_clustered as f64 * coarse - work.clusters_cost as f64;
    let how = "pairs × mean time of one sample − time of the clusters";
    Saving::of(work.pairs_clustered, "pairs", (Bound::About, evaluation_s * evaluations.max(0.0), how))
}

/// Rays that were not cast because nothing could be in between, in the scene or in shafts.
fn of_rays(work: &Work, evaluation_s: f64, unoccluded: bool) -> (&'static str, Saving) {
    if !unoccluded {
        return ("empty_shafts", of_sights(work.sights_free, work, evaluation_s));
    }
    let spared = work.sights_free + work.visibility_rays;
    let how = "at least one ray for each look of a point at a cell × mean time of an evaluation";
    ("nothing_between", Saving::of(spared, "rays", (Bound::About, evaluation_s * spared as f64, how)))
}

/// Rays that so many looks of points at cells would have needed.
fn of_sights(sights: u64, work: &Work, evaluation_s: f64) -> Saving {
    let (each, how) = match work.sights_by_rays {
        0 => (1.0, "at least one ray for each look of a point at a cell × mean time of an evaluation"),
        by_rays => (
            mean(work.visibility_rays, by_rays),
            "looks of a point at a cell × mean rays of those that needed some × mean time of an evaluation",
        ),
    };
    let spared = (sights as f64 * each) as u64;
    Saving::of(spared, "rays", (Bound::About, evaluation_s * spared as f64, how))
}

fn of_bands((bands, computed): (usize, usize), time_s: f64) -> Option<(&'static str, Saving)> {
    let spared = bands.saturating_sub(computed);
    let seconds = time_s * spared as f64 / computed.max(1) as f64;
    let how = "time of direct light and interreflection × (bands / bands computed − 1)";
    (spared > 0).then(|| ("bands", Saving::of(spared as u64, "bands", (Bound::AtMost, seconds, how))))
}

/// What follows from the scene alone.
fn of_scene(scene: &Scene, surfaces: &[Surface], direct_only: bool) -> Vec<(&'static str, Saving)> {
    let count = |which: &dyn Fn(&Surface) -> bool| surfaces.iter().filter(|s| which(s)).count() as u64;
    let black = |surface: &Surface| surface.reflectance.iter().all(|rho| *rho <= 0.0);
    let one_sided = scene.faces.iter().filter(|face| face.sides == Sides::One).count() as u64;
    let mut saved = vec![(
        "backs",
        Saving::uncertain(
            one_sided,
            "surfaces",
            "the backs of one-sided faces have no elements; what these would have taken is unknown",
        ),
    )];
    saved.push(if direct_only {
        let reason = "how often these would have shot what they reflect is known only by shooting";
        ("direct_only", Saving::uncertain(count(&|s| !black(s)), "surfaces", reason))
    } else {
        let reason = "these reflect nothing: what shooting it would have taken is unknown";
        ("black", Saving::uncertain(count(&black), "surfaces", reason))
    });
    saved
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seconds(saved: &[(&str, Saving)], rule: &str) -> f64 {
        let found = saved.iter().find(|(name, _)| *name == rule).unwrap();
        *found.1.seconds_estimated.as_result().unwrap()
    }

    #[test]
    fn estimates_are_the_runs_own_means() {
        let work = Work {
            interactions: 34,
            kernel_evaluations: 600,
            lambert_evaluations: 100,
            visibility_rays: 300,
            sights_by_rays: 100,
            sights_free: 50,
            sights_hidden: 20,
            pairs_behind: 6,
            pairs_resolved: 4,
            pairs_hidden: 8,
            pairs_coarse: 10,
            coarse_cost: 100,
            clusters: 4,
            clusters_cost: 100,
            pairs_clustered: 30,
            ..Work::default()
        };
        // A millisecond an evaluation, 200 a resolved pair, 40 a transfer, 10 a sample; and 44 pairs that face each other.
        let saved = of_work(&work, 1.0, false);
        let near = |rule: &str, expected: f64| {
            let found = seconds(&saved, rule);
            assert!((found - expected).abs() < 1e-9, "{rule}: {found}");
        };
        near("behind", 6.0 / 44.0);
        near("hidden", 8.0 * 0.04);
        near("coarse", 10.0 * (0.2 - 0.01));
        near("clusters", 30.0 * 0.01 - 0.1);
        near("empty_shafts", 150.0 * 0.001);
        near("hidden_cells", 60.0 * 0.001);
        for (rule, saving) in erring(saved, Unresolved { coarse: 0.01, clusters: 0.002, cut_short: 0.0 }) {
            let expected = [("coarse", 0.01), ("clusters", 0.002)].into_iter().find(|(of, _)| *of == rule);
            assert_eq!(saving.error_estimate, expected.map(|(_, error)| error), "{rule}");
        }
        assert_eq!(of_bands((3, 3), 1.0), None);
        assert_eq!(of_bands((3, 1), 1.0).unwrap().1.seconds_estimated.as_result(), Ok(&2.0));
    }

    #[test]
    fn nothing_done_saves_no_time_and_divides_by_nothing() {
        for (_, saving) in of_work(&Work::default(), 0.0, true) {
            assert!(saving.seconds_estimated.as_result().is_ok_and(|s| *s == 0.0) || saving.how.is_none());
        }
    }
}
