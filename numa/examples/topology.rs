//! Shows a machine, a plan for it, and, when it is this machine, where workers and their memory really land.
//!
//! `topology [--synthetic DESCRIPTION | --xml FILE] [--pin POLICY] [--workers N] [--json]`

use ccnuma::report::Topology;
use ccnuma::{Machine, Plan, Policy};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut machine = None;
    let mut policy = Policy::Compact;
    let mut workers = None;
    let mut json = false;
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| format!("{argument} needs a value"));
        match argument.as_str() {
            "--synthetic" => machine = Some(Machine::synthetic(&value()?)?),
            "--xml" => machine = Some(Machine::from_xml(value()?.as_ref())?),
            "--pin" => policy = value()?.parse()?,
            "--workers" => workers = Some(value()?.parse()?),
            "--json" => json = true,
            other => return Err(format!("unknown option {other}").into()),
        }
    }
    let machine = machine.map_or_else(Machine::this_machine, Ok)?;
    let report = Topology::check(Plan::new(machine.into(), policy, workers)?)?;
    println!("{}", if json { report.json() } else { report.text() });
    Ok(())
}
