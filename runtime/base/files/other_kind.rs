//! The refusal of a file that is of another kind than the one that is read.

use super::{FileKind, Wanted};

/// A file of another kind than the one that is read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, serde::Serialize)]
#[error("{file}: it is {}, which is not read as {}; {remedy}", found.describe(), wanted.describe())]
pub struct OtherKind {
    /// The file.
    pub file: String,
    /// Its kind, from its content.
    pub found: FileKind,
    /// What the reader wanted.
    pub wanted: Wanted,
    /// A line that makes a file of it that is read.
    pub remedy: String,
}
