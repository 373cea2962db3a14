//! Studies: runs over threads and schedules, replays of recorded runs on machines that are not here, and what can be learnt from both.
//!
//! [`replay`] says what a recorded run would take elsewhere, [`speedup`] sets it beside what is measured here. What comes out is data;
//! [`crate::output::study`] writes it.

pub mod replay;
pub mod speedup;
pub mod statistics;

pub use speedup::{Contestant, Problem, Speedup, Study, StudyError};
