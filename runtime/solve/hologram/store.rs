//! Reads and writes the hologram's own file, which is a Zarr v3 folder.

use super::chunks::{
    ARRAY, GROUP, check_is_one, check_length, check_memory, chunk_name, damaged, draft, is_hologram, none, read_chunk,
    read_document, read_whole, write_chunk,
};
use super::document::SequenceAttributes;
use super::phase_files::far_outside;
use super::tiles::Tiles;
use super::{Hologram, HologramError, document, foreign, save_phases};
use crate::files::Folder;
use crate::optics::wrap_phase;
use eyebox_base::{Reason, reason};
use std::path::Path;

impl Hologram {
    /// Saves in the format of the file extension. `.zarr` holds the whole hologram, `.npy` its phases alone.
    ///
    /// A hologram at `path` is replaced. Anything else there is refused. The old hologram stays until the new one is
    /// complete and on the disk. Phases are wrapped to [-pi, pi).
    ///
    /// # Errors
    /// Returns [`HologramError::Inconsistent`], [`HologramError::UnknownEnding`], or [`HologramError::File`] with
    /// [`FileError::Full`](crate::files::FileError::Full), [`Taken`](crate::files::FileError::Taken) or
    /// [`Write`](crate::files::FileError::Write). After an error nothing has changed at `path`.
    pub fn save(&self, path: &Path) -> Result<(), HologramError> {
        self.check()?;
        match path.extension().and_then(|e| e.to_str()).map(str::to_lowercase).as_deref() {
            Some("zarr") => self.save_zarr(path),
            Some("npy") => save_phases(self, path),
            _ => Err(HologramError::UnknownEnding { path: path.display().to_string() }),
        }
    }

    fn save_zarr(&self, path: &Path) -> Result<(), HologramError> {
        let draft = draft(path, is_hologram)?;
        draft.write(GROUP, |out| out.write_all(&document::group_at(path, self, None)))?;
        draft.write(ARRAY, |out| out.write_all(&document::array(self.shape(), None)))?;
        for color in 0..self.colors.len() {
            for frame in 0..self.frames {
                draft.write(&chunk_name(color, frame), |out| write_chunk(out, self.frame(color, frame)))?;
            }
        }
        Ok(draft.put()?)
    }

    /// Loads a hologram folder and checks every byte of it. If it is replaced meanwhile, the result is all old or all
    /// new.
    ///
    /// # Errors
    /// - [`HologramError::NotAHologram`] for another content.
    /// - [`HologramError::Damaged`] with the file that is missing, cut short or changed.
    /// - [`HologramError::FileOptics`], [`HologramError::File`], [`HologramError::Unfinished`] and
    ///   [`HologramError::Replaced`].
    pub fn load(path: &Path) -> Result<Self, HologramError> {
        read_whole(path, Self::load_from)
    }

    /// Reads the group's document of a folder. Returns a hologram without phases, the attributes of a sequence, and
    /// true if the document is sealed.
    pub(super) fn describe(folder: &Folder) -> Result<(Self, Option<SequenceAttributes>, bool), HologramError> {
        foreign::check_version(folder)?;
        check_is_one(folder)?;
        let group = read_document(folder, GROUP)?;
        let (mut about, sequence) =
            document::read_any_group(&group).map_err(|e| foreign::of_group(folder, &group, e))?;
        about.metadata.read_at(folder.path());
        Ok((about, sequence, document::is_sealed(&group)))
    }

    /// Sets the sizes of the array of the folder at `path`, and refuses optics that are impossible with them.
    pub(super) fn take_shape(&mut self, path: &Path, shape: [usize; 4]) -> Result<(), HologramError> {
        [_, self.frames, self.height, self.width] = shape;
        for i in 0..self.colors.len() {
            let file = path.join(GROUP).display().to_string();
            self.optics(i).map_err(|source| HologramError::FileOptics { file, source })?;
        }
        Ok(())
    }

    /// Returns true if an array of this shape has as many colors as this hologram, and is not empty.
    pub(super) fn fits(&self, [colors, frames, ..]: [usize; 4]) -> bool {
        colors == self.colors.len() && colors > 0 && frames > 0
    }

    pub(super) fn load_from(folder: &Folder) -> Result<Self, HologramError> {
        let path = folder.path();
        let (mut hologram, sequence, sealed) = Self::describe(folder)?;
        if sequence.is_some() {
            return Err(none(path, Reason::new("is-a-sequence", document::IS_SEQUENCE)));
        }
        let file = path.join(ARRAY);
        let described = read_document(folder, ARRAY)?;
        let array = document::read_array(&described, sealed);
        // Another program's chunks may be sub-frames or have any other shape.
        let foreign =
            !sealed && !document::is_sealed(&described) && !array.as_ref().is_ok_and(|array| array.side.is_none());
        let foreign = foreign.then(|| foreign::Stored::of(folder, &described)).transpose()?;
        let document::Array { shape, side, summed } = match &foreign {
            Some(stored) => document::Array { shape: stored.shape, side: None, summed: false },
            None => array.map_err(|e| damaged(&file, e))?,
        };
        if !(sealed && summed) {
            let path = path.display();
            tracing::debug!("{path}: another program wrote it, with no checksum of its documents or phases to check");
        }
        if side.is_some() {
            let tiles = Tiles::of_folder(folder)?;
            return tiles.unfinished().map_or_else(|| tiles.into_hologram(), |how_far| Err(how_far.refuse(path)));
        }
        if !hologram.fits(shape) {
            let described = hologram.colors.len();
            let reason = reason!("shape", "its shape is {shape:?}, but zarr.json describes {described} colors");
            return Err(damaged(&file, reason));
        }
        hologram.take_shape(path, shape)?;
        // Optics bound the size of a frame. The presence and length of all chunks are checked before any memory is
        // allocated, so that a wrong shape costs nothing.
        if let Some(stored) = foreign {
            for (c, phases) in hologram.colors.iter_mut().zip(stored.read(folder)?) {
                c.phases = phases;
            }
        } else {
            hologram.read_chunks(folder, summed)?;
        }
        let wrong = if sealed { damaged } else { none };
        hologram.check().map_err(|e| wrong(path, Reason::of(&e)))?;
        if !sealed {
            for c in &mut hologram.colors {
                if let Some(found) = far_outside(&c.phases) {
                    return Err(none(path, reason!("no-radians", "{found}, but its phases must be radians")));
                }
                c.phases.iter_mut().for_each(|p| *p = wrap_phase(*p));
            }
        }
        Ok(hologram)
    }

    /// Reads one chunk per color and sub-frame. Their presence and lengths are checked before memory is allocated.
    fn read_chunks(&mut self, folder: &Folder, summed: bool) -> Result<(), HologramError> {
        let (frames, pixels) = (self.frames, self.height * self.width);
        for color in 0..self.colors.len() {
            for frame in 0..frames {
                check_length(folder, &chunk_name(color, frame), pixels, summed)?;
            }
        }
        check_memory(folder.path(), &self.shape())?;
        for (color, c) in self.colors.iter_mut().enumerate() {
            c.phases = vec![0.0; frames * pixels];
            for (frame, phases) in c.phases.chunks_exact_mut(pixels).enumerate() {
                read_chunk(folder, &chunk_name(color, frame), summed, phases)?;
            }
        }
        Ok(())
    }
}
