//! What the runs of all studies share: the problem, the clock, and why a study may end without its result.

use std::time::Instant;

use ccnuma::WorkerPanic;
use ccnuma::counters::GroupError;

use crate::scene::{Scene, Surface};
use crate::schedule::record::OtherRun;
use crate::schedule::{Options, Outcome};
use crate::visibility::Occluder;

/// The problem, the same in every run.
#[derive(Clone, Copy)]
pub struct Problem<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Its surfaces.
    pub surfaces: &'a [Surface],
    /// What may stand between them.
    pub occluder: &'a dyn Occluder,
    /// How finely it is solved.
    pub options: &'a Options,
}

/// Why a study ended without its result.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The observer stopped it.
    #[error("interrupted: a study is whole or not at all, so nothing was written")]
    Interrupted,
    /// A team could not be started.
    #[error(transparent)]
    Team(#[from] ccnuma::Error),
    /// The events of this machine's CPU cannot be read from their file.
    #[error("a mistake in this program: {0}")]
    Group(#[from] GroupError),
    /// A worker panicked.
    #[error("a mistake in this program: {0}")]
    Panic(#[from] WorkerPanic),
    /// Two records of one problem differ.
    #[error(transparent)]
    Record(#[from] OtherRun),
}

/// The result of a run, and its seconds.
pub(super) fn timed<R>(run: impl FnOnce() -> R) -> (R, f64) {
    let start = Instant::now();
    let result = run();
    (result, start.elapsed().as_secs_f64())
}

/// Refuses what was cut short.
pub(super) fn whole(outcome: &Outcome) -> Result<(), StudyError> {
    if outcome.solution.incomplete { Err(StudyError::Interrupted) } else { Ok(()) }
}
