//! Schedules: who computes which pair when. The sequential one is the specification of the others.

pub mod control;
pub mod sequential;

pub use control::{Observer, Options, Outcome, Silent, Stage, solve};
