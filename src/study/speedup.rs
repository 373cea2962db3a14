//! Speed-up: one problem solved by several schedules on several numbers of workers, measured here and predicted elsewhere.
//!
//! All runs of a repetition follow each other before the next repetition begins, so that a slow quarter of an hour falls on all alike; the first
//! repetition warms up and does not count. Every run has a team of its own, started before the clock. The base of all speed-ups is the least
//! median on one thread, whoever reached it.

use ccnuma::counters::{Counters, CpuId, Group, Reading, RegionReport};
use ccnuma::team::Times;
use ccnuma::{Machine, Plan, Policy, Team};
use serde::Serialize;

use crate::schedule::{Batches, COUNTED, Observer, Record, Schedule, solve_by, solve_recorded};

use super::replay::{Bound, Model, Replayed, Site, bound, replay};
use super::run::{Problem, StudyError, timed, whole};
use super::statistics::Spread;

/// A schedule that takes part.
#[derive(Clone, Copy, Debug)]
pub struct Contestant {
    /// Its name.
    pub name: &'static str,
    /// Whether it has a team, and how many surfaces shoot at once; `None` where it is only predicted.
    pub measured: Option<(bool, Batches)>,
    /// How it is replayed, and from a record of which batches; `None` where it is only measured.
    pub model: Option<(Model, Batches)>,
}

/// What is to be run and predicted.
#[derive(Clone, Debug)]
pub struct Study {
    /// Who takes part.
    pub contestants: Vec<Contestant>,
    /// Numbers of workers to measure.
    pub threads: Vec<usize>,
    /// Repetitions that count.
    pub repeat: usize,
    /// Where workers are pinned.
    pub pin: Policy,
    /// This machine.
    pub here: Machine,
    /// Numbers of workers to predict.
    pub predict: Vec<usize>,
    /// Machines to predict for, by their descriptions.
    pub machines: Vec<(String, Machine)>,
}

/// What came out.
#[derive(Clone, Debug, Serialize)]
pub struct Speedup {
    /// Who was fastest on one thread.
    pub base: String,
    /// Its median: what all speed-ups are relative to.
    pub base_s: f64,
    /// All that was measured.
    pub measured: Vec<Measured>,
    /// All that was predicted.
    pub predicted: Vec<Predicted>,
    /// The recorded runs.
    pub records: Vec<Recorded>,
}

/// One schedule on so many workers.
#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    /// The schedule.
    pub schedule: String,
    /// Workers.
    pub threads: usize,
    /// Seconds from start to end of solving.
    pub seconds: Spread,
    /// The base over the median.
    pub speed_up: f64,
    /// The same, predicted for this machine.
    pub predicted_speed_up: Option<f64>,
    /// Leaf elements.
    pub elements: u64,
    /// Evaluations.
    pub cost: u64,
    /// Busy seconds of all workers together over those of the busiest times their number, of the last run.
    pub balance: Reading,
    /// Time waiting for memory over total time, of the last run.
    pub memory_overhead: Reading,
    /// Data accesses answered by the first-level cache, of the last run.
    pub l1_hit_rate: Reading,
    /// Those that missed it and were answered by the second, of the last run.
    pub l2_hit_rate: Reading,
}

/// A prediction.
#[derive(Clone, Debug, Serialize)]
pub struct Predicted {
    /// The machine's description.
    pub machine: String,
    /// The schedule.
    pub schedule: String,
    /// Workers.
    pub workers: usize,
    /// Nodes they sit on.
    pub nodes: usize,
    /// The base over the predicted time.
    pub speed_up: f64,
    /// What no schedule with the same batches exceeds; none for schedules without batches.
    pub bound: Option<f64>,
    /// Where the time goes.
    pub replayed: Replayed,
}

/// A recorded run.
#[derive(Clone, Debug, Serialize)]
pub struct Recorded {
    /// Who shoots.
    pub batches: &'static str,
    /// Its number of batches.
    pub count: usize,
    /// Seconds of the same run without a record.
    pub seconds: Spread,
    /// Seconds with it.
    pub recorded_s: Spread,
    /// Work and span.
    pub bound: Bound,
}

/// One run to be measured.
struct Entry {
    name: &'static str,
    on_team: bool,
    batches: Batches,
    threads: usize,
    seconds: Vec<f64>,
    last: Option<Last>,
}

/// What the last run of an entry was like.
struct Last {
    elements: u64,
    cost: u64,
    times: Option<Vec<Times>>,
    counted: RegionReport,
}

/// A record in the making.
struct Tape {
    batches: Batches,
    plain: Vec<f64>,
    recorded: Vec<f64>,
    record: Option<Record>,
}

impl Study {
    /// Runs all of it; `watch` is asked whether to stop.
    ///
    /// # Errors
    /// See [`StudyError`].
    pub fn run(&self, problem: Problem<'_>, watch: &mut dyn Observer) -> Result<Speedup, StudyError> {
        let mut entries = self.entries();
        let mut tapes = self.tapes();
        for repetition in 0..=self.repeat {
            for tape in &mut tapes {
                tape.run(problem, watch, repetition > 0)?;
            }
            for entry in &mut entries {
                entry.run(problem, self, watch, repetition > 0)?;
            }
        }
        Ok(self.result(&entries, tapes))
    }

    fn entries(&self) -> Vec<Entry> {
        let mut entries = Vec::new();
        for contestant in &self.contestants {
            let Some((on_team, batches)) = contestant.measured else { continue };
            let threads = if on_team { &self.threads[..] } else { &[1] };
            entries.extend(threads.iter().map(|threads| Entry {
                name: contestant.name,
                on_team,
                batches,
                threads: *threads,
                seconds: Vec::new(),
                last: None,
            }));
        }
        entries
    }

    /// A record for each kind of batches that somebody is replayed from; fitted batches always, for the base.
    fn tapes(&self) -> Vec<Tape> {
        let mut kinds = vec![Batches::Fitted];
        for (_, batches) in self.contestants.iter().filter_map(|contestant| contestant.model) {
            if !kinds.contains(&batches) {
                kinds.push(batches);
            }
        }
        let tape = |batches| Tape { batches, plain: Vec::new(), recorded: Vec::new(), record: None };
        kinds.into_iter().map(tape).collect()
    }

    fn result(&self, entries: &[Entry], tapes: Vec<Tape>) -> Speedup {
        let mut records: Vec<(Batches, Record)> = Vec::new();
        let mut recorded = Vec::new();
        let mut base: Option<(f64, String)> = None;
        let mut offer = |seconds: f64, name: String| {
            if base.as_ref().is_none_or(|(least, _)| seconds < *least) {
                base = Some((seconds, name));
            }
        };
        for tape in tapes {
            let (Some(seconds), Some(recorded_s)) = (Spread::of(&tape.plain), Spread::of(&tape.recorded))
            else {
                continue;
            };
            let batches = if tape.batches == Batches::Fitted { "fitted" } else { "single" };
            offer(seconds.median, format!("sequential, {batches} batches"));
            let mut record = tape.record.unwrap_or_default();
            record.smooth();
            // What the record itself cost is taken off again, evenly.
            record.scale(seconds.median / record.seconds().max(f64::MIN_POSITIVE));
            let (bound, count) = (bound(&record), record.batches().count());
            recorded.push(Recorded { batches, count, seconds, recorded_s, bound });
            records.push((tape.batches, record));
        }
        for entry in entries.iter().filter(|entry| entry.threads == 1) {
            let seconds = Spread::of(&entry.seconds);
            seconds.into_iter().for_each(|seconds| offer(seconds.median, entry.name.to_owned()));
        }
        let (base_s, base) = base.unwrap_or((f64::NAN, "nobody".to_owned()));
        let record = |batches: Batches| records.iter().find(|(kind, _)| *kind == batches).map(|(_, r)| r);
        let predictor = Predictor { contestants: &self.contestants, record: &record, base_s };
        Speedup {
            measured: entries.iter().filter_map(|entry| self.measured(entry, base_s, &predictor)).collect(),
            predicted: self.predicted(&predictor),
            records: recorded,
            base,
            base_s,
        }
    }

    fn measured(&self, entry: &Entry, base_s: f64, predictor: &Predictor<'_>) -> Option<Measured> {
        let (seconds, last) = (Spread::of(&entry.seconds)?, entry.last.as_ref()?);
        let here = Site::new(&self.here, entry.threads).ok();
        let predicted = here.and_then(|site| predictor.predict(entry.name, &site));
        Some(Measured {
            schedule: entry.name.to_owned(),
            threads: entry.threads,
            seconds,
            speed_up: base_s / seconds.median,
            predicted_speed_up: predicted.map(|(speed_up, ..)| speed_up),
            elements: last.elements,
            cost: last.cost,
            balance: balance(last.times.as_deref()),
            memory_overhead: last.counted.metric("memory_overhead_stalls"),
            l1_hit_rate: last.counted.metric("l1_hit_rate"),
            l2_hit_rate: last.counted.metric("l2_hit_rate"),
        })
    }

    fn predicted(&self, predictor: &Predictor<'_>) -> Vec<Predicted> {
        let mut predicted = Vec::new();
        for (name, machine) in &self.machines {
            let sites = self.predict.iter().filter_map(|workers| Site::new(machine, *workers).ok());
            for site in sites {
                for contestant in &self.contestants {
                    let Some((speed_up, bound, replayed)) = predictor.predict(contestant.name, &site) else {
                        continue;
                    };
                    predicted.push(Predicted {
                        machine: name.clone(),
                        schedule: contestant.name.to_owned(),
                        workers: site.workers(),
                        nodes: site.nodes(),
                        speed_up,
                        bound,
                        replayed,
                    });
                }
            }
        }
        predicted
    }
}

/// Replays by name.
struct Predictor<'a> {
    contestants: &'a [Contestant],
    record: &'a dyn Fn(Batches) -> Option<&'a Record>,
    base_s: f64,
}

impl Predictor<'_> {
    /// Speed-up, its bound, and where the time goes.
    fn predict(&self, name: &str, site: &Site) -> Option<(f64, Option<f64>, Replayed)> {
        let contestant = self.contestants.iter().find(|contestant| contestant.name == name)?;
        let (model, batches) = contestant.model?;
        let record = (self.record)(batches)?;
        let replayed = replay(record, site, model);
        let least_s = bound(record).least_s(site.workers());
        let limit = matches!(model, Model::Stealing | Model::WholeReceivers).then(|| self.base_s / least_s);
        Some((self.base_s / replayed.seconds, limit, replayed))
    }
}

impl Tape {
    fn run(
        &mut self,
        problem: Problem<'_>,
        watch: &mut dyn Observer,
        counts: bool,
    ) -> Result<(), StudyError> {
        let Problem { scene, surfaces, occluder, options } = problem;
        let schedule = Schedule { batches: self.batches, ..Schedule::default() };
        let (outcome, plain_s) = timed(|| solve_by(schedule, scene, surfaces, occluder, options, watch));
        whole(&outcome?)?;
        let record = || solve_recorded(self.batches, scene, surfaces, occluder, options, watch);
        let ((outcome, record), recorded_s) = timed(record);
        whole(&outcome)?;
        if counts {
            self.plain.push(plain_s);
            self.recorded.push(recorded_s);
            match &mut self.record {
                None => self.record = Some(record),
                Some(least) => least.keep_least(&record)?,
            }
        }
        Ok(())
    }
}

impl Entry {
    fn run(
        &mut self,
        problem: Problem<'_>,
        study: &Study,
        watch: &mut dyn Observer,
        counts: bool,
    ) -> Result<(), StudyError> {
        let Problem { scene, surfaces, occluder, options } = problem;
        let batches = self.batches;
        let plan = |n| Plan::new(study.here.clone().into(), study.pin.clone(), Some(n));
        let mut team = self.on_team.then(|| Team::new(&plan(self.threads)?)).transpose()?;
        let mut counters = Counters::open(team.as_mut(), Group::for_cpu(&CpuId::this())?)?;
        let schedule =
            Schedule { team: team.as_mut(), batches, counters: Some(&counters), ..Schedule::default() };
        let (outcome, seconds) = timed(|| solve_by(schedule, scene, surfaces, occluder, options, watch));
        let (outcome, times) = (outcome?, team.as_mut().map(Team::times));
        let counted = counters.report().total.remove(COUNTED).unwrap_or_default();
        whole(&outcome)?;
        if counts {
            self.seconds.push(seconds);
            let (elements, cost) = (outcome.elements, outcome.work.cost());
            self.last = Some(Last { elements, cost, times, counted });
        }
        Ok(())
    }
}

/// Mean over greatest busy time.
fn balance(times: Option<&[Times]>) -> Reading {
    let Some(times) = times else { return Reading::Unavailable("there is no team".to_owned()) };
    let busy = times.iter().map(|times| times.busy_s);
    let (sum, most) = (busy.clone().sum::<f64>(), busy.fold(0.0, f64::max));
    if most > 0.0 {
        Reading::Value(sum / times.len() as f64 / most)
    } else {
        Reading::Unavailable("no worker was busy".to_owned())
    }
}
