//! Names, writes and checks the documents and chunks of a hologram folder.

use super::HologramError;
use crate::files::{FileError, FileKind, FileLock, Folder, FolderDraft, Kind, Wanted, is_draft};
use crate::memory;
use crate::optics::wrap_phase;
use eyebox_base::{Reason, reason};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, Read, Write};
use std::path::Path;

pub(super) const GROUP: &str = "zarr.json";
pub(super) const ARRAY: &str = "phases/zarr.json";
/// The file that is locked by the program that makes a sequence or tiles.
pub(super) const LOCK: &str = "progress.lock";
/// The number of attempts to open a hologram that is replaced while it is read.
const ATTEMPTS: usize = 100;
/// No document of this format comes near this length in bytes. It bounds the reading of a wrong file.
const LONGEST_DOCUMENT: u64 = 16 << 20;

/// Returns a name of a temporary file that no other program uses. A process that seems dead may still be writing, and
/// process numbers repeat on other machines. The name comes from the system and not from a seed, so that no two
/// programs have the same.
pub(super) fn own_draft() -> String {
    format!(".eyebox-{:016x}.part", RandomState::new().build_hasher().finish())
}

pub(super) fn chunk_name(color: usize, frame: usize) -> String {
    chunk_file(color, frame, 0, 0)
}

pub(super) fn chunk_file(color: usize, frame: usize, row: usize, column: usize) -> String {
    format!("phases/c/{color}/{frame}/{row}/{column}")
}

/// Opens a hologram's folder.
pub(super) fn open_folder(path: &Path) -> Result<Folder, HologramError> {
    Folder::open(path).map_err(|e| match e.kind() {
        io::ErrorKind::NotADirectory => match FileKind::of(path) {
            Ok(kind) => FileError::of_kind(path, kind, Wanted::Hologram).into(),
            Err(e) => FileError::read(path, e).into(),
        },
        _ => FileError::read(path, e).into(),
    })
}

/// Reads the hologram at `path` through one open folder. If it is replaced meanwhile, the result is all old or all new.
pub(super) fn read_whole<T>(
    path: &Path,
    read: impl Fn(&Folder) -> Result<T, HologramError>,
) -> Result<T, HologramError> {
    for _ in 0..ATTEMPTS {
        let folder = open_folder(path)?;
        match read(&folder) {
            Err(HologramError::Replaced { .. }) => {}
            // Without descriptors of folders, names may have led into either folder.
            Ok(_) if cfg!(not(unix)) && folder.is_replaced() => {}
            other => return other,
        }
    }
    Err(HologramError::Replaced { path: path.display().to_string() })
}

/// Refuses a folder that is not a hologram.
pub(super) fn check_is_one(folder: &Folder) -> Result<(), HologramError> {
    if folder.has(GROUP) || folder.has("phases") {
        return Ok(());
    }
    Err(match folder.is_replaced() {
        true => HologramError::Replaced { path: folder.path().display().to_string() },
        false => none(folder.path(), reason!("no-zarr-json", "the folder has no zarr.json")),
    })
}

/// Starts a hologram at `path`. It replaces only a hologram that `ours` allows and that no program is making.
pub(super) fn draft(path: &Path, ours: fn(&Path) -> bool) -> Result<FolderDraft, HologramError> {
    if Folder::open(path).is_ok_and(|there| there.is_locked(LOCK)) {
        return Err(HologramError::Busy { path: path.display().to_string() });
    }
    Ok(FolderDraft::new(path, ours)?)
}

/// Takes the lock of an unfinished hologram.
pub(super) fn lock(folder: &Folder) -> Result<FileLock, HologramError> {
    let locked = folder.lock(LOCK).map_err(|e| FileError::write(&folder.path().join(LOCK), e))?;
    locked.ok_or_else(|| HologramError::Busy { path: folder.path().display().to_string() })
}

/// Returns true if a folder is a hologram, whole or damaged, that holds nothing else and that no program is making.
pub(super) fn is_hologram(path: &Path) -> bool {
    let Ok(folder) = Folder::open(path) else { return false };
    let document = || serde_json::from_slice::<serde_json::Value>(&read_document(&folder, GROUP).ok()?).ok();
    holds_only_ours(&folder)
        && document().is_some_and(|document| document["attributes"]["eyebox"].is_object())
        && !folder.is_locked(LOCK)
}

/// Returns true if this program wrote everything in a hologram's folder, down to the last file. Links are refused.
fn holds_only_ours(folder: &Folder) -> bool {
    const TOP: [&str; 5] = [GROUP, "phases", "progress.json", LOCK, "staged"];
    let mut left = vec![(String::new(), 0)];
    while let Some((at, depth)) = left.pop() {
        let Ok(entries) = folder.entries(&at) else { return false };
        for (name, kind) in entries {
            let Some(name) = name.to_str() else { return false };
            let ours = match depth {
                0 => TOP.contains(&name),
                1 => [GROUP, "c"].contains(&name) || is_staged(name),
                _ => name.bytes().all(|b| b.is_ascii_digit()),
            };
            if kind == Kind::Other || !(ours || is_draft(name)) {
                return false;
            }
            if kind == Kind::Folder {
                left.push((format!("{at}/{name}").trim_start_matches('/').to_owned(), depth + 1));
            }
        }
    }
    true
}

/// Returns true for the name of a staged tile, of a finished part of the job, or of a temporary file next to them.
pub(super) fn is_staged(name: &str) -> bool {
    let numbers = matches!(name.split('.').count(), 1 | 4) && name.bytes().all(|b| b.is_ascii_digit() || b == b'.');
    is_draft(name) || numbers
}

/// The error for a path that holds no hologram.
pub(super) fn none(path: &Path, reason: Reason) -> HologramError {
    HologramError::NotAHologram { path: path.display().to_string(), reason }
}

pub(super) fn damaged(file: &Path, reason: Reason) -> HologramError {
    HologramError::Damaged { file: file.display().to_string(), reason }
}

/// The error for a file that cannot be read. Either the file is missing, or the hologram was replaced as a whole.
pub(super) fn unreadable(folder: &Folder, name: &str, e: io::Error) -> HologramError {
    let file = folder.path().join(name);
    match e.kind() {
        io::ErrorKind::NotFound if folder.is_replaced() => {
            HologramError::Replaced { path: folder.path().display().to_string() }
        }
        io::ErrorKind::NotFound => damaged(&file, reason!("missing", "it is missing")),
        _ => FileError::read(&file, e).into(),
    }
}

/// The error for a file that cannot be written.
pub(super) fn unwritable(folder: &Folder, name: &str, e: io::Error) -> HologramError {
    let file = folder.path().join(name);
    match e.kind() {
        // The path of the file is a link, or not a file.
        io::ErrorKind::InvalidInput => damaged(&file, reason!("not-changed", "{e}. Nothing was changed")),
        _ => FileError::write(&file, e).into(),
    }
}

pub(super) fn read_document(folder: &Folder, name: &str) -> Result<Vec<u8>, HologramError> {
    folder.bytes(name, LONGEST_DOCUMENT).map_err(|e| unreadable(folder, name, e))
}

/// Writes Zarr's codecs `bytes` (little-endian) and `crc32c`, which are the values and then the sum of their bytes.
pub(super) fn write_chunk(out: &mut dyn Write, phases: &[f32]) -> io::Result<()> {
    let bytes: Vec<u8> = phases.iter().flat_map(|&p| wrap_phase(p).to_le_bytes()).collect();
    out.write_all(&bytes)?;
    out.write_all(&crc32c::crc32c(&bytes).to_le_bytes())
}

/// Refuses phases of this shape if memory cannot hold them.
pub(super) fn check_memory(path: &Path, shape: &[usize]) -> Result<(), HologramError> {
    let what = || format!("{}: phases of shape {shape:?}", path.display());
    Ok(memory::check_available(what, memory::bytes_of(shape, 4), "free some, or take a smaller hologram")?)
}

/// Refuses a chunk whose length does not fit the number of `values`. If `summed`, the chunk ends in its checksum.
pub(super) fn check_length(folder: &Folder, name: &str, values: usize, summed: bool) -> Result<(), HologramError> {
    check_file_length(folder, name, folder.length(name).map_err(|e| unreadable(folder, name, e))?, values, summed)
}

fn check_file_length(
    folder: &Folder,
    name: &str,
    length: u64,
    values: usize,
    summed: bool,
) -> Result<(), HologramError> {
    let expected = 4 * (values as u64 + u64::from(summed));
    if length != expected {
        return Err(damaged(&folder.path().join(name), reason!("length", "it is {length} bytes long, not {expected}")));
    }
    Ok(())
}

/// Refuses a chunk whose bytes have another checksum than the chunk states.
pub(super) fn check_sum(folder: &Folder, name: &str, bytes: &[u8], stated: [u8; 4]) -> Result<(), HologramError> {
    let (stated, found) = (u32::from_le_bytes(stated), crc32c::crc32c(bytes));
    if stated != found {
        let reason = reason!("checksum", "its checksum is {found:08x}, but it states {stated:08x}");
        return Err(damaged(&folder.path().join(name), reason));
    }
    Ok(())
}

/// Reads a chunk, and its checksum if it is `summed`. It allocates nothing unless it fails.
pub(super) fn read_chunk(folder: &Folder, name: &str, summed: bool, values: &mut [f32]) -> Result<(), HologramError> {
    let unreadable = |e| unreadable(folder, name, e);
    let mut opened = folder.file(name).map_err(unreadable)?;
    let length = opened.metadata().map_err(unreadable)?.len();
    check_file_length(folder, name, length, values.len(), summed)?;
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(values);
    opened.read_exact(bytes).map_err(unreadable)?;
    if summed {
        let mut stated = [0; 4];
        opened.read_exact(&mut stated).map_err(unreadable)?;
        check_sum(folder, name, bytes, stated)?;
    }
    if cfg!(target_endian = "big") {
        values.iter_mut().for_each(|v| *v = f32::from_bits(v.to_bits().swap_bytes()));
    }
    Ok(())
}

/// Reads one chunk into a new vector.
pub(super) fn read_tile(folder: &Folder, name: &str, values: usize) -> Result<Vec<f32>, HologramError> {
    let mut phases = vec![0.0; values];
    read_chunk(folder, name, true, &mut phases)?;
    if let Some(at) = phases.iter().position(|p| !p.is_finite()) {
        return Err(damaged(&folder.path().join(name), reason!("phase", "phase {at} is {}", phases[at])));
    }
    Ok(phases)
}
