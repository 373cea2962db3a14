//! Studies: runs over threads and schedules, replays of recorded runs on machines that are not here, runs over errors and bases, and what can
//! be learnt from all of them.
//!
//! [`replay`] says what a recorded run would take elsewhere, [`speedup`] sets it beside what is measured here; [`error`] sets time beside the
//! true error, which [`truth`] tells. What comes out is data; [`crate::output::study`] writes it.

pub mod error;
pub mod replay;
mod run;
pub mod speedup;
pub mod statistics;
pub mod truth;

pub use error::{ErrorCurves, ErrorStudy, Subject};
pub use run::{Problem, StudyError};
pub use speedup::{Contestant, Speedup, Study};
