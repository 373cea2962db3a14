//! What can go wrong when results are written or read back: every message names the file and the remedy.

use std::path::{Path, PathBuf};

/// An error of the room `output`.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file system refused.
    #[error("{path}: cannot {action}: {source}; {remedy}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What was attempted, an infinitive.
        action: &'static str,
        /// The reason given by the system.
        source: std::io::Error,
        /// What to do about it.
        remedy: &'static str,
    },
    /// A name whose extension stands for no format.
    #[error("{path}: {found}; supported are {supported}", supported = super::kind::SUPPORTED)]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// What was found in place of a known extension.
        found: String,
    },
    /// The request cannot be met: what was asked, why not, and what to do.
    #[error("{0}")]
    Request(String),
    /// A saved solution that is not one, is damaged, or contradicts itself.
    #[error("{path}: {problem}; {remedy}")]
    Solution {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
        /// What to do about it.
        remedy: &'static str,
    },
}

impl Error {
    /// An [`Error::Io`] whose remedy follows from the kind of failure.
    pub(super) fn io(path: &Path, action: &'static str, source: std::io::Error) -> Error {
        use std::io::ErrorKind as Kind;
        let remedy = match source.kind() {
            Kind::NotFound => "check the spelling, or create the directory first",
            Kind::PermissionDenied | Kind::ReadOnlyFilesystem => {
                "choose a place you may write to and read from"
            }
            Kind::StorageFull | Kind::QuotaExceeded => "free some space or choose another disk",
            Kind::IsADirectory => "name a file, not a directory",
            Kind::InvalidInput => "choose a format that can hold the result",
            _ => "check the disk and the path, then try again",
        };
        Error::Io { path: path.to_owned(), action, source, remedy }
    }
}
