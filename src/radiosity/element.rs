//! Elements: the quadtree of one surface, each element owning the ones below it, and push-pull on it.
//!
//! Irradiance stays at the level where it was deposited; the solution at a point is the sum over the elements that hold it. Pushing down to
//! leaves happens when a packet or the final field is made.

use std::ops::AddAssign;

use ccnuma::pages::PageSet;
use ccnuma::{Arena, ArenaBox};
use glam::DVec2;

use crate::math::basis::MAX_FUNCTIONS;
use crate::math::{Basis, Split};
use crate::transport::{Detail, PacketNode, Receiver, Shape};

/// An element with its subtree; an owned handle that may move between threads. What it owns lies in an arena: the children side by side,
/// followed by their coefficients, so that a division is one piece of memory.
#[derive(Debug)]
pub struct Element<const N: usize> {
    /// The part of the polygon within the cell, where its boundary cuts the cell.
    outline: Option<ArenaBox<[DVec2]>>,
    /// Share of the cell that belongs to the polygon: 0 outside.
    share: f64,
    /// Irradiance, then what of it is unshot; none outside.
    light: ArenaBox<[[f64; N]]>,
    children: Option<(Split, ArenaBox<[Element<N>]>)>,
}

/// Bytes that elements take, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ElementBytes {
    /// The elements without what they own.
    pub elements: u64,
    /// Irradiance and what of it is unshot.
    pub coefficients: u64,
    /// Parts of polygons in cells that they cut.
    pub outlines: u64,
}

impl<const N: usize> Element<N> {
    /// An element without light; outside the polygon it holds no coefficients.
    pub fn new(basis: Basis, shape: &Shape, arena: &Arena) -> Self {
        let count = if *shape == Shape::Outside { 0 } else { 2 * basis.len() };
        let outline = match shape {
            Shape::Part(outline, _) => Some(arena.alloc_slice_with(outline.len(), |i| outline[i])),
            _ => None,
        };
        let light = arena.alloc_slice_with(count, |_| [0.0; N]);
        Self { outline, share: shape.share(), light, children: None }
    }

    /// A copy in another arena.
    pub fn copy_to(&self, arena: &Arena) -> Self {
        let outline =
            self.outline.as_ref().map(|outline| arena.alloc_slice_with(outline.len(), |i| outline[i]));
        let light = arena.alloc_slice_with(self.light.len(), |i| self.light[i]);
        let copy = |children: &ArenaBox<[Self]>| {
            arena.alloc_slice_with(children.len(), |i| children[i].copy_to(arena))
        };
        let children = self.children.as_ref().map(|(split, children)| (*split, copy(children)));
        Self { outline, share: self.share, light, children }
    }

    /// Leaves inside the polygon.
    pub fn leaves(&self) -> u64 {
        match &self.children {
            Some((_, children)) => children.iter().map(Self::leaves).sum(),
            None => !self.is_outside() as u64,
        }
    }

    /// Shows all that the subtree owns in arenas, and returns its size.
    pub fn survey(&self, pages: &mut PageSet) -> ElementBytes {
        let mut bytes = ElementBytes {
            elements: size_of::<Self>() as u64,
            coefficients: size_of_val(&*self.light) as u64,
            outlines: self.outline.as_deref().map_or(0, size_of_val) as u64,
        };
        pages.add(&self.light);
        pages.add(self.outline.as_deref().unwrap_or_default());
        let children = self.children.as_ref().map_or(&[][..], |(_, children)| children);
        pages.add(children);
        for child in children {
            bytes += child.survey(pages);
        }
        bytes
    }

    /// The division and the children.
    pub fn children(&self) -> Option<(Split, &[Element<N>])> {
        self.children.as_ref().map(|(split, children)| (*split, &**children))
    }

    fn is_outside(&self) -> bool {
        self.share == 0.0
    }

    /// Its coefficients of irradiance; none outside.
    pub(super) fn irradiance(&self) -> &[[f64; N]] {
        &self.light[..self.light.len() / 2]
    }

    fn unshot(&self) -> &[[f64; N]] {
        &self.light[self.light.len() / 2..]
    }

    /// Irradiance and what of it is unshot.
    pub(super) fn light_mut(&mut self) -> (&mut [[f64; N]], &mut [[f64; N]]) {
        let middle = self.light.len() / 2;
        self.light.split_at_mut(middle)
    }

    /// Adds this element's irradiance to what comes from above.
    pub fn add_irradiance(&self, sum: &mut [[f64; N]; MAX_FUNCTIONS]) {
        add(sum, self.irradiance());
    }

    /// Mean of the unshot irradiance over the polygon's share of the cell; zero outside.
    pub fn mean_unshot(&self) -> [f64; N] {
        self.mean(&|element| element.unshot())
    }

    /// Mean of the irradiance, likewise.
    pub fn mean_irradiance(&self) -> [f64; N] {
        self.mean(&|element| element.irradiance())
    }

    fn mean(&self, light: &dyn Fn(&Self) -> &[[f64; N]]) -> [f64; N] {
        let mut mean = light(self).first().copied().unwrap_or([0.0; N]);
        if let Some((_, children)) = &self.children {
            let total: f64 = children.iter().map(|child| child.share).sum();
            for child in children.iter().filter(|child| !child.is_outside()) {
                let below = child.mean(light);
                for n in 0..N {
                    mean[n] += below[n] * child.share / total;
                }
            }
        }
        mean
    }

    /// Adds constant irradiance that is not to be shot.
    pub fn add_ambient(&mut self, irradiance_w_m2: [f64; N]) {
        if let Some(mean) = self.light_mut().0.first_mut() {
            for n in 0..N {
                mean[n] += irradiance_w_m2[n];
            }
        }
    }

    /// Marks all irradiance of the subtree as unshot.
    pub fn unshoot(&mut self) {
        let (irradiance, unshot) = self.light_mut();
        unshot.copy_from_slice(irradiance);
        for child in self.children_mut() {
            child.unshoot();
        }
    }

    /// Darkens the subtree, with what it held as unshot debt: what arrives from now on is measured against it.
    pub fn restart(&mut self) {
        let (irradiance, unshot) = self.light_mut();
        for (unshot, irradiance) in unshot.iter_mut().zip(irradiance) {
            *unshot = irradiance.map(|e| -e);
            *irradiance = [0.0; N];
        }
        for child in self.children_mut() {
            child.restart();
        }
    }

    /// Takes all light from the subtree.
    pub fn darken(&mut self) {
        self.light.fill([0.0; N]);
        for child in self.children_mut() {
            child.darken();
        }
    }

    /// Pulls the unshot irradiance of the subtree, `inherited` from above included, into `pulled`; returns the mean square of what the
    /// levels below leave out, each level at a quarter of the one above it: detail acts as far as its size.
    pub fn pull_unshot(
        &self,
        basis: Basis,
        inherited: &[[f64; N]; MAX_FUNCTIONS],
        pulled: &mut [[f64; N]; MAX_FUNCTIONS],
    ) -> f64 {
        let mut own = *inherited;
        add(&mut own, self.unshot());
        let Some((split, children)) = &self.children else {
            *pulled = own;
            return 0.0;
        };
        let mut parts = [[[0.0; N]; MAX_FUNCTIONS]; 4];
        let mut sum = 0.0;
        *pulled = [[0.0; N]; MAX_FUNCTIONS];
        for (index, child) in children.iter().enumerate().filter(|(_, c)| !c.is_outside()) {
            let mut pushed = [[0.0; N]; MAX_FUNCTIONS];
            basis.push(*split, index, &own, &mut pushed);
            sum += child.pull_unshot(basis, &pushed, &mut parts[index]);
        }
        let outside = |index: usize| children[index].is_outside();
        let beyond = beyond(children.len(), outside, |index| parts[index][0]);
        for index in 0..children.len() {
            if outside(index) {
                parts[index][0] = beyond;
            }
            basis.pull_add(*split, index, &parts[index], pulled);
        }
        for (index, _) in children.iter().enumerate().filter(|(_, c)| !c.is_outside()) {
            let mut coarse = [[0.0; N]; MAX_FUNCTIONS];
            basis.push(*split, index, pulled, &mut coarse);
            sum += square_distance(&coarse, &parts[index]);
        }
        0.25 * sum / children.len() as f64
    }

    /// Takes the unshot irradiance of the subtree as radiosity (times `reflectance`) into packet node `slot`, leaving none behind.
    /// Levels whose detail is at most `prune_w_m2` are left out.
    pub fn take_unshot(
        &mut self,
        basis: Basis,
        inherited: &[[f64; N]; MAX_FUNCTIONS],
        reflectance: &[f64; N],
        prune_w_m2: f64,
        nodes: &mut Vec<PacketNode<N>>,
        slot: usize,
    ) {
        let mut own = *inherited;
        for (sum, unshot) in own.iter_mut().zip(self.light_mut().1) {
            for n in 0..N {
                sum[n] += reflectance[n] * unshot[n];
            }
            *unshot = [0.0; N];
        }
        let Some((split, children)) = &mut self.children else {
            nodes[slot] = PacketNode { coefficients: own, detail: Detail::default(), children: None };
            return;
        };
        let first = nodes.len();
        let blank =
            PacketNode { coefficients: [[0.0; N]; MAX_FUNCTIONS], detail: Detail::default(), children: None };
        nodes.resize(first + children.len(), blank);
        for (index, child) in children.iter_mut().enumerate() {
            let mut pushed = [[0.0; N]; MAX_FUNCTIONS];
            basis.push(*split, index, &own, &mut pushed);
            if !child.is_outside() {
                child.take_unshot(basis, &pushed, reflectance, prune_w_m2, nodes, first + index);
            }
        }
        pull(basis, *split, nodes, slot, first, |index| children[index].is_outside());
        if nodes[slot].detail.rms_w_m2 <= prune_w_m2 {
            nodes.truncate(first);
            nodes[slot].children = None;
            nodes[slot].detail = Detail::default();
        }
    }
}

/// What stands for the function on children outside of the polygon, which receive nothing: the mean of its means on the others.
fn beyond<const N: usize>(
    count: usize,
    outside: impl Fn(usize) -> bool,
    mean: impl Fn(usize) -> [f64; N],
) -> [f64; N] {
    let inside = (0..count).filter(|index| !outside(*index));
    let (sum, held) = inside.fold(([0.0; N], 0), |(mut sum, held), index| {
        let mean = mean(index);
        for n in 0..N {
            sum[n] += mean[n];
        }
        (sum, held + 1)
    });
    sum.map(|s| s / held.max(1) as f64)
}

/// Pulls the children at `first` up to packet node `slot`, with the bound on the detail they hold; `outside` children hold none.
pub(super) fn pull<const N: usize>(
    basis: Basis,
    split: Split,
    nodes: &mut [PacketNode<N>],
    slot: usize,
    first: usize,
    outside: impl Fn(usize) -> bool,
) {
    let mut pulled = [[0.0; N]; MAX_FUNCTIONS];
    let count = split.children().len();
    let beyond = beyond(count, &outside, |index| nodes[first + index].coefficients[0]);
    for index in 0..count {
        if outside(index) {
            nodes[first + index].coefficients[0] = beyond;
        }
        basis.pull_add(split, index, &nodes[first + index].coefficients, &mut pulled);
    }
    let mut detail = Detail::default();
    for index in (0..count).filter(|index| !outside(*index)) {
        let mut coarse = [[0.0; N]; MAX_FUNCTIONS];
        basis.push(split, index, &pulled, &mut coarse);
        let node = &nodes[first + index];
        let square = square_distance(&coarse, &node.coefficients);
        // The maximum of a linear function is √3 times its RMS.
        detail.max_w_m2 = detail.max_w_m2.max((3.0 * square).sqrt() + node.detail.max_w_m2);
        // What the levels leave out is orthogonal: squares add up.
        detail.rms_w_m2 += (square + node.detail.rms_w_m2.powi(2)) / count as f64;
    }
    detail.rms_w_m2 = detail.rms_w_m2.sqrt();
    nodes[slot] = PacketNode { coefficients: pulled, detail, children: Some((split, first as u32)) };
}

impl<const N: usize> Receiver<N> for Element<N> {
    fn shape(&self) -> Shape<&[DVec2]> {
        match &self.outline {
            Some(outline) => Shape::Part(outline, self.share),
            None if self.is_outside() => Shape::Outside,
            None => Shape::Whole,
        }
    }

    fn split(&self) -> Option<Split> {
        self.children.as_ref().map(|(split, _)| *split)
    }

    fn subdivide(&mut self, split: Split, shapes: &[Shape], arena: &Arena) {
        let basis = match self.irradiance().len() {
            9 => Basis::M3,
            4 => Basis::M2,
            _ => Basis::Haar,
        };
        let child = |i: usize| Element::new(basis, &shapes[i], arena);
        self.children = Some((split, arena.alloc_slice_with(shapes.len(), child)));
    }

    fn children_mut(&mut self) -> &mut [Self] {
        self.children.as_mut().map_or(&mut [], |(_, children)| children)
    }

    fn deposit(&mut self, light: &[[f64; N]; MAX_FUNCTIONS]) {
        let (irradiance, unshot) = self.light_mut();
        add(irradiance, light);
        add(unshot, light);
    }
}

impl AddAssign for ElementBytes {
    fn add_assign(&mut self, o: Self) {
        self.elements += o.elements;
        self.coefficients += o.coefficients;
        self.outlines += o.outlines;
    }
}

fn add<const N: usize>(sum: &mut [[f64; N]], more: &[[f64; N]]) {
    for (s, m) in sum.iter_mut().zip(more) {
        for n in 0..N {
            s[n] += m[n];
        }
    }
}

/// Mean square of the difference of two functions over a cell, all bands.
fn square_distance<const N: usize>(a: &[[f64; N]; MAX_FUNCTIONS], b: &[[f64; N]; MAX_FUNCTIONS]) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(x, y)| (x - y) * (x - y)).sum()
}
