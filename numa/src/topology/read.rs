//! Fills the table from hwloc.
//!
//! Three traps are handled here. A memory-only node reports the CPUs it is near to, so which CPUs a node *owns* is
//! read from sysfs on the real machine, and elsewhere is decided by the most specific node (lowest number on a tie).
//! `HWLOC_SYNTHETIC` and `HWLOC_XMLFILE` silently replace the machine: [`Source::Environment`] says so. And the
//! allowed set is the mask snapshot taken by [`crate::affinity`], never the mask of a thread pinned meanwhile.

use std::path::Path;

use hwlocality::Topology;
use hwlocality::object::TopologyObject;
use hwlocality::object::attributes::ObjectAttributes;
use hwlocality::object::types::ObjectType;
use hwlocality::topology::builder::TopologyBuilder;

use super::{Cache, Cpu, Machine, Node, Source};
use crate::affinity;
use crate::cpuset::CpuSet;
use crate::error::Error;

fn failed(what: &Source, reason: impl std::fmt::Display) -> Error {
    Error::Topology { what: what.to_string(), reason: reason.to_string() }
}

pub(super) fn this_machine() -> Result<Machine, Error> {
    let mask = affinity::process_mask();
    let topology = Topology::new().map_err(|error| failed(&Source::ThisMachine, error))?;
    if !topology.is_this_system() {
        return table(Source::Environment, &topology, &|_| None);
    }
    table(Source::ThisMachine, &topology, &sysfs_cpus)?.restricted_to(mask)
}

pub(super) fn synthetic(description: &str) -> Result<Machine, Error> {
    let source = Source::Synthetic(description.to_owned());
    let builder = Topology::builder().from_synthetic(description);
    build(builder.map_err(|error| failed(&source, error))?, source)
}

pub(super) fn xml(path: &Path) -> Result<Machine, Error> {
    let source = Source::Xml(path.display().to_string());
    // Read by us, because hwloc says only "invalid" for a missing file.
    let text = std::fs::read_to_string(path).map_err(|error| failed(&source, error))?;
    let builder = Topology::builder().from_xml(&text);
    build(builder.map_err(|error| failed(&source, error))?, source)
}

fn build(builder: TopologyBuilder, source: Source) -> Result<Machine, Error> {
    let topology = builder.build().map_err(|error| failed(&source, error))?;
    table(source, &topology, &|_| None)
}

/// The CPUs a node owns, as the kernel lists them; `None` where the kernel does not.
fn sysfs_cpus(node: usize) -> Option<CpuSet> {
    let list = std::fs::read_to_string(format!("/sys/devices/system/node/node{node}/cpulist")).ok()?;
    list.parse().ok()
}

/// All CPU (or node) numbers of an object's set.
fn set_of(object: &TopologyObject) -> CpuSet {
    object.cpuset().map(|set| set.iter_set().map(usize::from).collect()).unwrap_or_default()
}

fn table(
    source: Source,
    topology: &Topology,
    owned: &dyn Fn(usize) -> Option<CpuSet>,
) -> Result<Machine, Error> {
    let mut node_objects: Vec<_> = topology.objects_with_type(ObjectType::NUMANode).collect();
    node_objects.sort_by_key(|object| object.os_index());
    let mut machine = Machine {
        source,
        cpus: Vec::new(),
        nodes: node_objects.iter().map(|object| node(object)).collect(),
        caches: Vec::new(),
        packages: topology.objects_with_type(ObjectType::Package).count().max(1),
        distances: Vec::new(),
        distances_assumed: false,
        allowed: CpuSet::new(),
    };
    let owned: Vec<Option<CpuSet>> = machine.nodes.iter().map(|node| owned(node.os)).collect();
    let near: Vec<CpuSet> = node_objects.iter().map(|object| set_of(object)).collect();
    let cache_ids = caches(topology, &mut machine);
    for object in topology.objects_with_type(ObjectType::PU) {
        let cpu = cpu(object, &owned, &near, &cache_ids);
        machine.nodes[cpu.node].has_cpus = true;
        machine.cpus.push(cpu);
    }
    let Machine { nodes, cpus, .. } = &mut machine;
    for (node, near) in nodes.iter_mut().zip(&near) {
        node.packages = cpus.iter().filter(|cpu| near.contains(cpu.os)).map(|cpu| cpu.package).collect();
    }
    if !read_distances(topology, &mut machine) {
        machine.assume_distances();
    }
    let all = machine.cpus.iter().map(|cpu| cpu.os).collect();
    machine.restricted_to(&all)
}

fn node(object: &TopologyObject) -> Node {
    let memory = match object.attributes() {
        Some(ObjectAttributes::NUMANode(attributes)) => {
            attributes.local_memory().map_or(0, |bytes| bytes.get())
        }
        _ => 0,
    };
    Node {
        os: object.os_index().unwrap_or(0),
        cpus: CpuSet::new(),
        has_cpus: false,
        packages: CpuSet::new(),
        memory_bytes: memory,
    }
}

/// Pushes the data caches by level and returns their hwloc identities in the same order.
fn caches(topology: &Topology, machine: &mut Machine) -> Vec<u64> {
    use ObjectType::{L1Cache, L2Cache, L3Cache, L4Cache, L5Cache};
    let mut ids = Vec::new();
    for (level, kind) in [L1Cache, L2Cache, L3Cache, L4Cache, L5Cache].into_iter().enumerate() {
        for object in topology.objects_with_type(kind) {
            let (mut size_bytes, mut line_bytes) = (0, 0);
            if let Some(ObjectAttributes::Cache(attributes)) = object.attributes() {
                size_bytes = attributes.size().map_or(0, |bytes| bytes.get());
                line_bytes = attributes.line_size().map_or(0, |bytes| bytes.get());
            }
            ids.push(object.global_persistent_index());
            machine.caches.push(Cache { level: level + 1, size_bytes, line_bytes, cpus: set_of(object) });
        }
    }
    ids
}

fn cpu(pu: &TopologyObject, owned: &[Option<CpuSet>], near: &[CpuSet], cache_ids: &[u64]) -> Cpu {
    let os = pu.os_index().unwrap_or_else(|| pu.logical_index());
    let by_kernel = owned.iter().position(|cpus| cpus.as_ref().is_some_and(|cpus| cpus.contains(os)));
    let most_specific = || {
        let candidates = near.iter().enumerate().filter(|(_, cpus)| cpus.contains(os));
        candidates.min_by_key(|(index, cpus)| (cpus.len(), *index)).map_or(0, |(index, _)| index)
    };
    let logical = |kind| pu.first_ancestor_with_type(kind).map(TopologyObject::logical_index);
    let of_cache = |object: &TopologyObject| {
        let id = object.global_persistent_index();
        cache_ids.iter().position(|&cache| cache == id)
    };
    Cpu {
        os,
        // Some virtual machines report no cores or packages.
        core: logical(ObjectType::Core).unwrap_or_else(|| pu.logical_index()),
        smt: 0,
        package: logical(ObjectType::Package).unwrap_or(0),
        node: by_kernel.unwrap_or_else(most_specific),
        caches: pu.ancestors().filter_map(of_cache).collect(),
        allowed: true,
    }
}

/// Reads the latency table; `false` where there is none for all nodes. Its order is its own, so it is permuted.
fn read_distances(topology: &Topology, machine: &mut Machine) -> bool {
    let Ok(tables) = topology.distances_with_type(None, ObjectType::NUMANode) else { return false };
    let wanted = machine.nodes.len();
    for table in &tables {
        let is_latency = table.name().is_none_or(|name| name.to_bytes() == b"NUMALatency");
        let position = |object: Option<&TopologyObject>| machine.node_position(object?.os_index()?);
        let Some(order) = table.objects().map(position).collect::<Option<Vec<usize>>>() else { continue };
        let values = table.distances();
        if !is_latency || order.len() != wanted || values.len() != wanted * wanted {
            continue;
        }
        let mut distances = vec![vec![0; wanted]; wanted];
        for (index, &value) in values.iter().enumerate() {
            distances[order[index / wanted]][order[index % wanted]] = value;
        }
        machine.distances = distances;
        return true;
    }
    false
}
