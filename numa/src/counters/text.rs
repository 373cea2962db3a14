//! A counter report for people: values by region, and each reason for a missing one said once.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::{CounterReport, Reading};

impl CounterReport {
    /// What is unavailable, by reason.
    pub fn unavailable(&self) -> BTreeMap<&str, Vec<&str>> {
        let mut reasons: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for region in self.total.values() {
            for (name, reading) in region.metrics.iter().chain(&region.events) {
                let Reading::Unavailable(reason) = reading else { continue };
                let names = reasons.entry(reason).or_default();
                if !names.contains(&name.as_str()) {
                    names.push(name);
                }
            }
        }
        reasons
    }

    /// The sums over all workers.
    pub fn text(&self) -> String {
        let mut text = format!("{}: {}\n", self.group, self.description);
        // Writing to a string cannot fail.
        for (name, region) in &self.total {
            let _ = writeln!(text, "{name} (entered {} times)", region.entered);
            for (name, reading) in region.metrics.iter().chain(&region.events) {
                if let Reading::Value(value) = reading {
                    let digits = if value.fract() == 0.0 { 0 } else { 4 };
                    let _ = writeln!(text, "  {name:<24} {value:.digits$}");
                }
            }
        }
        for (reason, names) in self.unavailable() {
            let _ = writeln!(text, "unavailable: {}\n  because {reason}", names.join(", "));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::super::RegionReport;
    use super::*;

    #[test]
    fn reasons_are_said_once_and_values_shown() {
        let none = || Reading::Unavailable("no PMU".to_owned());
        let region = RegionReport {
            entered: 2,
            events: [("A".to_owned(), none()), ("page_faults".to_owned(), Reading::Value(3.0))].into(),
            metrics: [("l1_hit_rate".to_owned(), none())].into(),
        };
        let report = CounterReport {
            group: "generic".to_owned(),
            description: "any CPU".to_owned(),
            total: [("x".to_owned(), region.clone()), ("y".to_owned(), region)].into(),
            workers: Vec::new(),
            leader: BTreeMap::new(),
        };
        let text = report.text();
        assert_eq!(text.matches("no PMU").count(), 1, "{text}");
        assert!(text.contains("unavailable: l1_hit_rate, A") && text.contains("page_faults              3"));
    }
}
