//! The hologram's own file: a Zarr v3 folder.

use super::tiles::{self, Tiles};
use super::{Hologram, HologramError, document, save_phases, wrap_phase};
use crate::files::{FileError, FolderDraft};
use std::{
    fs::{self, File},
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

impl Hologram {
    /// Saves by the ending of `path`: `.zarr` is the whole hologram, `.npy` its phases alone.
    ///
    /// A hologram that stands at `path` is replaced; anything else is left alone. Until the new one is complete and on
    /// the disk the old one stays. Phases are wrapped to [-pi, pi) on the way.
    ///
    /// # Errors
    /// [`HologramError::Inconsistent`], [`HologramError::UnknownEnding`], and [`HologramError::File`] with
    /// [`FileError::Full`], [`FileError::Taken`], [`FileError::Write`]; then nothing has changed at `path`.
    pub fn save(&self, path: &Path) -> Result<(), HologramError> {
        self.check()?;
        match path.extension().and_then(|e| e.to_str()).map(str::to_lowercase).as_deref() {
            Some("zarr") => self.save_zarr(path),
            Some("npy") => save_phases(self, path),
            _ => Err(HologramError::UnknownEnding { path: path.display().to_string() }),
        }
    }

    fn save_zarr(&self, path: &Path) -> Result<(), HologramError> {
        let draft = FolderDraft::new(path, is_hologram)?;
        draft.write(GROUP, |out| out.write_all(&document::group(self)))?;
        let shape = [self.colors.len(), self.frames, self.height, self.width];
        draft.write(ARRAY, |out| out.write_all(&document::array(shape, None)))?;
        for color in 0..self.colors.len() {
            for frame in 0..self.frames {
                draft.write(&chunk_name(color, frame), |out| write_chunk(out, self.frame(color, frame)))?;
            }
        }
        Ok(draft.put()?)
    }

    /// Loads a hologram folder, checking every byte of it.
    ///
    /// # Errors
    /// [`HologramError::NotAHologram`]; [`HologramError::Damaged`] naming the file that is missing, cut short or
    /// changed; [`HologramError::FileOptics`]; [`HologramError::File`].
    pub fn load(path: &Path) -> Result<Self, HologramError> {
        let no = |reason: &str| HologramError::NotAHologram { path: path.display().to_string(), reason: reason.into() };
        match fs::metadata(path) {
            Err(e) => return Err(FileError::read(path, e).into()),
            Ok(there) if !there.is_dir() => {
                return Err(no(
                    "it is a file, and a hologram is a .zarr folder; bare phases (.npy) need the optics too",
                ));
            }
            Ok(_) if !path.join(GROUP).exists() && !path.join("phases").exists() => {
                return Err(no("the folder has no zarr.json"));
            }
            Ok(_) => {}
        }
        let file = path.join(GROUP);
        let mut hologram = document::read_group(&read_document(&file)?).map_err(|e| damaged(&file, e))?;
        let file = path.join(ARRAY);
        let (shape, side) = document::read_array(&read_document(&file)?).map_err(|e| damaged(&file, e))?;
        if side.is_some() {
            Tiles::open(path)?.check()?;
            return tiles::read_all(path);
        }
        let [colors, frames, height, width] = shape;
        if colors != hologram.colors.len() || colors == 0 || frames == 0 {
            let described = hologram.colors.len();
            return Err(damaged(&file, format!("its shape is {shape:?}, and zarr.json describes {described} colours")));
        }
        (hologram.frames, hologram.height, hologram.width) = (frames, height, width);
        for i in 0..colors {
            let file = path.join(GROUP).display().to_string();
            hologram.optics(i).map_err(|source| HologramError::FileOptics { file, source })?;
        }
        // Optics bound the size of a frame; that all chunks are there, and as long as they must be, is known before
        // memory is taken for any, so that a lying shape costs nothing.
        let pixels = height * width;
        for color in 0..colors {
            for frame in 0..frames {
                check_length(&path.join(chunk_name(color, frame)), pixels)?;
            }
        }
        for (color, c) in hologram.colors.iter_mut().enumerate() {
            c.phases.reserve_exact(frames * pixels);
            for frame in 0..frames {
                read_chunk(&path.join(chunk_name(color, frame)), pixels, &mut c.phases)?;
            }
        }
        hologram.check().map_err(|e| damaged(path, e.to_string()))?;
        Ok(hologram)
    }
}

/// Whether a folder is a hologram, whole or damaged, and nothing else.
pub(super) fn is_hologram(folder: &Path) -> bool {
    let ours = ["zarr.json", "phases", "progress.json", "progress.lock", "staged"];
    let only_ours = fs::read_dir(folder)
        .is_ok_and(|entries| entries.flatten().all(|e| ours.iter().any(|name| e.file_name() == *name)));
    only_ours
        && read_document(&folder.join(GROUP))
            .ok()
            .and_then(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).ok())
            .is_some_and(|document| document["attributes"]["eyebox"].is_object())
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
    let mut bytes = Vec::new();
    let opened = File::open(file).map_err(|e| unreadable(file, e))?;
    opened.take(LONGEST_DOCUMENT).read_to_end(&mut bytes).map_err(|e| unreadable(file, e))?;
    Ok(bytes)
}

/// Zarr's codecs `bytes` (little-endian) and `crc32c`: the values, then the sum of their bytes.
pub(super) fn write_chunk(out: &mut dyn Write, phases: &[f32]) -> io::Result<()> {
    let bytes: Vec<u8> = phases.iter().flat_map(|&p| wrap_phase(p).to_le_bytes()).collect();
    out.write_all(&bytes)?;
    out.write_all(&crc32c::crc32c(&bytes).to_le_bytes())
}

fn check_length(file: &PathBuf, pixels: usize) -> Result<(), HologramError> {
    let (length, expected) = (fs::metadata(file).map_err(|e| unreadable(file, e))?.len(), 4 * pixels as u64 + 4);
    if length != expected {
        return Err(damaged(file, format!("it is {length} bytes long, not {expected}")));
    }
    Ok(())
}

fn read_chunk(file: &Path, pixels: usize, phases: &mut Vec<f32>) -> Result<(), HologramError> {
    let mut bytes = vec![0; 4 * pixels + 4];
    File::open(file).and_then(|mut f| f.read_exact(&mut bytes)).map_err(|e| unreadable(file, e))?;
    let (values, sum) = bytes.split_at(4 * pixels);
    let (stated, found) = (u32::from_le_bytes([sum[0], sum[1], sum[2], sum[3]]), crc32c::crc32c(values));
    if stated != found {
        return Err(damaged(file, format!("its checksum is {found:08x}, and it states {stated:08x}")));
    }
    phases.extend(values.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    Ok(())
}

/// One chunk by itself.
pub(super) fn read_tile(file: &Path, values: usize) -> Result<Vec<f32>, HologramError> {
    check_length(&file.to_path_buf(), values)?;
    let mut phases = Vec::with_capacity(values);
    read_chunk(file, values, &mut phases)?;
    if let Some(at) = phases.iter().position(|p| !p.is_finite()) {
        return Err(damaged(file, format!("phase {at} is {}", phases[at])));
    }
    Ok(phases)
}
