//! The parts of a task: where a receiver's subtrees could have been shared out, and what each half cost. A helper that never helps notes
//! it: it runs both halves one after the other and looks at the counts of work in between.

use std::cell::RefCell;

use ccnuma::Arena;

use crate::transport::{Half, Helpers, Scratch};

/// Halves that cost less than this are not told apart, as costs ([`crate::transport::Work::cost`]): some twenty microseconds, ten times
/// what a steal costs.
const LEAST_PART: u32 = 256;

/// A step of a task. The steps of a task, and of each half, follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Work that cannot be shared out: its cost.
    Run(u32),
    /// Two halves that may run at the same time: how many of the parts that follow belong to the first, and after them to the second.
    Fork {
        /// Parts of the first half.
        first: u32,
        /// Parts of the second half.
        second: u32,
    },
}

/// Notes the parts of one task after the other.
#[derive(Debug)]
pub(super) struct Noting<'a>(RefCell<Notes>, &'a Arena);

#[derive(Debug, Default)]
struct Notes {
    /// The half at hand.
    steps: Steps,
    /// The account of work up to which costs are noted.
    noted: u64,
}

/// Steps that follow each other; no two runs stand side by side.
#[derive(Debug, Default)]
struct Steps(Vec<Step>);

#[derive(Debug)]
enum Step {
    Run(u32),
    Fork(Steps, Steps),
}

impl<'a> Noting<'a> {
    /// Nothing noted yet; elements are made in the arena.
    pub fn new(arena: &'a Arena) -> Self {
        Self(RefCell::default(), arena)
    }

    /// Appends the parts of the task that has just ended, having cost this much, to `parts`: none if it has no forks. The next one may begin.
    pub fn finish(&self, cost: u64, parts: &mut Vec<Part>) {
        let mut notes = std::mem::take(&mut *self.0.borrow_mut());
        notes.note(cost);
        if notes.steps.0.iter().any(|step| matches!(step, Step::Fork(..))) {
            notes.steps.append_to(parts);
        }
    }
}

impl Notes {
    /// Notes the work since the last time as one run.
    fn note(&mut self, cost: u64) {
        self.steps.run(clamp(cost - self.noted));
        self.noted = cost;
    }
}

impl Steps {
    fn run(&mut self, cost: u32) {
        match self.0.last_mut() {
            _ if cost == 0 => {}
            Some(Step::Run(before)) => *before = before.saturating_add(cost),
            _ => self.0.push(Step::Run(cost)),
        }
    }

    fn follow(&mut self, steps: Steps) {
        for step in steps.0 {
            match step {
                Step::Run(cost) => self.run(cost),
                fork => self.0.push(fork),
            }
        }
    }

    fn append_to(self, parts: &mut Vec<Part>) {
        for step in self.0 {
            match step {
                Step::Run(cost) => parts.push(Part::Run(cost)),
                Step::Fork(first, second) => {
                    let at = parts.len();
                    parts.push(Part::Run(0));
                    first.append_to(parts);
                    let middle = parts.len();
                    second.append_to(parts);
                    let (first, second) = ((middle - at - 1) as u32, (parts.len() - middle) as u32);
                    parts[at] = Part::Fork { first, second };
                }
            }
        }
    }
}

impl Helpers for Noting<'_> {
    fn arena(&self) -> &Arena {
        self.1
    }

    fn wanted(&self) -> bool {
        true
    }

    fn both(&self, scratch: &mut Scratch, first: Half<'_>, second: Half<'_>) {
        // The notes are not borrowed while the halves run, for they come here themselves.
        let note = |scratch: &Scratch| {
            let notes = &mut *self.0.borrow_mut();
            notes.note(scratch.work.cost());
            (std::mem::take(&mut notes.steps), notes.noted)
        };
        let (mut steps, start) = note(scratch);
        first(self, scratch);
        let (before, half) = note(scratch);
        second(self, scratch);
        let (after, end) = note(scratch);
        let (first_cost, second_cost) = (half - start, end - half);
        if first_cost.min(second_cost) >= u64::from(LEAST_PART) {
            steps.0.push(Step::Fork(before, after));
        } else if first_cost >= second_cost {
            steps.follow(before);
            steps.run(clamp(second_cost));
        } else {
            steps.run(clamp(first_cost));
            steps.follow(after);
        }
        self.0.borrow_mut().steps = steps;
    }
}

fn clamp(cost: u64) -> u32 {
    u32::try_from(cost).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn work(cost: u64) -> impl FnMut(&dyn Helpers, &mut Scratch) + Send {
        move |_, scratch| scratch.work.kernel_evaluations += cost
    }

    #[test]
    fn forks_are_noted_and_small_halves_are_not() {
        let arena = Arena::new(ccnuma::arena::Backend::Malloc);
        let (noting, mut scratch) = (Noting::new(&arena), Scratch::default());
        scratch.work.kernel_evaluations += 10;
        noting.both(&mut scratch, &mut work(1000), &mut |helpers, scratch| {
            work(7)(helpers, scratch);
            helpers.both(scratch, &mut work(500), &mut work(300));
            helpers.both(scratch, &mut work(2), &mut |helpers, scratch| {
                helpers.both(scratch, &mut work(3), &mut work(4));
            });
        });
        noting.both(&mut scratch, &mut work(20), &mut work(30));
        scratch.work.kernel_evaluations += 5;
        let mut parts = Vec::new();
        noting.finish(scratch.work.cost(), &mut parts);
        let expected = [
            Part::Run(10),
            Part::Fork { first: 1, second: 5 },
            Part::Run(1000),
            Part::Run(7),
            Part::Fork { first: 1, second: 1 },
            Part::Run(500),
            Part::Run(300),
            Part::Run(9),
            Part::Run(55),
        ];
        assert_eq!(parts, expected);
        scratch.work = Default::default();
        noting.both(&mut scratch, &mut work(20), &mut work(30));
        noting.finish(scratch.work.cost(), &mut parts);
        assert_eq!(parts.len(), expected.len(), "a task without forks is its cost alone");
    }
}
