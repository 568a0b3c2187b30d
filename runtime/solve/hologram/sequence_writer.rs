//! Writes a sequence of holograms, by one program or by several programs at once.
//!
//! One program writes hologram by hologram. Several programs write the holograms that they have solved, in any order. A
//! hologram is one file that appears only when complete, so there is no merge step. A reader of the unfinished folder
//! sees the holograms before the first missing one.

use super::chunks::{ARRAY, GROUP, LOCK, draft, lock, open_folder, own_draft, unreadable, unwritable};
use super::document::{self, SequenceAttributes};
use super::sequence::sequence_chunk;
use super::{Hologram, HologramError, Sequence};
use crate::files::{FileLock, Folder, Kind, is_draft};
use crate::optics::wrap_phase;
use eyebox_base::{Reason, reason};
use std::io::{self, Write};
use std::path::Path;

/// The file of a single writer until its content is complete. If the writer is killed, its successor overwrites it.
pub(super) const DRAFT: &str = ".eyebox-next.part";

/// A sequence under way, to which holograms are added at their own indices.
#[derive(Debug)]
pub struct SequenceParts {
    pub(super) folder: Folder,
    /// The shared description, without phases.
    pub(super) about: Hologram,
    pub(super) attributes: SequenceAttributes,
}

impl SequenceParts {
    /// Opens a sequence that a [`SequenceWriter`] has begun.
    ///
    /// # Errors
    /// Returns the errors of [`Sequence::open`], and [`HologramError::Inconsistent`] for a single hologram or for a
    /// sequence without a planned number of holograms.
    pub fn open(path: &Path) -> Result<Self, HologramError> {
        Self::of(&Sequence::open_quietly(path)?)
    }

    /// Opens a sequence only if it consists of `planned` holograms like `like`, `rate` per second.
    ///
    /// # Errors
    /// Returns the errors of [`open`](Self::open), or [`HologramError::OtherSequence`].
    pub fn open_same(path: &Path, like: &Hologram, rate: [u32; 2], planned: u64) -> Result<Self, HologramError> {
        let there = Sequence::open_quietly(path)?;
        check_same(&there, like, rate, Some(planned))?;
        Self::of(&there)
    }

    fn of(there: &Sequence) -> Result<Self, HologramError> {
        let (rate, shape, planned) = (there.rate(), there.shape(), there.planned());
        if there.is_single() || planned.is_none() {
            let what = "it is a single hologram, or a sequence without a planned length";
            let reason =
                reason!("several-programs", "{}: {what}. Several programs cannot write it", there.path().display());
            return Err(HologramError::Inconsistent(reason));
        }
        let attributes = SequenceAttributes { rate, shape, planned };
        Ok(Self { folder: open_folder(there.path())?, about: there.about().clone(), attributes })
    }

    /// Returns the description that all its holograms share, with their exposures and without phases.
    pub fn about(&self) -> &Hologram {
        &self.about
    }

    /// Returns the planned number of holograms.
    pub fn planned(&self) -> u64 {
        self.attributes.planned.unwrap_or(0)
    }

    /// Returns true if a hologram exists.
    pub fn has(&self, index: u64) -> bool {
        let mut name = String::new();
        sequence_chunk(&mut name, index);
        let values: usize = self.attributes.shape.iter().product();
        self.folder.length(&name).is_ok_and(|length| length == 4 * values as u64 + 4)
    }

    /// Writes a hologram at its index. It is on the disk when this returns. Programs that write the same hologram at
    /// the same time write the same bytes.
    ///
    /// # Errors
    /// Returns the errors of [`SequenceWriter::append`], and [`HologramError::Inconsistent`] for an index beyond the
    /// planned number.
    pub fn write(&self, index: u64, hologram: &Hologram) -> Result<(), HologramError> {
        if index >= self.planned() {
            let reason = reason!("no-such-place", "it has {} holograms and no index {index}", self.planned());
            return Err(HologramError::Inconsistent(reason));
        }
        self.put(&own_draft(), index, hologram)
    }

    /// Marks the sequence as complete, and removes temporary files of programs that were killed.
    ///
    /// # Errors
    /// Returns [`HologramError::Inconsistent`] with the first missing hologram, [`HologramError::Busy`] if another
    /// program finishes it, or [`HologramError::File`].
    pub fn finish(self) -> Result<(), HologramError> {
        let planned = self.planned();
        if let Some(missing) = (0..planned).find(|index| !self.has(*index)) {
            let reason = reason!("not-there-yet", "hologram {missing} of {planned} does not exist yet");
            return Err(HologramError::Inconsistent(reason));
        }
        let _lock = lock(&self.folder)?;
        for (name, kind) in self.folder.entries("").map_err(|e| unreadable(&self.folder, "", e))? {
            if let (Some(name), Kind::File) = (name.to_str().filter(|name| is_draft(name)), kind) {
                self.folder.remove(name).map_err(|e| unwritable(&self.folder, name, e))?;
            }
        }
        self.state(planned, true)?;
        self.folder.remove(LOCK).map_err(|e| unwritable(&self.folder, LOCK, e))
    }

    /// Writes a hologram with the temporary file `draft`.
    pub(super) fn put(&self, draft: &str, index: u64, hologram: &Hologram) -> Result<(), HologramError> {
        self.check_fits(hologram)?;
        let mut name = String::new();
        sequence_chunk(&mut name, index);
        self.replace(draft, &name, |out| {
            let mut sum = 0;
            let mut bytes = Vec::new();
            for color in 0..hologram.colors.len() {
                for frame in 0..hologram.frames {
                    bytes.clear();
                    bytes.extend(hologram.frame(color, frame).iter().flat_map(|&p| wrap_phase(p).to_le_bytes()));
                    sum = crc32c::crc32c_append(sum, &bytes);
                    out.write_all(&bytes)?;
                }
            }
            out.write_all(&sum.to_le_bytes())
        })
    }

    /// Writes the number of holograms into the array's document.
    pub(super) fn state(&self, count: u64, complete: bool) -> Result<(), HologramError> {
        let document = document::sequence_array(count, self.attributes.shape, complete);
        self.replace(DRAFT, ARRAY, |out| out.write_all(&document))
    }

    fn replace(
        &self,
        draft: &str,
        name: &str,
        fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<(), HologramError> {
        self.folder.replace(draft, name, fill).map_err(|e| unwritable(&self.folder, name, e))
    }

    fn check_fits(&self, hologram: &Hologram) -> Result<(), HologramError> {
        hologram.check()?;
        let (shape, of) = (hologram.shape(), self.attributes.shape);
        if shape != of {
            let reason = reason!("shape", "its shape is {shape:?}, but the sequence has {of:?}");
            return Err(HologramError::Inconsistent(reason));
        }
        for (c, of) in hologram.colors.iter().zip(&self.about.colors) {
            if (c.color, c.wavelength, c.exposure) != (of.color, of.wavelength, of.exposure) {
                let reason = reason!(
                    "exposure-differs",
                    "a color at {:.1} nm has the exposure {}, but all of the sequence have {:.1} nm and {}",
                    c.wavelength * 1e9,
                    c.exposure,
                    of.wavelength * 1e9,
                    of.exposure
                );
                return Err(HologramError::Inconsistent(reason));
            }
        }
        Ok(())
    }
}

/// Refuses a sequence that is not of holograms like `like`. Otherwise returns the description that all its holograms
/// share.
pub(super) fn check_same(
    there: &Sequence,
    like: &Hologram,
    rate: [u32; 2],
    planned: Option<u64>,
) -> Result<Hologram, HologramError> {
    let other = |reason: Reason| {
        let reason = reason.reworded(|text| format!("{text}. Use another name, or remove it"));
        Err(HologramError::OtherSequence { path: there.path().display().to_string(), reason })
    };
    if there.is_single() {
        return other(reason!("single-hologram", "it is a single hologram, not a sequence"));
    }
    let shape = like.shape();
    let attributes = SequenceAttributes { rate, shape, planned };
    let about = there.about().clone();
    // The first hologram determines the exposures, so they are not compared.
    let mut wanted = like.clone();
    let (kept, own) = (&about.metadata, &mut wanted.metadata);
    // A display that was calibrated again shows the same phases.
    own.display_file.clone_from(&kept.display_file);
    if kept.scenes.is_empty() {
        // An older eyebox stored only the names of its scenes.
        own.scenes.clear();
        (own.order, own.photographs, own.depth_map_mm) = (kept.order, kept.photographs, kept.depth_map_mm);
    } else if own.scenes.is_empty() {
        // The writer of a part knows the contents of its own scene alone.
        own.scenes.clone_from(&kept.scenes);
    }
    for (w, a) in wanted.colors.iter_mut().zip(&about.colors) {
        (w.exposure, w.efficiency, w.phases) = (a.exposure, a.efficiency, Vec::new());
    }
    if there.shape() != shape || there.rate() != rate || there.planned() != planned {
        return other(reason!(
            "shape-or-rate",
            "it is a sequence of {:?} at {}/{} per second, not of {shape:?} at {}/{}",
            there.shape(),
            there.rate()[0],
            there.rate()[1],
            rate[0],
            rate[1]
        ));
    }
    let document = |h: &Hologram| document::group_with(h, h.metadata.without_places(), Some(attributes));
    if document(&about) != document(&wanted) {
        let what = difference(&about, &wanted);
        return other(what.reworded(|what| format!("it is a sequence that was made differently ({what})")));
    }
    Ok(about)
}

/// Returns the difference between two descriptions.
fn difference(is: &Hologram, wanted: &Hologram) -> Reason {
    if is.display != wanted.display {
        return reason!("other-display", "for the display '{}', not '{}'", is.display, wanted.display);
    }
    if is.scene != wanted.scene {
        return reason!("other-scene", "of {}, not {}", is.scene, wanted.scene);
    }
    match is.metadata.without_places().difference(&wanted.metadata.without_places()) {
        Some(key) => reason!("other-setting", "its settings differ in '{key}'"),
        None => reason!("made-otherwise", "other optics, seed or version"),
    }
}

/// A sequence under way. When [`append`](Self::append) returns, each hologram is complete, on the disk, and in the
/// array's document. An interruption of the next append does not change that.
#[derive(Debug)]
pub struct SequenceWriter {
    to: SequenceParts,
    count: u64,
    /// Only one program at a time writes it.
    _lock: FileLock,
}

impl SequenceWriter {
    /// Starts a sequence at `path`, which must not exist, of holograms like `like` (its phases are ignored). It is
    /// shown at `rate` holograms per second, a fraction.
    ///
    /// # Errors
    /// Returns [`HologramError::Inconsistent`], [`HologramError::Busy`] if another program writes one, or
    /// [`HologramError::File`], with [`FileError::Taken`](crate::files::FileError::Taken) if `path` exists.
    pub fn create(path: &Path, like: &Hologram, rate: [u32; 2], planned: Option<u64>) -> Result<Self, HologramError> {
        like.check()?;
        if rate.contains(&0) {
            return Err(HologramError::Inconsistent(reason!("rate", "it has the rate {} / {}", rate[0], rate[1])));
        }
        let mut about = like.clone();
        about.colors.iter_mut().for_each(|c| c.phases = Vec::new());
        let shape = like.shape();
        let attributes = SequenceAttributes { rate, shape, planned };
        let draft = draft(path, |_| false)?;
        draft.write(GROUP, |out| out.write_all(&document::group_at(path, &about, Some(attributes))))?;
        draft.write(ARRAY, |out| out.write_all(&document::sequence_array(0, shape, false)))?;
        draft.put()?;
        let folder = open_folder(path)?;
        Ok(Self { count: 0, _lock: lock(&folder)?, to: SequenceParts { folder, about, attributes } })
    }

    /// Continues an interrupted sequence with the same settings, scene, display, rate and number.
    ///
    /// All holograms are read, and everything after the last whole one is written again. Returns none if the
    /// sequence is complete.
    ///
    /// # Errors
    /// Returns [`HologramError::OtherSequence`] if `path` holds another sequence, [`HologramError::Busy`] if another
    /// program writes it, or the errors of [`Sequence::open`].
    pub fn resume(
        path: &Path,
        like: &Hologram,
        rate: [u32; 2],
        planned: Option<u64>,
    ) -> Result<Option<Self>, HologramError> {
        let mut there = Sequence::open(path)?;
        let mut about = check_same(&there, like, rate, planned)?;
        let folder = open_folder(path)?;
        // A program that was killed at its very end left the lock.
        if there.is_complete() && !folder.has(LOCK) {
            return Ok(None);
        }
        let _lock = lock(&folder)?;
        // The previous holder of the lock may have made progress.
        there = Sequence::open(path)?;
        if there.is_complete() {
            return folder.remove(LOCK).map(|()| None).map_err(|e| unwritable(&folder, LOCK, e));
        }
        let mut phases = vec![0.0; there.values()];
        let whole = (0..there.count()).take_while(|i| there.read_into(*i, &mut phases).is_ok()).count() as u64;
        about.colors.iter_mut().for_each(|c| c.phases = Vec::new());
        let attributes = SequenceAttributes { rate, shape: there.shape(), planned };
        let writer = Self { to: SequenceParts { folder, about, attributes }, count: whole, _lock };
        writer.to.state(writer.count, false)?;
        Ok(Some(writer))
    }

    /// Returns the number of holograms written.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the description that all its holograms share, with their exposures and without phases.
    pub fn about(&self) -> &Hologram {
        self.to.about()
    }

    /// Appends a hologram to the sequence.
    ///
    /// # Errors
    /// Returns [`HologramError::Inconsistent`] for another shape, other colors or another exposure, or
    /// [`HologramError::File`]. Then everything before it is unchanged.
    pub fn append(&mut self, hologram: &Hologram) -> Result<(), HologramError> {
        self.to.put(DRAFT, self.count, hologram)?;
        self.count += 1;
        self.to.state(self.count, false)
    }

    /// Marks the sequence as complete.
    ///
    /// # Errors
    /// Returns [`HologramError::File`] if a file cannot be written.
    pub fn finish(self) -> Result<(), HologramError> {
        self.to.state(self.count, true)?;
        self.to.folder.remove(LOCK).map_err(|e| unwritable(&self.to.folder, LOCK, e))
    }
}
