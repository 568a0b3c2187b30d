//! The files of a hologram folder: their names, its documents, its chunks; sealed, and checked when they are read.

use super::HologramError;
use super::wrap_phase;
use crate::files::FileError;
use crate::files::read;
use crate::memory;
use std::{
    fs,
    io::{self, Read, Write},
    path::{Path, PathBuf},
};

pub(super) const GROUP: &str = "zarr.json";
pub(super) const ARRAY: &str = "phases/zarr.json";
/// No document of this format comes near it; it bounds what a wrong file can make us read.
const LONGEST_DOCUMENT: u64 = 16 << 20;

pub(super) fn chunk_name(color: usize, frame: usize) -> String {
    chunk_file(color, frame, 0, 0)
}

pub(super) fn chunk_file(color: usize, frame: usize, row: usize, column: usize) -> String {
    format!("phases/c/{color}/{frame}/{row}/{column}")
}

/// Whether a folder is a hologram, whole or damaged, and nothing else.
pub(super) fn is_hologram(folder: &Path) -> bool {
    holds_only_ours(folder)
        && read_document(&folder.join(GROUP))
            .ok()
            .and_then(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).ok())
            .is_some_and(|document| document["attributes"]["eyebox"].is_object())
}

/// Whether everything in a hologram's folder, down to the last file, was written by this program. Links are not.
fn holds_only_ours(folder: &Path) -> bool {
    const TOP: [&str; 5] = ["zarr.json", "phases", "progress.json", "progress.lock", "staged"];
    let mut left = vec![(folder.to_path_buf(), 0)];
    while let Some((at, depth)) = left.pop() {
        let Ok(entries) = fs::read_dir(&at) else { return false };
        for entry in entries {
            let Ok(entry) = entry else { return false };
            let (name, Ok(kind)) = (entry.file_name(), entry.file_type()) else { return false };
            let Some(name) = name.to_str() else { return false };
            let ours = match depth {
                0 => TOP.contains(&name),
                1 => ["zarr.json", "c"].contains(&name) || is_staged(name),
                _ => name.bytes().all(|b| b.is_ascii_digit()),
            };
            if kind.is_symlink() || !(ours || is_draft(name)) {
                return false;
            }
            if kind.is_dir() {
                left.push((entry.path(), depth + 1));
            }
        }
    }
    true
}

/// A draft that a program left when it was killed.
fn is_draft(name: &str) -> bool {
    name.starts_with(".eyebox-") && name.ends_with(".part")
}

/// The name of a staged tile, or of a draft beside it.
pub(super) fn is_staged(name: &str) -> bool {
    is_draft(name) || (name.split('.').count() == 4 && name.bytes().all(|b| b.is_ascii_digit() || b == b'.'))
}

/// A folder inside a hologram, which is made if it is not there; a link in its place is not followed.
pub(super) fn own_folder(folder: &Path) -> Result<(), HologramError> {
    match fs::symlink_metadata(folder) {
        Ok(there) if there.is_dir() => Ok(()),
        Ok(_) => Err(damaged(
            folder,
            "it is a link or a file, and a folder of the hologram's is wanted: nothing was changed",
        )),
        Err(_) => fs::create_dir(folder).map_err(|e| FileError::write(folder, e).into()),
    }
}

/// The folders on the way from a hologram to a file in it, made if they are not there; links are not followed.
pub(super) fn own_way(hologram: &Path, file: &Path) -> Result<(), HologramError> {
    let inside = file.strip_prefix(hologram).unwrap_or(file);
    let mut at = hologram.to_path_buf();
    for part in inside.parent().into_iter().flat_map(Path::components) {
        at.push(part);
        own_folder(&at)?;
    }
    Ok(())
}

pub(super) fn damaged(file: &Path, reason: impl Into<String>) -> HologramError {
    HologramError::Damaged { file: file.display().to_string(), reason: reason.into() }
}

pub(super) fn unreadable(file: &Path, e: io::Error) -> HologramError {
    match e.kind() {
        io::ErrorKind::NotFound => damaged(file, "it is missing"),
        _ => FileError::read(file, e).into(),
    }
}

pub(super) fn read_document(file: &Path) -> Result<Vec<u8>, HologramError> {
    read::bytes(file, LONGEST_DOCUMENT).map_err(|e| unreadable(file, e))
}

/// Zarr's codecs `bytes` (little-endian) and `crc32c`: the values, then the sum of their bytes.
pub(super) fn write_chunk(out: &mut dyn Write, phases: &[f32]) -> io::Result<()> {
    let bytes: Vec<u8> = phases.iter().flat_map(|&p| wrap_phase(p).to_le_bytes()).collect();
    out.write_all(&bytes)?;
    out.write_all(&crc32c::crc32c(&bytes).to_le_bytes())
}

/// Refuses phases of this shape where memory does not hold them.
pub(super) fn promise(path: &Path, shape: &[usize]) -> Result<(), HologramError> {
    let what = || format!("{}: phases of shape {shape:?}", path.display());
    Ok(memory::promise(what, memory::bytes_of(shape, 4), "free some, or take a smaller hologram")?)
}

/// `summed`: whether it ends in its checksum.
pub(super) fn check_length(file: &PathBuf, pixels: usize, summed: bool) -> Result<(), HologramError> {
    let length = fs::metadata(file).map_err(|e| unreadable(file, e))?.len();
    let expected = 4 * (pixels as u64 + u64::from(summed));
    if length != expected {
        return Err(damaged(file, format!("it is {length} bytes long, not {expected}")));
    }
    Ok(())
}

/// `summed`: whether it ends in its checksum.
pub(super) fn read_chunk(file: &Path, pixels: usize, summed: bool, phases: &mut Vec<f32>) -> Result<(), HologramError> {
    let mut bytes = vec![0; 4 * (pixels + usize::from(summed))];
    read::open(file).and_then(|mut f| f.read_exact(&mut bytes)).map_err(|e| unreadable(file, e))?;
    let (values, sum) = bytes.split_at(4 * pixels);
    if let Ok(stated) = sum.try_into().map(u32::from_le_bytes) {
        let found = crc32c::crc32c(values);
        if stated != found {
            return Err(damaged(file, format!("its checksum is {found:08x}, and it states {stated:08x}")));
        }
    }
    phases.extend(values.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    Ok(())
}

/// One chunk by itself.
pub(super) fn read_tile(file: &Path, values: usize) -> Result<Vec<f32>, HologramError> {
    check_length(&file.to_path_buf(), values, true)?;
    let mut phases = Vec::with_capacity(values);
    read_chunk(file, values, true, &mut phases)?;
    if let Some(at) = phases.iter().position(|p| !p.is_finite()) {
        return Err(damaged(file, format!("phase {at} is {}", phases[at])));
    }
    Ok(phases)
}
