//! The report of a run of `wrad solve`, from what each phase knows.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use serde_json::{Value, json};

use crate::output::energy_balance;
use crate::output::machine::{Machine, peak_memory_bytes};
use crate::output::report::{Known, Memory, Outcome, Program, Report, SceneFacts, Times, Work};
use crate::schedule::Batches;
use crate::transport::Oracle;

use super::load::Loaded;
use super::plan::{SolvePlan, Visibility, basis_name};
use super::saved;
use super::solve::Solved;

/// The report; `start` is when the program started.
pub(super) fn of_run(
    plan: &SolvePlan,
    loaded: &Loaded,
    solved: &Solved,
    output_s: f64,
    start: Instant,
) -> Report {
    Report {
        program: Program::this(),
        machine: Machine::this(),
        scene: SceneFacts::new(&loaded.scene, &loaded.surfaces),
        options: options(plan, solved),
        work: work(plan, loaded, solved),
        result: result(solved),
        memory: memory(solved, loaded.occluder.depth()),
        workers: solved.workers.clone(),
        counters: solved.counters.clone(),
        time_s: Times {
            load: loaded.load_s,
            build: loaded.build_s,
            direct: solved.direct_s,
            interreflection: solved.interreflection_s,
            output: output_s,
            total: start.elapsed().as_secs_f64(),
        },
    }
}

fn options(plan: &SolvePlan, solved: &Solved) -> BTreeMap<String, Value> {
    let path = |path: &Path| path.to_string_lossy().into_owned();
    let oracle = match plan.options.oracle {
        Oracle::Energy => json!("energy"),
        Oracle::Geometry => json!("geometry"),
        Oracle::Uniform(levels) => json!({ "uniform": levels }),
    };
    let visibility = match plan.visibility {
        _ if solved.unoccluded => "none",
        Visibility::Bsp => "bsp",
        _ => "bvh",
    };
    let (method, links, link_memory) = match plan.workers.batches {
        Batches::All { link_bytes: 0 } => ("gather", "recompute", None),
        Batches::All { link_bytes } => ("gather", "store", Some(link_bytes)),
        _ => ("shoot", "recompute", None),
    };
    let pairs = [
        ("scene", json!(path(&plan.scene))),
        ("error", json!(plan.options.error)),
        ("basis", json!(basis_name(plan.options.basis))),
        ("method", json!(method)),
        ("links", json!(links)),
        ("link_memory", json!(link_memory)),
        ("oracle", oracle),
        ("visibility", json!(visibility)),
        ("direct_only", json!(plan.options.direct_only)),
        ("schedule", json!(plan.workers.schedule)),
        ("threads", json!(plan.workers.count())),
        ("pin", json!(plan.workers.policy())),
        ("memory", json!(plan.workers.memory.to_string())),
        ("counters", json!(plan.counters.name())),
        ("probes", json!(plan.probes.as_ref().map(|(input, _)| path(input)))),
        ("probes_out", json!(plan.probes.as_ref().map(|(_, out)| path(out)))),
        ("out", json!(plan.out.iter().map(|out| path(out)).collect::<Vec<_>>())),
        ("report", json!(plan.report.as_deref().map(path))),
        ("quiet", json!(plan.quiet)),
    ];
    pairs.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

fn work(plan: &SolvePlan, loaded: &Loaded, solved: &Solved) -> Work {
    let (outcome, done) = (&solved.outcome, &solved.outcome.work);
    Work {
        interactions: done.interactions,
        kernel_evaluations: done.kernel_evaluations,
        lambert_evaluations: done.lambert_evaluations,
        // Asked, but answered without a test.
        visibility_rays: if solved.unoccluded { 0 } else { done.visibility_rays },
        interactions_without_rays: match solved.unoccluded {
            true => done.interactions,
            false => done.interactions_without_rays,
        },
        exact_visibilities: done.exact_visibilities,
        pairs_resolved: done.pairs_resolved,
        pairs_skipped: BTreeMap::from([("behind".to_owned(), done.pairs_behind)]),
        pairs_without_rays: done.pairs_unoccluded,
        transfers_coarse: done.pairs_coarse,
        pairs_clustered: done.pairs_clustered,
        clusters: done.clusters,
        bands_computed: solved.bands_computed as u64,
        shots: outcome.statistics.shots,
        batches: outcome.statistics.batches,
        passes: outcome.passes as u64,
        iterations: outcome.statistics.iterations,
        links_stored: done.links_stored,
        links_reused: done.links_reused,
        longest_receivers: outcome.longest_receivers,
        longest_chains: outcome.longest_chains,
        saved: saved::by_rule(&loaded.scene, &loaded.surfaces, solved, plan.options.direct_only),
    }
}

fn result(solved: &Solved) -> Outcome {
    let outcome = &solved.outcome;
    let solution = &outcome.solution;
    let estimate = match solution.incomplete {
        true => Known::unavailable("the run was cut short"),
        false => Known::Value(solution.error_estimate),
    };
    Outcome {
        elements: outcome.elements,
        error_estimate: estimate,
        unshot_fraction: outcome.unshot_fraction,
        energy_balance: energy_balance(solution),
        transport_lost: match outcome.statistics.lost {
            Some(lost) => Known::Value(lost),
            None => Known::unavailable(
                "only known where surfaces alone emit, light is reflected on, and hardly any leaves",
            ),
        },
        incomplete: solution.incomplete,
    }
}

fn memory(solved: &Solved, visibility_depth: usize) -> Memory {
    let footprint = &solved.outcome.footprint;
    let bytes = footprint.element_bytes;
    let elements = solved.outcome.elements;
    let by_node = |nodes: &Result<BTreeMap<usize, u64>, String>| {
        let named = |nodes: BTreeMap<usize, u64>| {
            nodes.into_iter().map(|(node, count)| (node.to_string(), count)).collect()
        };
        Known::from(nodes.clone().map(named))
    };
    Memory {
        peak_bytes: peak_memory_bytes(),
        bytes_per_element: match elements {
            0 => Known::unavailable("there are no elements"),
            _ => {
                Known::Value((bytes.elements + bytes.coefficients + bytes.outlines) as f64 / elements as f64)
            }
        },
        bytes_by_kind: footprint.bytes_by_kind.iter().map(|(kind, n)| ((*kind).to_owned(), *n)).collect(),
        arena_bytes_per_node: by_node(&footprint.arena_bytes_per_node),
        pages_per_node: by_node(&footprint.pages_per_node),
        pages_at_home: footprint.pages_at_home.clone().into(),
        surfaces_moved: footprint.moved,
        visibility_depth,
        notes: ccnuma::warnings::all(),
    }
}
