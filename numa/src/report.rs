//! The machine, the plan, and a live check of both, as text with a picture, and as JSON.

use std::collections::BTreeSet;
use std::fmt::Write;

use serde::Serialize;

use crate::affinity;
use crate::cpuset::CpuSet;
use crate::error::Error;
use crate::pages::{Applied, PageCount, Pages, Placement};
use crate::pinning::{Plan, Policy};
use crate::team::{Seat, Team};
use crate::topology::{Machine, Source};

/// Where one worker really runs, and where its memory really lands.
#[derive(Clone, Debug, Serialize)]
pub struct Check {
    /// Worker index.
    pub worker: usize,
    /// The pin, read back.
    pub seat: Seat,
    /// The CPU it was on during the check.
    pub ran_on: Option<usize>,
    /// Whether the pin holds: one CPU, the planned one, and that is where it ran. True for free workers.
    pub pinned_as_planned: bool,
    /// Its node, by the operating system's number.
    pub node: usize,
    /// Whether memory could be bound.
    pub binding: Option<Applied>,
    /// Pages bound to its node, after a touch.
    pub bound_pages: Option<PageCount>,
    /// Pages placed by first touch, after its touch.
    pub first_touch_pages: Option<PageCount>,
    /// Why a page count is missing.
    pub problem: Option<String>,
}

/// A plan and what came of it.
#[derive(Clone, Debug, Serialize)]
pub struct Topology {
    /// The plan, with its machine.
    pub plan: Plan,
    /// One per worker; empty for a machine that is not here.
    pub checks: Vec<Check>,
    /// What had to be replaced by something weaker.
    pub warnings: Vec<String>,
}

impl Topology {
    /// Checks a plan live; one for another machine is only shown.
    pub fn check(plan: Plan) -> Result<Self, Error> {
        let checks = match plan.machine.source {
            Source::ThisMachine => check_live(&plan)?,
            _ => Vec::new(),
        };
        Ok(Self { plan, checks, warnings: crate::warnings::all() })
    }

    /// For people.
    pub fn text(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = self.write_text(&mut text);
        text
    }

    /// For programs: one object, indented.
    pub fn json(&self) -> String {
        match serde_json::to_string_pretty(self) {
            Ok(json) => json,
            Err(error) => unreachable!("a report of plain data is always JSON: {error}"),
        }
    }

    fn write_text(&self, out: &mut String) -> std::fmt::Result {
        let machine = &self.plan.machine;
        write_machine(machine, out)?;
        writeln!(out)?;
        picture(&self.plan, out)?;
        writeln!(out, "\nplan: {} workers, policy {}", self.plan.slots.len(), self.plan.policy)?;
        for (worker, slot) in self.plan.slots.iter().enumerate() {
            let node = machine.nodes[slot.node].os;
            match slot.cpu {
                Some(cpu) => write!(out, "  worker {worker:>3}: CPU {cpu}, node {node}")?,
                None => write!(out, "  worker {worker:>3}: not pinned, counted to node {node}")?,
            }
            if let Some(check) = self.checks.get(worker) {
                write!(out, "{}", check.text())?;
            }
            writeln!(out)?;
        }
        if self.checks.is_empty() {
            writeln!(out, "  (a plan for {}; nothing was run)", machine.source)?;
        }
        self.warnings.iter().try_for_each(|warning| writeln!(out, "note: {warning}"))
    }
}

impl Check {
    fn text(&self) -> String {
        let place =
            |count: &Option<PageCount>| match count.as_ref().and_then(|count| count.share_on(self.node)) {
                Some(share) => format!("{:.0} %", 100.0 * share),
                None => "unknown".to_owned(),
            };
        let ran_on = self.ran_on.map_or("an unknown CPU".to_owned(), |cpu| format!("CPU {cpu}"));
        let verdict = if self.pinned_as_planned { "" } else { " NOT AS PLANNED" };
        let mut text = format!(
            "; ran on {ran_on} (mask {}){verdict}; its memory on its node: bound {}, first touch {}",
            self.seat.mask,
            place(&self.bound_pages),
            place(&self.first_touch_pages),
        );
        if let Some(problem) = &self.problem {
            let _ = write!(text, "; {problem}");
        }
        text
    }
}

/// Starts the plan's team and has every worker look where it and its memory are.
fn check_live(plan: &Plan) -> Result<Vec<Check>, Error> {
    let mut team = Team::new(plan)?;
    let seats = team.seats().to_vec();
    let run = team.run(|worker| {
        let node = worker.node_os();
        let seat = seats[worker.index()].clone();
        let mut check = Check {
            worker: worker.index(),
            ran_on: affinity::current_cpu(),
            pinned_as_planned: true,
            node,
            binding: None,
            bound_pages: None,
            first_touch_pages: None,
            problem: None,
            seat,
        };
        if let Some(cpu) = check.seat.slot.cpu {
            let alone: CpuSet = [cpu].into_iter().collect();
            check.pinned_as_planned =
                check.seat.mask == alone && check.ran_on.is_none_or(|ran_on| ran_on == cpu);
        }
        let mut land = |placement| match land(placement) {
            Ok((applied, count)) => Some((applied, count)),
            Err(error) => {
                check.problem = Some(error.to_string());
                None
            }
        };
        let (bound, touched) = (land(&Placement::Bind(node)), land(&Placement::FirstTouch));
        (check.binding, check.bound_pages) = bound.unzip();
        check.first_touch_pages = touched.map(|(_, count)| count);
        check
    });
    run.map_err(|panic| Error::Spawn { worker: panic.worker, reason: panic.message })
}

/// Maps, touches and counts some pages.
fn land(placement: &Placement) -> Result<(Applied, PageCount), Error> {
    let mut pages = Pages::map_small(1, placement)?;
    pages.populate();
    Ok((pages.applied().clone(), pages.count()?))
}

fn write_machine(machine: &Machine, out: &mut String) -> std::fmt::Result {
    writeln!(
        out,
        "{}: {} packages, {} nodes, {} cores and {} CPUs for this process of {} (allowed: {})",
        machine.source,
        machine.packages,
        machine.nodes.len(),
        machine.cores(),
        machine.allowed.len(),
        machine.cpus.len(),
        machine.allowed,
    )?;
    for node in &machine.nodes {
        let cpus = match (node.cpus.is_empty(), node.has_cpus) {
            (false, _) => format!("CPUs {}", node.cpus),
            (true, true) => "no CPU for this process".to_owned(),
            (true, false) => "memory only".to_owned(),
        };
        writeln!(out, "  node {}: {}, {cpus}", node.os, bytes(node.memory_bytes))?;
    }
    let kinds: BTreeSet<(usize, u64)> =
        machine.caches.iter().map(|cache| (cache.level, cache.size_bytes)).collect();
    for (level, size) in kinds {
        let same =
            || machine.caches.iter().filter(move |cache| (cache.level, cache.size_bytes) == (level, size));
        let shared = same().map(|cache| cache.cpus.len()).max().unwrap_or(0);
        writeln!(out, "  L{level}: {} of {}, each for up to {shared} CPUs", same().count(), bytes(size))?;
    }
    if machine.nodes.len() > 1 {
        let assumed = if machine.distances_assumed { " (assumed: the machine reports none)" } else { "" };
        writeln!(out, "  distances{assumed}:")?;
        for (node, row) in machine.nodes.iter().zip(&machine.distances) {
            let row: Vec<String> = row.iter().map(|distance| format!("{distance:>3}")).collect();
            writeln!(out, "    node {:>3}: {}", node.os, row.join(" "))?;
        }
    }
    Ok(())
}

/// A box per node, a line per largest cache, each CPU with the worker on it.
fn picture(plan: &Plan, out: &mut String) -> std::fmt::Result {
    let machine = &plan.machine;
    for (position, node) in machine.nodes.iter().enumerate() {
        writeln!(out, "+- node {} {}", node.os, "-".repeat(40))?;
        let mut last = None;
        for cpu in machine.cpus.iter().filter(|cpu| cpu.node == position) {
            let cache = cpu.caches.last().copied();
            if last != Some(cache) {
                let name = cache.map_or("no shared cache".to_owned(), |cache| {
                    let cache = &machine.caches[cache];
                    format!("L{} {}", cache.level, bytes(cache.size_bytes))
                });
                write!(out, "{}| {name}:", if last.is_some() { "\n" } else { "" })?;
                last = Some(cache);
            }
            let worker = plan.slots.iter().position(|slot| slot.cpu == Some(cpu.os));
            match worker {
                Some(worker) => write!(out, " [{} w{worker}]", cpu.os)?,
                None if cpu.allowed => write!(out, " [{}]", cpu.os)?,
                None => write!(out, " ({})", cpu.os)?,
            }
        }
        if last.is_none() {
            write!(out, "| memory only")?;
        }
        writeln!(out)?;
    }
    let legend = "[CPU wN]: worker N is pinned there; [CPU]: free; (CPU): not for this process";
    let free = plan.policy == Policy::None;
    writeln!(out, "{legend}{}", if free { "; workers are not pinned" } else { "" })
}

/// Bytes in the largest unit that leaves a number of at least 1.
fn bytes(bytes: u64) -> String {
    let units = ["B", "KiB", "MiB", "GiB", "TiB"];
    let unit = (0..units.len()).rev().find(|&unit| bytes >> (10 * unit) > 0).unwrap_or(0);
    let value = bytes as f64 / (1u64 << (10 * unit)) as f64;
    if value.fract() < 0.05 {
        format!("{value:.0} {}", units[unit])
    } else {
        format!("{value:.1} {}", units[unit])
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    fn report(machine: Machine, policy: &str) -> Topology {
        let plan = Plan::new(machine.into(), policy.parse().unwrap(), None).unwrap();
        Topology::check(plan).unwrap()
    }

    #[test]
    fn this_machine_is_checked_live() {
        let report = report(Machine::this_machine().unwrap(), "compact");
        assert_eq!(report.checks.len(), report.plan.slots.len());
        assert!(report.checks.iter().all(|check| check.pinned_as_planned), "{}", report.text());
        let json: serde_json::Value = serde_json::from_str(&report.json()).unwrap();
        assert_eq!(json["checks"][0]["worker"], 0);
    }

    #[test]
    fn other_machines_are_only_planned() {
        let report = report(Machine::synthetic("pack:2 [numa] [numa] l3:1 core:2 pu:2").unwrap(), "scatter");
        let text = report.text();
        assert!(report.checks.is_empty() && text.contains("nothing was run"));
        for part in ["memory only", "distances (assumed", "[0 w0]", "[4 w1]", "[1]", "policy scatter"] {
            assert!(text.contains(part), "{part} in\n{text}");
        }
    }

    #[test]
    fn sizes_are_readable() {
        assert_eq!([0, 1023, 1 << 20, 3 << 29].map(bytes), ["0 B", "1023 B", "1 MiB", "1.5 GiB"]);
    }
}
