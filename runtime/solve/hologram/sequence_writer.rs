//! Writing a sequence, hologram by hologram.

use super::chunks::{ARRAY, GROUP, LOCK, draft_in_place_of, lock, open_folder, unwritable};
use super::document::{self, SequenceAttributes};
use super::sequence_parts::{DRAFT, SequenceParts, check_same};
use super::{Hologram, HologramError, Sequence};
use eyebox_base::reason;
use std::fs::File;
use std::path::Path;

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
        let draft = draft_in_place_of(path, |_| false)?;
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
