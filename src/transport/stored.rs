//! Stored links: what a pair task found out about transport, kept to be applied to other light without a look at kernel or visibility.
//!
//! A link is `E_a = Σ_cells Σ_b T_ab B_b`: the irradiance on one element of the receiver from those cells of the emitter's packet that it was
//! found by, all bands alike. It holds for other radiosity as long as that would be judged alike: while the link carries no more than so many
//! times the light that it was judged for, and the cells leave out hardly more detail than they did. A pair is kept whole or not at all.

use std::collections::BTreeMap;

use super::packet::{Detail, Packet};
use super::pair::{Scratch, Task};
use super::receiver::{Deposited, Patch, Receiver};
use super::recording::Row;
use super::samples::SampleRule;
use super::share::Helpers;
use super::{Clusters, Oracle, Rules, Source, Work};
use crate::math::basis::MAX_FUNCTIONS;
use crate::math::{Cell, Split};

/// A link may carry so many times the light that it was judged for, if its error leaves room for that, and at least so many times.
const GROWTH: (f64, f64) = (1.25, 4.0);

/// Share of the threshold that detail may bring which was not there when the link was judged.
const NEW_DETAIL: f64 = 0.3;

/// Links of one pair: three lists, each link's entries in the second and third following those of the link before it.
#[derive(Clone, Debug, Default)]
pub struct Links {
    links: Vec<Link>,
    sources: Vec<LinkSource>,
    /// For each source of a link, for each function kept, a factor for each function of the source.
    factors: Vec<f32>,
}

/// Whom a link lights, and how it was judged.
#[derive(Clone, Debug)]
struct Link {
    cell: Cell,
    area_m2: f64,
    /// Error in W/m.
    error_w_m: f64,
    /// How many times the light it may carry.
    limit: f64,
    /// Light carried in W/m², as the sum of what the means of the sources bring for their strength.
    carried_w_m2: f64,
    /// Light of detail in W/m², likewise.
    detail_w_m2: f64,
    /// Number of the surface that sends, among those that came together.
    source: u32,
    /// How many sources it has.
    sources: u32,
    /// Which functions of the receiver's element are kept, as bits.
    kept: u16,
}

/// A cell that sends.
#[derive(Clone, Debug)]
struct LinkSource {
    cell: Cell,
    /// Irradiance of detail per RMS of it.
    fading: f32,
}

/// An element's link to be kept, as it was judged.
pub(super) struct Kept {
    pub cell: Cell,
    pub area_m2: f64,
    pub error_w_m: f64,
    /// Threshold over error.
    pub room: f64,
}

impl Links {
    /// Notes a link that was found by `rows` at the nodes of a rule.
    pub(super) fn note(&mut self, link: Kept, rows: &[Row], rule: &SampleRule) {
        let basis = rule.basis;
        let kept: Vec<&[f64]> = (0..basis.len()).map(|a| rule.projection(a)).collect();
        let nodes = kept[0].len() as f64;
        let (mut sources, mut carried_w_m2, mut detail_w_m2) = (0, 0.0, 0.0);
        for of_cell in rows.chunk_by(|a, b| a.cell == b.cell) {
            let start = self.factors.len();
            for weights in kept.iter().filter(|weights| !weights.is_empty()) {
                for b in 0..basis.len() {
                    let factor: f64 = of_cell.iter().map(|row| weights[row.point] * row.factors[b]).sum();
                    self.factors.push(factor as f32);
                }
            }
            let fading = of_cell.iter().map(|row| row.fading * row.factors[0].abs()).sum::<f64>() / nodes;
            carried_w_m2 += f64::from(self.factors[start].abs()) * of_cell[0].strength_w_m2;
            detail_w_m2 += fading * of_cell[0].detail_w_m2;
            self.sources.push(LinkSource { cell: of_cell[0].cell, fading: fading as f32 });
            sources += 1;
        }
        let Kept { cell, area_m2, error_w_m, room } = link;
        let limit = room.max(GROWTH.0).min(GROWTH.1);
        let kept = (0..kept.len()).filter(|a| !kept[*a].is_empty()).map(|a| 1 << a).sum();
        self.links.push(Link {
            cell,
            area_m2,
            error_w_m,
            limit,
            carried_w_m2,
            detail_w_m2,
            source: 0,
            sources,
            kept,
        });
    }

    /// Adds others.
    pub(super) fn append(&mut self, mut other: Links) {
        if self.links.is_empty() {
            *self = other;
            return;
        }
        self.links.append(&mut other.links);
        self.sources.append(&mut other.sources);
        self.factors.append(&mut other.factors);
    }

    /// Says what these links may err by.
    pub(super) fn set_error(&mut self, error_w_m: f64) {
        self.links.iter_mut().for_each(|link| link.error_w_m = error_w_m);
    }

    /// Says which of the sources that came together these links belong to.
    pub(super) fn set_source(&mut self, number: u32) {
        self.links.iter_mut().for_each(|link| link.source = number);
    }

    /// The links of each of so many sources.
    fn by_source(self, count: usize) -> Vec<Links> {
        let functions = self.functions();
        let mut all = vec![Links::default(); count];
        let (mut sources, mut factors) = (self.sources.into_iter(), &self.factors[..]);
        for link in self.links {
            let (own, rest) = factors.split_at((link.sources * link.kept.count_ones()) as usize * functions);
            factors = rest;
            let links = &mut all[link.source as usize];
            links.sources.extend(sources.by_ref().take(link.sources as usize));
            links.factors.extend(own);
            links.links.push(link);
        }
        all
    }

    /// How many functions the sources have.
    fn functions(&self) -> usize {
        let rows: u32 = self.links.iter().map(|link| link.sources * link.kept.count_ones()).sum();
        self.factors.len() / rows.max(1) as usize
    }

    fn bytes(&self) -> u64 {
        let lists = size_of_val(&*self.links) + size_of_val(&*self.sources) + size_of_val(&*self.factors);
        (lists + size_of::<(u32, Self)>()) as u64
    }

    /// What the links bring of this packet: of each its coefficients and its error in W/m. `None` if one of them does not hold any more.
    fn carry<const N: usize>(
        &self,
        packet: &Packet<N>,
        patch: &Patch<N>,
        rules: &Rules,
    ) -> Option<Vec<([[f64; N]; MAX_FUNCTIONS], f64)>> {
        let geometric = rules.oracle == Oracle::Geometry;
        let relative = if geometric { packet.strength() / rules.reference_w_m2 } else { 1.0 };
        let most_w_m = NEW_DETAIL * rules.threshold_w_m * relative;
        let weight = patch.weight(rules.least_reflectance);
        let (mut sources, mut factors) = (self.sources.iter(), self.factors.chunks_exact(packet.basis.len()));
        let mut brought = Vec::with_capacity(self.links.len());
        for link in &self.links {
            let mut light = [[0.0; N]; MAX_FUNCTIONS];
            let (mut carried_w_m2, mut detail_w_m2) = (0.0, 0.0);
            for source in sources.by_ref().take(link.sources as usize) {
                let (sent, detail) = sent(packet, &source.cell);
                for (place, a) in (0..packet.basis.len()).filter(|a| link.kept >> a & 1 == 1).enumerate() {
                    let factors = factors.next()?;
                    if place == 0 {
                        let square: f64 = sent.iter().flatten().map(|c| c * c).sum();
                        carried_w_m2 += f64::from(factors[0].abs()) * square.sqrt();
                    }
                    for (factor, coefficient) in factors.iter().zip(&sent) {
                        for n in 0..N {
                            light[a][n] += f64::from(*factor) * coefficient[n];
                        }
                    }
                }
                detail_w_m2 += f64::from(source.fading) * detail.rms_w_m2;
            }
            let new_detail_w_m = weight * link.area_m2.sqrt() * (detail_w_m2 - link.detail_w_m2).max(0.0);
            let holds = geometric || carried_w_m2 <= link.limit * link.carried_w_m2;
            if !holds || new_detail_w_m > most_w_m {
                return None;
            }
            let grown = if link.carried_w_m2 > 0.0 { carried_w_m2 / link.carried_w_m2 } else { 0.0 };
            brought.push((light, (grown * link.error_w_m).hypot(new_detail_w_m)));
        }
        Some(brought)
    }
}

/// What a packet sends from a cell that is one of its nodes or lies in one of its leaves, and what of it that leaves out.
fn sent<const N: usize>(packet: &Packet<N>, cell: &Cell) -> ([[f64; N]; MAX_FUNCTIONS], Detail) {
    let (mut node, mut here) = (&packet.nodes[0], Cell::UNIT);
    while let Some((split, first)) = node.children.filter(|_| here != *cell) {
        let child = split.child_at(here.to_local(cell.centre()));
        (node, here) = (&packet.nodes[first as usize + child], here.child(split, child));
    }
    let (mut coefficients, detail) = (node.coefficients, node.detail);
    while here.size.x > cell.size.x || here.size.y > cell.size.y {
        let split = if here.size.x > cell.size.x { Split::U } else { Split::V };
        let child = split.child_at(here.to_local(cell.centre()));
        let mut pushed = [[0.0; N]; MAX_FUNCTIONS];
        packet.basis.push(split, child, &coefficients, &mut pushed);
        (coefficients, here) = (pushed, here.child(split, child));
    }
    (coefficients, detail)
}

/// The element of a receiver that has this cell, or the one that holds it if that is not divided so far.
fn element<'r, const N: usize, R: Receiver<N>>(receiver: &'r mut R, cell: &Cell) -> &'r mut R {
    let (mut element, mut here) = (receiver, Cell::UNIT);
    while let Some(split) = element.split().filter(|_| here != *cell) {
        let child = split.child_at(here.to_local(cell.centre()));
        here = here.child(split, child);
        element = &mut element.children_mut()[child];
    }
    element
}

impl<const N: usize> Task<'_, N> {
    /// As [`Task::shoot`], by links in the `store` where it has them; others are put there as far as there is room.
    pub fn shoot_stored<R: Receiver<N>>(
        self,
        (packets, clusters): (&[Packet<N>], Option<&Clusters>),
        receiver: &mut R,
        store: &mut Store,
        scratch: &mut Scratch,
        helpers: &dyn Helpers,
    ) -> Deposited<N> {
        let (mut deposited, resolved) = self.sort((packets, clusters), receiver, scratch, helpers);
        let mut open = Vec::new();
        for packet in resolved.into_iter().map(|index| &packets[index]) {
            match store.shoot(packet, self.patch, receiver, self.rules, &mut scratch.work) {
                Some(taken) => deposited.add_after(taken),
                None => open.push(packet),
            }
        }
        let records = !open.is_empty() && store.has_room();
        let mut taken = self.resolve(&open, records, receiver, scratch, helpers);
        let links = std::mem::take(&mut taken.links);
        deposited.add_after(taken);
        if records {
            for (packet, links) in open.iter().zip(links.by_source(open.len())) {
                store.keep(packet.surface, links, &mut scratch.work);
            }
        }
        deposited
    }
}

/// The links of one receiver, by emitting surface, within a number of bytes.
#[derive(Clone, Debug, Default)]
pub struct Store {
    pairs: BTreeMap<u32, Links>,
    held_bytes: u64,
    allowed_bytes: u64,
    refused_bytes: u64,
}

impl Store {
    /// Bytes held.
    pub fn held_bytes(&self) -> u64 {
        self.held_bytes
    }

    /// Bytes, at the least, of links that found no room since the last time that more was [allowed](Store::allow).
    pub fn refused_bytes(&self) -> u64 {
        self.refused_bytes
    }

    /// Allows so many bytes from now on; what is held stays.
    pub fn allow(&mut self, bytes: u64) {
        (self.allowed_bytes, self.refused_bytes) = (bytes, 0);
    }

    /// Whether there may be room for another pair, which is about to be computed.
    pub(super) fn has_room(&mut self) -> bool {
        let room = self.held_bytes < self.allowed_bytes;
        if !room {
            self.refused_bytes += size_of::<Links>() as u64;
        }
        room
    }

    /// Lights the receiver by what is stored of its pair with the packet's surface, if that is and still holds; else forgets it.
    pub(super) fn shoot<const N: usize, R: Receiver<N>>(
        &mut self,
        packet: &Packet<N>,
        patch: &Patch<N>,
        receiver: &mut R,
        rules: &Rules,
        work: &mut Work,
    ) -> Option<Deposited<N>> {
        let links = self.pairs.get(&packet.surface)?;
        let Some(brought) = links.carry(packet, patch, rules) else {
            self.held_bytes -= links.bytes();
            self.pairs.remove(&packet.surface);
            return None;
        };
        let mut deposited = Deposited::default();
        for (link, (light, error_w_m)) in links.links.iter().zip(brought) {
            element(receiver, &link.cell).deposit(&light);
            deposited.take(patch, &light, link.area_m2);
            deposited.error_squared += error_w_m * error_w_m;
        }
        work.links_reused += links.links.len() as u64;
        Some(deposited)
    }

    /// Keeps the links of a pair if there is room.
    pub(super) fn keep(&mut self, surface: u32, mut links: Links, work: &mut Work) {
        links.links.shrink_to_fit();
        links.sources.shrink_to_fit();
        links.factors.shrink_to_fit();
        let bytes = links.bytes();
        if self.held_bytes + bytes > self.allowed_bytes {
            self.refused_bytes += bytes;
            return;
        }
        work.links_stored += links.links.len() as u64;
        self.held_bytes += bytes;
        self.pairs.insert(surface, links);
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use ccnuma::Arena;
    use ccnuma::arena::Backend;

    use super::*;
    use crate::math::Basis;
    use crate::radiosity::{Tree, trees};
    use crate::scene::{read::read_file, surfaces};
    use crate::transport::{Alone, SampleRules};
    use crate::visibility::{Bvh, OpaqueFaces};

    /// A receiver in the furnished room, and packets of light that varies.
    struct Case {
        tree: Tree<3>,
        packets: Vec<Packet<3>>,
        bvh: Bvh,
        arena: Arena,
        scratch: Scratch,
        store: Store,
    }

    impl Case {
        fn new(basis: Basis) -> Self {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/furnished-room.iv");
            let scene = read_file(&path).unwrap();
            let arena = Arena::new(Backend::Malloc);
            let mut all = trees::<3>(&surfaces(&scene), basis, &arena);
            let slope = |tree: &mut Tree<3>| {
                let mut light = [[0.0; 3]; MAX_FUNCTIONS];
                (light[0], light[basis.len() - 1]) = ([3.0, 2.0, 1.0], [0.2, 0.1, -0.1]);
                tree.root.deposit(&light);
                tree.take_packet(0.0)
            };
            let packets = all.iter_mut().skip(1).step_by(3).map(slope).collect();
            let store = Store { allowed_bytes: u64::MAX, ..Store::default() };
            let (tree, bvh) = (all.swap_remove(0), Bvh::new(OpaqueFaces::new(&scene)));
            Self { tree, packets, bvh, arena, scratch: Scratch::default(), store }
        }

        /// Lights the receiver, dark before, by packets that send so many times their light; returns its irradiance and the work done.
        fn light(&mut self, times: f64) -> (Vec<f64>, Work) {
            let rules = Rules {
                oracle: Oracle::Energy,
                threshold_w_m: 0.01,
                reference_w_m2: 1.0,
                least_reflectance: 0.5,
                point_w_m2: 0.002,
                samples: SampleRules::new(self.tree.basis),
            };
            let brighter = |packet: &Packet<3>| {
                let mut nodes = packet.nodes.clone();
                nodes
                    .iter_mut()
                    .flat_map(|node| node.coefficients.iter_mut().flatten())
                    .for_each(|c| *c *= times);
                Packet::new(
                    packet.surface,
                    packet.face,
                    packet.frame,
                    packet.outline.clone(),
                    packet.basis,
                    nodes,
                )
            };
            let packets: Vec<Packet<3>> = self.packets.iter().map(brighter).collect();
            self.tree.darken();
            let Tree { patch, root, .. } = &mut self.tree;
            let task = Task { patch, occluder: &self.bvh, rules: &rules, go_on: &|| true };
            let (scratch, store, alone) = (&mut self.scratch, &mut self.store, Alone(&self.arena));
            task.shoot_stored((&packets, None), root, store, scratch, &alone);
            (self.tree.field().coefficients, std::mem::take(&mut self.scratch.work))
        }
    }

    fn distance(a: &[f64], b: &[f64]) -> f64 {
        let square = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
        square(&mut a.iter().zip(b).map(|(a, b)| a - b)) / square(&mut b.iter().copied())
    }

    #[test]
    fn stored_links_bring_what_was_found_and_as_many_times_as_much() {
        for basis in [Basis::Haar, Basis::M2, Basis::M3] {
            let mut case = Case::new(basis);
            let (found, work) = case.light(1.0);
            assert!(work.links_stored > 10 && work.links_reused == 0);
            let (again, work) = case.light(1.0);
            assert_eq!((work.cost(), work.links_stored), (0, 0), "{basis:?}: all is known");
            assert!(distance(&again, &found) < 1e-6, "{basis:?}: {}", distance(&again, &found));
            let (half, _) = case.light(0.5);
            let twice: Vec<f64> = half.iter().map(|e| 2.0 * e).collect();
            assert!(distance(&twice, &found) < 1e-6, "{basis:?}");
            let (_, work) = case.light(1.2);
            assert_eq!(work.cost(), 0, "{basis:?}: a little more is borne");
        }
    }

    #[test]
    fn links_are_judged_anew_where_they_would_carry_much_more() {
        let mut case = Case::new(Basis::M2);
        let (_, first) = case.light(1.0);
        let (found, work) = case.light(5.0);
        assert!(work.links_reused < first.links_stored / 2 && work.links_stored > first.links_stored / 2);
        let (again, work) = case.light(5.0);
        assert_eq!(work.cost(), 0);
        assert!(distance(&again, &found) < 1e-6);
    }

    #[test]
    fn a_full_store_refuses_and_counts() {
        let mut case = Case::new(Basis::M2);
        case.light(1.0);
        let all = case.store.held_bytes();
        let sum: u64 = case.store.pairs.values().map(Links::bytes).sum();
        assert_eq!(sum, all);
        let mut small = Case::new(Basis::M2);
        small.store.allow(all / 3);
        let (_, work) = small.light(1.0);
        assert!(small.store.held_bytes() <= all / 3 && small.store.refused_bytes() > 0);
        let (_, second) = small.light(1.0);
        assert!(second.cost() > 0 && second.cost() < work.cost());
        assert_eq!(second.links_reused, work.links_stored);
    }
}
