//! Sharing out a pair task: the subtrees of a divided receiver are disjoint, so their parts of the task may run at the same time. Nothing here
//! knows a thread; whoever runs pair tasks may offer helpers, and the result is the same without them.

use super::pair::Scratch;

/// One half of what is shared out; called once, with the helpers and the working memory of whoever runs it.
pub type Half<'a> = &'a mut (dyn FnMut(&dyn Helpers, &mut Scratch) + Send);

/// Those who may take over a part of a task.
pub trait Helpers {
    /// Whether somebody may be waiting for work; where not, sharing out only costs.
    fn wanted(&self) -> bool;

    /// Runs both halves, perhaps at the same time; the counts of both end up in `scratch`.
    fn both(&self, scratch: &mut Scratch, first: Half<'_>, second: Half<'_>);
}
