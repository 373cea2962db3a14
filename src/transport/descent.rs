//! From the root of a receiver down, with all sources that are to be resolved on it: at each element each source's link is judged, and those
//! that are too rough for it go on to its children together.
//!
//! What is judged at an element depends on the element alone, so the sources may be shared out among helpers there, and so may its children.

use glam::DVec3;

use super::candidates::{Candidates, narrow};
use super::link::{Element, Link, Samplings, Verdict};
use super::packet::{Shape, cell_corners};
use super::pair::{Oracle, Scratch, Task};
use super::receiver::{Deposited, Receiver};
use super::share::Helpers;
use super::source::Source;
use crate::math::{Cell, Split};
use crate::visibility::NO_FACE;

/// Sources of an element that are judged in one piece.
const TOGETHER: usize = 4;

/// A source as the receiver sees it.
pub(super) struct Aim<'a, S> {
    pub source: &'a S,
    /// What a link may err by, in W/m.
    pub threshold: f64,
    /// Whether its light continues smoothly beyond the receiver's polygon.
    pub extend: bool,
}

impl<'a, S> Aim<'a, S> {
    pub fn new<const N: usize>(source: &'a S, task: Task<'_, N>) -> Self
    where
        S: Source<N>,
    {
        let hull = cell_corners(&Cell::UNIT).map(|c| task.patch.frame.point(c));
        // Beyond the polygon the light of a source in front continues smoothly; that of a source whose plane cuts the
        // parallelogram does not, and is taken from the nearest point of the polygon. A plane through a side does not cut.
        let (source_hull, source_normal) = source.hull(&hull);
        let extend = source_normal.is_none_or(|n| {
            let height = |p: &DVec3| n.dot(*p - source_hull[0]);
            let least = hull.iter().map(height).fold(f64::INFINITY, f64::min);
            least > -1e-9 * hull[0].distance(hull[2]).max(hull[1].distance(hull[3]))
        });
        Self { source, threshold: task.rules.threshold(source), extend }
    }
}

/// A source that comes to an element, by its number among the aims, and what may stand between: lists are ranges of the faces beside.
#[derive(Clone, Copy)]
struct Visitor {
    aim: u32,
    candidates: Candidates,
    /// The face that blocked a segment last, where there is no list. It goes with the source, not with the worker, so that counts of rays are
    /// the same on any number of threads.
    last_blocker: u32,
}

/// What became of the sources that came to an element.
struct Judged<const N: usize> {
    links: Vec<(Visitor, Verdict<N>)>,
    /// The faces that may stand between, of all of them.
    faces: Vec<u32>,
    /// Cost of the longest chain of parts that wait for each other.
    span: u64,
}

impl<const N: usize> Judged<N> {
    /// Adds what became of further sources, who did not wait for these.
    fn and(mut self, other: Self) -> Self {
        let start = self.faces.len();
        self.faces.extend(other.faces);
        self.links.extend(other.links.into_iter().map(|(mut visitor, verdict)| {
            if let Candidates::List(from, to) = &mut visitor.candidates {
                (*from, *to) = (*from + start, *to + start);
            }
            (visitor, verdict)
        }));
        self.span = self.span.max(other.span);
        self
    }
}

/// An element, and who comes to it.
#[derive(Clone, Copy)]
struct Visit<'v> {
    cell: Cell,
    level: u8,
    visitors: &'v [Visitor],
    /// The faces that may stand between, of all visitors.
    faces: &'v [u32],
}

/// A child of a receiver.
struct Part<'a, const N: usize, R> {
    receiver: &'a mut R,
    cell: Cell,
    deposited: Deposited<N>,
}

/// A receiver's task, once its sources are sorted.
pub(super) struct Descent<'a, const N: usize, S> {
    task: Task<'a, N>,
    weight: f64,
    aims: &'a [Aim<'a, S>],
    /// Whether links are recorded.
    records: bool,
}

impl<const N: usize, S> Clone for Descent<'_, N, S> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<const N: usize, S> Copy for Descent<'_, N, S> {}

impl<'a, const N: usize, S: Source<N>> Descent<'a, N, S> {
    pub fn new(task: Task<'a, N>, aims: &'a [Aim<'a, S>], records: bool) -> Self {
        Self { task, weight: task.weight(), aims, records }
    }

    /// Visits the whole receiver with all sources.
    pub fn begin<R: Receiver<N>>(
        self,
        receiver: &mut R,
        scratch: &mut Scratch,
        helpers: &dyn Helpers,
    ) -> Deposited<N> {
        let candidates = self.task.candidates();
        let visitor = |aim| Visitor { aim, candidates, last_blocker: NO_FACE };
        let visitors = (0..self.aims.len() as u32).map(visitor);
        let visitors: Vec<Visitor> = visitors.collect();
        self.visit(
            receiver,
            Visit { cell: Cell::UNIT, level: 0, visitors: &visitors, faces: &[] },
            scratch,
            helpers,
        )
    }

    fn visit<R: Receiver<N>>(
        self,
        receiver: &mut R,
        visit: Visit<'_>,
        scratch: &mut Scratch,
        helpers: &dyn Helpers,
    ) -> Deposited<N> {
        let mut deposited = Deposited::default();
        if receiver.shape() == Shape::Outside || !(self.task.go_on)() {
            return deposited;
        }
        let hull = cell_corners(&visit.cell).map(|c| self.task.patch.frame.point(c));
        let shape = receiver.shape();
        let area_m2 = self.task.patch.frame.area_m2 * visit.cell.area() * shape.share();
        let element = Element { cell: visit.cell, hull, shape, area_m2, divided: receiver.split().is_some() };
        let Judged { links, faces, span } = self.judge(&element, visit, scratch, helpers);
        deposited.span = span;
        let wanted = links.iter().find_map(|(_, verdict)| match verdict {
            Verdict::Rough(split) => Some(*split),
            _ => None,
        });
        if let (None, Some(wanted)) = (receiver.split(), wanted) {
            let shapes: Vec<Shape> = (0..wanted.children().len())
                .map(|i| receiver.shape().of_child(&visit.cell.child(wanted, i)))
                .collect();
            receiver.subdivide(wanted, &shapes, helpers.arena());
        }
        let split = receiver.split();
        let mut visitors = Vec::new();
        for (visitor, verdict) in links {
            match verdict {
                Verdict::Linked { light, error_squared, cut_short, deviates, mut record }
                    if !deviates || split.is_none() =>
                {
                    scratch.work.interactions += 1;
                    scratch.work.interactions_without_rays +=
                        u64::from(visitor.candidates == Candidates::Free);
                    receiver.deposit(&light);
                    deposited.take(self.task.patch, &light, area_m2);
                    deposited.error_squared += error_squared;
                    deposited.unresolved.cut_short += if cut_short { error_squared } else { 0.0 };
                    record.set_source(visitor.aim);
                    deposited.links.append(record);
                }
                _ => visitors.push(visitor),
            }
        }
        if let (Some(split), false) = (split, visitors.is_empty()) {
            let below = Visit { level: visit.level + 1, visitors: &visitors, faces: &faces, ..visit };
            deposited.add_after(self.visit_children(receiver, split, below, scratch, helpers));
        }
        deposited
    }

    /// Visits the children. What they receive is summed child by child, so that it is the same whoever visited them.
    fn visit_children<R: Receiver<N>>(
        self,
        receiver: &mut R,
        split: Split,
        visit: Visit<'_>,
        scratch: &mut Scratch,
        helpers: &dyn Helpers,
    ) -> Deposited<N> {
        let mut sum = Deposited::default();
        let children = receiver.children_mut().iter_mut().enumerate();
        let children = children.map(|(index, child)| (child, visit.cell.child(split, index)));
        if helpers.wanted() {
            let part = |(receiver, cell)| Part { receiver, cell, deposited: Deposited::default() };
            let mut parts: Vec<Part<'_, N, R>> = children.map(part).collect();
            self.visit_parts(&mut parts, visit, scratch, helpers);
            parts.into_iter().for_each(|part| sum.add_beside(part.deposited));
        } else {
            for (child, cell) in children {
                sum.add_beside(self.visit(child, Visit { cell, ..visit }, scratch, helpers));
            }
        }
        sum
    }

    /// Visits the parts, half of them perhaps elsewhere.
    fn visit_parts<R: Receiver<N>>(
        self,
        parts: &mut [Part<'_, N, R>],
        visit: Visit<'_>,
        scratch: &mut Scratch,
        helpers: &dyn Helpers,
    ) {
        match parts {
            [] => {}
            [part] => {
                let visit = Visit { cell: part.cell, ..visit };
                part.deposited = self.visit(part.receiver, visit, scratch, helpers);
            }
            _ => {
                let (first, second) = parts.split_at_mut(parts.len() / 2);
                helpers.both(
                    scratch,
                    &mut |helpers, scratch| self.visit_parts(first, visit, scratch, helpers),
                    &mut |helpers, scratch| self.visit_parts(second, visit, scratch, helpers),
                );
            }
        }
    }

    /// Judges the links of all visitors to an element; those that bring nothing are left out. Many are halved, always at the same places, so
    /// that the outcome is the same whoever judges which half.
    fn judge(
        self,
        element: &Element<'_>,
        visit: Visit<'_>,
        scratch: &mut Scratch,
        helpers: &dyn Helpers,
    ) -> Judged<N> {
        if visit.visitors.len() <= TOGETHER {
            return self.judge_together(element, visit, scratch);
        }
        let (first, second) = visit.visitors.split_at(visit.visitors.len() / 2);
        let (mut one, mut other) = (None, None);
        let mut judge_one = |helpers: &dyn Helpers, scratch: &mut Scratch| {
            one = Some(self.judge(element, Visit { visitors: first, ..visit }, scratch, helpers));
        };
        let mut judge_other = |helpers: &dyn Helpers, scratch: &mut Scratch| {
            other = Some(self.judge(element, Visit { visitors: second, ..visit }, scratch, helpers));
        };
        if helpers.wanted() {
            helpers.both(scratch, &mut judge_one, &mut judge_other);
        } else {
            judge_one(helpers, scratch);
            judge_other(helpers, scratch);
        }
        one.into_iter().chain(other).reduce(Judged::and).unwrap_or_default()
    }

    fn judge_together(self, element: &Element<'_>, visit: Visit<'_>, scratch: &mut Scratch) -> Judged<N> {
        let samplings = Samplings::new(element, self.task);
        let (before, top) = (scratch.work.cost(), scratch.candidates.len());
        let mut judged = Judged::default();
        let mut divided = element.divided;
        for visitor in visit.visitors {
            let aim = &self.aims[visitor.aim as usize];
            if !aim.source.reaches(self.task.patch.frame.normal, &element.hull) {
                continue;
            }
            scratch.last_blocker = visitor.last_blocker;
            let candidates = self.narrow(aim, element, visitor.candidates, visit.faces, scratch);
            if visit.level == 0 && candidates == Candidates::Free {
                scratch.work.pairs_unoccluded += 1;
            }
            if candidates == Candidates::Hidden {
                scratch.work.pairs_hidden += 1;
                scratch.candidates.truncate(top);
                continue;
            }
            let verdict = match self.task.rules.oracle {
                Oracle::Uniform(depth) if visit.level < depth => Verdict::Rough(Split::Both),
                _ => {
                    let Self { task, weight, records, .. } = self;
                    Link { task, weight, records, aim, element, samplings: &samplings, candidates, scratch }
                        .judge(divided)
                }
            };
            divided |= matches!(verdict, Verdict::Rough(_));
            let mut visitor = Visitor { candidates, last_blocker: scratch.last_blocker, ..*visitor };
            if let Candidates::List(from, to) = &mut visitor.candidates {
                let start = judged.faces.len();
                judged.faces.extend_from_slice(&scratch.candidates[*from..*to]);
                (*from, *to) = (start, judged.faces.len());
            }
            scratch.candidates.truncate(top);
            judged.links.push((visitor, verdict));
        }
        judged.span = scratch.work.cost() - before;
        judged
    }

    /// Narrows what may stand between; a list then stands at the end of the scratch list.
    fn narrow(
        self,
        aim: &Aim<'_, S>,
        element: &Element<'_>,
        candidates: Candidates,
        faces: &[u32],
        scratch: &mut Scratch,
    ) -> Candidates {
        if candidates == Candidates::Free {
            return candidates;
        }
        let (hull, patch) = (&element.hull, self.task.patch);
        let (source, normal) = aim.source.hull(hull);
        let skip = [patch.face, aim.source.face()];
        let candidates = match candidates {
            Candidates::List(from, to) => {
                let start = scratch.candidates.len();
                scratch.candidates.extend_from_slice(&faces[from..to]);
                Candidates::List(start, scratch.candidates.len())
            }
            other => other,
        };
        let receiver = (&hull[..], Some(patch.frame.normal));
        narrow(self.task.occluder, candidates, skip, receiver, (&source, normal), scratch)
    }
}

impl<const N: usize> Default for Judged<N> {
    fn default() -> Self {
        Self { links: Vec::new(), faces: Vec::new(), span: 0 }
    }
}
