//! The end of memory: a run is stopped while there is still room to write what is done, instead of being killed.
//!
//! Three limits count: what the machine has left, the memory of the control group, and the process's own address space. All
//! are read from Linux' `/proc` and `/sys`; where they are not there, nothing limits.

use std::fs::read_to_string;
use std::path::Path;

use crate::output::units;

/// The room to keep, as a share of what the process holds: the solution is made beside the elements, results beside the solution.
const RESERVE: f64 = 0.6;

/// Address space to keep in any case: a run may take much of it between two looks, however little it holds.
const LEAST_SPACE_BYTES: u64 = 32 << 20;

/// Address space without which no run begins: the stack of the thread that conducts it, and what the allocator reserves for a thread.
const FIRST_SPACE_BYTES: u64 = 128 << 20;

const SPACE: &str = "the limit on address space (ulimit -v)";

/// What may run out.
pub(super) struct Memory {
    /// Of the address space, from the limits of the process.
    space_bytes: Option<u64>,
    /// Of the control group.
    group_bytes: Option<u64>,
}

impl Memory {
    /// Reads the limits of this process.
    pub fn of_this_process() -> Memory {
        let limits = read_to_string("/proc/self/limits").unwrap_or_default();
        let groups = read_to_string("/proc/self/cgroup").unwrap_or_default();
        Memory {
            space_bytes: address_space(&limits),
            group_bytes: group(&groups, Path::new("/sys/fs/cgroup")),
        }
    }

    /// Why no run can begin; `None` where there is room.
    pub fn too_little(&self) -> Option<String> {
        let room = self.space_bytes?.saturating_sub(held()?.0);
        (room < FIRST_SPACE_BYTES).then(|| {
            let (left, needed) = (units::bytes(room), units::bytes(FIRST_SPACE_BYTES));
            format!("too little memory to begin: {SPACE} leaves {left}, and a run needs {needed} at least; raise it")
        })
    }

    /// Why the run must stop now; `None` while there is room.
    pub fn running_out(&self) -> Option<String> {
        let (mapped, resident) = held()?;
        let reserve = (RESERVE * resident as f64) as u64;
        let machine = read_to_string("/proc/meminfo").ok().and_then(|info| available(&info));
        let rooms = [
            ("the machine", reserve, machine),
            ("the control group", reserve, self.group_bytes.map(|limit| limit.saturating_sub(resident))),
            (
                SPACE,
                reserve.max(LEAST_SPACE_BYTES),
                self.space_bytes.map(|limit| limit.saturating_sub(mapped)),
            ),
        ];
        rooms.into_iter().find_map(|(whose, reserve, room)| short(resident, whose, reserve, room?))
    }
}

/// Bytes that this process has mapped, and that are in memory.
fn held() -> Option<(u64, u64)> {
    let statm = read_to_string("/proc/self/statm").ok()?;
    let mut pages = statm.split_whitespace().map_while(|pages| pages.parse::<u64>().ok());
    let page = 4096;
    Some((pages.next()? * page, pages.next()? * page))
}

fn short(resident: u64, whose: &str, reserve: u64, room: u64) -> Option<String> {
    (room < reserve).then(|| {
        let (held, left) = (units::bytes(resident), units::bytes(room));
        format!(
            "stopped because memory runs out: the run holds {held}, and {whose} leaves {left}. \
             What was done is marked incomplete; ask for a larger --error, or give the run more memory"
        )
    })
}

/// The soft limit on address space in a table like `/proc/self/limits`.
fn address_space(limits: &str) -> Option<u64> {
    let row = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    row.split_whitespace().next()?.parse().ok()
}

/// What the machine can still give, from a table like `/proc/meminfo`.
fn available(info: &str) -> Option<u64> {
    let row = info.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(row.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}

/// The least limit of the memory control groups named in a table like `/proc/self/cgroup`, of either version; a container sees its
/// own at the root.
fn group(groups: &str, root: &Path) -> Option<u64> {
    let limits = groups.lines().filter_map(|line| {
        let (controllers, path) = line.split_once(':')?.1.split_once(':')?;
        let (root, file) = match controllers {
            "" => (root.to_owned(), "memory.max"),
            _ if controllers.split(',').any(|name| name == "memory") => {
                (root.join("memory"), "memory.limit_in_bytes")
            }
            _ => return None,
        };
        let own = root.join(path.trim_start_matches('/')).join(file);
        let limit = read_to_string(own).or_else(|_| read_to_string(root.join(file))).ok()?;
        limit.trim().parse::<u64>().ok()
    });
    limits.min()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_read_and_unlimited_is_none() {
        let limits = |value: &str| {
            format!(
                "Limit                     Soft Limit   Hard Limit  Units\nMax address space         {value}  unlimited   bytes\n"
            )
        };
        assert_eq!(address_space(&limits("409600000")), Some(409_600_000));
        assert_eq!(address_space(&limits("unlimited")), None);
        assert_eq!(available("MemTotal: 9 kB\nMemAvailable:    2048 kB\n"), Some(2 << 20));
    }

    #[test]
    fn groups_of_both_versions_limit() {
        let root = tempfile::tempdir().unwrap();
        let put = |path: &str, text: &str| {
            let path = root.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        put("a/memory.max", "max\n");
        assert_eq!(group("0::/a\n", root.path()), None);
        put("a/memory.max", "1000\n");
        assert_eq!(group("0::/a\n", root.path()), Some(1000));
        put("memory/memory.limit_in_bytes", "500\n");
        assert_eq!(group("4:cpu,memory:/elsewhere\n0::/a\n", root.path()), Some(500));
    }

    #[test]
    fn there_must_be_room_to_write() {
        let none = Memory { space_bytes: Some(0), group_bytes: None };
        let why = none.running_out();
        assert!(cfg!(not(target_os = "linux")) || why.is_some_and(|why| why.contains("ulimit -v")));
        assert!(
            cfg!(not(target_os = "linux")) || none.too_little().is_some_and(|why| why.contains("128 MiB"))
        );
        assert_eq!(Memory { space_bytes: None, group_bytes: None }.too_little(), None);
        assert!(short(1 << 30, "the machine", 1 << 29, 1 << 30).is_none());
        let why = short(1 << 30, "the machine", 1 << 29, 1 << 28);
        assert!(why.is_some_and(|text| text.contains("1.00 GiB")));
    }
}
