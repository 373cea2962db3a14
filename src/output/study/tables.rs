//! Studies as tables: CSV for programs, aligned text for people.

use std::fmt::Write;

use ccnuma::counters::Reading;

use crate::study::Speedup;
use crate::study::replay::Replayed;
use crate::study::speedup::Predicted;

/// Where the time goes is shown for these numbers of workers, the paper's and the next power of two, where they were predicted.
const LOOKED_INTO: [usize; 2] = [36, 64];

/// The machines predicted for, in order.
pub fn machines(study: &Speedup) -> Vec<String> {
    let mut machines: Vec<String> = Vec::new();
    for predicted in &study.predicted {
        if !machines.contains(&predicted.machine) {
            machines.push(predicted.machine.clone());
        }
    }
    machines
}

/// Rows as CSV.
pub(super) fn csv(rows: impl Iterator<Item = Vec<String>>) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.write_record(row).expect("memory takes every row, all of one length");
    }
    String::from_utf8(writer.into_inner().expect("memory takes every row")).expect("rows are text")
}

/// A row of names.
pub(super) fn row(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

fn number<T: ToString>(value: Option<T>) -> String {
    value.map_or_else(|| "unavailable".to_owned(), |value| value.to_string())
}

/// What was measured, a row for each schedule and number of threads; times in seconds.
pub fn measured_csv(study: &Speedup) -> String {
    let header = row(&[
        "schedule",
        "threads",
        "median_s",
        "least_s",
        "greatest_s",
        "runs",
        "speed_up",
        "efficiency",
        "predicted_speed_up",
        "elements",
        "evaluations",
        "balance",
        "memory_overhead",
        "l1_hit_rate",
        "l2_hit_rate",
    ]);
    let rows = study.measured.iter().map(|m| {
        vec![
            m.schedule.clone(),
            m.threads.to_string(),
            m.seconds.median.to_string(),
            m.seconds.least.to_string(),
            m.seconds.greatest.to_string(),
            m.seconds.count.to_string(),
            m.speed_up.to_string(),
            (m.speed_up / m.threads as f64).to_string(),
            number(m.predicted_speed_up),
            m.elements.to_string(),
            m.cost.to_string(),
            number(m.balance.value()),
            number(m.memory_overhead.value()),
            number(m.l1_hit_rate.value()),
            number(m.l2_hit_rate.value()),
        ]
    });
    csv(std::iter::once(header).chain(rows))
}

/// What was predicted, a row for each machine, schedule and number of workers; times in seconds.
pub fn predicted_csv(study: &Speedup) -> String {
    let header = row(&[
        "machine",
        "schedule",
        "workers",
        "nodes",
        "seconds",
        "speed_up",
        "bound",
        "busy_s",
        "remote_s",
        "overhead_s",
        "lock_s",
        "merge_s",
        "barrier_s",
        "alone_s",
        "barriers",
        "steals_near",
        "steals_far",
    ]);
    let rows = study.predicted.iter().map(|p| {
        let r = &p.replayed;
        let seconds = [r.busy_s, r.remote_s, r.overhead_s, r.lock_s, r.merge_s, r.barrier_s, r.alone_s];
        let mut row = vec![p.machine.clone(), p.schedule.clone(), p.workers.to_string(), p.nodes.to_string()];
        row.extend([r.seconds, p.speed_up].map(|value| format!("{value:.6}")));
        row.push(p.bound.map_or_else(String::new, |bound| format!("{bound:.6}")));
        row.extend(seconds.map(|value| format!("{value:.6}")));
        row.extend([r.batches, r.steals_near, r.steals_far].map(|count| count.to_string()));
        row
    });
    csv(std::iter::once(header).chain(rows))
}

/// What was measured, as a table in Markdown.
pub fn measured(study: &Speedup) -> String {
    let mut text = String::from(
        "| schedule | threads | seconds | ± | speed-up | efficiency | predicted | balance |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for m in &study.measured {
        let balance = m.balance.value().map_or("–".to_owned(), |value| format!("{value:.3}"));
        let predicted = m.predicted_speed_up.map_or("–".to_owned(), |value| format!("{value:.3}"));
        let _ = writeln!(
            text,
            "| {} | {} | {:.3} | {:.0} % | {:.3} | {:.3} | {predicted} | {balance} |",
            m.schedule,
            m.threads,
            m.seconds.median,
            100.0 * m.seconds.relative(),
            m.speed_up,
            m.speed_up / m.threads as f64,
        );
    }
    text
}

/// The paper's other metrics, or why they are missing.
pub fn counters(study: &Speedup) -> String {
    let mut text = String::new();
    let mut missing: Vec<String> = Vec::new();
    for m in &study.measured {
        let metrics = [
            ("memory overhead", &m.memory_overhead),
            ("L1 hit rate", &m.l1_hit_rate),
            ("L2 hit rate", &m.l2_hit_rate),
        ];
        for (name, reading) in metrics {
            match reading {
                Reading::Value(value) => {
                    let _ = writeln!(text, "* {} on {}: {name} {value:.4}", m.schedule, m.threads);
                }
                Reading::Unavailable(reason) => {
                    let line = format!("* {name}: unavailable: {reason}");
                    if !missing.contains(&line) {
                        missing.push(line);
                    }
                }
            }
        }
    }
    for line in missing {
        text += &line;
        text.push('\n');
    }
    text
}

/// Predicted speed-ups on one machine, schedules by numbers of workers, as a table in Markdown.
pub fn predicted(study: &Speedup, machine: &str) -> String {
    let here: Vec<&Predicted> = study.predicted.iter().filter(|p| p.machine == machine).collect();
    let (mut workers, mut schedules): (Vec<usize>, Vec<&str>) = (Vec::new(), Vec::new());
    for predicted in &here {
        if !workers.contains(&predicted.workers) {
            workers.push(predicted.workers);
        }
        if !schedules.contains(&predicted.schedule.as_str()) {
            schedules.push(&predicted.schedule);
        }
    }
    let mut text = String::from("| workers |");
    workers.iter().for_each(|n| text += &format!(" {n} |"));
    text += "\n|---|";
    workers.iter().for_each(|_| text += "---:|");
    text.push('\n');
    let find = |schedule: &str, n: usize| here.iter().find(|p| p.schedule == schedule && p.workers == n);
    for schedule in &schedules {
        let _ = write!(text, "| {schedule} |");
        for n in &workers {
            let found = find(schedule, *n).map_or("–".to_owned(), |p| format!("{:.2}", p.speed_up));
            let _ = write!(text, " {found} |");
        }
        text.push('\n');
        let bounds: Vec<f64> = workers.iter().filter_map(|n| find(schedule, *n)?.bound).collect();
        if bounds.len() == workers.len() {
            text += "| … at most |";
            bounds.iter().for_each(|bound| text += &format!(" {bound:.2} |"));
            text.push('\n');
        }
    }
    text
}

/// Where the time of the workers goes on one machine, in percent of all of it, as a table in Markdown.
pub fn where_time_goes(study: &Speedup, machine: &str) -> String {
    let here = || study.predicted.iter().filter(|p| p.machine == machine);
    let most = here().map(|p| p.workers).max();
    let known = |n: &usize| here().any(|p| p.workers == *n);
    let mut looked_into: Vec<usize> = LOOKED_INTO.into_iter().filter(known).collect();
    if looked_into.is_empty() {
        looked_into.extend(most);
    }
    let mut text = String::from(
        "| schedule | workers | tasks | remote data | sharing out | locks | merging | end of batches | alone | barriers | steals near, far |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for predicted in here().filter(|p| looked_into.contains(&p.workers)) {
        let r: &Replayed = &predicted.replayed;
        let all = r.seconds * predicted.workers as f64;
        let _ = write!(text, "| {} | {} |", predicted.schedule, predicted.workers);
        for seconds in [r.busy_s, r.remote_s, r.overhead_s, r.lock_s, r.merge_s, r.barrier_s, r.alone_s] {
            let _ = write!(text, " {:.1} |", 100.0 * seconds / all);
        }
        let _ = writeln!(text, " {} | {}, {} |", r.batches, r.steals_near, r.steals_far);
    }
    text
}

/// Work and span of the recorded runs, and what recording cost.
pub fn records(study: &Speedup) -> String {
    let mut text = String::from(
        "| batches | number | seconds | with the record | alone | loops | longest tasks | longest chains |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for r in &study.records {
        let share = |seconds: f64| format!("{:.2} %", 100.0 * seconds / r.bound.work_s);
        let _ = writeln!(
            text,
            "| {} | {} | {:.3} | {:+.1} % | {} | {} | {} | {} |",
            r.batches,
            r.count,
            r.seconds.median,
            100.0 * (r.recorded_s.median / r.seconds.median - 1.0),
            share(r.bound.alone_s),
            share(r.bound.loops_s),
            share(r.bound.tasks_s),
            share(r.bound.chains_s),
        );
    }
    text
}
