//! Opens files of splats, and checks the counts in them against their length and the free memory.

use crate::SceneError;
use crate::splats::cloud::Cloud;
use eyebox_base::files::read;
use eyebox_base::memory;
use eyebox_base::reason;
use std::io::{self, BufRead, BufReader, Cursor, Seek};
use std::path::Path;

/// The largest number of splats. Indices have 32 bits, and larger scenes fit no display.
const MOST: u64 = 1 << 30;

/// The bytes of a file.
pub(crate) trait Bytes: BufRead + Seek {}

impl<T: BufRead + Seek> Bytes for T {}

/// An opened file with its length.
pub(crate) struct Opened {
    pub file: Box<dyn Bytes>,
    pub length: u64,
}

impl Opened {
    /// Opens a regular file.
    pub fn new(path: &Path) -> Result<Self, SceneError> {
        let io = |error: io::Error| SceneError::unreadable(path, &error);
        let file = read::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        Ok(Self { file: Box::new(BufReader::with_capacity(1 << 16, file)), length })
    }

    /// Opens a file that is a part of the program.
    pub fn of_bytes(bytes: &'static [u8]) -> Self {
        Self { file: Box::new(Cursor::new(bytes)), length: bytes.len() as u64 }
    }
}

/// Returns the stated number of splats, if `left` bytes hold them with at least `bytes` each.
pub(crate) fn checked_count(path: &Path, stated: u64, bytes: u64, left: u64) -> Result<usize, SceneError> {
    let corrupt = |reason| SceneError::Corrupt { file: path.display().to_string(), reason };
    if stated > MOST {
        return Err(corrupt(reason!("count", "it states {stated} splats, but at most {MOST} are read")));
    }
    match stated.checked_mul(bytes) {
        Some(needed) if needed <= left => Ok(stated as usize),
        _ => Err(corrupt(reason!(
            "cut",
            "it states {stated} splats of {bytes} bytes, but only {left} bytes follow, so it is cut or damaged"
        ))),
    }
}

/// Returns an empty cloud with room for this number of splats.
pub(crate) fn room(path: &Path, count: usize, degree: usize) -> Result<Cloud, SceneError> {
    let what = || format!("{count} splats of {}", path.display());
    let bytes = Cloud::bytes_of_one(degree).saturating_mul(count as u64);
    memory::check_available(what, bytes, "take a scene with fewer splats")?;
    Ok(Cloud::with_room(count, degree))
}

/// Returns the error of reading a file that ends too early, or that a decoder refuses.
pub(crate) fn broken(path: &Path, error: &io::Error) -> SceneError {
    let reason = match error.kind() {
        io::ErrorKind::UnexpectedEof => reason!("cut", "it ends before its last splat, so it is cut or damaged"),
        io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput | io::ErrorKind::Other => {
            reason!("damaged", "it is damaged ({error})")
        }
        _ => return SceneError::unreadable(path, error),
    };
    SceneError::Corrupt { file: path.display().to_string(), reason }
}
