//! The machine and the process as far as the system tells: from `/proc`, elsewhere unavailable.

use std::collections::HashSet;
use std::fs;

use serde::{Deserialize, Serialize};

use super::report::Known;

/// The machine a run took place on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// Its name on the network.
    pub host: Known<String>,
    /// The processor's model.
    pub cpu: Known<String>,
    /// Physical cores.
    pub cores: Known<u64>,
    /// Logical CPUs this process may use.
    pub cpus: Known<u64>,
    /// The operating system and its version.
    pub os: Known<String>,
    /// Main memory.
    pub memory_bytes: Known<u64>,
}

impl Machine {
    /// The machine this runs on.
    pub fn this() -> Machine {
        let cpuinfo = read("/proc/cpuinfo");
        let from_cpuinfo = |find: fn(&str) -> Option<String>, what: &str| {
            let text = cpuinfo.as_ref().map_err(String::clone)?;
            find(text).ok_or_else(|| format!("/proc/cpuinfo does not tell {what}"))
        };
        let cores = cpuinfo.as_ref().map_err(String::clone).and_then(|text| {
            cores(text).ok_or_else(|| "/proc/cpuinfo does not tell cores from threads".to_owned())
        });
        let cpus = std::thread::available_parallelism().map(|n| n.get() as u64);
        let line = |path| read(path).map(|text| text.trim().to_owned());
        let os = line("/proc/sys/kernel/ostype")
            .and_then(|kind| line("/proc/sys/kernel/osrelease").map(|release| format!("{kind} {release}")));
        let memory = read("/proc/meminfo").and_then(|text| kibibytes(&text, "MemTotal", "/proc/meminfo"));
        Machine {
            host: line("/proc/sys/kernel/hostname").into(),
            cpu: from_cpuinfo(|text| value(text, "model name"), "the model").into(),
            cores: cores.into(),
            cpus: cpus.map_err(|e| e.to_string()).into(),
            os: os.into(),
            memory_bytes: memory.into(),
        }
    }
}

/// The most memory this process has had resident so far.
pub fn peak_memory_bytes() -> Known<u64> {
    read("/proc/self/status").and_then(|text| kibibytes(&text, "VmHWM", "/proc/self/status")).into()
}

fn read(path: &str) -> Result<String, String> {
    fs::read_to_string(path).map_err(|error| format!("{path} cannot be read: {error}"))
}

/// The value of the first line `key : value`.
fn value(text: &str, key: &str) -> Option<String> {
    let pairs = text.lines().filter_map(|line| line.split_once(':'));
    let mut found = pairs.filter(|(k, _)| k.trim() == key).map(|(_, v)| v.trim().to_owned());
    found.find(|v| !v.is_empty())
}

fn kibibytes(text: &str, key: &str, file: &str) -> Result<u64, String> {
    let number =
        value(text, key).and_then(|v| v.strip_suffix(" kB").and_then(|n| n.trim().parse::<u64>().ok()));
    number.map(|n| n * 1024).ok_or_else(|| format!("{file} has no {key} in kB"))
}

/// Distinct pairs of package and core.
fn cores(cpuinfo: &str) -> Option<u64> {
    let ids =
        cpuinfo.split("\n\n").filter_map(|cpu| Some((value(cpu, "physical id")?, value(cpu, "core id")?)));
    let distinct: HashSet<(String, String)> = ids.collect();
    (!distinct.is_empty()).then_some(distinct.len() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_the_kernel_are_read_and_silence_is_not_zero() {
        let text = "processor : 0\nmodel name\t: Some CPU\nphysical id : 0\ncore id : 0\n\n\
                    processor : 1\nphysical id : 0\ncore id : 0\n\n\
                    processor : 2\nphysical id : 0\ncore id : 1\n";
        assert_eq!(cores(text), Some(2));
        assert_eq!(value(text, "model name").as_deref(), Some("Some CPU"));
        assert_eq!(cores("processor : 0\n"), None);
        assert_eq!(kibibytes("VmHWM:\t  2048 kB\n", "VmHWM", "f"), Ok(2 << 20));
        assert_eq!(kibibytes("", "VmHWM", "f"), Err("f has no VmHWM in kB".to_owned()));
        let missing = Known::<String>::from(read("/nowhere/x"));
        assert!(missing.as_result().unwrap_err().contains("/nowhere/x"));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn this_process_has_a_peak() {
        assert!(peak_memory_bytes().as_result().is_ok_and(|b| *b > 1 << 20));
        assert!(Machine::this().memory_bytes.as_result().is_ok_and(|b| *b > 1 << 24));
    }
}
