//! The state of a run: one tree per surface, what each has still to shoot, and norms of the solution so far.

use ccnuma::Arena;

use crate::math::Basis;
use crate::math::basis::MAX_FUNCTIONS;
use crate::scene::{Scene, Surface};
use crate::transport::{
    Deposited, Detail, Packet, PacketNode, Patch, Receiver, Shape, Store, Unresolved, Work,
};

use super::element::Element;
use super::mixing::Direct;
use super::order;
use super::solution::{Field, Node};

/// A surface with its tree of elements.
#[derive(Debug)]
pub struct Tree<const N: usize> {
    /// What pair tasks need to know of the surface.
    pub patch: Patch<N>,
    /// The tree.
    pub root: Element<N>,
    /// Basis of the tree.
    pub basis: Basis,
    /// Area of the polygon.
    pub area_m2: f64,
    /// Exitance.
    pub exitance_w_m2: [f64; N],
    /// Bound on the unshot power in W: reflected and not yet sent on.
    pub unshot_w: f64,
    /// Power received from other surfaces by interreflection so far, per band, in W.
    pub indirect_w: [f64; N],
    /// Squared link errors of what was received since it was last dark, in W²/m².
    pub error_squared: f64,
    /// Those of light that was not resolved.
    pub unresolved: Unresolved,
    /// Work done to light it in the stage at hand.
    pub work: Work,
    /// Cost of the longest chain of parts of that work that wait for each other.
    pub span: u64,
    /// Links to other surfaces, where they are stored.
    pub store: Option<Box<Store>>,
    /// The direct irradiance, where states are to be mixed.
    pub(super) direct: Option<Box<Direct<N>>>,
    outline: Option<Box<[glam::DVec2]>>,
}

impl<const N: usize> Tree<N> {
    /// The tree of a surface, dark; its elements live in `arena`.
    pub fn new(index: u32, surface: &Surface, basis: Basis, arena: &Arena) -> Self {
        let shape = Shape::of_surface(surface);
        Self {
            patch: Patch::new(index, surface),
            root: Element::new(basis, &shape, arena),
            basis,
            area_m2: surface.area_m2,
            exitance_w_m2: std::array::from_fn(|n| surface.exitance_w_m2[n]),
            unshot_w: 0.0,
            indirect_w: [0.0; N],
            error_squared: 0.0,
            unresolved: Unresolved::default(),
            work: Work::default(),
            span: 0,
            store: None,
            direct: None,
            outline: (!surface.full).then(|| surface.outline.clone().into_boxed_slice()),
        }
    }

    /// The packet of the surface's own exitance.
    pub fn exitance_packet(&self) -> Packet<N> {
        let mut coefficients = [[0.0; N]; MAX_FUNCTIONS];
        coefficients[0] = self.exitance_w_m2;
        let nodes = vec![PacketNode { coefficients, detail: Detail::default(), children: None }];
        self.packet(Basis::Haar, nodes)
    }

    /// Takes what is unshot into a packet; nothing remains. Detail below `prune_w_m2` is averaged, and where orders are not fixed, so are
    /// functions.
    pub fn take_packet(&mut self, prune_w_m2: f64) -> Packet<N> {
        let blank =
            PacketNode { coefficients: [[0.0; N]; MAX_FUNCTIONS], detail: Detail::default(), children: None };
        let mut nodes = vec![blank];
        let none = [[0.0; N]; MAX_FUNCTIONS];
        self.root.take_unshot(self.basis, &none, &self.patch.reflectance, prune_w_m2, &mut nodes, 0);
        // Packets of all surfaces may be under way at once.
        nodes.shrink_to_fit();
        self.unshot_w = 0.0;
        let cells = nodes.iter().map(|node| node.coefficients.as_flattened());
        let basis = order::least(self.basis, N, cells, prune_w_m2);
        for node in &mut nodes {
            order::restrict(self.basis, basis, node.coefficients.as_flattened_mut(), N);
        }
        self.packet(basis, nodes)
    }

    /// Marks all irradiance as unshot and measures it.
    pub fn unshoot(&mut self) {
        self.root.unshoot();
        self.measure_unshot();
    }

    /// Darkens the tree, all of whose irradiance is marked unshot ([`Tree::unshoot`]), for a better transport of the light it reflects by
    /// now, which is returned; what the new irradiance differs from the old is unshot.
    pub fn restart(&mut self, prune_w_m2: f64) -> Packet<N> {
        let packet = self.take_packet(prune_w_m2);
        self.root.restart();
        (self.error_squared, self.unresolved) = (0.0, Unresolved::default());
        packet
    }

    /// Takes all light from the tree.
    pub fn darken(&mut self) {
        self.root.darken();
        self.unshot_w = 0.0;
        (self.error_squared, self.unresolved) = (0.0, Unresolved::default());
    }

    /// Books what a pair task brought; all sums over sources are kept per receiver, so that they do not depend on who works.
    pub fn book(&mut self, deposited: &Deposited<N>) {
        self.unshot_w += deposited.to_reflect_w;
        self.error_squared += deposited.error_squared;
        self.unresolved += deposited.unresolved;
        self.span += deposited.span;
        for n in 0..N {
            self.indirect_w[n] += deposited.received_w[n];
        }
    }

    /// Measures the unshot power anew: sums of signed light that cancels are smaller than the sums of its parts.
    pub fn measure_unshot(&mut self) {
        let mut pulled = [[0.0; N]; MAX_FUNCTIONS];
        let detail = self.root.pull_unshot(self.basis, &[[0.0; N]; MAX_FUNCTIONS], &mut pulled);
        let brightest = self.patch.reflectance.iter().copied().fold(0.0, f64::max);
        self.unshot_w = self.area_m2 * (self.patch.reflected_w_m2(&pulled) + brightest * detail.sqrt());
    }

    /// Moves the elements to another arena.
    pub fn move_to(&mut self, arena: &Arena) {
        self.root = self.root.copy_to(arena);
    }

    /// Drops all that the tree owns; nothing can be done with it any more.
    pub fn fell(&mut self, arena: &Arena) {
        self.root = Element::new(self.basis, &Shape::Outside, arena);
        self.patch.corners = Box::default();
        self.store = None;
        self.outline = None;
    }

    /// Bytes besides the elements.
    pub fn bytes(&self) -> usize {
        let outline = self.outline.as_deref().map_or(0, size_of_val);
        size_of::<Self>() - size_of::<Element<N>>() + size_of_val(&*self.patch.corners) + outline
    }

    /// Power left to reflect per band in W, without the bound's allowance for what varies.
    pub fn unshot_by_band_w(&self) -> [f64; N] {
        let mean = self.root.mean_unshot();
        std::array::from_fn(|n| mean[n] * self.patch.reflectance[n] * self.area_m2)
    }

    fn packet(&self, basis: Basis, nodes: Vec<PacketNode<N>>) -> Packet<N> {
        let Patch { surface, face, frame, .. } = self.patch;
        Packet::new(surface, face, frame, self.outline.clone(), basis, nodes)
    }

    /// `∫ Σ_bands (ρE)² dA` over the surface, in W²/m²; cut leaves by their share.
    pub fn reflected_norm_squared(&self) -> f64 {
        let none = [[0.0; N]; MAX_FUNCTIONS];
        self.norm_squared(&self.root, &none, self.patch.frame.area_m2)
    }

    fn norm_squared(&self, element: &Element<N>, above: &[[f64; N]; MAX_FUNCTIONS], area_m2: f64) -> f64 {
        let mut sum = *above;
        element.add_irradiance(&mut sum);
        match element.children() {
            None => {
                let rho = &self.patch.reflectance;
                let square: f64 =
                    sum.iter().flat_map(|c| (0..N).map(|n| (rho[n] * c[n]) * (rho[n] * c[n]))).sum();
                square * area_m2 * element.shape().share()
            }
            Some((split, children)) => (0..children.len())
                .map(|i| {
                    let mut pushed = [[0.0; N]; MAX_FUNCTIONS];
                    self.basis.push(split, i, &sum, &mut pushed);
                    self.norm_squared(&children[i], &pushed, area_m2 / children.len() as f64)
                })
                .sum(),
        }
    }

    /// The irradiance pushed down to the leaves.
    pub fn field(&self) -> Field {
        let coefficients = Vec::with_capacity(self.root.leaves() as usize * self.basis.len() * N);
        let mut field = Field::new(self.basis, N, vec![Node::Outside], coefficients);
        self.flatten(&self.root, &[[0.0; N]; MAX_FUNCTIONS], &mut field, 0);
        field.nodes.shrink_to_fit();
        field
    }

    fn flatten(
        &self,
        element: &Element<N>,
        above: &[[f64; N]; MAX_FUNCTIONS],
        field: &mut Field,
        slot: usize,
    ) {
        if element.shape() == Shape::Outside {
            return;
        }
        let mut sum = *above;
        element.add_irradiance(&mut sum);
        match element.children() {
            None => {
                field.nodes[slot] = Node::Leaf(field.coefficients.len() as u32);
                field.coefficients.extend(sum[..self.basis.len()].iter().flatten());
            }
            Some((split, children)) => {
                let first = field.nodes.len();
                field.nodes[slot] = Node::Inner(split, first as u32);
                field.nodes.resize(first + children.len(), Node::Outside);
                for (i, child) in children.iter().enumerate() {
                    let mut pushed = [[0.0; N]; MAX_FUNCTIONS];
                    self.basis.push(split, i, &sum, &mut pushed);
                    self.flatten(child, &pushed, field, first + i);
                }
            }
        }
    }
}

/// All trees of a scene, dark, in one arena.
pub fn trees<const N: usize>(surfaces: &[Surface], basis: Basis, arena: &Arena) -> Vec<Tree<N>> {
    surfaces.iter().enumerate().map(|(i, s)| Tree::new(i as u32, s, basis, arena)).collect()
}

/// Diameter of the scene, lights included, in metres.
pub fn extent_m(scene: &Scene) -> f64 {
    let Some((mut low, mut high)) = scene.bounds_m() else { return 0.0 };
    for light in &scene.lights {
        if let crate::scene::Light::Point { position, .. } | crate::scene::Light::Spot { position, .. } =
            light
        {
            (low, high) = (low.min(*position), high.max(*position));
        }
    }
    (high - low).length()
}
