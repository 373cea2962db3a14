//! Readers of scene files, one file or folder per format.

use std::path::{Path, PathBuf};

use thiserror::Error;

use super::Scene;

pub mod inventor;
mod place;

/// Why a scene could not be read.
#[derive(Debug, Error)]
pub enum ReadError {
    /// The content of a file is not what its format allows.
    #[error("{0}")]
    Content(Box<ContentError>),
    /// A file cannot be opened or read.
    #[error("{path}: cannot be read: {source}", path = .path.display())]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// What is wrong in a file, and where.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{path}:{line}:{column}: expected {expected}, found {found}; {remedy}", path = .path.display())]
pub struct ContentError {
    /// Which file.
    pub path: PathBuf,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// What the format allows there.
    pub expected: String,
    /// What stands there.
    pub found: String,
    /// What to do.
    pub remedy: String,
}

impl ReadError {
    /// An error at byte `at` of a text.
    pub(crate) fn at(
        path: &Path,
        text: &str,
        at: usize,
        expected: impl Into<String>,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> ReadError {
        let (line, column) = place::line_and_column(text, at);
        ReadError::Content(Box::new(ContentError {
            path: path.to_owned(),
            line,
            column,
            expected: expected.into(),
            found: found.into(),
            remedy: remedy.into(),
        }))
    }

    pub(crate) fn io(path: &Path, source: std::io::Error) -> ReadError {
        ReadError::Io { path: path.to_owned(), source }
    }
}

/// Reads a scene file, recognised by its first bytes, and validates the scene.
pub fn read_file(path: &Path) -> Result<Scene, ReadError> {
    let bytes = std::fs::read(path).map_err(|source| ReadError::io(path, source))?;
    inventor::parse(&decode(path, bytes)?, path)
}

/// The bytes of a text file as text: UTF-8, or Latin-1 where they are not UTF-8. Compressed files are
/// refused.
fn decode(path: &Path, bytes: Vec<u8>) -> Result<String, ReadError> {
    if bytes.starts_with(&[0x1f, 0x8b]) {
        let (expected, found) = ("text", "a gzip-compressed file");
        return Err(ReadError::at(path, "", 0, expected, found, "decompress it with `gzip -dc IN > OUT.iv`"));
    }
    Ok(String::from_utf8(bytes).unwrap_or_else(|error| error.as_bytes().iter().map(|b| *b as char).collect()))
}

/// A scene's name for people: the stem of its file.
fn name_of(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}
