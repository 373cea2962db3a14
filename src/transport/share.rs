//! Sharing out a pair task: the subtrees of a divided receiver are disjoint, so their parts of the task may run at the same time. Nothing here
//! knows a thread; whoever runs pair tasks says where new elements live and may offer helpers, and the result is the same without them.

use ccnuma::Arena;

use super::pair::Scratch;

/// One half of what is shared out; called once, with the helpers and the working memory of whoever runs it.
pub type Half<'a> = &'a mut (dyn FnMut(&dyn Helpers, &mut Scratch) + Send);

/// Where a task runs: memory for what it makes, and those who may take over a part of it.
pub trait Helpers {
    /// Where the receiver's new elements live.
    fn arena(&self) -> &Arena;

    /// Whether somebody may be waiting for work; where not, sharing out only costs.
    fn wanted(&self) -> bool;

    /// Runs both halves, perhaps at the same time; the counts of both end up in `scratch`.
    fn both(&self, scratch: &mut Scratch, first: Half<'_>, second: Half<'_>);
}

/// Nobody helps.
#[derive(Clone, Copy, Debug)]
pub struct Alone<'a>(
    /// Where new elements live.
    pub &'a Arena,
);

impl Helpers for Alone<'_> {
    fn arena(&self) -> &Arena {
        self.0
    }

    fn wanted(&self) -> bool {
        false
    }

    fn both(&self, scratch: &mut Scratch, first: Half<'_>, second: Half<'_>) {
        first(self, scratch);
        second(self, scratch);
    }
}
