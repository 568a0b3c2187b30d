//! Reading a sequence of holograms, one at a time, while it may still grow.

use super::chunks::{ARRAY, GROUP, chunk_name, damaged, promise, read_document, unreadable};
use super::document::{self, SequenceAttributes};
use super::{Hologram, HologramError};
use crate::files::FileError;
use crate::files::read;
use std::fmt::Write as _;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A sequence of holograms of one shape, or a single hologram as a sequence of one.
///
/// Each hologram is one file with its own checksum, so one that is damaged costs no other.
#[derive(Debug)]
pub struct Sequence {
    path: PathBuf,
    about: Hologram,
    attributes: SequenceAttributes,
    single: bool,
    count: u64,
    complete: bool,
    notes: Vec<String>,
    /// A single hologram that is not read from a folder of its own.
    here: Option<Hologram>,
    // Kept, so that reading allocates nothing.
    file: PathBuf,
    name: String,
}

impl Sequence {
    /// Opens a sequence, or a single hologram.
    ///
    /// A sequence that was cut off is opened up to its last whole hologram; [`notes`](Self::notes) say so. So is one
    /// whose array document is damaged: its holograms are then counted by their files.
    ///
    /// # Errors
    /// [`HologramError::NotAHologram`]; [`HologramError::Damaged`] for the group's document;
    /// [`HologramError::FileOptics`]; [`HologramError::File`].
    pub fn open(path: &Path) -> Result<Self, HologramError> {
        let no = |reason: &str| HologramError::NotAHologram { path: path.display().to_string(), reason: reason.into() };
        match fs::metadata(path) {
            Err(e) => return Err(FileError::read(path, e).into()),
            Ok(there) if !there.is_dir() => return Err(no("it is a file, and a hologram is a .zarr folder")),
            Ok(_) if !path.join(GROUP).exists() && !path.join("phases").exists() => {
                return Err(no("the folder has no zarr.json"));
            }
            Ok(_) => {}
        }
        let file = path.join(GROUP);
        let group = read_document(&file)?;
        let (mut about, sequence) = document::read_any_group(&group).map_err(|e| damaged(&file, e))?;
        if sequence.is_none() && !document::is_sealed(&group) {
            return Ok(Self::single(path, Hologram::load(path)?));
        }
        let array = path.join(ARRAY);
        let single = sequence.is_none();
        let attributes = match sequence {
            Some(attributes) => attributes,
            None => {
                let read = document::read_array(&read_document(&array)?, true).map_err(|e| damaged(&array, e))?;
                let document::Array { shape, side, .. } = read;
                if side.is_some() {
                    return Err(no("it is stored in tiles, and cannot be streamed: export it first"));
                }
                SequenceAttributes { rate: [1, 1], shape, planned: Some(1) }
            }
        };
        let [colors, frames, height, width] = attributes.shape;
        (about.frames, about.height, about.width) = (frames, height, width);
        if colors != about.colors.len() || colors == 0 || frames == 0 {
            let (shape, described) = (attributes.shape, about.colors.len());
            return Err(damaged(&file, format!("its shape is {shape:?}, and it describes {described} colours")));
        }
        for i in 0..colors {
            let file = file.display().to_string();
            about.optics(i).map_err(|source| HologramError::FileOptics { file, source })?;
        }
        promise(path, &[colors, frames, height, width])?;
        let base = path.join("phases").join("c");
        let mut opened = Self {
            path: path.to_path_buf(),
            about,
            attributes,
            single,
            count: 1,
            complete: true,
            notes: Vec::new(),
            here: None,
            file: base,
            name: String::with_capacity(64),
        };
        if !single {
            opened.count_frames(&array);
        }
        Ok(opened)
    }

    /// A hologram in memory, read from `path`, as a sequence of one.
    pub(super) fn single(path: &Path, hologram: Hologram) -> Self {
        let shape = [hologram.colors.len(), hologram.frames, hologram.height, hologram.width];
        let mut about = hologram.clone();
        about.colors.iter_mut().for_each(|c| c.phases = Vec::new());
        Self {
            path: path.to_path_buf(),
            about,
            attributes: SequenceAttributes { rate: [1, 1], shape, planned: Some(1) },
            single: true,
            count: 1,
            complete: true,
            notes: Vec::new(),
            here: Some(hologram),
            file: PathBuf::new(),
            name: String::new(),
        }
    }

    /// Whether a sequence stands at `path`, damaged or not; not a single hologram.
    pub fn is_at(path: &Path) -> bool {
        let read = || read_document(&path.join(GROUP)).ok().and_then(|bytes| document::read_any_group(&bytes).ok());
        matches!(read(), Some((_, Some(_))))
    }

    /// How many are whole, as far as their files' lengths tell.
    fn count_frames(&mut self, array: &Path) {
        let stated = read_document(array).and_then(|bytes| {
            document::read_sequence_array(&bytes, self.attributes.shape).map_err(|e| damaged(array, e))
        });
        (self.count, self.complete) = match stated {
            Ok((count, complete)) => (count, complete),
            Err(error) => {
                self.note(format!("{error}; the holograms are counted by their files"));
                (0, false)
            }
        };
        // A lying count costs a search by halves, not a walk.
        if self.count > 0 && !self.is_whole(self.count - 1) {
            let said = self.count;
            let (mut low, mut high) = (0, self.count - 1);
            while low < high {
                let middle = low + (high - low) / 2;
                if self.is_whole(middle) { low = middle + 1 } else { high = middle }
            }
            (self.count, self.complete) = (low, false);
            while self.is_whole(self.count) {
                self.count += 1;
            }
            self.note(format!(
                "{}: the sequence is cut off: {} of its {said} holograms are there",
                self.path.display(),
                self.count
            ));
        }
        self.refresh();
    }

    fn note(&mut self, note: String) {
        tracing::warn!("{note}");
        self.notes.push(note);
    }

    /// Looks whether it has grown: the number of holograms, from now on.
    pub fn refresh(&mut self) -> u64 {
        if !self.single && !self.complete {
            while self.is_whole(self.count) {
                self.count += 1;
            }
        }
        self.count
    }

    /// Whether there will be no more; a sequence under way is asked again.
    pub fn is_complete(&mut self) -> bool {
        if !self.complete {
            let stated = read_document(&self.path.join(ARRAY))
                .ok()
                .and_then(|bytes| document::read_sequence_array(&bytes, self.attributes.shape).ok());
            if stated == Some((self.refresh(), true)) {
                self.complete = true;
            }
        }
        self.complete
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What is true of all its holograms; without phases.
    pub fn about(&self) -> &Hologram {
        &self.about
    }

    /// Whether it is a single hologram.
    pub fn is_single(&self) -> bool {
        self.single
    }

    /// How many holograms there are.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// How many there are to be, where that is known.
    pub fn planned(&self) -> Option<u64> {
        self.attributes.planned
    }

    /// Holograms a second, as a fraction; of a single one, 1.
    pub fn rate(&self) -> [u32; 2] {
        self.attributes.rate
    }

    /// Colours, sub-frames, rows, columns of each.
    pub fn shape(&self) -> [usize; 4] {
        self.attributes.shape
    }

    /// Phases of one of them: all colours.
    pub fn values(&self) -> usize {
        self.attributes.shape.iter().product()
    }

    /// What a user should know about it, in sentences.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Reads a hologram's phases, (colour, sub-frame, row, column), radians, checking every byte. `phases` are as many as
    /// [`values`](Self::values). Allocates nothing unless it fails.
    ///
    /// # Errors
    /// [`HologramError::Damaged`] naming the file; [`HologramError::File`]; then `phases` are undefined.
    pub fn read_into(&mut self, index: u64, phases: &mut [f32]) -> Result<(), HologramError> {
        let values = self.values();
        if phases.len() != values {
            return Err(HologramError::Inconsistent(format!(
                "{values} phases were read into room for {}",
                phases.len()
            )));
        }
        if !self.single {
            return self.with_file(index, |file| read_checked(file, phases));
        }
        let [_, frames, height, width] = self.attributes.shape;
        if let Some(hologram) = &self.here {
            let parts = phases.chunks_exact_mut(frames * height * width);
            parts.zip(&hologram.colors).for_each(|(part, color)| part.copy_from_slice(&color.phases));
            return Ok(());
        }
        for (i, part) in phases.chunks_exact_mut(height * width).enumerate() {
            read_checked(&self.path.join(chunk_name(i / frames, i % frames)), part)?;
        }
        Ok(())
    }

    /// One of its holograms, whole.
    ///
    /// # Errors
    /// Those of [`read_into`](Self::read_into), and for an `index` that there is not.
    pub fn load(&mut self, index: u64) -> Result<Hologram, HologramError> {
        if index >= self.count {
            let (path, last) = (self.path.display().to_string(), self.count.saturating_sub(1));
            let reason = format!("it has no hologram {index}: its last is {last}");
            return Err(HologramError::NotAHologram { path, reason });
        }
        // As long as it must be, before memory is taken for it.
        if !self.single && !self.is_whole(index) {
            self.with_file(index, |file| Err(damaged(file, "it is missing, or not as long as it must be")))?;
        }
        if let Some(hologram) = &self.here {
            return Ok(hologram.clone());
        }
        if self.single {
            return Hologram::load(&self.path);
        }
        let mut phases = vec![0.0; self.values()];
        self.read_into(index, &mut phases)?;
        let mut hologram = self.about.clone();
        // The scenes of all of them, one after the other.
        let scenes: Vec<&str> = self.about.scene.split(", ").collect();
        if scenes.len() as u64 == self.attributes.planned.unwrap_or(self.count) {
            hologram.scene = scenes[index as usize].to_owned();
        }
        let each = phases.len() / hologram.colors.len();
        for (c, part) in hologram.colors.iter_mut().zip(phases.chunks_exact(each)) {
            c.phases = part.to_vec();
        }
        hologram.check().map_err(|e| damaged(&self.path, e.to_string()))?;
        Ok(hologram)
    }

    fn is_whole(&mut self, index: u64) -> bool {
        let expected = 4 * self.values() as u64 + 4;
        self.with_file(index, |file| fs::metadata(file).is_ok_and(|m| m.is_file() && m.len() == expected))
    }

    fn with_file<T>(&mut self, index: u64, run: impl FnOnce(&Path) -> T) -> T {
        sequence_chunk(&mut self.name, index);
        self.file.push(&self.name);
        let done = run(&self.file);
        // One name pushed, of five parts.
        for _ in 0..5 {
            self.file.pop();
        }
        done
    }
}

/// The name of a hologram's file, under `phases/c`.
pub(super) fn sequence_chunk(name: &mut String, index: u64) {
    name.clear();
    // Writing to a string does not fail.
    let _ = write!(name, "{index}/0/0/0/0");
}

/// Values, then the sum of their bytes.
fn read_checked(file: &Path, values: &mut [f32]) -> Result<(), HologramError> {
    let mut opened = read::open(file).map_err(|e| unreadable(file, e))?;
    let (length, expected) = (opened.metadata().map_err(|e| unreadable(file, e))?.len(), 4 * values.len() as u64 + 4);
    if length != expected {
        return Err(damaged(file, format!("it is {length} bytes long, not {expected}")));
    }
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(values);
    let mut sum = [0; 4];
    opened.read_exact(bytes).and_then(|()| opened.read_exact(&mut sum)).map_err(|e| unreadable(file, e))?;
    let (stated, found) = (u32::from_le_bytes(sum), crc32c::crc32c(bytes));
    if stated != found {
        return Err(damaged(file, format!("its checksum is {found:08x}, and it states {stated:08x}")));
    }
    if cfg!(target_endian = "big") {
        values.iter_mut().for_each(|v| *v = f32::from_bits(v.to_bits().swap_bytes()));
    }
    Ok(())
}
