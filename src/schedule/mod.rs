//! Schedules: who computes which pair when. The sequential one is the specification of the others.
//!
//! A run is a few passes ([`control`], which divides the error by a budget), a pass a sequence of batches ([`pass`], [`batch`]), and a batch
//! one task per receiver, which a crew runs: one thread, or a team that steals from each other, with receivers at home on nodes ([`homes`]),
//! their trees in arenas there, and what all read copied to each ([`copies`]); [`footprint`] says what that takes and where it lies.
//! Where no light can leave ([`enclosure`]), all that is sent must arrive.
//! Where light is gathered ([`gathering`]), each batch is all surfaces.
//!
//! | schedule | crew | batches |
//! |---|---|---|
//! | `sequential` | one thread | fitted |
//! | `inner-loop`, the paper's | a team | single shooters |
//! | `stealing` | a team | fitted |
//! | `single-queue`, `outer-loop`, the paper's, each also with `+lure` | a team | none: [`walks`] |

pub mod batch;
mod budget;
pub mod control;
mod copies;
mod crew;
mod enclosure;
mod footprint;
mod gathering;
mod guess;
pub mod homes;
mod mixing;
mod parts;
pub mod pass;
pub mod record;
pub mod walks;
mod watch;

pub use batch::Batches;
pub use control::{COUNTED, Options, Outcome, Schedule, solve, solve_by, solve_emitting, solve_recorded};
pub use crew::Longest;
pub use footprint::Footprint;
pub use parts::Part;
pub use record::Record;
pub use walks::Walks;
pub use watch::{Observer, Silent, Stage};
