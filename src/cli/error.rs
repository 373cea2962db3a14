//! How a run ends: done, interrupted, or an error of one of two kinds, each with its exit code.

use std::process::ExitCode;

use crate::{output, scene};

/// The end of a run without error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// All was done: exit code 0.
    Done,
    /// The user stopped it; what was done is written and marked: exit code 130.
    Interrupted,
}

/// Why a run ended without its result.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The command line or a file given to it cannot be used: exit code 2, nothing was written.
    #[error("{0}")]
    Input(String),
    /// The scene cannot be used: exit code 2, nothing was written.
    #[error(transparent)]
    Scene(#[from] scene::read::ReadError),
    /// It did not work out for a reason outside of the input: exit code 1.
    #[error("{0}")]
    Failed(String),
    /// Results could not be written: exit code 1.
    #[error("{}", lines(.0))]
    Output(Vec<output::Error>),
}

impl From<Status> for ExitCode {
    fn from(status: Status) -> ExitCode {
        match status {
            Status::Done => ExitCode::SUCCESS,
            Status::Interrupted => ExitCode::from(super::interrupt::EXIT_CODE),
        }
    }
}

fn lines(errors: &[output::Error]) -> String {
    errors.iter().map(output::Error::to_string).collect::<Vec<_>>().join("\n")
}

impl Error {
    /// The exit code of the contract.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Error::Input(_) | Error::Scene(_) => ExitCode::from(2),
            Error::Output(_) | Error::Failed(_) => ExitCode::FAILURE,
        }
    }
}
