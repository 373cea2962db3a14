//! Packets of light that is known as a field: the radiosity of a finished solution, or an exitance that varies over its surface.

use super::element::pull;
use super::solution::{Field, Node};
use crate::math::basis::MAX_FUNCTIONS;
use crate::scene::Surface;
use crate::transport::{Detail, Packet, PacketNode};

/// The packet of surface number `index` that sends, in W/m², what `value` makes of each of the field's coefficients, told its function and
/// its band.
pub fn field_packet<const N: usize>(
    index: usize,
    surface: &Surface,
    field: &Field,
    value: impl Fn(usize, usize, f64) -> f64,
) -> Packet<N> {
    let blank =
        PacketNode { coefficients: [[0.0; N]; MAX_FUNCTIONS], detail: Detail::default(), children: None };
    let mut nodes = vec![blank];
    Builder { field, value }.fill(0, &mut nodes, 0);
    let outline = (!surface.full).then(|| surface.outline.clone().into_boxed_slice());
    Packet::new(index as u32, surface.face, surface.frame, outline, field.basis, nodes)
}

struct Builder<'a, V> {
    field: &'a Field,
    value: V,
}

impl<V: Fn(usize, usize, f64) -> f64> Builder<'_, V> {
    fn fill<const N: usize>(&self, at: usize, nodes: &mut Vec<PacketNode<N>>, slot: usize) {
        let basis = self.field.basis;
        match self.field.nodes[at] {
            Node::Outside => {}
            Node::Leaf(start) => {
                for a in 0..basis.len() {
                    let from = start as usize + a * N;
                    nodes[slot].coefficients[a] =
                        std::array::from_fn(|n| (self.value)(a, n, self.field.coefficients[from + n]));
                }
            }
            Node::Inner(split, first_child) => {
                let first = nodes.len();
                let count = split.children().len();
                let blank = nodes[slot].clone();
                nodes.resize(first + count, blank);
                for i in 0..count {
                    self.fill(first_child as usize + i, nodes, first + i);
                }
                pull(basis, split, nodes, slot, first, |i| {
                    matches!(self.field.nodes[first_child as usize + i], Node::Outside)
                });
            }
        }
    }
}
