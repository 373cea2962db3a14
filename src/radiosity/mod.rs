//! Elements, push-pull, the state of a solution and its convergence. No threads.

pub mod ambient;
pub mod element;
pub mod emission;
pub mod lure;
pub mod mixing;
mod order;
pub mod probe;
pub mod ripples;
pub mod solution;
pub mod state;

pub use ambient::{Received, add_ambient};
pub use element::{Element, ElementBytes};
pub use emission::field_packet;
pub use lure::{Form, Lure};
pub use mixing::Power;
pub use solution::{Field, Leaf, Node, Solution};
pub use state::{Tree, extent_m, trees};
