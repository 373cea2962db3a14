//! Elements, push-pull, the state of a solution and its convergence. No threads.

pub mod solution;

pub use solution::{Field, Leaf, Node, Solution};
