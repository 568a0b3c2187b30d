//! Reads a sequence of holograms, one at a time, while it may still grow.

use super::chunks::{
    ARRAY, GROUP, check_memory, chunk_name, damaged, none, read_chunk, read_document, read_whole, unreadable,
};
use super::document::{self, SequenceAttributes};
use super::newest::NewestHologram;
use super::{Hologram, HologramError};
use crate::files::Folder;
use eyebox_base::{Reason, reason};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A sequence of holograms of one shape, or a single hologram as a sequence of one.
///
/// Each hologram is one file with its own checksum, so a damaged hologram does not affect the others.
#[derive(Debug)]
pub struct Sequence {
    path: PathBuf,
    about: Hologram,
    attributes: SequenceAttributes,
    single: bool,
    count: u64,
    complete: bool,
    notes: Vec<String>,
    phases: Phases,
    // Kept, so that reading allocates nothing.
    name: String,
}

#[derive(Debug)]
enum Phases {
    /// Phases in the folder, which stays open even if it is replaced.
    In(Folder),
    /// Phases of a single hologram that is in memory.
    Here(Box<Hologram>),
    /// Phases of a hologram that may be replaced.
    Newest(NewestHologram),
}

impl Sequence {
    /// Opens a sequence, or a single hologram.
    ///
    /// A sequence that was cut off is opened up to its last whole hologram, and [`notes`](Self::notes) state it. A
    /// sequence whose array document is damaged is opened in the same way, and its holograms are counted by their
    /// files.
    ///
    /// # Errors
    /// Returns [`HologramError::NotAHologram`], [`HologramError::Damaged`] for the group's document,
    /// [`HologramError::FileOptics`] or [`HologramError::File`].
    pub fn open(path: &Path) -> Result<Self, HologramError> {
        let opened = Self::open_quietly(path)?;
        opened.notes.iter().for_each(|note| tracing::warn!("{note}"));
        Ok(opened)
    }

    pub(super) fn open_quietly(path: &Path) -> Result<Self, HologramError> {
        read_whole(path, Self::open_in)
    }

    fn open_in(folder: &Folder) -> Result<Self, HologramError> {
        let path = folder.path();
        let file = path.join(GROUP);
        let (mut about, sequence, sealed) = Hologram::describe(folder)?;
        if sequence.is_none() && !sealed {
            return Ok(Self::single(path, Hologram::load_from(folder)?));
        }
        let array = path.join(ARRAY);
        let single = sequence.is_none();
        let attributes = match sequence {
            Some(attributes) => attributes,
            None => {
                let read =
                    document::read_array(&read_document(folder, ARRAY)?, true).map_err(|e| damaged(&array, e))?;
                let document::Array { shape, side, .. } = read;
                if side.is_some() {
                    let reason = reason!("tiles", "it is stored in tiles and cannot be streamed. Export it first");
                    return Err(none(path, reason));
                }
                SequenceAttributes { rate: [1, 1], shape, planned: Some(1) }
            }
        };
        if !about.fits(attributes.shape) {
            let (shape, described) = (attributes.shape, about.colors.len());
            let reason = reason!("shape", "its shape is {shape:?}, but it describes {described} colors");
            return Err(damaged(&file, reason));
        }
        about.take_shape(path, attributes.shape)?;
        check_memory(path, &attributes.shape)?;
        let mut opened = Self {
            path: path.to_path_buf(),
            about,
            attributes,
            single,
            count: 1,
            complete: true,
            notes: Vec::new(),
            phases: Phases::In(folder.clone()),
            name: String::with_capacity(64),
        };
        if !single {
            opened.count_frames(folder);
            if !opened.notes.is_empty() && folder.is_replaced() {
                // The missing files belong to a folder that was replaced as a whole.
                return Err(HologramError::Replaced { path: path.display().to_string() });
            }
        }
        Ok(opened)
    }

    /// Returns a hologram in memory, read or solved from `path`, as a sequence of one.
    pub fn single(path: &Path, hologram: Hologram) -> Self {
        Self::in_memory(path, hologram.clone(), Phases::Here(Box::new(hologram)))
    }

    /// Returns a hologram that may be replaced during playback, as a sequence of one.
    pub fn newest_of(path: &Path, newest: &NewestHologram) -> Self {
        Self::in_memory(path, newest.load(), Phases::Newest(newest.clone()))
    }

    fn in_memory(path: &Path, mut about: Hologram, phases: Phases) -> Self {
        let shape = about.shape();
        about.colors.iter_mut().for_each(|c| c.phases = Vec::new());
        Self {
            path: path.to_path_buf(),
            about,
            attributes: SequenceAttributes { rate: [1, 1], shape, planned: Some(1) },
            single: true,
            count: 1,
            complete: true,
            notes: Vec::new(),
            phases,
            name: String::new(),
        }
    }

    /// Returns true if there is a sequence at `path`, damaged or not. Returns false for a single hologram.
    pub fn is_at(path: &Path) -> bool {
        let document = read_whole(path, |folder| read_document(folder, GROUP));
        document.is_ok_and(|bytes| matches!(document::read_any_group(&bytes), Ok((_, Some(_)))))
    }

    /// Counts the whole holograms, by the lengths of their files.
    fn count_frames(&mut self, folder: &Folder) {
        let stated = read_document(folder, ARRAY).and_then(|bytes| {
            let read = document::read_sequence_array(&bytes, self.attributes.shape);
            read.map_err(|e| damaged(&folder.path().join(ARRAY), e))
        });
        (self.count, self.complete) = match stated {
            Ok((count, complete)) => (count, complete),
            Err(error) => {
                self.notes.push(format!("{error}. The holograms are counted by their files"));
                (0, false)
            }
        };
        // A wrong count costs a binary search, not a walk through all holograms.
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
            self.notes.push(format!(
                "{}: the sequence is cut off, with {} of its {said} holograms",
                self.path.display(),
                self.count
            ));
        }
        self.refresh();
    }

    /// Checks whether it has grown. Returns the present number of holograms.
    pub fn refresh(&mut self) -> u64 {
        if !self.single && !self.complete {
            while self.is_whole(self.count) {
                self.count += 1;
            }
        }
        self.count
    }

    /// Returns true if the sequence will not grow. For a sequence under way, the file is read again.
    pub fn is_complete(&mut self) -> bool {
        if !self.complete {
            let document = match &self.phases {
                Phases::In(folder) => read_document(folder, ARRAY).ok(),
                Phases::Here(_) | Phases::Newest(_) => None,
            };
            let stated = document.and_then(|bytes| document::read_sequence_array(&bytes, self.attributes.shape).ok());
            if stated == Some((self.refresh(), true)) {
                self.complete = true;
            }
        }
        self.complete
    }

    /// Returns the path of the sequence.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the description that all its holograms share, without phases.
    pub fn about(&self) -> &Hologram {
        &self.about
    }

    /// Returns the hologram that may be replaced, if it is one.
    pub fn newest(&self) -> Option<&NewestHologram> {
        match &self.phases {
            Phases::Newest(newest) => Some(newest),
            Phases::In(_) | Phases::Here(_) => None,
        }
    }

    /// Returns true if it is a single hologram.
    pub fn is_single(&self) -> bool {
        self.single
    }

    /// Returns the number of holograms.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the planned number of holograms, if known.
    pub fn planned(&self) -> Option<u64> {
        self.attributes.planned
    }

    /// Returns the holograms per second, as a fraction. It is 1 for a single hologram.
    pub fn rate(&self) -> [u32; 2] {
        self.attributes.rate
    }

    /// Returns the numbers of colors, sub-frames, rows and columns of each hologram.
    pub fn shape(&self) -> [usize; 4] {
        self.attributes.shape
    }

    /// Returns the number of phases of one hologram, with all colors.
    pub fn values(&self) -> usize {
        self.attributes.shape.iter().product()
    }

    /// Returns notes for the user about its state, in sentences.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Reads a hologram's phases (color, sub-frame, row, column) in radians and checks every byte. `phases` has the
    /// length [`values`](Self::values). It allocates nothing unless it fails. Returns the version of a hologram that
    /// may be replaced, and 0 for others.
    ///
    /// # Errors
    /// Returns [`HologramError::Damaged`] with the file, or [`HologramError::File`]. Then `phases` are undefined.
    pub fn read_into(&mut self, index: u64, phases: &mut [f32]) -> Result<u64, HologramError> {
        let values = self.values();
        if phases.len() != values {
            return Err(HologramError::Inconsistent(reason!(
                "phases-count",
                "{values} phases do not fit into an array of {}",
                phases.len()
            )));
        }
        if !self.single {
            return self.with_file(index, |folder, name| read_chunk(folder, name, true, phases)).map(|()| 0);
        }
        let [_, frames, height, width] = self.attributes.shape;
        let each = frames * height * width;
        let mut copy = |hologram: &Hologram| {
            let parts = phases.chunks_exact_mut(each);
            parts.zip(&hologram.colors).for_each(|(part, color)| part.copy_from_slice(&color.phases));
        };
        match &self.phases {
            Phases::Here(hologram) => copy(hologram),
            Phases::Newest(newest) => {
                let newest = newest.get();
                copy(&newest.1);
                return Ok(newest.0);
            }
            Phases::In(folder) => {
                for (i, part) in phases.chunks_exact_mut(height * width).enumerate() {
                    read_chunk(folder, &chunk_name(i / frames, i % frames), true, part)?;
                }
            }
        }
        Ok(0)
    }

    /// Returns one of its holograms with all phases.
    ///
    /// # Errors
    /// Returns the errors of [`read_into`](Self::read_into), and an error for an `index` that does not exist.
    pub fn load(&mut self, index: u64) -> Result<Hologram, HologramError> {
        if index >= self.count {
            let last = self.count.saturating_sub(1);
            return Err(none(
                &self.path,
                reason!("no-such-hologram", "it has no hologram {index}, the last is {last}"),
            ));
        }
        // The length is checked before memory is allocated.
        if !self.single && !self.is_whole(index) {
            self.with_file(index, |folder, name| {
                folder.length(name).map_err(|e| unreadable(folder, name, e))?;
                Err(damaged(&folder.path().join(name), reason!("length", "it is not as long as it must be")))
            })?;
        }
        match &self.phases {
            Phases::Here(hologram) => return Ok((**hologram).clone()),
            Phases::Newest(newest) => return Ok(newest.load()),
            Phases::In(folder) if self.single => return Hologram::load_from(folder),
            Phases::In(_) => {}
        }
        let mut phases = vec![0.0; self.values()];
        self.read_into(index, &mut phases)?;
        let mut hologram = self.about.clone();
        // The scenes of all holograms, one after the other.
        let scenes: Vec<&str> = self.about.scene.split(", ").collect();
        if scenes.len() as u64 == self.attributes.planned.unwrap_or(self.count) {
            hologram.scene = scenes[index as usize].to_owned();
        }
        if let Some(record) = self.about.metadata.scenes.get(index as usize) {
            hologram.set_scene(&record.source, record.clone());
        }
        let each = phases.len() / hologram.colors.len();
        for (c, part) in hologram.colors.iter_mut().zip(phases.chunks_exact(each)) {
            c.phases = part.to_vec();
        }
        hologram.check().map_err(|e| damaged(&self.path, Reason::of(&e)))?;
        Ok(hologram)
    }

    fn is_whole(&mut self, index: u64) -> bool {
        let expected = 4 * self.values() as u64 + 4;
        let length = |folder: &Folder, name: &str| folder.length(name).map_err(|e| unreadable(folder, name, e));
        self.with_file(index, length).is_ok_and(|length| length == expected)
    }

    /// Runs `run` on a hologram's file.
    fn with_file<T>(
        &mut self,
        index: u64,
        run: impl FnOnce(&Folder, &str) -> Result<T, HologramError>,
    ) -> Result<T, HologramError> {
        sequence_chunk(&mut self.name, index);
        match &self.phases {
            Phases::In(folder) => run(folder, &self.name),
            Phases::Here(_) | Phases::Newest(_) => {
                Err(damaged(&self.path, reason!("in-memory", "it is a single hologram in memory")))
            }
        }
    }
}

/// Writes the name of a hologram's file into `name`.
pub(super) fn sequence_chunk(name: &mut String, index: u64) {
    name.clear();
    // Writing to a string does not fail.
    let _ = write!(name, "phases/c/{index}/0/0/0/0");
}
