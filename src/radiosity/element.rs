//! Elements: the quadtree of one surface, each element owning the ones below it, and push-pull on it.
//!
//! Irradiance stays at the level where it was deposited; the solution at a point is the sum over the elements that hold it. Pushing down to
//! leaves happens when a packet or the final field is made.

use crate::math::basis::MAX_FUNCTIONS;
use crate::math::{Basis, Split};
use crate::transport::{Detail, PacketNode, Receiver, Shape};

/// An element with its subtree; an owned handle that may move between threads.
#[derive(Clone, Debug)]
pub struct Element<const N: usize> {
    shape: Shape,
    irradiance: Box<[[f64; N]]>,
    unshot: Box<[[f64; N]]>,
    children: Option<(Split, Box<[Element<N>]>)>,
}

impl<const N: usize> Element<N> {
    /// An element without light; outside the polygon it holds no coefficients.
    pub fn new(basis: Basis, shape: Shape) -> Self {
        let count = if shape == Shape::Outside { 0 } else { basis.len() };
        let zeros = || vec![[0.0; N]; count].into_boxed_slice();
        Self { shape, irradiance: zeros(), unshot: zeros(), children: None }
    }

    /// Leaves inside the polygon.
    pub fn leaves(&self) -> u64 {
        match &self.children {
            Some((_, children)) => children.iter().map(Self::leaves).sum(),
            None => (self.shape != Shape::Outside) as u64,
        }
    }

    /// The division and the children.
    pub fn children(&self) -> Option<(Split, &[Element<N>])> {
        self.children.as_ref().map(|(split, children)| (*split, &**children))
    }

    /// How the cell lies to the polygon.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Adds this element's irradiance to what comes from above.
    pub fn add_irradiance(&self, sum: &mut [[f64; N]; MAX_FUNCTIONS]) {
        add(sum, &self.irradiance);
    }

    /// Mean of the unshot irradiance over the polygon's share of the cell; zero outside.
    pub fn mean_unshot(&self) -> [f64; N] {
        let mut mean = self.unshot.first().copied().unwrap_or([0.0; N]);
        if let Some((_, children)) = &self.children {
            let total: f64 = children.iter().map(|child| child.shape.share()).sum();
            for child in children.iter().filter(|child| child.shape != Shape::Outside) {
                let below = child.mean_unshot();
                for n in 0..N {
                    mean[n] += below[n] * child.shape.share() / total;
                }
            }
        }
        mean
    }

    /// Adds constant irradiance that is not to be shot.
    pub fn add_ambient(&mut self, irradiance_w_m2: [f64; N]) {
        if let Some(mean) = self.irradiance.first_mut() {
            for n in 0..N {
                mean[n] += irradiance_w_m2[n];
            }
        }
    }

    /// Marks all irradiance of the subtree as unshot.
    pub fn unshoot(&mut self) {
        self.unshot.copy_from_slice(&self.irradiance);
        for child in self.children.iter_mut().flat_map(|(_, children)| children) {
            child.unshoot();
        }
    }

    /// Darkens the subtree, with what it held as unshot debt: what arrives from now on is measured against it.
    pub fn restart(&mut self) {
        for (unshot, irradiance) in self.unshot.iter_mut().zip(&mut self.irradiance) {
            *unshot = irradiance.map(|e| -e);
            *irradiance = [0.0; N];
        }
        for child in self.children.iter_mut().flat_map(|(_, children)| children) {
            child.restart();
        }
    }

    /// Takes all light from the subtree.
    pub fn darken(&mut self) {
        self.irradiance.fill([0.0; N]);
        self.unshot.fill([0.0; N]);
        for child in self.children.iter_mut().flat_map(|(_, children)| children) {
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
        add(&mut own, &self.unshot);
        let Some((split, children)) = &self.children else {
            *pulled = own;
            return 0.0;
        };
        let mut parts = [[[0.0; N]; MAX_FUNCTIONS]; 4];
        let mut sum = 0.0;
        *pulled = [[0.0; N]; MAX_FUNCTIONS];
        for (index, child) in children.iter().enumerate().filter(|(_, c)| c.shape != Shape::Outside) {
            let mut pushed = [[0.0; N]; MAX_FUNCTIONS];
            basis.push(*split, index, &own, &mut pushed);
            sum += child.pull_unshot(basis, &pushed, &mut parts[index]);
        }
        let outside = |index: usize| children[index].shape == Shape::Outside;
        let beyond = beyond(children.len(), outside, |index| parts[index][0]);
        for index in 0..children.len() {
            if outside(index) {
                parts[index][0] = beyond;
            }
            basis.pull_add(*split, index, &parts[index], pulled);
        }
        for (index, _) in children.iter().enumerate().filter(|(_, c)| c.shape != Shape::Outside) {
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
        for (sum, unshot) in own.iter_mut().zip(&mut self.unshot) {
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
            if child.shape != Shape::Outside {
                child.take_unshot(basis, &pushed, reflectance, prune_w_m2, nodes, first + index);
            }
        }
        pull(basis, *split, nodes, slot, first, |index| children[index].shape == Shape::Outside);
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
    fn shape(&self) -> &Shape {
        &self.shape
    }

    fn split(&self) -> Option<Split> {
        self.children.as_ref().map(|(split, _)| *split)
    }

    fn subdivide(&mut self, split: Split, shapes: Vec<Shape>) {
        let basis = match self.irradiance.len() {
            9 => Basis::M3,
            4 => Basis::M2,
            _ => Basis::Haar,
        };
        self.children = Some((split, shapes.into_iter().map(|shape| Element::new(basis, shape)).collect()));
    }

    fn children_mut(&mut self) -> &mut [Self] {
        self.children.as_mut().map_or(&mut [], |(_, children)| children)
    }

    fn deposit(&mut self, irradiance: &[[f64; N]; MAX_FUNCTIONS]) {
        add(&mut self.irradiance, irradiance);
        add(&mut self.unshot, irradiance);
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
