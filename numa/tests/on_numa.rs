//! What only a machine with several nodes can show: pins, memory on every node, first touch, interleaving, copies,
//! homes, stealing order, a full node.
//!
//! Runs anywhere (on one node much of it is trivially true); `scripts/virtual-numa` boots it on virtual machines with
//! several nodes. Prints `N passed, N failed`. What the machine should look like is given by the environment:
//! `CCNUMA_NODES`, `CCNUMA_CPUS`, `CCNUMA_MEMORY_ONLY`, `CCNUMA_HUGE=never`.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use ccnuma::arena::{CHUNK, Memory, NodeArenas};
use ccnuma::cpuset::CpuSet;
use ccnuma::pages::{HUGE, PageCount, Pages, Placement, count_of, interleaving, room_bytes};
use ccnuma::per_thread::{Counter, PerWorker};
use ccnuma::replicate::ReplicatedSlice;
use ccnuma::report::Topology;
use ccnuma::{Arena, Error, Home, Machine, Plan, Policy, Team, per_thread};

fn main() {
    let tests: [(&str, fn()); 14] = [
        ("the machine is as expected", the_machine_is_as_expected),
        ("pins hold under every policy", pins_hold_under_every_policy),
        ("an arena on every node is there", an_arena_on_every_node_is_there),
        ("what a thief makes lands on its item's home node", thieves_allocate_at_home),
        ("bound pages ignore who touches them", bound_pages_ignore_who_touches_them),
        ("interleaved pages go round", interleaved_pages_go_round),
        ("large vectors can be interleaved too", large_vectors_can_be_interleaved),
        ("first touch decides", first_touch_decides),
        ("every node reads its own copy", every_node_reads_its_own_copy),
        ("per-thread slots are on their owner's node", per_thread_slots_are_local),
        ("items that may not travel stay at home", items_stay_at_home),
        ("workers steal from the nearest first", workers_steal_from_the_nearest_first),
        ("a full node is refused, and arenas go on nearby", a_full_node_is_refused),
        ("huge pages or small ones, as the kernel allows", huge_pages_as_allowed),
    ];
    let run = |&(name, test): &(&str, fn())| {
        let started = std::time::Instant::now();
        let passed = catch_unwind(AssertUnwindSafe(test)).is_ok();
        println!(
            "{} {name} ({:.1} s)",
            if passed { "ok    " } else { "FAILED" },
            started.elapsed().as_secs_f64()
        );
        passed
    };
    let passed = tests.iter().filter(|test| run(test)).count();
    let failed = tests.len() - passed;
    println!("{passed} passed, {failed} failed");
    std::process::exit(i32::from(failed > 0));
}

fn machine() -> Arc<Machine> {
    Arc::new(Machine::this_machine().expect("the machine is readable"))
}

fn team(policy: Policy) -> Team {
    let plan = Plan::new(machine(), policy, None).expect("a plan");
    Team::new(&plan).expect("a team")
}

fn assert_all_on(count: &PageCount, node: usize) {
    assert_eq!(count.share_on(node), Some(1.0), "all on node {node}: {count:?}");
}

fn expected(name: &str) -> Option<usize> {
    std::env::var(name).ok()?.parse().ok()
}

fn the_machine_is_as_expected() {
    let machine = machine();
    let memory_only = machine.nodes.iter().filter(|node| !node.has_cpus).count();
    for (name, found) in [
        ("CCNUMA_NODES", machine.nodes.len()),
        ("CCNUMA_CPUS", machine.allowed.len()),
        ("CCNUMA_MEMORY_ONLY", memory_only),
    ] {
        assert_eq!(expected(name).unwrap_or(found), found, "{name}");
    }
    assert!(machine.nodes.len() == 1 || !machine.distances_assumed, "the firmware tells distances");
}

fn pins_hold_under_every_policy() {
    let machine = machine();
    let last = machine.allowed.iter().last().expect("a CPU");
    for policy in [Policy::Compact, Policy::Scatter, Policy::None, Policy::List(vec![last])] {
        let plan = Plan::new(Arc::clone(&machine), policy, None).expect("a plan");
        let report = Topology::check(plan).expect("a check");
        println!("{}", report.text());
        for check in &report.checks {
            assert!(check.pinned_as_planned, "{check:?}");
            assert_all_on(check.bound_pages.as_ref().expect("counted"), check.node);
        }
    }
    let too_many = Plan::new(Arc::clone(&machine), Policy::Compact, Some(machine.allowed.len() + 1));
    assert!(matches!(too_many, Err(Error::TooManyWorkers { .. })));
    let half: CpuSet = machine.allowed.iter().take(1).collect();
    let cut = Machine::clone(&machine).restricted_to(&half).expect("one CPU is left");
    assert!(Plan::new(Arc::new(cut), Policy::Compact, Some(2)).is_err(), "a cpuset smaller than asked");
}

fn an_arena_on_every_node_is_there() {
    for node in &machine().nodes {
        let arena = Arena::on_node(node.os);
        let values: Vec<_> = (0..40_000u64).map(|value| arena.alloc([value; 24])).collect();
        let count = arena.count_pages().expect("counted");
        assert_all_on(&count, node.os);
        assert!(values.iter().zip(0..).all(|(value, expected)| **value == [expected; 24]));
        assert_eq!(arena.stats().placed_elsewhere, 0);
        assert!(arena.stats().mapped_bytes >= 40_000 * 192);
    }
}

fn thieves_allocate_at_home() {
    let mut team = team(Policy::Compact);
    let machine = machine();
    let mut arenas = PerWorker::new(&mut team, |_| NodeArenas::new(&machine, Memory::Node)).expect("made");
    team.run(|worker| {
        for (node, table) in machine.nodes.iter().enumerate() {
            let arena = arenas.local(worker).on_node(node);
            let values: Vec<_> = (0..1000u64).map(|value| arena.alloc([value; 24])).collect();
            assert_all_on(&arena.count_pages().expect("counted"), table.os);
            drop(values);
        }
    })
    .expect("no worker fails");
    let values = (1000 * machine.nodes.len() * team.len()) as u64;
    assert_eq!(arenas.iter_mut().map(|arenas| arenas.stats().allocations).sum::<u64>(), values);
}

fn bound_pages_ignore_who_touches_them() {
    let machine = machine();
    let mut team = team(Policy::Scatter);
    team.run(|_| {
        for node in &machine.nodes {
            let mut pages = Pages::map_small(1, &Placement::Bind(node.os)).expect("mapped");
            pages.populate();
            assert_all_on(&pages.count().expect("counted"), node.os);
        }
    })
    .expect("no worker fails");
}

fn interleaved_pages_go_round() {
    let nodes: CpuSet = machine().nodes.iter().map(|node| node.os).collect();
    let mut pages = Pages::map_small(8 * HUGE, &Placement::Interleave(nodes.clone())).expect("mapped");
    pages.populate();
    let count = pages.count().expect("counted");
    for node in nodes.iter() {
        let share = count.share_on(node).expect("touched");
        assert!((share - 1.0 / nodes.len() as f64).abs() < 0.01, "{count:?}");
    }
}

fn large_vectors_can_be_interleaved() {
    let nodes: CpuSet = machine().nodes.iter().map(|node| node.os).collect();
    // Huge pages go round whole, and the vector starts and ends within one.
    let vector = interleaving(&nodes, || vec![1u8; 32 * HUGE]);
    let count = count_of(&vector).expect("counted");
    for node in nodes.iter() {
        let share = count.share_on(node).expect("touched");
        assert!((share - 1.0 / nodes.len() as f64).abs() < 0.06, "{count:?}");
    }
    let here = vec![1u8; 32 * HUGE];
    assert_eq!(count_of(&here).expect("counted").by_node.len(), 1, "the policy is reset");
}

fn first_touch_decides() {
    let mut team = team(Policy::Scatter);
    let touched = team.run(|worker| {
        let mut pages = Pages::map(1, &Placement::FirstTouch).expect("mapped");
        pages.populate();
        (worker.node_os(), pages.count().expect("counted"))
    });
    for (node, count) in touched.expect("no worker fails") {
        assert_all_on(&count, node);
    }
}

fn every_node_reads_its_own_copy() {
    let mut team = team(Policy::Compact);
    let items: Vec<u64> = (0..100_000).collect();
    let replicated = ReplicatedSlice::copy_to_nodes(&mut team, &items).expect("copied");
    let staffed = team.plan().workers_by_node().iter().filter(|workers| !workers.is_empty()).count();
    assert_eq!(replicated.copies(), staffed);
    team.run(|worker| {
        let local = replicated.local(worker);
        assert_eq!(local, items);
        assert_all_on(&count_of(local).expect("counted"), worker.node_os());
    })
    .expect("no worker fails");
}

per_thread! {
    static HITS: Counter = Counter::new();
}

fn per_thread_slots_are_local() {
    let mut team = team(Policy::Compact);
    team.run(|worker| {
        HITS.local(worker).add(worker.index() as u64 + 1);
        let slot = std::slice::from_ref(HITS.local(worker));
        assert_all_on(&count_of(slot).expect("counted"), worker.node_os());
    })
    .expect("no worker fails");
    let workers = team.len() as u64;
    assert_eq!(HITS.fold(&mut team, 0, |sum, _, hits| sum + hits.get()), workers * (workers + 1) / 2);
}

fn items_stay_at_home() {
    let mut team = team(Policy::Compact);
    let plan = team.plan().clone();
    let nodes = plan.machine.nodes.len();
    let mut visit = |far_limit| {
        team.set_far_limit(far_limit);
        let mut items: Vec<(usize, usize)> = (0..400).map(|item| (item % nodes, usize::MAX)).collect();
        let home = |&(node, _): &(usize, usize)| Home { node, weight: 1 };
        team.for_each_mut(&mut items, home, |worker, item| item.1 = worker.node()).expect("no worker fails");
        items
    };
    assert!(visit(u64::MAX).iter().all(|&(home, ran_on)| ran_on == plan.nearest_staffed_node(home)));
    assert!(visit(0).iter().all(|&(_, ran_on)| ran_on < nodes), "each visited");
}

fn workers_steal_from_the_nearest_first() {
    let team = team(Policy::Compact);
    let plan = team.plan();
    for worker in 0..team.len() {
        let node = plan.slots[worker].node;
        let distance = |&other: &usize| plan.machine.distances[node][plan.slots[other].node];
        let distances: Vec<u64> = team.steal_order(worker).iter().map(distance).collect();
        assert!(distances.is_sorted(), "worker {worker}: {distances:?}");
        assert_eq!(distances.len(), team.len() - 1);
    }
}

fn a_full_node_is_refused() {
    let machine = machine();
    let node = machine.nodes[machine.nodes.len() - 1].os;
    let Some(room) = room_bytes(node).filter(|_| machine.nodes.len() > 1) else {
        return println!("       (needs several nodes)");
    };
    let more = usize::try_from(room).expect("fits") + 16 * HUGE;
    let refused = Pages::map(more, &Placement::Bind(node));
    assert!(matches!(refused, Err(Error::NodeFull { .. })), "{refused:?}");
    let arena = Arena::on_node(node);
    let values = arena.alloc_slice_with(more / 8, |index| index as u64);
    assert!(values.iter().step_by(CHUNK).zip(0..).all(|(value, step)| *value == step * CHUNK as u64));
    assert_eq!(arena.stats().placed_elsewhere, 1);
    let count = arena.count_pages().expect("counted");
    assert!(count.share_on(node).expect("touched") < 1.0, "{count:?}");
    assert!(ccnuma::warnings::all().iter().any(|warning| warning.contains("is full")));
}

fn huge_pages_as_allowed() {
    let pages = Pages::map(1, &Placement::FirstTouch).expect("mapped");
    if std::env::var("CCNUMA_HUGE").is_ok_and(|huge| huge == "never") {
        assert!(!pages.huge());
        assert!(ccnuma::warnings::all().iter().any(|warning| warning.contains("huge pages")));
    } else {
        println!("       (huge pages: {})", pages.huge());
    }
}
