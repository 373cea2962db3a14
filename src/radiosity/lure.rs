//! Lures: what a pair task shoots onto where the receiver itself is not at hand (the paper's section 5.2), and how it is merged later.
//!
//! A lure is an empty tree that is divided as the receiver was when its [`Form`] was last looked at, and further where the light asks for it; elements
//! that the light does not reach are never made. Meanwhile the receiver may have been divided in other ways. Where it is undivided it is divided
//! as the lure is; where both are divided alike the children are merged; where they are divided differently the lure's functions are pushed
//! down, exactly (a restriction of a polynomial is a polynomial), to the largest cells that both know. So the sum at every point is kept to
//! rounding.

use std::sync::Arc;

use ccnuma::Arena;
use glam::DVec2;

use crate::math::basis::MAX_FUNCTIONS;
use crate::math::{Basis, Cell, Split};
use crate::transport::{Deposited, Patch, Receiver, Shape, Work};

use super::element::Element;
use super::state::Tree;

/// How an element was divided, with the ones below it.
#[derive(Clone, Debug)]
struct Division {
    shape: Shape,
    children: Option<(Split, Arc<[Division]>)>,
}

impl Division {
    fn of<const N: usize>(element: &Element<N>) -> Self {
        let below = |(split, children): (_, &[Element<N>])| (split, children.iter().map(Self::of).collect());
        Self { shape: element.shape().map(Box::from), children: element.children().map(below) }
    }
}

/// What lures of a receiver are made from; at hand while the receiver is not. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Form<const N: usize> {
    /// The receiver's patch.
    pub patch: Arc<Patch<N>>,
    root: Division,
}

impl<const N: usize> Form<N> {
    /// The form of a receiver as it is divided now.
    pub fn new(tree: &Tree<N>) -> Self {
        Self { patch: Arc::new(tree.patch.clone()), root: Division::of(&tree.root) }
    }

    /// Follows the receiver's divisions.
    pub fn renew(&mut self, tree: &Tree<N>) {
        self.root = Division::of(&tree.root);
    }

    /// An empty tree of this form.
    pub fn lure(&self) -> Lure<N> {
        Lure { root: LureElement::of(&self.root), deposited: Deposited::default(), work: Work::default() }
    }
}

/// What one pair task shot onto an empty tree.
#[derive(Clone, Debug)]
pub struct Lure<const N: usize> {
    /// The tree.
    pub root: LureElement<N>,
    /// What the pair task brought.
    pub deposited: Deposited<N>,
    /// What it took.
    pub work: Work,
}

/// An element of a lure; those below it are made when they are asked for.
#[derive(Clone, Debug)]
pub struct LureElement<const N: usize> {
    shape: Shape,
    form: Option<(Split, Arc<[Division]>)>,
    irradiance: [[f64; N]; MAX_FUNCTIONS],
    children: Option<(Split, Box<[Self]>)>,
}

impl<const N: usize> LureElement<N> {
    fn new(shape: Shape, form: Option<(Split, Arc<[Division]>)>) -> Self {
        Self { shape, form, irradiance: [[0.0; N]; MAX_FUNCTIONS], children: None }
    }

    fn of(division: &Division) -> Self {
        Self::new(division.shape.clone(), division.children.clone())
    }
}

impl<const N: usize> Receiver<N> for LureElement<N> {
    fn shape(&self) -> Shape<&[DVec2]> {
        match &self.shape {
            Shape::Whole => Shape::Whole,
            Shape::Outside => Shape::Outside,
            Shape::Part(outline, share) => Shape::Part(outline, *share),
        }
    }

    fn split(&self) -> Option<Split> {
        let made = self.children.as_ref().map(|(split, _)| *split);
        made.or(self.form.as_ref().map(|(split, _)| *split))
    }

    /// A lure does not live long: it is on the heap, not in the receiver's arena.
    fn subdivide(&mut self, split: Split, shapes: &[Shape], _: &Arena) {
        self.children = Some((split, shapes.iter().map(|shape| Self::new(shape.clone(), None)).collect()));
    }

    fn children_mut(&mut self) -> &mut [Self] {
        if let (None, Some((split, below))) = (&self.children, &self.form) {
            self.children = Some((*split, below.iter().map(Self::of).collect()));
        }
        self.children.as_mut().map_or(&mut [], |(_, children)| children)
    }

    fn deposit(&mut self, irradiance: &[[f64; N]; MAX_FUNCTIONS]) {
        for (sum, more) in self.irradiance.iter_mut().zip(irradiance) {
            for n in 0..N {
                sum[n] += more[n];
            }
        }
    }
}

impl<const N: usize> Tree<N> {
    /// Adds what was shot onto a lure of this surface, as if it had been shot here; new elements live in `arena`.
    pub fn merge(&mut self, lure: &Lure<N>, arena: &Arena) {
        Merge { basis: self.basis, arena }.add(&mut self.root, &lure.root, Cell::UNIT);
        self.book(&lure.deposited);
        self.work += lure.work;
    }
}

/// What a merge needs at every element.
#[derive(Clone, Copy)]
struct Merge<'a> {
    basis: Basis,
    arena: &'a Arena,
}

impl Merge<'_> {
    /// Adds the light of `lure` to `receiver`; both have this cell.
    fn add<const N: usize>(self, receiver: &mut Element<N>, lure: &LureElement<N>, cell: Cell) {
        receiver.deposit(&lure.irradiance);
        let Some((split, children)) = &lure.children else { return };
        if receiver.split().is_none() {
            let shapes: Vec<Shape> = children.iter().map(|child| child.shape.clone()).collect();
            receiver.subdivide(*split, &shapes, self.arena);
        }
        if receiver.split() == Some(*split) {
            for (index, (mine, child)) in receiver.children_mut().iter_mut().zip(children).enumerate() {
                self.add(mine, child, cell.child(*split, index));
            }
        } else {
            for (index, child) in children.iter().enumerate() {
                self.scatter(receiver, cell, child, cell.child(*split, index));
            }
        }
    }

    /// Adds the light of `lure`, an element with the cell `part` of the receiver's.
    fn scatter<const N: usize>(
        self,
        receiver: &mut Element<N>,
        cell: Cell,
        lure: &LureElement<N>,
        part: Cell,
    ) {
        if lure.irradiance.iter().flatten().any(|c| *c != 0.0) {
            self.deposit_part(receiver, cell, &lure.irradiance, part);
        }
        let Some((split, children)) = &lure.children else { return };
        for (index, child) in children.iter().enumerate() {
            self.scatter(receiver, cell, child, part.child(*split, index));
        }
    }

    /// Adds a function given on `part` of the receiver's cell. Cells are dyadic: in each direction `part` spans the receiver's cell, or lies in
    /// one of its halves.
    fn deposit_part<const N: usize>(
        self,
        receiver: &mut Element<N>,
        cell: Cell,
        function: &[[f64; N]; MAX_FUNCTIONS],
        part: Cell,
    ) {
        if receiver.shape() == Shape::Outside {
            return;
        }
        if part == cell {
            return receiver.deposit(function);
        }
        let smaller = (part.size.x < cell.size.x, part.size.y < cell.size.y);
        let split = receiver.split().unwrap_or_else(|| {
            let split = match smaller {
                (true, true) => Split::Both,
                (true, false) => Split::U,
                (false, _) => Split::V,
            };
            let shape = receiver.shape();
            let shapes: Vec<Shape> =
                (0..split.children().len()).map(|i| shape.of_child(&cell.child(split, i))).collect();
            receiver.subdivide(split, &shapes, self.arena);
            split
        });
        // Where the receiver is divided across a direction that the part spans, the part is divided too.
        let cut = match split {
            Split::Both if smaller == (true, true) => None,
            Split::Both if smaller.0 => Some(Split::V),
            Split::Both => Some(Split::U),
            Split::U if smaller.0 => None,
            Split::V if smaller.1 => None,
            other => Some(other),
        };
        let mut pieces = vec![(part, *function)];
        if let Some(cut) = cut {
            let piece = |index| {
                let mut pushed = [[0.0; N]; MAX_FUNCTIONS];
                self.basis.push(cut, index, function, &mut pushed);
                (part.child(cut, index), pushed)
            };
            pieces = (0..cut.children().len()).map(piece).collect();
        }
        for (piece, function) in pieces {
            let index = split.child_at(cell.to_local(piece.centre()));
            let child = &mut receiver.children_mut()[index];
            self.deposit_part(child, cell.child(split, index), &function, piece);
        }
    }
}

#[cfg(test)]
mod tests {
    use ccnuma::arena::Backend;
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;
    use crate::math::polygon;
    use crate::scene::{Frame, Surface};

    const SPLITS: [Split; 3] = [Split::U, Split::V, Split::Both];

    /// Two numbers a step, from a stream that starts over.
    type Numbers = Vec<(usize, f64)>;

    fn numbers() -> impl Strategy<Value = Numbers> {
        proptest::collection::vec((0..6usize, -1.0..1.0f64), 40)
    }

    /// Divides where nothing is divided, and deposits, as the numbers say, at most `depth` levels down.
    fn grow<R: Receiver<1>>(
        element: &mut R,
        basis: Basis,
        cell: Cell,
        depth: usize,
        numbers: &mut dyn Iterator<Item = (usize, f64)>,
        arena: &Arena,
    ) {
        if element.shape() == Shape::Outside {
            return;
        }
        let (choice, _) = numbers.next().unwrap();
        if choice % 2 == 0 || depth == 0 {
            let mut function = [[0.0]; MAX_FUNCTIONS];
            function[..basis.len()].fill_with(|| [numbers.next().unwrap().1]);
            element.deposit(&function);
        }
        if choice < 4 && depth > 0 {
            let split = element.split().unwrap_or(SPLITS[choice % 3]);
            if element.split().is_none() {
                let shape = element.shape();
                let shapes: Vec<Shape> =
                    (0..split.children().len()).map(|i| shape.of_child(&cell.child(split, i))).collect();
                element.subdivide(split, &shapes, arena);
            }
            for (index, child) in element.children_mut().iter_mut().enumerate() {
                grow(child, basis, cell.child(split, index), depth - 1, numbers, arena);
            }
        }
    }

    fn value(element: &Element<1>, basis: Basis, local: DVec2) -> f64 {
        let mut own = [[0.0]; MAX_FUNCTIONS];
        element.add_irradiance(&mut own);
        let phi = basis.evaluate(local);
        let here: f64 = own.iter().zip(phi).map(|([c], phi)| c * phi).sum();
        let Some((split, children)) = element.children() else { return here };
        let index = split.child_at(local);
        here + value(&children[index], basis, Cell::UNIT.child(split, index).to_local(local))
    }

    /// A square, or a quadrilateral that fills half of one.
    fn tree(cut: bool, basis: Basis, arena: &Arena) -> Tree<1> {
        let upper = if cut { [(1.0, 0.4), (0.7, 1.0)] } else { [(1.0, 1.0), (0.0, 1.0)] };
        let outline = [(0.0, 0.0), (1.0, 0.0), upper[0], upper[1]].map(DVec2::from).to_vec();
        let (origin, u, v, normal) = (DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z);
        let surface = Surface {
            face: 0,
            back: false,
            frame: Frame { origin, u, v, normal, area_m2: 1.0 },
            area_m2: polygon::area(&outline),
            outline,
            full: !cut,
            reflectance: vec![0.5],
            exitance_w_m2: vec![0.0],
        };
        Tree::new(0, &surface, basis, arena)
    }

    /// A tree with the light of the lure alone.
    fn alone(cut: bool, basis: Basis, lure: &Lure<1>, arena: &Arena) -> Tree<1> {
        let mut alone = tree(cut, basis, arena);
        alone.merge(lure, arena);
        alone
    }

    /// A receiver divided `early`, further after the lure's form was taken, and the lure shot at meanwhile.
    fn check(cut: bool, basis: Basis, [early, mine, other]: [&Numbers; 3]) -> Result<(), TestCaseError> {
        let arena = &Arena::new(Backend::Malloc);
        let stream = |numbers: &Numbers| numbers.clone().into_iter().cycle();
        let mut tree = tree(cut, basis, arena);
        grow(&mut tree.root, basis, Cell::UNIT, 2, &mut stream(early), arena);
        let form = Form::new(&tree);
        let mut lure = form.lure();
        grow(&mut tree.root, basis, Cell::UNIT, 4, &mut stream(mine), arena);
        grow(&mut lure.root, basis, Cell::UNIT, 4, &mut stream(other), arena);
        let (before, alone) = (tree.root.copy_to(arena), alone(cut, basis, &lure, arena));
        tree.merge(&lure, arena);
        for (i, j) in (0..23).flat_map(|i| (0..23).map(move |j| (i, j))) {
            let at = DVec2::new(i as f64 + 0.51, j as f64 + 0.53) / 23.0;
            let inside = match tree.root.shape() {
                Shape::Part(outline, _) => polygon::contains(outline, at),
                _ => true,
            };
            if inside {
                let expected = value(&before, basis, at) + value(&alone.root, basis, at);
                let found = value(&tree.root, basis, at);
                prop_assert!((found - expected).abs() < 1e-11, "{basis:?} at {at}: {found}, not {expected}");
            }
        }
        if !cut {
            let mean = |root: &Element<1>| root.mean_unshot()[0];
            let expected = mean(&before) + mean(&alone.root);
            prop_assert!((mean(&tree.root) - expected).abs() < 1e-12, "{basis:?}");
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn merging_adds_the_functions_however_both_are_divided(
            early in numbers(), mine in numbers(), other in numbers(),
        ) {
            for basis in [Basis::Haar, Basis::M2, Basis::M3] {
                check(false, basis, [&early, &mine, &other])?;
                check(true, basis, [&early, &mine, &other])?;
            }
        }
    }

    #[test]
    fn what_is_shot_on_a_lure_ends_up_where_it_would_have_been_shot() {
        let numbers: Numbers = (0..40).map(|i| (i % 5, (i * i % 17) as f64)).collect();
        let mut numbers = std::iter::repeat_with(|| numbers.clone().into_iter().cycle());
        let arena = &Arena::new(Backend::Malloc);
        let mut grown = |depth| {
            let mut tree = tree(true, Basis::M2, arena);
            grow(&mut tree.root, Basis::M2, Cell::UNIT, depth, &mut numbers.next().unwrap(), arena);
            tree
        };
        for depth in [0, 2] {
            let (mut receiver, mut direct) = (grown(depth), grown(depth));
            let form = Form::new(&receiver);
            let mut lure = form.lure();
            let stream = |from| (from..).map(|i: usize| (i / 3 % 4, (i % 13) as f64));
            grow(&mut lure.root, Basis::M2, Cell::UNIT, 4, &mut stream(depth), arena);
            grow(&mut direct.root, Basis::M2, Cell::UNIT, 4, &mut stream(depth), arena);
            receiver.merge(&lure, arena);
            assert!(direct.root.leaves() > 8);
            assert_eq!(format!("{:?}", receiver.root), format!("{:?}", direct.root));
        }
    }

    #[test]
    fn accounts_are_booked_and_no_needless_element_is_made() {
        let arena = &Arena::new(Backend::Malloc);
        let mut receiver = tree(false, Basis::Haar, arena);
        let shapes = [const { Shape::Whole }; 4];
        receiver.root.subdivide(Split::Both, &shapes, arena);
        let form = Form::new(&receiver);
        let mut lure = form.lure();
        assert_eq!(lure.root.split(), Some(Split::Both));
        lure.deposited = Deposited {
            received_w: [2.0],
            to_reflect_w: 1.0,
            error_squared: 0.5,
            span: 7,
            ..Deposited::default()
        };
        lure.work.interactions = 3;
        receiver.merge(&lure, arena);
        receiver.merge(&lure, arena);
        assert!(lure.root.children.is_none());
        let booked = (receiver.indirect_w, receiver.unshot_w, receiver.error_squared, receiver.span);
        assert_eq!(booked, ([4.0], 2.0, 1.0, 14));
        assert_eq!(receiver.work.interactions, 6);
    }
}
