//! Splits names in a folder, and classifies the entries with these names.

use std::io;

/// The type of an entry in a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A regular file of the file system.
    File,
    /// A folder, which is not a link.
    Folder,
    /// A link, a pipe or a device.
    Other,
}

/// Splits a name into the folders on its path and its last part. Names come from eyebox itself, and none may lead out
/// of the folder.
pub(super) fn split(name: &str) -> io::Result<(&str, &str)> {
    let (way, last) = name.rsplit_once('/').unwrap_or(("", name));
    let plain = !last.is_empty() && name.split('/').all(|part| part != ".." && part != ".");
    if plain {
        Ok((way, last))
    } else {
        Err(io::Error::new(io::ErrorKind::InvalidInput, "it is not a name inside a folder"))
    }
}
