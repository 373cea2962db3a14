//! The README of a study: what was run where, what came out, and how to run it again.

use std::fmt::Write;

use serde_json::Value;

use super::tables;
use super::{ErrorReport, SpeedupStudy, curves};
use crate::output::machine::Machine;
use crate::output::report::{Known, Program, SceneFacts};
use crate::study::error::{FINER, SceneCurves};

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

/// A title, how to run it again, and where it ran.
fn head(title: &str, command: Option<&Value>, program: &Program, machine: &Machine) -> String {
    let mut text = format!("# {title}\n\n    {}\n\n", command.and_then(Value::as_str).unwrap_or_default());
    let _ = writeln!(text, "* wrad {}, commit {}", program.version, known(&program.commit));
    let _ = writeln!(
        text,
        "* {}: {}, {} CPUs; {}",
        known(&machine.host),
        known(&machine.cpu),
        known(&machine.cpus),
        known(&machine.os)
    );
    text
}

fn size(scene: &SceneFacts) -> String {
    format!("{} surfaces, {} lights", scene.surfaces, scene.lights)
}

/// The README of a study of speed-up, with the plots and the machines they are of.
pub(super) fn speedup(study: &SpeedupStudy, plots: &[(String, String)]) -> String {
    let SpeedupStudy { program, machine, scene, options, result } = study;
    let mut text = head(&format!("Speed-up on {}", scene.name), options.get("command"), program, machine);
    let _ = writeln!(text, "* {}", size(scene));
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

/// What needs to be said of every error.
const WHAT_IS_TRUE: &str = "\
One thread. Repetitions are interleaved; ± is half the range over the median. *Asked*, *estimate* and *reflected* are of the same error, the L2
norm of reflected radiosity over that of the truth; *irradiance* is RMS |E − E*| / RMS E* over all points and bands, *median* that of the
worst band's |E − E*| over the mean E*. MB: elements, packets, the visibility structure and the solution.
";

/// The README of a study of time against error; `plots` are names of files.
pub(super) fn error(study: &ErrorReport, plots: &[String]) -> String {
    let ErrorReport { program, machine, scenes, options, result } = study;
    let names: Vec<&str> = scenes.iter().map(|scene| scene.name.as_str()).collect();
    let title = format!("Time against error on {}", names.join(", "));
    let mut text = head(&title, options.get("command"), program, machine);
    scenes.iter().for_each(|scene| text += &format!("* {}: {}\n", scene.name, size(scene)));
    let _ = write!(
        text,
        "\n{WHAT_IS_TRUE}Errors are measured at {} points spread over all surfaces by area, against a solution {FINER} times finer than the least\n\
         error asked for, and at the reference probes where a scene has them: the first shares what all solutions may have in common, the\n\
         second carries noise.\n",
        result.points
    );
    for (scene, name) in result.scenes.iter().zip(names) {
        let _ = write!(text, "\n## {name}\n\n{}\n", truth(scene));
        let own = |plot: &&String| plot.ends_with(&format!("-{}.svg", scene.scene));
        plots.iter().filter(own).for_each(|plot| text += &format!("![{plot}]({plot})\n"));
        let _ = write!(text, "\n{}\n", curves::solutions(scene));
        let _ = write!(
            text,
            "Seconds to an equal RMS error of irradiance, and how many times faster than haar:\n\n{}",
            curves::levels(scene)
        );
    }
    let _ = write!(text, "\n## Estimates\n\n![estimates](estimate.svg)\n\n{}", curves::honesty(result));
    text
}

/// What is known of the finer solution.
fn truth(scene: &SceneCurves) -> String {
    let truth = &scene.truth;
    let mut text = format!(
        "The finer solution: {}, error asked for {:.3} %, estimated {:.3} %, {} elements,\n{:.1} s",
        truth.basis,
        100.0 * truth.error,
        100.0 * truth.estimate,
        truth.elements,
        truth.seconds
    );
    if let Some(deviation) = truth.at_probes {
        let noise = truth.noise.map(|noise| format!("; their noise: {:.3} %", 100.0 * noise));
        let _ = write!(
            text,
            "; {:.3} % off at the reference probes (median {:.3} %{}).\nWhat is below that in the tables is how solutions agree, not how true they are",
            100.0 * deviation.rms,
            100.0 * deviation.median,
            noise.unwrap_or_default()
        );
    }
    text + ".\n"
}
