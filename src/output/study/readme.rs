//! The README of a study: what was run where, what came out, and how to run it again.

use std::fmt::Write;

use serde_json::Value;

use super::SpeedupStudy;
use super::tables;
use crate::output::report::Known;

/// What needs to be said of every prediction.
const HOW: &str = "\
Speed-ups are relative to the least median on one thread. Repetitions are interleaved; ± is half the range over the median. Predictions
replay a recorded sequential run, task by task and part by part; synthetic machines have assumed distances, and neither shared caches nor
the width of memory are modelled. *At most* is what no schedule with the same batches exceeds: the work over the workers, or the span.

Where the time goes, in percent of the time of all workers: *tasks*, the work itself; *remote data*, tasks away from their home; *sharing
out*, queues, forks and steals; *locks*, waiting for a locked receiver; *merging*, private copies; *end of batches*, waiting for the last
worker and starting the next batch; *alone*, one thread at work while the others wait, and the ends of loops over all receivers.
";

fn known<T: std::fmt::Display>(value: &Known<T>) -> String {
    value.as_result().map_or_else(|reason| format!("unavailable ({reason})"), T::to_string)
}

/// The README of a study of speed-up, with the plots and the machines they are of.
pub(super) fn speedup(study: &SpeedupStudy, plots: &[(String, String)]) -> String {
    let SpeedupStudy { program, machine, scene, options, result } = study;
    let mut text = format!("# Speed-up on {}\n\n", scene.name);
    let option = |name: &str| match &options.get(name) {
        Some(Value::String(text)) => text.clone(),
        Some(other) => other.to_string(),
        None => String::new(),
    };
    let _ = writeln!(text, "    {}\n", option("command"));
    let _ = writeln!(text, "* wrad {}, commit {}", program.version, known(&program.commit));
    let _ = writeln!(
        text,
        "* {}: {}, {} CPUs; {}",
        known(&machine.host),
        known(&machine.cpu),
        known(&machine.cpus),
        known(&machine.os)
    );
    let _ = writeln!(text, "* {} surfaces, {} lights", scene.surfaces, scene.lights);
    let _ = writeln!(text, "* base: {:.3} s, {}\n", result.base_s, result.base);
    text += HOW;
    let _ = write!(text, "\n## Measured here\n\n{}\n{}", tables::measured(result), tables::counters(result));
    let _ = write!(text, "\n## Recorded runs\n\nShares of the work.\n\n{}", tables::records(result));
    for (plot, machine) in plots {
        let _ = write!(text, "\n## Predicted for `{machine}`\n\n![speed-up]({plot})\n\n");
        text += &tables::predicted(result, machine);
        let _ = write!(text, "\n{}", tables::where_time_goes(result, machine));
    }
    text
}
