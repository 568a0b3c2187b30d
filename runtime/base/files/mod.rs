//! Reads files up to a limit, and writes files completely or not at all.
//!
//! It also has the two plain formats of the runtime, `.npy` and PNG. Everything is written to a temporary name next to
//! its destination, and renamed when it is complete and on the disk. After a full disk, a crash or Ctrl-C, the old
//! contents are still there. This module handles bytes and shapes, and has no optics.

mod array;
mod atomic;
#[cfg(feature = "image-formats")]
mod color_profile;
mod convert;
mod created_dir;
mod entry;
#[cfg(feature = "image-formats")]
mod exr_pixels;
mod file_lock;
mod folder;
mod grey;
mod growing;
#[cfg_attr(not(unix), path = "held_path.rs")]
mod held;
mod kind;
mod managed_dir;
mod npy;
mod npy_header;
mod os;
pub mod overlay;
mod picture;
#[cfg_attr(not(feature = "image-formats"), path = "no_pixels.rs")]
mod pixels;
mod primaries;
pub mod read;
mod record;
mod samples;
mod similar;
mod sniff;
mod staging;
mod text;
#[cfg(feature = "image-formats")]
mod tiff_pixels;
mod timeout_writer;
mod zip;

pub use array::NpyArray;
pub use atomic::{FolderDraft, check_place, write_file};
#[cfg(feature = "image-formats")]
pub use color_profile::color_space;
pub use convert::{OtherKind, Wanted, npz_line, zarr_line};
pub use created_dir::CreatedDirGuard;
pub use entry::Kind;
pub use file_lock::FileLock;
pub use folder::Folder;
pub use grey::read_grey;
pub use growing::GrowingFile;
pub use kind::FileKind;
pub use managed_dir::{ManagedDir, holds_only_own, write_listed};
pub use npy::{Npy, npy_header, read_npy, read_npy_with_gaps, write_npy};
pub use os::cache_folder;
pub use picture::{encode_png, linear_to_srgb, write_png};
#[cfg(not(feature = "image-formats"))]
pub use pixels::color_space;
pub use pixels::{
    encode_jpeg8, encode_png8, holds_depth, holds_light, picture_layers, picture_orientation, picture_size,
    read_layers, read_pixels, read_png8,
};
pub use primaries::Primaries;
pub use record::{Digester, FileRecord, digest_file};
pub use samples::{ColorSpace, Pixels, Samples};
pub use similar::similar;
pub use staging::{end_without_drafts, is_draft};
pub use text::decode as decode_text;
pub use timeout_writer::{TimeoutWriter, asked_to_end};

#[cfg(test)]
mod kind_tests;
#[cfg(all(test, feature = "image-formats"))]
mod pixels_tests;

use crate::error::Reason;
use crate::reason;
use std::{io, path::Path};

/// The gray levels of a picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Grey {
    /// Number of levels that the bits of the picture distinguish, 256 or 65536.
    pub levels: u32,
    /// The levels, row by row.
    pub values: Vec<u16>,
}

/// Returns the reason that a file cannot be read, with the remedy if there is one.
pub fn reason_to_read(error: &io::Error) -> String {
    match error.kind() {
        // An error that already has the remedy is not an error of the system itself.
        io::ErrorKind::PermissionDenied if error.raw_os_error().is_some() => {
            format!("{error}: allow reading it, as by chmod")
        }
        _ => error.to_string(),
    }
}

/// The errors of files.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
pub enum FileError {
    /// The file could not be read.
    #[error("{file}: cannot be read: {source}")]
    Read {
        /// Path of the file.
        file: String,
        /// Error of the system.
        #[serde(serialize_with = "crate::error::as_text")]
        source: io::Error,
    },
    /// The file could not be written. Nothing was left behind.
    #[error("{file}: cannot be written: {source}")]
    Write {
        /// Path of the file.
        file: String,
        /// Error of the system.
        #[serde(serialize_with = "crate::error::as_text")]
        source: io::Error,
    },
    /// The system denies it, because the folder or the disk is read-only for this user. Nothing was left behind.
    #[error("{file}: cannot be written: {source}: give another place, or allow writing there")]
    Denied {
        /// Path of the file.
        file: String,
        /// Error of the system.
        #[serde(serialize_with = "crate::error::as_text")]
        source: io::Error,
    },
    /// The disk, the quota or the file size limit is exhausted. Nothing was left behind.
    #[error("{file}: cannot be written, the disk is full ({source}): free some space or write elsewhere")]
    Full {
        /// Path of the file.
        file: String,
        /// Error of the system.
        #[serde(serialize_with = "crate::error::as_text")]
        source: io::Error,
    },
    /// The content of the file is not valid.
    #[error("{file}: {reason}")]
    Content {
        /// Path of the file.
        file: String,
        /// The fault, its place in the file, and the expected content.
        reason: Reason,
    },
    /// The file is of another kind than the reader expects.
    #[error(transparent)]
    Kind(#[from] OtherKind),
    /// The path is taken by something that must not be replaced.
    #[error("{path}: {reason}")]
    Taken {
        /// Path that is taken.
        path: String,
        /// Contents that are there.
        reason: Reason,
    },
}

impl FileError {
    /// Returns the error of a failure to read `file`.
    pub fn read(file: &Path, source: io::Error) -> Self {
        let source = match source.kind() {
            io::ErrorKind::PermissionDenied => io::Error::new(source.kind(), reason_to_read(&source)),
            _ => source,
        };
        Self::Read { file: file.display().to_string(), source }
    }

    /// Returns the error of a failure to write `file`. It is [`FileError::Full`] if there was no room,
    /// [`FileError::Denied`] without the right to write, and [`FileError::Taken`] if a file is in the way or a folder
    /// is missing.
    pub fn write(file: &Path, source: io::Error) -> Self {
        // An error of a temporary file names a path that no user has seen, and contains the error of the system.
        let own = source.get_ref().and_then(|error| error.source()).and_then(|error| error.downcast_ref::<io::Error>());
        let own = own.map(|own| own.raw_os_error().map_or_else(|| own.kind().into(), io::Error::from_raw_os_error));
        let source = own.unwrap_or(source);
        let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
        match source.kind() {
            io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => {
                if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
                    let why = "there is no such folder to write into: make it, or give another place";
                    return Self::taken(folder, Reason::new("no-such-folder", why));
                }
            }
            io::ErrorKind::AlreadyExists if file.is_file() => return Self::is_a_file(file),
            _ => {}
        }
        let file = file.display().to_string();
        match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => {
                Self::Full { file, source }
            }
            io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => Self::Denied { file, source },
            _ => Self::Write { file, source },
        }
    }

    /// Returns the error of a decoder of `file` in one line, with the remedy.
    #[cfg(feature = "image-formats")]
    pub fn damaged(file: &Path, error: impl ToString) -> Self {
        let said = error.to_string().replace('\n', " ");
        let remedy = "the file is damaged or its format is not read, so copy it again or save it again";
        Self::content(file, reason!("damaged", "{said}: {remedy}"))
    }

    /// Returns the error of `file`, which is of kind `found` although `wanted` is expected.
    pub fn of_kind(file: &Path, found: FileKind, wanted: Wanted) -> Self {
        let remedy = convert::remedy(file, found, wanted);
        Self::Kind(OtherKind { file: file.display().to_string(), found, wanted, remedy })
    }

    /// Returns the error of a folder whose views are all of kind `found`. `first` is one of them.
    pub fn of_all(folder: &Path, first: &Path, found: FileKind) -> Self {
        let remedy = convert::remedy_of_all(folder, first, found);
        Self::Kind(OtherKind { file: first.display().to_string(), found, wanted: Wanted::Scene, remedy })
    }

    /// Returns the error of a refusal to replace `path`.
    pub fn taken(path: &Path, reason: Reason) -> Self {
        Self::Taken { path: path.display().to_string(), reason }
    }

    /// Returns the error of a refusal to replace a file by a folder.
    fn is_a_file(path: &Path) -> Self {
        Self::taken(path, reason!("is-a-file", "is a file, and a folder cannot replace it: give another place"))
    }

    /// Returns the error of a `file` whose content is not valid.
    pub fn content(file: &Path, reason: impl Into<Reason>) -> Self {
        Self::Content { file: file.display().to_string(), reason: reason.into() }
    }
}
