//! Event groups as data files, one per CPU family, in the manner of likwid's: `SHORT`, `CPUS`, `EVENTS`, `METRICS`,
//! `LONG`. An empty line between events starts a new batch: what the CPU can count at once, at most four.

use serde::Serialize;

use super::cpu::CpuId;
use super::formula::Formula;
use crate::cpuset::CpuSet;

/// What to count.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Event {
    /// Name in formulas and reports.
    pub name: String,
    /// `type` of `perf_event_attr`.
    pub kind: u32,
    /// `config` of `perf_event_attr`.
    pub config: u64,
}

/// A number computed from events.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    /// Name in reports.
    pub name: String,
    /// How.
    pub formula: Formula,
}

/// CPUs that a group is for.
#[derive(Clone, Debug, PartialEq)]
struct Cpus {
    /// `None` is any CPU.
    vendor: Option<String>,
    family: u32,
    models: CpuSet,
}

impl Cpus {
    fn hold(&self, cpu: &CpuId) -> bool {
        self.vendor.as_ref().is_none_or(|vendor| {
            *vendor == cpu.vendor && self.family == cpu.family && self.models.contains(cpu.model as usize)
        })
    }
}

/// A group of events with its metrics and prose.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// File name without extension.
    pub name: String,
    /// One line.
    pub short: String,
    cpus: Vec<Cpus>,
    /// Events by batch.
    pub batches: Vec<Vec<Event>>,
    /// Metrics in order.
    pub metrics: Vec<Metric>,
    /// The explanation.
    pub long: String,
}

/// A line of a group file that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}:{line}: {problem}")]
pub struct GroupError {
    /// Which file.
    pub file: String,
    /// Which line, from 1.
    pub line: usize,
    /// What was expected and found.
    pub problem: String,
}

macro_rules! builtin {
    ($($name:literal),+) => { [$(($name, include_str!(concat!("../../groups/", $name, ".txt")))),+] };
}

/// The groups that come with the crate; the generic one last.
const BUILTIN: [(&str, &str); 8] =
    builtin!("skylake_x", "sapphire_rapids", "zen2", "zen3", "zen4", "neoverse_n1", "neoverse", "generic");

/// Events that one batch may hold: what every CPU of the last fifteen years counts at once.
const MAX_BATCH: usize = 4;

impl Group {
    /// The crate's groups.
    pub fn builtin() -> Result<Vec<Self>, GroupError> {
        BUILTIN.iter().map(|(name, text)| Self::parse(name, text)).collect()
    }

    /// The crate's group for a CPU; the generic one where the CPU is not known.
    pub fn for_cpu(cpu: &CpuId) -> Result<Self, GroupError> {
        // Only the one is read whole: a program may be over in milliseconds.
        let cpus = |text: &'static str| {
            let lines = text.lines().skip_while(|line| *line != "CPUS").skip(1);
            lines.take_while(|line| *line != "EVENTS").filter_map(|line| parse_cpus(line).ok())
        };
        let is_for_it = |(_, text): &&(&str, &'static str)| cpus(text).any(|cpus| cpus.hold(cpu));
        let (name, text) = BUILTIN.iter().find(is_for_it).unwrap_or(&BUILTIN[BUILTIN.len() - 1]);
        Self::parse(name, text)
    }

    /// Whether the group is for this CPU.
    pub fn fits(&self, cpu: &CpuId) -> bool {
        self.cpus.iter().any(|cpus| cpus.hold(cpu))
    }

    /// All events.
    pub fn events(&self) -> impl Iterator<Item = &Event> {
        self.batches.iter().flatten()
    }

    /// Reads a group file; `name` is used in errors and reports.
    pub fn parse(name: &str, text: &str) -> Result<Self, GroupError> {
        let mut group = Self {
            name: name.to_owned(),
            short: String::new(),
            cpus: Vec::new(),
            batches: vec![Vec::new()],
            metrics: Vec::new(),
            long: String::new(),
        };
        let mut section = "";
        for (number, line) in (1..).zip(text.lines()) {
            let line = line.trim_end();
            if let Some(short) = line.strip_prefix("SHORT ") {
                group.short = short.to_owned();
            } else if ["CPUS", "EVENTS", "METRICS", "LONG"].contains(&line) && section != "LONG" {
                section = line;
            } else {
                group.line(section, line).map_err(|problem| GroupError {
                    file: format!("{name}.txt"),
                    line: number,
                    problem,
                })?;
            }
        }
        group.batches.retain(|batch| !batch.is_empty());
        group.long = group.long.trim().to_owned();
        group.check().map_err(|problem| GroupError {
            file: format!("{name}.txt"),
            line: text.lines().count(),
            problem,
        })?;
        Ok(group)
    }

    fn line(&mut self, section: &str, line: &str) -> Result<(), String> {
        match section {
            "LONG" => {
                self.long.push_str(line);
                self.long.push('\n');
            }
            "EVENTS" if line.is_empty() => self.batches.push(Vec::new()),
            _ if line.is_empty() => {}
            "CPUS" => self.cpus.push(parse_cpus(line)?),
            "EVENTS" => {
                let event = parse_event(line)?;
                let batch = self.batches.last_mut().ok_or("no batch")?;
                batch.push(event);
                if batch.len() > MAX_BATCH {
                    return Err(format!(
                        "more than {MAX_BATCH} events in a batch; put an empty line between"
                    ));
                }
            }
            "METRICS" => {
                let (name, formula) = line
                    .split_once('=')
                    .ok_or_else(|| format!("expected `name = formula`, found {line:?}"))?;
                self.metrics.push(Metric { name: name.trim().to_owned(), formula: Formula::parse(formula)? });
            }
            _ => return Err(format!("expected SHORT, CPUS, EVENTS, METRICS or LONG, found {line:?}")),
        }
        Ok(())
    }

    fn check(&self) -> Result<(), String> {
        let known = |name: &str| self.events().filter(|event| event.name == name).count() == 1;
        if let Some(event) = self.events().find(|event| !known(&event.name)) {
            return Err(format!("event {} is given twice", event.name));
        }
        let missing =
            self.metrics.iter().flat_map(|metric| metric.formula.events()).find(|event| !known(event));
        match missing {
            Some(event) => Err(format!("a metric needs event {event}, which is not given")),
            None if self.cpus.is_empty() => Err("no CPUS".to_owned()),
            None => Ok(()),
        }
    }
}

fn parse_cpus(line: &str) -> Result<Cpus, String> {
    if line == "any" {
        return Ok(Cpus { vendor: None, family: 0, models: CpuSet::new() });
    }
    let bad =
        || format!("expected `vendor family models`, such as `AuthenticAMD 25 0-15,32`, found {line:?}");
    let mut words = line.split_whitespace();
    let vendor = words.next().map(str::to_owned);
    let family = words.next().and_then(|word| word.parse().ok()).ok_or_else(bad)?;
    let models = words.next().and_then(|word| word.parse().ok()).ok_or_else(bad)?;
    Ok(Cpus { vendor, family, models })
}

fn parse_event(line: &str) -> Result<Event, String> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let [name, kind, config] = words[..] else {
        return Err(format!("expected `NAME kind 0xconfig`, found {line:?}"));
    };
    let kind = match kind {
        "hardware" => 0,
        "software" => 1,
        "cache" => 3,
        "raw" => 4,
        _ => return Err(format!("expected hardware, software, cache or raw, found {kind:?}")),
    };
    let config = config.strip_prefix("0x").and_then(|digits| u64::from_str_radix(digits, 16).ok());
    let config = config.ok_or_else(|| format!("expected a number such as 0x81d0, found {:?}", words[2]))?;
    Ok(Event { name: name.to_owned(), kind, config })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_files_are_sound_and_say_what_the_issue_asks_for() {
        for group in Group::builtin().unwrap() {
            assert!(!group.short.is_empty() && group.long.contains("Source:"), "{}", group.name);
            let metrics: Vec<_> = group.metrics.iter().map(|metric| metric.name.as_str()).collect();
            assert!(metrics.contains(&"l1_hit_rate"), "{}", group.name);
            if group.name != "generic" {
                assert!(metrics.contains(&"l2_hit_rate") && metrics.contains(&"memory_overhead_perfex"));
            }
        }
    }

    #[test]
    fn each_cpu_gets_its_group() {
        for (vendor, family, model, expected) in [
            ("GenuineIntel", 6, 85, "skylake_x"),
            ("GenuineIntel", 6, 143, "sapphire_rapids"),
            ("AuthenticAMD", 23, 49, "zen2"),
            ("AuthenticAMD", 25, 1, "zen3"),
            ("AuthenticAMD", 25, 17, "zen4"),
            ("AuthenticAMD", 26, 2, "zen4"),
            ("0x41", 8, 0xd0c, "neoverse_n1"),
            ("0x41", 8, 0xd40, "neoverse"),
            ("GenuineIntel", 6, 1, "generic"),
        ] {
            let cpu = CpuId { vendor: vendor.to_owned(), family, model };
            assert_eq!(Group::for_cpu(&cpu).unwrap().name, expected);
        }
    }

    #[test]
    fn bad_lines_are_named() {
        for (text, line, word) in [
            ("CPUS\nany\nEVENTS\nA raw 5", 4, "0x81d0"),
            ("CPUS\nany\nEVENTS\nA steam 0x5", 4, "steam"),
            ("CPUS\nAMD", 2, "vendor family models"),
            ("hello", 1, "SHORT"),
            ("CPUS\nany\nMETRICS\nx = A", 4, "needs event A"),
            ("CPUS\nany\nMETRICS\nx", 4, "formula"),
            ("CPUS\nany\nEVENTS\nA raw 0x1\nA raw 0x2", 5, "twice"),
            ("EVENTS\nA raw 0x1", 2, "no CPUS"),
            ("CPUS\nany\nEVENTS\nA raw 0x1\nB raw 0x1\nC raw 0x1\nD raw 0x1\nE raw 0x1", 8, "empty line"),
        ] {
            let error = Group::parse("test", text).unwrap_err();
            assert_eq!(error.line, line, "{error}");
            assert!(error.to_string().contains(word), "{error}");
        }
    }
}
