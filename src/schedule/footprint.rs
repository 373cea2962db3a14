//! What a run's data takes in memory, by kind, and where it lies: pages are asked from the kernel.

use std::collections::BTreeMap;

use ccnuma::WorkerPanic;
use ccnuma::arena::Memory;
use ccnuma::pages::{PageCount, PageSet};

use crate::radiosity::{ElementBytes, Tree};

use super::crew::{Crew, Hands};

/// Memory of a run at its end.
#[derive(Clone, Debug)]
pub struct Footprint {
    /// How the elements' memory was placed.
    pub memory: Memory,
    /// Bytes of the elements of all levels, with what they own.
    pub element_bytes: ElementBytes,
    /// Bytes by kind: the elements', `surfaces` (what trees hold besides), `packets` (the most that was under way at once, copies
    /// included), `visibility` (copies included), `links` (the most stored at once), `solution`.
    pub bytes_by_kind: BTreeMap<&'static str, u64>,
    /// Bytes of the arenas' chunks by node (operating-system number), or why there are none.
    pub arena_bytes_per_node: Result<BTreeMap<usize, u64>, String>,
    /// Small pages of the arenas' chunks by node (operating-system number), or why that is not known.
    pub pages_per_node: Result<BTreeMap<usize, u64>, String>,
    /// Share of the pages that hold elements which is on the home node of these elements' surface, or why that is not known. A page with
    /// elements of several surfaces counts for each.
    pub pages_at_home: Result<f64, String>,
    /// Trees that moved to another home.
    pub moved: u64,
}

impl Crew<'_> {
    /// Looks at the trees' memory; `others` are bytes of other kinds.
    pub fn footprint<const N: usize>(
        &mut self,
        trees: &mut [Tree<N>],
        others: [(&'static str, u64); 4],
    ) -> Result<Footprint, WorkerPanic> {
        let surveys = self.map(
            trees,
            |_| true,
            |tree| {
                let mut pages = PageSet::default();
                let bytes = (tree.root.survey(&mut pages), tree.bytes() as u64);
                (bytes, pages.count().map_err(|error| error.to_string()))
            },
        )?;
        let (mut element_bytes, mut surfaces) = (ElementBytes::default(), 0);
        for ((elements, surface), _) in &surveys {
            element_bytes += *elements;
            surfaces += surface;
        }
        let own = [
            ("elements", element_bytes.elements),
            ("coefficients", element_bytes.coefficients),
            ("outlines", element_bytes.outlines),
            ("surfaces", surfaces),
        ];
        Ok(Footprint {
            memory: self.memory,
            element_bytes,
            bytes_by_kind: own.into_iter().chain(others).collect(),
            arena_bytes_per_node: self.arena_bytes_per_node(),
            pages_per_node: self.pages_per_node(),
            pages_at_home: self.pages_at_home(surveys.iter().map(|(_, count)| count)),
            moved: self.moved,
        })
    }

    fn arena_bytes_per_node(&mut self) -> Result<BTreeMap<usize, u64>, String> {
        match (&mut self.hands, self.memory) {
            (Hands::Team(_, kits), Memory::Node) => {
                let mut bytes = BTreeMap::new();
                for kit in kits.iter_mut() {
                    for (node, arena) in kit.arenas.by_node() {
                        *bytes.entry(node).or_default() += arena.stats().chunk_bytes as u64;
                    }
                }
                Ok(bytes)
            }
            (_, Memory::Malloc) => Err(ON_THE_HEAP.to_owned()),
            (_, memory) => Err(format!("with --memory {memory} arenas are not for a node")),
        }
    }

    fn pages_per_node(&mut self) -> Result<BTreeMap<usize, u64>, String> {
        if self.memory == Memory::Malloc {
            return Err(ON_THE_HEAP.to_owned());
        }
        let mut count = PageCount::default();
        match &mut self.hands {
            Hands::Recording(_) => {}
            Hands::Alone(own) => count.add(&own.1.count_pages().map_err(|error| error.to_string())?),
            Hands::Team(_, kits) => {
                for kit in kits.iter_mut() {
                    count.add(&kit.arenas.count_pages().map_err(|error| error.to_string())?);
                }
            }
        }
        Ok(count.by_node.into_iter().map(|(node, pages)| (node, pages as u64)).collect())
    }

    fn pages_at_home<'a>(
        &self,
        counts: impl Iterator<Item = &'a Result<PageCount, String>>,
    ) -> Result<f64, String> {
        let Hands::Team(team, _) = &self.hands else {
            return Err("one thread that is not pinned has no home nodes".to_owned());
        };
        let nodes = &team.plan().machine.nodes;
        let (mut at_home, mut all) = (0, 0);
        for (count, home) in counts.zip(&self.homes) {
            let by_node = &count.as_ref().map_err(String::clone)?.by_node;
            at_home += by_node.get(&nodes[*home].os).copied().unwrap_or(0);
            all += by_node.values().sum::<usize>();
        }
        match all {
            0 => Err("no element has memory of its own".to_owned()),
            _ => Ok(at_home as f64 / all as f64),
        }
    }
}

const ON_THE_HEAP: &str = "elements are on the heap of the process, not in arenas";
