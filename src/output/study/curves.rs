//! Studies of time against error as tables: CSV for programs, aligned text for people; and as plots.

use std::fmt::Write;

use super::loglog::{LogLog, Series, Style};
use super::tables::{csv, row};
use crate::study::ErrorCurves;
use crate::study::error::{Case, SceneCurves};
use crate::study::truth::Deviation;

/// Errors at which times are compared.
const LEVELS: [f64; 5] = [0.02, 0.01, 0.005, 0.002, 0.001];

/// The basis that others are compared with.
const BASE: &str = "haar";

/// All solutions, a row each; times in seconds, errors as shares.
pub(super) fn csv_of_all(study: &ErrorCurves) -> String {
    let header = row(&[
        "scene",
        "basis",
        "error",
        "median_s",
        "least_s",
        "greatest_s",
        "runs",
        "elements",
        "passes",
        "rays",
        "kernel_evaluations",
        "lambert_evaluations",
        "memory_bytes",
        "estimate",
        "reflected_rms",
        "irradiance_rms",
        "irradiance_median",
        "probes_rms",
        "probes_median",
    ]);
    let mut rows = vec![header];
    for scene in &study.scenes {
        for curve in &scene.curves {
            rows.extend(curve.cases.iter().map(|case| csv_of(&scene.scene, &curve.basis, case)));
        }
    }
    csv(rows.into_iter())
}

fn csv_of(scene: &str, basis: &str, case: &Case) -> Vec<String> {
    let seconds = case.seconds;
    let counts = [case.rays, case.kernel_evaluations, case.lambert_evaluations, case.memory_bytes];
    let errors = [case.estimate, case.reflected.rms, case.irradiance.rms, case.irradiance.median];
    let at_probes =
        |share: fn(Deviation) -> f64| case.at_probes.map_or_else(String::new, |d| share(d).to_string());
    let mut row = vec![scene.to_owned(), basis.to_owned(), case.error.to_string()];
    row.extend([seconds.median, seconds.least, seconds.greatest].map(|s| s.to_string()));
    row.extend([seconds.count.to_string(), case.elements.to_string(), case.passes.to_string()]);
    row.extend(counts.map(|count| count.to_string()));
    row.extend(errors.map(|error| error.to_string()));
    row.extend([at_probes(|d| d.rms), at_probes(|d| d.median)]);
    row
}

/// All tables, in Markdown.
pub fn tables(study: &ErrorCurves) -> String {
    let mut text = String::new();
    for scene in &study.scenes {
        let _ = write!(text, "{}\n\n{}\n{}\n", scene.scene, solutions(scene), levels(scene));
    }
    text + &honesty(study)
}

/// A scene's solutions, as a table in Markdown; errors in percent.
pub(super) fn solutions(scene: &SceneCurves) -> String {
    let mut text = String::from(
        "| basis | asked | seconds | ± | elements | rays | kernel | MB | estimate | reflected | estimate / true | irradiance | median \
         | at probes | median |\n|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for curve in &scene.curves {
        for case in &curve.cases {
            let probes = |share: Option<f64>| share.map_or("–".to_owned(), percent);
            let _ = writeln!(
                text,
                "| {} | {} | {} | {:.0} % | {} | {} | {} | {:.1} | {} | {} | {:.2} | {} | {} | {} | {} |",
                curve.basis,
                percent(case.error),
                short(case.seconds.median),
                100.0 * case.seconds.relative(),
                case.elements,
                case.rays,
                case.kernel_evaluations,
                case.memory_bytes as f64 / 1e6,
                percent(case.estimate),
                percent(case.reflected.rms),
                case.honesty(),
                percent(case.irradiance.rms),
                percent(case.irradiance.median),
                probes(case.at_probes.map(|d| d.rms)),
                probes(case.at_probes.map(|d| d.median)),
            );
        }
        if let Some(error) = curve.too_long {
            let _ =
                writeln!(text, "| {} | {} | too long | | | | | | | | | | | | |", curve.basis, percent(error));
        }
    }
    text
}

/// Seconds to equal errors, as a table in Markdown.
pub(super) fn levels(scene: &SceneCurves) -> String {
    let mut text = String::from("| irradiance to |");
    LEVELS.iter().for_each(|level| text += &format!(" {} |", percent(*level)));
    text += "\n|---|---:|---:|---:|---:|---:|\n";
    levels_by(scene, "", |case| Some(case.irradiance), &mut text);
    if scene.truth.at_probes.is_some() {
        levels_by(scene, ", at probes", |case| case.at_probes, &mut text);
    }
    text
}

fn levels_by(scene: &SceneCurves, whose: &str, judged: fn(&Case) -> Option<Deviation>, text: &mut String) {
    let base = scene.curves.iter().find(|curve| curve.basis == BASE);
    for curve in &scene.curves {
        let _ = write!(text, "| {}{whose} |", curve.basis);
        for level in LEVELS {
            let seconds = curve.seconds_to(level, judged);
            let ratio = base.and_then(|base| Some(base.seconds_to(level, judged)? / seconds?));
            let ratio = ratio.filter(|_| curve.basis != BASE).map(|r| format!(" ({r:.2} ×)"));
            let seconds = seconds.map_or("–".to_owned(), |seconds| format!("{} s", short(seconds)));
            let _ = write!(text, " {seconds}{} |", ratio.unwrap_or_default());
        }
        text.push('\n');
    }
}

/// How the estimates compare with the true errors.
pub(super) fn honesty(study: &ErrorCurves) -> String {
    let cases = study.scenes.iter().flat_map(|scene| &scene.curves).flat_map(|curve| &curve.cases);
    let shares: Vec<f64> = cases.map(Case::honesty).filter(|share| share.is_finite()).collect();
    if shares.is_empty() {
        return "There is no estimate to compare.\n".to_owned();
    }
    let count = |holds: fn(f64) -> bool| shares.iter().filter(|share| holds(**share)).count();
    let least = shares.iter().copied().fold(f64::INFINITY, f64::min);
    let most = shares.iter().copied().fold(0.0, f64::max);
    format!(
        "Of {} estimates {} are on the safe side and {} within a factor of 2 of the true error; they are {least:.2} to {most:.2} times it.\n",
        shares.len(),
        count(|share| share >= 1.0),
        count(|share| (0.5..=2.0).contains(&share)),
    )
}

/// The plots: names of files without extension, and how to draw them.
pub(super) fn plots(study: &ErrorCurves) -> Vec<(String, LogLog<'_>)> {
    let mut plots = Vec::new();
    for scene in &study.scenes {
        let time = LogLog {
            caption: &scene.scene,
            x: "RMS error of irradiance, % (circles: at reference probes)",
            y: "seconds",
            series: over_error(scene, |case| case.seconds.median, true),
            guides: &[],
        };
        let elements = LogLog {
            caption: &scene.scene,
            x: "RMS error of irradiance, %",
            y: "elements",
            series: over_error(scene, |case| case.elements as f64, false),
            guides: &[],
        };
        plots.push((format!("time-{}", scene.scene), time));
        plots.push((format!("elements-{}", scene.scene), elements));
    }
    plots.push(("estimate".to_owned(), estimates(study)));
    plots
}

/// Something over the true error of irradiance, a line for each basis; with the probes, circles for what they say of the error.
fn over_error(scene: &SceneCurves, value: fn(&Case) -> f64, at_probes: bool) -> Vec<Series> {
    let mut series = Vec::new();
    for (colour, curve) in scene.curves.iter().enumerate() {
        let points = |judged: fn(&Case) -> Option<Deviation>| {
            let point = |case: &Case| Some((100.0 * judged(case)?.rms, value(case)));
            curve.cases.iter().filter_map(point).collect()
        };
        let line = points(|case| Some(case.irradiance));
        series.push(Series { label: Some(curve.basis.clone()), points: line, colour, style: Style::Line });
        if at_probes {
            let circles = points(|case| case.at_probes);
            series.push(Series { label: None, points: circles, colour, style: Style::Circles });
        }
    }
    series
}

/// Estimates over true errors, all scenes together.
fn estimates(study: &ErrorCurves) -> LogLog<'_> {
    let mut series = Vec::new();
    let mut names: Vec<&str> = Vec::new();
    let curves = study.scenes.iter().flat_map(|scene| &scene.curves);
    for curve in curves {
        let named = names.iter().position(|name| *name == curve.basis);
        let colour = named.unwrap_or(names.len());
        if named.is_none() {
            names.push(&curve.basis);
        }
        series.push(Series {
            label: named.is_none().then(|| curve.basis.clone()),
            points: curve.cases.iter().map(|c| (100.0 * c.reflected.rms, 100.0 * c.estimate)).collect(),
            colour,
            style: Style::Circles,
        });
    }
    let caption = "Estimates (lines: the true error, and twice it)";
    LogLog {
        caption,
        x: "true error of reflected radiosity, %",
        y: "estimate, %",
        series,
        guides: &[1.0, 2.0],
    }
}

fn percent(share: f64) -> String {
    format!("{} %", short(100.0 * share))
}

/// Three digits that count.
fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let places = (2 - value.abs().log10().floor() as i32).max(0) as usize;
    let text = format!("{value:.places$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_digits_are_shown() {
        assert_eq!(
            [0.0, 0.1, 1.0, 0.01234, 12.345, 1234.5].map(short),
            ["0", "0.1", "1", "0.0123", "12.3", "1234"]
        );
        assert_eq!(percent(0.003), "0.3 %");
    }
}
