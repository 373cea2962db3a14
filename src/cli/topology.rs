//! `wrad topology`: the machine, which worker goes where under a policy, and where workers and their memory really land.

use ccnuma::report::Topology;
use ccnuma::{Machine, Plan, Policy};

use super::arguments::TopologyArguments;
use super::error::{Error, Status};
use super::print;

/// What to show, checked.
#[derive(Clone, Debug)]
pub struct TopologyPlan {
    plan: Plan,
    json: bool,
}

impl TopologyPlan {
    /// Reads the machine and lays the workers over it.
    pub fn new(arguments: TopologyArguments) -> Result<Self, Error> {
        let input = |problem: ccnuma::Error| Error::Input(problem.to_string());
        let machine = match (&arguments.synthetic, &arguments.xml) {
            (Some(description), _) => Machine::synthetic(description),
            (None, Some(path)) => Machine::from_xml(path),
            (None, None) => Machine::this_machine(),
        };
        let policy: Policy = arguments.pin.parse().map_err(input)?;
        let plan = Plan::new(machine.map_err(input)?.into(), policy, arguments.threads).map_err(input)?;
        Ok(Self { plan, json: arguments.json })
    }

    /// Checks the plan live where the machine is this one, and prints it.
    pub fn run(&self) -> Result<Status, Error> {
        let report =
            Topology::check(self.plan.clone()).map_err(|problem| Error::Failed(problem.to_string()))?;
        print(&format!("{}\n", if self.json { report.json() } else { report.text() }));
        Ok(Status::Done)
    }
}
