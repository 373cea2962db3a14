//! The report of a run (`--report`): one JSON object. A figure that could not be had says so with its
//! reason, never 0.

mod counters;
mod saving;

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::Error;
use super::machine::Machine;
use crate::scene::{Finding, Scene};
pub use counters::{Counted, CounterSource, Counters};
pub use saving::{Bound, Saving};

/// A value, or `{"unavailable": "why"}`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Known<T> {
    /// The value.
    Value(T),
    /// There is none.
    Unavailable {
        /// Why.
        unavailable: String,
    },
}

impl<T> Known<T> {
    /// No value, for this reason.
    pub fn unavailable(reason: impl Into<String>) -> Known<T> {
        Known::Unavailable { unavailable: reason.into() }
    }

    /// The value, or the reason why there is none.
    pub fn as_result(&self) -> Result<&T, &str> {
        match self {
            Known::Value(value) => Ok(value),
            Known::Unavailable { unavailable } => Err(unavailable),
        }
    }
}

impl<T> From<Result<T, String>> for Known<T> {
    fn from(result: Result<T, String>) -> Known<T> {
        result.map_or_else(Known::unavailable, Known::Value)
    }
}

/// Everything about one run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// What ran.
    pub program: Program,
    /// Where it ran.
    pub machine: Machine,
    /// What it was given.
    pub scene: SceneFacts,
    /// All options, resolved, by their names on the command line.
    pub options: BTreeMap<String, Value>,
    /// Where the time went.
    pub time_s: Times,
    /// What was done, and what was skipped.
    pub work: Work,
    /// What came out.
    pub result: Outcome,
    /// What it took in memory.
    pub memory: Memory,
    /// Each worker.
    pub workers: Vec<Worker>,
    /// Cache and memory behaviour of the solve.
    pub counters: Known<Counters>,
}

/// The program.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Program {
    /// Its version.
    pub version: String,
    /// The commit it was built from.
    pub commit: Known<String>,
}

impl Program {
    /// This program; the commit is what `WRAD_COMMIT` held when it was built.
    pub fn this() -> Program {
        let commit = option_env!("WRAD_COMMIT").filter(|c| !c.is_empty()).map(str::to_owned);
        let commit = commit.ok_or_else(|| "WRAD_COMMIT was not set when the program was built".to_owned());
        Program { version: env!("CARGO_PKG_VERSION").to_owned(), commit: commit.into() }
    }
}

/// The scene in numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneFacts {
    /// Its name.
    pub name: String,
    /// Polygons.
    pub faces: u64,
    /// Sides of polygons that take part.
    pub surfaces: u64,
    /// Lights without area, and emissive surfaces.
    pub lights: u64,
    /// Names of the bands.
    pub bands: Vec<String>,
    /// Features of the file that were not read, with how often they occurred.
    pub skipped_features: BTreeMap<String, u64>,
    /// Repairs by rule.
    pub repairs: BTreeMap<String, Finding>,
}

impl SceneFacts {
    /// The facts of a scene with its surfaces.
    pub fn new(scene: &Scene, surfaces: &[crate::scene::Surface]) -> SceneFacts {
        let emissive = surfaces.iter().filter(|s| s.exitance_w_m2.iter().any(|m| *m > 0.0)).count();
        SceneFacts {
            name: scene.name.clone(),
            faces: scene.faces.len() as u64,
            surfaces: surfaces.len() as u64,
            lights: (scene.lights.len() + emissive) as u64,
            bands: scene.bands.clone(),
            skipped_features: scene.findings.skipped.clone(),
            repairs: scene.findings.repairs.clone(),
        }
    }
}

/// Seconds by phase.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Times {
    /// Reading and validating the scene.
    pub load: f64,
    /// Building the visibility structure and the surfaces.
    pub build: f64,
    /// Direct illumination.
    pub direct: f64,
    /// Interreflection.
    pub interreflection: f64,
    /// Writing results.
    pub output: f64,
    /// All of it.
    pub total: f64,
}

/// Work done and avoided.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Work {
    /// Transports between two elements.
    pub interactions: u64,
    /// Evaluations of the kernel without visibility.
    pub kernel_evaluations: u64,
    /// Evaluations of Lambert's closed form.
    pub lambert_evaluations: u64,
    /// Segments tested for occlusion.
    pub visibility_rays: u64,
    /// Interactions for which none was.
    pub interactions_without_rays: u64,
    /// Visible parts of emitters computed exactly.
    pub exact_visibilities: u64,
    /// Pairs of surfaces that were resolved, once for each time that one of them shot.
    pub pairs_resolved: u64,
    /// Pairs of surfaces that needed no transport, by reason.
    pub pairs_skipped: BTreeMap<String, u64>,
    /// Pairs of a receiver and an emitter with nothing in between, which needed no ray.
    pub pairs_without_rays: u64,
    /// Transfers too small to be resolved, for which one sample was taken.
    pub transfers_coarse: u64,
    /// Pairs of surfaces taken in clusters of emitters.
    pub pairs_clustered: u64,
    /// Clusters taken as one, for one receiver each.
    pub clusters: u64,
    /// Bands computed; the others are copies of them.
    pub bands_computed: u64,
    /// Emitters shot in the last pass.
    pub shots: u64,
    /// Batches of emitters in the last pass.
    pub batches: u64,
    /// Passes at decreasing thresholds, the pilot included. The counts above are of all of them.
    pub passes: u64,
    /// How often light was gathered in the last pass; 0 where it is shot.
    pub iterations: u64,
    /// Links that were stored. `memory.bytes_by_kind.links` says what they took.
    pub links_stored: u64,
    /// Transports by stored links; they are no interactions, and need no evaluations.
    pub links_reused: u64,
    /// Share of the last pass' cost, in evaluations, in the costliest receiver of each batch: were receivers not divided between workers, no
    /// number of workers would be faster than this share of the sequential time.
    pub longest_receivers: f64,
    /// The same for the longest chain of parts that wait for each other, from a receiver down to a leaf: no number of workers is faster.
    pub longest_chains: f64,
    /// What each rule that skipped something spared.
    pub saved: BTreeMap<String, Saving>,
}

/// The solution in numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Leaves over all surfaces.
    pub elements: u64,
    /// Estimated relative L2 error of radiosity.
    pub error_estimate: Known<f64>,
    /// Power not yet shot over power emitted.
    pub unshot_fraction: f64,
    /// `1 − Σ A E / Σ A B` over all surfaces and bands: 0 for a closed scene, the share of the light that leaves or falls on
    /// black backs for others.
    pub energy_balance: Known<f64>,
    /// Share of the light sent that transport has lost, or made if it is negative, before the ambient correction made up for it; known where little
    /// or no light leaves the scene, as rays told that `work` does not count.
    pub transport_lost: Known<f64>,
    /// Whether the run was cut short.
    pub incomplete: bool,
}

/// Memory.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Memory {
    /// The most the process had resident.
    pub peak_bytes: Known<u64>,
    /// Bytes of the trees, their inner elements included, per element.
    pub bytes_per_element: Known<f64>,
    /// Bytes by kind: `elements` of all levels, their `coefficients` and `outlines`, `surfaces` (what trees hold besides), `packets` (of the
    /// largest batch) and the `visibility` structure with the copies near the workers, stored `links` (the most at once), and the `solution`.
    pub bytes_by_kind: BTreeMap<String, u64>,
    /// Bytes of the arenas' chunks by the number of the NUMA node they are for.
    pub arena_bytes_per_node: Known<BTreeMap<String, u64>>,
    /// Where the arenas' small pages really are, by the number of the NUMA node.
    pub pages_per_node: Known<BTreeMap<String, u64>>,
    /// Share of the pages that hold elements which is on the home node of these elements' surface.
    pub pages_at_home: Known<f64>,
    /// Trees that moved to another home before a pass, because the work expected or recorded was lopsided.
    pub surfaces_moved: u64,
    /// Nodes on the longest path of the visibility structure, leaves not counted.
    pub visibility_depth: usize,
    /// What the system did not do as asked, such as binding pages.
    pub notes: Vec<String>,
}

/// One worker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Worker {
    /// The CPU it is pinned to.
    pub cpu: Known<u32>,
    /// The NUMA node it works on.
    pub node: Known<u32>,
    /// Seconds in tasks.
    pub busy_s: f64,
    /// Seconds without work, those in which one thread prepared the next batch included.
    pub idle_s: f64,
    /// Seconds looking for work elsewhere, with success.
    pub steal_s: f64,
    /// Seconds waiting in barriers.
    pub barrier_s: f64,
    /// Seconds waiting for locks.
    pub lock_s: f64,
    /// How often it waited for one.
    pub lock_waits: u64,
    /// Pairs that it shot onto a lure, because the receiver was locked.
    pub lures: u64,
    /// Tasks run that came through a queue.
    pub tasks: u64,
    /// Of these, taken from another worker of the node.
    pub steals_near: u64,
    /// Of these, taken from another node.
    pub steals_far: u64,
}

impl Default for Worker {
    fn default() -> Self {
        let none = || Known::unavailable("there was no worker");
        let (busy_s, idle_s, steal_s, barrier_s, lock_s) = (0.0, 0.0, 0.0, 0.0, 0.0);
        let (lock_waits, lures, tasks, steals_near, steals_far) = (0, 0, 0, 0, 0);
        Self {
            cpu: none(),
            node: none(),
            busy_s,
            idle_s,
            steal_s,
            barrier_s,
            lock_s,
            lock_waits,
            lures,
            tasks,
            steals_near,
            steals_far,
        }
    }
}

impl Report {
    /// Writes the report as JSON, whole or not at all.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        super::write_atomically(path, |out| {
            serde_json::to_writer_pretty(&mut *out, self)?;
            out.write_all(b"\n")
        })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::math::Basis;
    use crate::output::rooms;

    /// A report as of a small run.
    pub fn example() -> Report {
        let solution = rooms::gallery(Basis::M2, 1, 0);
        let worker = Worker {
            cpu: Known::Value(1),
            node: Known::Value(0),
            busy_s: 1.9,
            idle_s: 0.08,
            steal_s: 0.02,
            tasks: 120,
            steals_near: 7,
            ..Worker::default()
        };
        Report {
            program: Program::this(),
            machine: Machine::this(),
            scene: SceneFacts::new(&solution.scene, &solution.surfaces),
            options: BTreeMap::from([("error".to_owned(), Value::from(0.01))]),
            time_s: Times {
                load: 0.01,
                build: 0.02,
                direct: 0.5,
                interreflection: 1.7,
                output: 0.1,
                total: 2.33,
            },
            work: Work {
                interactions: 1_230_000,
                kernel_evaluations: 48_100_000,
                lambert_evaluations: 1_300_000,
                visibility_rays: 5_020_000,
                interactions_without_rays: 430_500,
                pairs_resolved: 35_000,
                exact_visibilities: 2_100,
                pairs_skipped: BTreeMap::from([("behind".to_owned(), 320), ("black".to_owned(), 12)]),
                pairs_without_rays: 41_000,
                transfers_coarse: 900,
                pairs_clustered: 12_000,
                clusters: 700,
                bands_computed: 3,
                shots: 96,
                batches: 7,
                passes: 2,
                iterations: 0,
                links_stored: 0,
                links_reused: 0,
                longest_receivers: 0.07,
                longest_chains: 0.01,
                saved: BTreeMap::from([
                    ("behind".to_owned(), Saving::of(320, "pairs", (Bound::About, 0.021, "how"))),
                    (
                        "coarse".to_owned(),
                        Saving::of(75, "pairs", (Bound::AtMost, 0.003, "how")).erring(0.0023),
                    ),
                    ("empty_shafts".to_owned(), Saving::of(4_100_000, "rays", (Bound::About, 1.72, "how"))),
                    ("short_lists".to_owned(), Saving::uncertain(3_300_000, "rays", "nobody timed it")),
                ]),
            },
            result: Outcome {
                elements: 48_213,
                error_estimate: Known::Value(0.0081),
                unshot_fraction: 0.0012,
                energy_balance: Known::unavailable("the scene is open"),
                transport_lost: Known::unavailable("the scene is open"),
                incomplete: false,
            },
            memory: Memory {
                peak_bytes: Known::Value(132 << 20),
                bytes_per_element: Known::Value(312.0),
                bytes_by_kind: BTreeMap::from([
                    ("coefficients".to_owned(), 13 << 20),
                    ("elements".to_owned(), 2 << 20),
                    ("packets".to_owned(), 5 << 20),
                ]),
                arena_bytes_per_node: Known::Value(BTreeMap::from([("0".to_owned(), 15 << 20)])),
                pages_per_node: Known::unavailable("move_pages is not permitted here"),
                pages_at_home: Known::Value(0.998),
                surfaces_moved: 3,
                visibility_depth: 7,
                notes: Vec::new(),
            },
            workers: vec![worker.clone(), worker],
            counters: Known::unavailable("this machine gives access to no hardware counters"),
        }
    }

    #[test]
    fn reports_have_the_keys_of_the_contract_and_read_back() {
        let report = example();
        let json = serde_json::to_value(&report).unwrap();
        let keys = |v: &Value| v.as_object().unwrap().keys().cloned().collect::<Vec<_>>().join(" ");
        assert_eq!(keys(&json), "counters machine memory options program result scene time_s work workers");
        assert_eq!(keys(&json["time_s"]), "build direct interreflection load output total");
        assert_eq!(json["result"]["energy_balance"]["unavailable"], "the scene is open");
        assert!(json["counters"]["unavailable"].is_string());
        assert_eq!(json["memory"]["arena_bytes_per_node"]["0"], 15 << 20);
        assert_eq!(json["work"]["pairs_skipped"]["behind"], 320);
        assert_eq!(serde_json::from_value::<Report>(json).unwrap(), report);
    }
}
