//! Writing a sequence, hologram by hologram.

use super::chunks::{ARRAY, GROUP, LOCK, draft_in_place_of, lock, open_folder, unwritable};
use super::document::{self, SequenceAttributes};
use super::sequence::sequence_chunk;
use super::{Hologram, HologramError, Sequence, wrap_phase};
use crate::files::Folder;
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

/// What is written of it lies here until it is whole: killed, it is written over by who goes on.
const DRAFT: &str = ".eyebox-next.part";

/// A sequence under way. Each hologram is complete and on the disk, and in the array's document, when
/// [`append`](Self::append) returns; whatever interrupts the next leaves it so.
#[derive(Debug)]
pub struct SequenceWriter {
    folder: Folder,
    about: Hologram,
    attributes: SequenceAttributes,
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
            return Err(HologramError::Inconsistent(format!("it has the rate {} / {}", rate[0], rate[1])));
        }
        let mut about = like.clone();
        about.colors.iter_mut().for_each(|c| c.phases = Vec::new());
        let shape = [like.colors.len(), like.frames, like.height, like.width];
        let attributes = SequenceAttributes { rate, shape, planned };
        let draft = draft_in_place_of(path, |_| false)?;
        draft.write(GROUP, |out| out.write_all(&document::group_of(&about, Some(attributes))))?;
        draft.write(ARRAY, |out| out.write_all(&document::sequence_array(0, shape, false)))?;
        draft.put()?;
        let folder = open_folder(path)?;
        Ok(Self { about, attributes, count: 0, _lock: lock(&folder)?, folder })
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
        let other = |reason: String| {
            let reason = format!("{reason}; give it another name, or remove it");
            Err(HologramError::OtherSequence { path: path.display().to_string(), reason })
        };
        if there.is_single() {
            return other("a single hologram stands there, not a sequence".into());
        }
        let shape = [like.colors.len(), like.frames, like.height, like.width];
        let attributes = SequenceAttributes { rate, shape, planned };
        let mut about = there.about().clone();
        // Found out in its first frame, not decided before.
        let mut wanted = like.clone();
        for (w, a) in wanted.colors.iter_mut().zip(&about.colors) {
            (w.exposure, w.efficiency, w.phases) = (a.exposure, a.efficiency, Vec::new());
        }
        if there.shape() != shape || there.rate() != rate || there.planned() != planned {
            return other(format!(
                "a sequence of {:?} at {}/{} a second stands there, not of {shape:?} at {}/{}",
                there.shape(),
                there.rate()[0],
                there.rate()[1],
                rate[0],
                rate[1]
            ));
        }
        let document = |h: &Hologram| document::group_of(h, Some(attributes));
        if document(&about) != document(&wanted) {
            let what = difference(&about, &wanted);
            return other(format!("a sequence made otherwise stands there ({what})"));
        }
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
        let writer = Self { folder, about, attributes, count: whole, _lock };
        writer.state(false)?;
        Ok(Some(writer))
    }

    /// How many holograms it has.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// What is true of all its holograms, their exposures among it; without phases.
    pub fn about(&self) -> &Hologram {
        &self.about
    }

    /// Adds a hologram.
    ///
    /// # Errors
    /// [`HologramError::Inconsistent`] for one of another shape, other colours or another exposure;
    /// [`HologramError::File`], then everything before it is as it was.
    pub fn append(&mut self, hologram: &Hologram) -> Result<(), HologramError> {
        hologram.check()?;
        let shape = [hologram.colors.len(), hologram.frames, hologram.height, hologram.width];
        if shape != self.attributes.shape {
            let of = self.attributes.shape;
            return Err(HologramError::Inconsistent(format!("it is {shape:?}, and the sequence's are {of:?}")));
        }
        for (c, of) in hologram.colors.iter().zip(&self.about.colors) {
            if (c.color, c.wavelength, c.exposure) != (of.color, of.wavelength, of.exposure) {
                let reason = format!(
                    "a colour at {:.1} nm has the exposure {}, and the sequence has {:.1} nm and {}: one for all",
                    c.wavelength * 1e9,
                    c.exposure,
                    of.wavelength * 1e9,
                    of.exposure
                );
                return Err(HologramError::Inconsistent(reason));
            }
        }
        let mut name = String::new();
        sequence_chunk(&mut name, self.count);
        self.write(&name, |out| {
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
        })?;
        self.count += 1;
        self.state(false)
    }

    /// Says that there will be no more.
    ///
    /// # Errors
    /// [`HologramError::File`].
    pub fn finish(self) -> Result<(), HologramError> {
        self.state(true)?;
        self.folder.remove(LOCK).map_err(|e| unwritable(&self.folder, LOCK, e))
    }

    fn state(&self, complete: bool) -> Result<(), HologramError> {
        let document = document::sequence_array(self.count, self.attributes.shape, complete);
        self.write(ARRAY, |out| out.write_all(&document))
    }

    fn write(&self, name: &str, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), HologramError> {
        self.folder.replace(DRAFT, name, fill).map_err(|e| unwritable(&self.folder, name, e))
    }
}

/// Which part of two descriptions is not the same.
fn difference(is: &Hologram, wanted: &Hologram) -> String {
    if is.display != wanted.display {
        return format!("for the display '{}', not '{}'", is.display, wanted.display);
    }
    if is.scene != wanted.scene {
        return format!("of {}, not {}", is.scene, wanted.scene);
    }
    match is.metadata.difference(&wanted.metadata) {
        Some(key) => format!("its settings differ in '{key}'"),
        None => "other optics, seed or version".into(),
    }
}
