//! Names in a folder, and what they stand for.

use std::io;

/// What stands in a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A regular file.
    File,
    /// A folder.
    Folder,
    /// A link, a pipe, a device.
    Other,
}

/// The folders on the way to a name, and its last part. Names are this program's own: none leads out of the folder.
pub(super) fn split(name: &str) -> io::Result<(&str, &str)> {
    let (way, last) = name.rsplit_once('/').unwrap_or(("", name));
    let plain = !last.is_empty() && name.split('/').all(|part| part != ".." && part != ".");
    if plain { Ok((way, last)) } else { Err(io::Error::new(io::ErrorKind::InvalidInput, "it is no name in a folder")) }
}
