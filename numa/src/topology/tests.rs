//! Tests on machines that are not here.

use super::*;

/// AMD EPYC, two packages of four nodes, 128 cores, two threads each.
pub const EPYC: &str = "pack:2 numa:4 l3:4 l2:4 l1d:1 core:1 pu:2";
/// The paper's machine: 32 nodes of two R10000 with 4 MiB of second-level cache each.
pub const ORIGIN: &str = "numa:32(memory=268435456) l2:2(size=4194304) l1d:1(size=32768) core:1 pu:1";

fn synthetic(description: &str) -> Machine {
    let machine = Machine::synthetic(description).unwrap();
    for cpu in &machine.cpus {
        assert!(
            cpu.node < machine.nodes.len() && cpu.caches.iter().all(|&cache| cache < machine.caches.len())
        );
        assert_eq!(cpu.allowed, machine.nodes[cpu.node].cpus.contains(cpu.os));
    }
    for (from, row) in machine.distances.iter().enumerate() {
        assert_eq!(row.len(), machine.nodes.len());
        assert_eq!(row[from], LOCAL_DISTANCE);
    }
    machine
}

#[test]
fn epyc() {
    let machine = synthetic(EPYC);
    assert_eq!((machine.nodes.len(), machine.cpus.len(), machine.cores()), (8, 256, 128));
    assert_eq!(machine.packages, 2);
    assert!(machine.distances_assumed);
    assert_eq!(machine.nodes_by_distance(5), [5, 6, 4, 7, 3, 0, 2, 1]);
    let [sibling, same_l3, same_node, far] =
        [1, 2, 8, 255].map(|other| machine.closeness(&machine.cpus[0], &machine.cpus[other]));
    assert_eq!(sibling, Closeness::Cache(1));
    assert_eq!(same_l3, Closeness::Cache(3));
    assert_eq!(same_node, Closeness::Node);
    assert_eq!(far, Closeness::Remote(REMOTE_DISTANCE));
    assert!(sibling < same_l3 && same_l3 < same_node && same_node < far);
}

#[test]
fn origin2000() {
    let machine = synthetic(ORIGIN);
    assert_eq!((machine.nodes.len(), machine.cpus.len(), machine.cores()), (32, 64, 64));
    assert_eq!(machine.nodes[7].memory_bytes, 256 << 20);
    assert_eq!(machine.nodes[7].cpus.to_string(), "14-15");
    assert_eq!(machine.caches.iter().find(|cache| cache.level == 2).unwrap().size_bytes, 4 << 20);
}

#[test]
fn fast_memory_beside_dram_owns_no_cpu() {
    let machine = synthetic("pack:2 [numa(memory=64GB)] [numa(memory=16GB)] core:2 pu:1");
    let owners: Vec<bool> = machine.nodes.iter().map(|node| node.has_cpus).collect();
    assert_eq!(owners, [true, false, true, false]);
    assert_eq!(machine.nodes[1].cpus, CpuSet::new());
    assert_eq!(machine.nodes_by_distance(2), [2, 3, 1, 0]);
}

#[test]
fn a_node_over_the_whole_machine_owns_no_cpu() {
    let machine = synthetic("[numa] pack:2 [numa] core:2 pu:1");
    let owners: Vec<bool> = machine.nodes.iter().map(|node| node.has_cpus).collect();
    assert_eq!(owners, [true, true, false]);
}

#[test]
fn node_numbers_may_have_gaps() {
    let machine = synthetic("numa:4(indexes=0,2,4,6) core:1 pu:2");
    assert_eq!(machine.node_position(4), Some(2));
    assert_eq!(machine.node_position(3), None);
    assert_eq!(machine.cpu(5).unwrap().node, 2);
}

#[test]
fn a_mask_that_cuts_a_node_in_half() {
    let mask = "17-31,33".parse().unwrap();
    let machine = synthetic(EPYC).restricted_to(&mask).unwrap();
    assert_eq!(machine.allowed, mask);
    assert_eq!(machine.nodes[0].cpus.to_string(), "17-31");
    assert_eq!(machine.nodes[1].cpus.to_string(), "33");
    assert!(machine.nodes[2].cpus.is_empty() && machine.nodes[2].has_cpus);
    // CPU 17's sibling 16 is not ours, so 17 is its core's first.
    assert_eq!(machine.cpu(17).unwrap().smt, 0);
    assert_eq!(machine.cores(), 9);
}

#[test]
fn a_mask_that_leaves_nothing_is_an_error() {
    let error = synthetic(ORIGIN).restricted_to(&"900".parse().unwrap()).unwrap_err().to_string();
    assert!(error.contains("taskset"), "{error}");
}

#[test]
fn one_cpu_and_two_thousand() {
    assert_eq!(synthetic("numa:1 core:1 pu:1").cores(), 1);
    let machine = synthetic("pack:16 numa:1 core:64 pu:2");
    assert_eq!((machine.cpus.len(), machine.cores(), machine.nodes.len()), (2048, 1024, 16));
    assert!(machine.allowed.contains(2047));
}

#[test]
fn bad_descriptions_are_named() {
    for description in ["", "numa:", "potato:3", "pu:0"] {
        let error = Machine::synthetic(description).unwrap_err().to_string();
        assert!(error.contains("synthetic"), "{error}");
    }
}

#[test]
fn xml_with_distances_gaps_and_a_bad_file() {
    let machine = Machine::from_xml(std::path::Path::new("tests/data/two-nodes-gap.xml")).unwrap();
    assert_eq!(machine.nodes.iter().map(|node| node.os).collect::<Vec<_>>(), [1, 3]);
    assert!(!machine.distances_assumed);
    assert_eq!(machine.distances, [[10, 21], [31, 10]]);
    assert_eq!(machine.cpus.len(), 3, "CPU 2 is offline in the file");
    for path in ["tests/data/none.xml", "Cargo.toml"] {
        let error = Machine::from_xml(std::path::Path::new(path)).unwrap_err().to_string();
        assert!(error.contains(path), "{error}");
    }
}

#[test]
fn this_machine_is_read() {
    let machine = Machine::this_machine().unwrap();
    if machine.source == Source::ThisMachine {
        assert_eq!(&machine.allowed, crate::affinity::process_mask());
    }
}
