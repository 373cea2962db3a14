//! Schedules: who computes which pair when. The sequential one is the specification of the others.

pub mod batch;
pub mod control;
pub mod pass;

pub use control::{Observer, Options, Outcome, Silent, Stage, solve};
