//! Transport of light: the kernel, Lambert's closed form, emission packets, and one emitter–receiver pair.
//!
//! Receivers are sampled: the irradiance from one emitter is evaluated at points of a receiver element ([`gather`]), projected
//! onto its basis, and judged at further points ([`link`]); what does not pass is divided ([`descent`]). Emitters are integrated
//! hierarchically from each sample point; of many, those that matter little are taken together ([`cluster`], [`several`]).
//! What looks see can be recorded ([`recording`]) and kept as links ([`stored`]).
//!
//! Nothing here knows a thread; a task ([`pair`]) borrows the sources and owns the receiver.

pub mod candidates;
mod cluster;
mod descent;
mod expected;
pub mod gather;
mod judge;
pub mod kernel;
pub mod lambert;
pub mod lamp;
mod light;
mod link;
mod missed;
pub mod nodes;
pub mod packet;
pub mod pair;
pub mod receiver;
mod recent;
mod recording;
pub mod samples;
mod several;
pub mod share;
pub mod source;
pub mod stored;
pub mod unblocked;
pub mod view;
pub mod work;

pub use cluster::Clusters;
pub use gather::{Gather, Points};
pub use lamp::Lamp;
pub use packet::{Detail, Packet, PacketNode, Shape, by_place};
pub use pair::{GoOn, Oracle, Rules, Scratch, Task};
pub use receiver::{Deposited, Patch, Receiver, Unresolved};
pub use samples::SampleRules;
pub use share::{Alone, Half, Helpers};
pub use source::Source;
pub use stored::Store;
pub use work::Work;
