//! The report for people: a dozen aligned lines.

use super::report::{Counted, Known, Memory, Outcome, Report, Saving, Times, Work, Worker};
use super::units::{bytes, count, percent, seconds};

/// What a person wants to know after a run, ending in a line feed.
pub fn summary(report: &Report) -> String {
    let (scene, memory, result) = (&report.scene, &report.memory, &report.result);
    let (surfaces, lights) = (count(scene.surfaces), count(scene.lights));
    let bands = scene.bands.join(" ");
    let each =
        memory.bytes_per_element.as_result().map(|b| format!(", {b:.0} bytes each")).unwrap_or_default();
    let mut lines = vec![
        ("scene", format!("{}: {surfaces} surfaces, {lights} lights, bands {bands}", scene.name)),
        ("time", time(&report.time_s)),
        ("error", error(report)),
        ("unshot", percent(result.unshot_fraction)),
        ("energy", energy(result)),
        ("elements", format!("{}{each}", count(result.elements))),
        ("work", work(&report.work)),
        ("rays", rays(&report.work)),
        ("saved", saved(&report.work)),
        ("memory", self::memory(memory)),
        ("workers", workers(&report.workers)),
        ("counters", counters(report)),
    ];
    if result.incomplete {
        lines.push(("note", "the run was cut short; the solution is incomplete".to_owned()));
    }
    lines.iter().map(|(name, text)| format!("{name:<10}{text}\n")).collect()
}

fn time(time: &Times) -> String {
    let phases = [
        ("load", time.load),
        ("build", time.build),
        ("direct", time.direct),
        ("interreflection", time.interreflection),
        ("output", time.output),
    ];
    let phases: Vec<String> = phases.iter().map(|(name, s)| format!("{name} {}", seconds(*s))).collect();
    format!("{} ({})", seconds(time.total), phases.join(", "))
}

fn work(work: &Work) -> String {
    let (interactions, kernel) = (count(work.interactions), count(work.kernel_evaluations));
    let (rays, shots, batches) = (count(work.visibility_rays), count(work.shots), count(work.batches));
    let passes = work.passes;
    let last = match work.iterations {
        0 => format!("{shots} shots in {batches} batches in the last"),
        iterations => {
            let (stored, reused) = (count(work.links_stored), count(work.links_reused));
            format!("{iterations} iterations in the last; {stored} links stored, used {reused} times")
        }
    };
    format!(
        "{interactions} interactions, {kernel} kernel evaluations, {rays} visibility rays in {passes} passes; {last}"
    )
}

/// How often none was needed.
fn rays(work: &Work) -> String {
    if work.interactions == 0 {
        return "no interactions".to_owned();
    }
    let each = |sum: u64| sum as f64 / work.interactions as f64;
    let without = percent(each(work.interactions_without_rays));
    format!("{:.1} per interaction; {without} of interactions without any", each(work.visibility_rays))
}

/// What each rule spared, the most time first, then what no time is known of; and the error that comes of it.
fn saved(work: &Work) -> String {
    let seconds_of = |saving: &Saving| saving.seconds_estimated.as_result().copied().unwrap_or(-1.0);
    let mut rules: Vec<_> = work.saved.iter().collect();
    rules.sort_by(|a, b| seconds_of(b.1).total_cmp(&seconds_of(a.1)));
    let text = |(rule, saving): (&String, &Saving)| {
        let time = match (saving.bound, saving.seconds_estimated.as_result()) {
            (Some(bound), Ok(s)) => format!(", {bound} {}", seconds(*s)),
            _ => String::new(),
        };
        let error = saving.error_estimate.map(|error| format!(", error {}", percent(error)));
        let spared = format!("{} {} {}", rule.replace('_', " "), count(saving.spared), saving.unit);
        spared + &time + &error.unwrap_or_default()
    };
    match rules.is_empty() {
        true => "nothing".to_owned(),
        false => format!("{} (estimates)", rules.into_iter().map(text).collect::<Vec<_>>().join("; ")),
    }
}

fn known<T>(value: &Known<T>, show: impl Fn(&T) -> String) -> String {
    value.as_result().map_or_else(|reason| format!("unavailable: {reason}"), show)
}

fn energy(result: &Outcome) -> String {
    let balance = known(&result.energy_balance, |balance| format!("balance off by {}", percent(*balance)));
    match result.transport_lost.as_result() {
        Ok(lost) => format!("{balance}; {} that transport lost is made up for", percent(*lost)),
        Err(_) => balance,
    }
}

fn error(report: &Report) -> String {
    let estimate = known(&report.result.error_estimate, |e| format!("{} estimated", percent(*e)));
    match report.options.get("error").and_then(|e| e.as_f64()) {
        Some(target) => format!("{estimate}, {} asked for", percent(target)),
        None => estimate,
    }
}

/// The most, the three kinds that take most of it, and where elements lie if they have a home.
fn memory(memory: &Memory) -> String {
    let mut kinds: Vec<_> = memory.bytes_by_kind.iter().collect();
    kinds.sort_by_key(|(_, bytes)| std::cmp::Reverse(**bytes));
    let most = known(&memory.peak_bytes, |b| format!("{} at most", bytes(*b)));
    let kinds = kinds.iter().take(3).map(|(kind, b)| format!(", {} {kind}", bytes(**b)));
    let at_home = memory.pages_at_home.as_result();
    let at_home = at_home.map(|share| format!("; {} of element pages at home", percent(*share)));
    most + &kinds.collect::<String>() + &at_home.unwrap_or_default()
}

/// How many, and what share of their time went where.
fn workers(workers: &[Worker]) -> String {
    let sum = |of: fn(&Worker) -> f64| workers.iter().map(of).sum::<f64>();
    let parts = [
        ("busy", sum(|w| w.busy_s)),
        ("idle", sum(|w| w.idle_s)),
        ("stealing", sum(|w| w.steal_s)),
        ("in barriers", sum(|w| w.barrier_s)),
        ("locked", sum(|w| w.lock_s)),
    ];
    let total: f64 = parts.iter().map(|(_, s)| s).sum();
    if total <= 0.0 {
        return format!("{}, no time recorded", workers.len());
    }
    let shares: Vec<String> = parts
        .iter()
        .filter(|(_, s)| *s > 0.0)
        .map(|(name, s)| format!("{} {name}", percent(s / total)))
        .collect();
    format!("{}: {}", workers.len(), shares.join(", "))
}

fn counters(report: &Report) -> String {
    known(&report.counters, |counters| {
        let source = format!("{:?}", counters.source).to_lowercase();
        format!("{source}: {}; {}", metrics(&counters.total), events(&counters.total))
    })
}

/// Those that are known, and the names of the others; or why there are none.
fn metrics(counted: &Counted) -> String {
    let (mut found, mut missing, mut why) = (Vec::new(), Vec::new(), "");
    for (name, value) in &counted.metrics {
        let words = name.replace('_', " ");
        match value.as_result() {
            // The one that is not a share of anything: see the groups of events.
            Ok(value) if name == "memory_overhead_perfex" => found.push(format!("{words} {value:.2}")),
            Ok(value) => found.push(format!("{words} {}", percent(*value))),
            Err(reason) => {
                // Any says more than that a group does not offer one.
                why = if why.is_empty() || why.contains("does not offer") { reason } else { why };
                missing.push(words);
            }
        }
    }
    match (found.is_empty(), missing.is_empty()) {
        (true, _) => format!("no cache metrics ({why})"),
        (false, true) => found.join(", "),
        (false, false) => format!("{} (without {})", found.join(", "), missing.join(", ")),
    }
}

/// The kernel's events.
fn events(counted: &Counted) -> String {
    let names = ["page_faults", "context_switches", "cpu_migrations"];
    let texts = names.map(|name| {
        let number = counted.events.get(name).and_then(|event| event.as_result().ok());
        format!("{} {}", number.map_or("unknown".to_owned(), |n| count(*n)), name.replace('_', " "))
    });
    texts.join(", ")
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::output::report::{CounterSource, Counters, tests::example};

    #[test]
    fn a_run_reads_like_this() {
        assert_eq!(
            summary(&example()),
            "\
scene     gallery: 10 surfaces, 1 lights, bands r g b
time      2.33 s (load 10.0 ms, build 20.0 ms, direct 500 ms, interreflection 1.70 s, output 100 ms)
error     0.810 % estimated, 1.00 % asked for
unshot    0.120 %
energy    unavailable: the scene is open
elements  48.2 k, 312 bytes each
work      1.23 M interactions, 48.1 M kernel evaluations, 5.02 M visibility rays in 2 passes; 96 shots in 7 batches in the last
rays      4.1 per interaction; 35.0 % of interactions without any
saved     empty shafts 4.10 M rays, about 1.72 s; behind 320 pairs, about 21.0 ms; coarse 75 pairs, at most 3.00 ms, error 0.230 %; short lists 3.30 M rays (estimates)
memory    132 MiB at most, 13.0 MiB coefficients, 5.00 MiB packets, 2.00 MiB elements; 99.8 % of element pages at home
workers   2: 95.0 % busy, 4.00 % idle, 1.00 % stealing
counters  unavailable: this machine gives access to no hardware counters
"
        );
    }

    fn counted(metrics: &[(&str, Known<f64>)]) -> Counted {
        Counted {
            metrics: metrics.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect(),
            events: BTreeMap::from([
                ("page_faults".to_owned(), Known::Value(1234)),
                ("cpu_migrations".to_owned(), Known::Value(0)),
            ]),
        }
    }

    fn line(source: CounterSource, total: Counted) -> String {
        let mut report = example();
        let group = "zen4".to_owned();
        report.counters = Known::Value(Counters { source, group, total, workers: Vec::new(), leader: None });
        report.result.incomplete = true;
        let text = summary(&report);
        assert!(text.contains("incomplete"), "{text}");
        text.lines().find(|line| line.starts_with("counters")).unwrap().to_owned()
    }

    #[test]
    fn counters_say_whence_they_are_and_what_is_missing() {
        let none = || Known::unavailable("no PMU: ask for one");
        let [l1, perfex] =
            [("l1_hit_rate", Known::Value(0.987)), ("memory_overhead_perfex", Known::Value(1.2))];
        assert_eq!(
            line(CounterSource::Hardware, counted(&[l1.clone(), perfex, ("l2_hit_rate", none())])),
            "counters  hardware: l1 hit rate 98.7 %, memory overhead perfex 1.20 (without l2 hit rate); \
             1.23 k page faults, unknown context switches, 0 cpu migrations"
        );
        assert!(line(CounterSource::Simulated, counted(&[l1])).contains("simulated: l1 hit rate 98.7 %; "));
        let text = line(CounterSource::Software, counted(&[("l1_hit_rate", none())]));
        assert!(text.contains("software: no cache metrics (no PMU: ask for one); 1.23 k"), "{text}");
    }
}
