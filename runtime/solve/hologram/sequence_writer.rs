//! Writing a sequence: by one program, hologram by hologram, or by several at once, each hologram by whichever has solved it, in any
//! order.
//!
//! A hologram is one file, there whole or not at all, so nothing has to be joined in the end. Who reads the folder meanwhile sees the
//! holograms up to the first that is missing.

use super::chunks::{ARRAY, GROUP, LOCK, draft, lock, open_folder, own_draft, unreadable, unwritable};
use super::document::{self, SequenceAttributes};
use super::sequence::sequence_chunk;
use super::{Hologram, HologramError, Sequence};
use crate::files::{Folder, Kind, is_draft};
use crate::optics::wrap_phase;
use eyebox_base::{Reason, reason};
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

/// What its only writer writes lies here until it is whole: killed, it is written over by who goes on.
pub(super) const DRAFT: &str = ".eyebox-next.part";

/// A sequence under way, to whose holograms more are added at their own places.
#[derive(Debug)]
pub struct SequenceParts {
    pub(super) folder: Folder,
    /// Without phases.
    pub(super) about: Hologram,
    pub(super) attributes: SequenceAttributes,
}

impl SequenceParts {
    /// Opens a sequence that a [`SequenceWriter`] has begun.
    ///
    /// # Errors
    /// Those of [`Sequence::open`]; [`HologramError::Inconsistent`] for a single hologram, and for a sequence of which nobody said how many
    /// holograms it is to have.
    pub fn open(path: &Path) -> Result<Self, HologramError> {
        Self::of(&Sequence::open_quietly(path)?)
    }

    /// The same, where it is one of holograms like `like`, `rate` a second, `planned` of them.
    ///
    /// # Errors
    /// The same; [`HologramError::OtherSequence`].
    pub fn open_same(path: &Path, like: &Hologram, rate: [u32; 2], planned: u64) -> Result<Self, HologramError> {
        let there = Sequence::open_quietly(path)?;
        check_same(&there, like, rate, Some(planned))?;
        Self::of(&there)
    }

    fn of(there: &Sequence) -> Result<Self, HologramError> {
        let (rate, shape, planned) = (there.rate(), there.shape(), there.planned());
        if there.is_single() || planned.is_none() {
            let what = "it is a single hologram, or a sequence whose length nobody knows";
            let reason =
                reason!("several-programs", "{}: {what}: several programs cannot write it", there.path().display());
            return Err(HologramError::Inconsistent(reason));
        }
        let attributes = SequenceAttributes { rate, shape, planned };
        Ok(Self { folder: open_folder(there.path())?, about: there.about().clone(), attributes })
    }

    /// What is true of all its holograms, their exposures among it; without phases.
    pub fn about(&self) -> &Hologram {
        &self.about
    }

    /// How many holograms there are to be.
    pub fn planned(&self) -> u64 {
        self.attributes.planned.unwrap_or(0)
    }

    /// Whether a hologram is there.
    pub fn has(&self, index: u64) -> bool {
        let mut name = String::new();
        sequence_chunk(&mut name, index);
        let values: usize = self.attributes.shape.iter().product();
        self.folder.length(&name).is_ok_and(|length| length == 4 * values as u64 + 4)
    }

    /// Writes a hologram at its place: it is on the disk when this returns. Whoever writes the same one at the same time writes the same.
    ///
    /// # Errors
    /// Those of [`SequenceWriter::append`]; [`HologramError::Inconsistent`] for a place that it has not.
    pub fn write(&self, index: u64, hologram: &Hologram) -> Result<(), HologramError> {
        if index >= self.planned() {
            let reason = reason!("no-such-place", "it has {} holograms, and no place {index}", self.planned());
            return Err(HologramError::Inconsistent(reason));
        }
        self.put(&own_draft(), index, hologram)
    }

    /// Says that all of them are there, and removes what programs that died were writing.
    ///
    /// # Errors
    /// [`HologramError::Inconsistent`] that names the first hologram that is missing; [`HologramError::Busy`] where another program says
    /// it; [`HologramError::File`].
    pub fn finish(self) -> Result<(), HologramError> {
        let planned = self.planned();
        if let Some(missing) = (0..planned).find(|index| !self.has(*index)) {
            let reason = reason!("not-there-yet", "hologram {missing} of {planned} is not there yet");
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

    /// Writes a hologram by way of the file `draft`.
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

    /// Says how many there are.
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
            let reason = reason!("shape", "it is {shape:?}, and the sequence's are {of:?}");
            return Err(HologramError::Inconsistent(reason));
        }
        for (c, of) in hologram.colors.iter().zip(&self.about.colors) {
            if (c.color, c.wavelength, c.exposure) != (of.color, of.wavelength, of.exposure) {
                let reason = reason!(
                    "exposure-differs",
                    "a colour at {:.1} nm has the exposure {}, and the sequence has {:.1} nm and {}: one for all",
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

/// Refuses a sequence that is another one than of holograms like `like`; else what is true of all of its own.
pub(super) fn check_same(
    there: &Sequence,
    like: &Hologram,
    rate: [u32; 2],
    planned: Option<u64>,
) -> Result<Hologram, HologramError> {
    let other = |reason: Reason| {
        let reason = reason.reworded(|text| format!("{text}; give it another name, or remove it"));
        Err(HologramError::OtherSequence { path: there.path().display().to_string(), reason })
    };
    if there.is_single() {
        return other(reason!("single-hologram", "a single hologram stands there, not a sequence"));
    }
    let shape = like.shape();
    let attributes = SequenceAttributes { rate, shape, planned };
    let about = there.about().clone();
    // Found out in its first frame, not decided before.
    let mut wanted = like.clone();
    let (kept, own) = (&about.metadata, &mut wanted.metadata);
    // A display that was calibrated again shows the same phases.
    own.display_file.clone_from(&kept.display_file);
    if kept.scenes.is_empty() {
        // An older eyebox kept no more of its scenes than their names.
        own.scenes.clear();
        (own.order, own.photographs, own.depth_map_mm) = (kept.order, kept.photographs, kept.depth_map_mm);
    } else if own.scenes.is_empty() {
        // Whoever writes a part knows the contents of its own scene alone.
        own.scenes.clone_from(&kept.scenes);
    }
    for (w, a) in wanted.colors.iter_mut().zip(&about.colors) {
        (w.exposure, w.efficiency, w.phases) = (a.exposure, a.efficiency, Vec::new());
    }
    if there.shape() != shape || there.rate() != rate || there.planned() != planned {
        return other(reason!(
            "shape-or-rate",
            "a sequence of {:?} at {}/{} a second stands there, not of {shape:?} at {}/{}",
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
        return other(what.reworded(|what| format!("a sequence made otherwise stands there ({what})")));
    }
    Ok(about)
}

/// Which part of two descriptions is not the same.
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

/// A sequence under way. Each hologram is complete and on the disk, and in the array's document, when
/// [`append`](Self::append) returns; whatever interrupts the next leaves it so.
#[derive(Debug)]
pub struct SequenceWriter {
    to: SequenceParts,
    count: u64,
    /// One program at a time writes it.
    _lock: File,
}

impl SequenceWriter {
    /// Starts a sequence at `path`, where nothing may be, of holograms like `like` (its phases do not matter), to be
    /// shown `rate` (a fraction) a second.
    ///
    /// # Errors
    /// [`HologramError::Inconsistent`]; [`HologramError::Busy`] where another program writes one; [`HologramError::File`], with
    /// [`FileError::Taken`](crate::files::FileError::Taken) where something else stands.
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

    /// Goes on with a sequence that was interrupted: one with these `settings`, scene, display, rate and number.
    ///
    /// Its holograms are read to the last, and what comes after the last whole one is written again. None where the
    /// sequence is complete.
    ///
    /// # Errors
    /// [`HologramError::OtherSequence`] where another one stands there; [`HologramError::Busy`] where another program writes
    /// it; those of [`Sequence::open`].
    pub fn resume(
        path: &Path,
        like: &Hologram,
        rate: [u32; 2],
        planned: Option<u64>,
    ) -> Result<Option<Self>, HologramError> {
        let mut there = Sequence::open(path)?;
        let mut about = check_same(&there, like, rate, planned)?;
        let folder = open_folder(path)?;
        // Who was killed at its very end left the lock.
        if there.is_complete() && !folder.has(LOCK) {
            return Ok(None);
        }
        let _lock = lock(&folder)?;
        // Whoever held it a moment ago may have gone on.
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

    /// How many holograms it has.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// What is true of all its holograms, their exposures among it; without phases.
    pub fn about(&self) -> &Hologram {
        self.to.about()
    }

    /// Adds a hologram.
    ///
    /// # Errors
    /// [`HologramError::Inconsistent`] for one of another shape, other colours or another exposure;
    /// [`HologramError::File`], then everything before it is as it was.
    pub fn append(&mut self, hologram: &Hologram) -> Result<(), HologramError> {
        self.to.put(DRAFT, self.count, hologram)?;
        self.count += 1;
        self.to.state(self.count, false)
    }

    /// Says that there will be no more.
    ///
    /// # Errors
    /// [`HologramError::File`].
    pub fn finish(self) -> Result<(), HologramError> {
        self.to.state(self.count, true)?;
        self.to.folder.remove(LOCK).map_err(|e| unwritable(&self.to.folder, LOCK, e))
    }
}
