//! Stores holograms larger than memory in square tiles on the disk.
//! Each tile has all sub-frames. Callers read and write one rectangle at a time.
//!
//! An unfinished hologram is a hologram already. Tiles that were never written hold the first phases, which are a
//! function of seed and position ([`first_phase`]) and take no space. The same folder has `progress.json`. A
//! [`commit`](Tiles::commit) replaces any number of tiles and the progress together, in three steps. It writes new
//! tiles to `staged/`. It replaces `progress.json`, which lists the tiles that count. It moves these tiles into place.
//! If the program is killed before the second step, the old state is valid, and after it the new state. Then
//! [`resume`](Tiles::resume) moves the remaining tiles and removes tiles that do not count. One program at a time makes
//! a hologram, and holds a lock. Others may open it meanwhile ([`open`](Tiles::open)) and change nothing.

mod around;
mod versions;

pub use versions::TileVersion;

use super::chunks::{
    ARRAY, GROUP, LOCK, check_is_one, check_length, check_memory, chunk_file, damaged, draft, is_hologram, is_staged,
    lock, none, read_document, read_tile, read_whole, unreadable, unwritable, write_chunk,
};
use super::{Hologram, HologramError, Metadata, document};
use crate::files::{FileLock, Folder, Kind};
use crate::optics::{Geometry, wrap_phase};
use crate::plan::ModelTables;
use eyebox_base::random::{GOLDEN, mix};
use eyebox_base::{Reason, reason};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::HashMap;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, OnceLock};

const PROGRESS: &str = "progress.json";
const STAGED: &str = "staged";
/// The path of incomplete progress. [`Tiles::resume`] removes what a killed program left here.
const DRAFT: &str = "staged/.eyebox-progress.part";

/// The progress of an unfinished hologram.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Made {
    /// Number of parts of the job that are done.
    pub done: u64,
    /// The description of the job. Only the same job may resume a hologram.
    pub job: Value,
    /// Number of parts of the job, if it was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub total: Option<u64>,
    /// Tiles (color, row, column) that were staged with it.
    pending: Vec<[usize; 3]>,
}

/// A hologram that is stored in tiles.
#[derive(Debug)]
pub struct Tiles {
    /// Held open, so that tiles are of this hologram even if its folder is replaced.
    folder: Folder,
    about: Hologram,
    side: usize,
    made: Option<Made>,
    /// Held while this program makes the hologram.
    lock: Option<FileLock>,
    read: AtomicU64,
    written: AtomicU64,
    /// The model of the display for each color, computed at the first request.
    models: OnceLock<Vec<Option<Arc<ModelTables>>>>,
    /// The locations of the tiles for one part of the job. If it is none, each tile is in its place.
    versions: Option<HashMap<[usize; 3], TileVersion>>,
}

/// A rectangle of whole tiles with new phases.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    /// The index of the color in the hologram.
    pub color: usize,
    /// Row and column of its first pixel.
    pub at: [usize; 2],
    /// Number of rows and columns.
    pub size: [usize; 2],
    /// Phases in radians, with the axes (sub-frame, row, column).
    pub phases: Vec<f32>,
}

/// Returns the first phase of a pixel. It is uniform in [-pi, pi) and a function of seed and position alone.
pub(crate) fn first_phase(seed: u64, color: usize, frame: usize, row: usize, column: usize) -> f32 {
    // Two rounds of a bijective mixer, over the numbers that identify a pixel.
    let plane = mix(seed.wrapping_add(GOLDEN) ^ ((color as u64) << 32 | frame as u64));
    let bits = mix(plane.wrapping_add(((row as u64) << 32 | column as u64).wrapping_mul(GOLDEN)));
    let turns = (bits >> 40) as f32 / (1u64 << 24) as f32 - 0.5;
    wrap_phase(turns * std::f32::consts::TAU)
}

impl Tiles {
    /// Creates a hologram with the description `about`, whose phases are ignored, in tiles of `side` x `side` pixels. A
    /// `job` of `total` parts makes it. It replaces a hologram at `path`.
    ///
    /// # Errors
    /// Returns [`HologramError::Inconsistent`] or [`HologramError::File`].
    pub fn create(path: &Path, about: &Hologram, side: usize, job: Value, total: u64) -> Result<Self, HologramError> {
        let mut side = side.clamp(1, 1 << 14);
        // A single tile that holds a whole single sub-frame has the same layout as a hologram without tiles.
        if (about.frames, about.height, about.width) == (1, side, side) && side > 1 {
            side = side.div_ceil(2);
        }
        let made = Made { done: 0, job, total: Some(total), pending: Vec::new() };
        let draft = draft(path, is_hologram)?;
        for i in 0..about.colors.len() {
            about.optics(i).map_err(|e| HologramError::Inconsistent(Reason::of(&e)))?;
        }
        draft.write(GROUP, |out| out.write_all(&document::group_at(path, about, None)))?;
        draft.write(ARRAY, |out| out.write_all(&document::array(about.shape(), Some(side))))?;
        draft.write(PROGRESS, |out| out.write_all(&to_json(&made)))?;
        draft.put()?;
        Self::resume(path)
    }

    /// Opens an unfinished hologram to continue it. An interrupted commit is completed or discarded. A finished
    /// hologram is only opened.
    ///
    /// # Errors
    /// Returns the errors of [`open`](Self::open), and [`HologramError::Busy`] if another program makes it.
    pub fn resume(path: &Path) -> Result<Self, HologramError> {
        let tiles = Self::open(path)?;
        // A program that was killed at its very end left the lock.
        if tiles.made.is_none() && !tiles.folder.has(LOCK) {
            return Ok(tiles);
        }
        let lock = lock(&tiles.folder)?;
        // The previous holder of the lock may have made progress.
        let tiles = Self { lock: Some(lock), ..Self::of_folder(&tiles.folder)? };
        if tiles.made.is_some() {
            tiles.settle()?;
        } else {
            tiles.unlock();
        }
        Ok(tiles)
    }

    /// Opens a hologram in tiles, finished or not, for reading.
    ///
    /// # Errors
    /// Returns [`HologramError::NotAHologram`] for a path without a tiled hologram, and [`HologramError::Damaged`].
    pub fn open(path: &Path) -> Result<Self, HologramError> {
        read_whole(path, Self::of_folder)
    }

    pub(super) fn of_folder(folder: &Folder) -> Result<Self, HologramError> {
        let path = folder.path();
        check_is_one(folder)?;
        let file = path.join(GROUP);
        let mut about = document::read_group(&read_document(folder, GROUP)?).map_err(|e| damaged(&file, e))?;
        about.metadata.read_at(path);
        let file = path.join(ARRAY);
        let array = document::read_array(&read_document(folder, ARRAY)?, true).map_err(|e| damaged(&file, e))?;
        let (shape, Some(side)) = (array.shape, array.side) else {
            return Err(none(path, reason!("not-tiles", "it is not stored in tiles")));
        };
        if !about.fits(shape) {
            return Err(damaged(&file, reason!("shape", "its shape {shape:?} differs from zarr.json")));
        }
        if about.geometry != Geometry::FarField {
            let what = "its shape is for tiles, which hold far fields, but zarr.json is for a relay";
            return Err(damaged(&file, Reason::new("tiles-of-a-relay", what)));
        }
        // A tile is held in memory as a whole.
        check_memory(path, &[shape[1], side, side])?;
        about.take_shape(path, shape)?;
        let made = if folder.has(PROGRESS) {
            let made = document::read_sealed(&read_document(folder, PROGRESS)?);
            let made = made.and_then(|value| Made::deserialize(value).map_err(|e| Reason::new("progress", e)));
            Some(made.map_err(|e| damaged(&path.join(PROGRESS), e))?)
        } else {
            None
        };
        Ok(Self::looking(folder.clone(), about, side, made))
    }

    /// Returns tiles that are open for reading.
    fn looking(folder: Folder, about: Hologram, side: usize, made: Option<Made>) -> Self {
        let (read, written) = (AtomicU64::new(0), AtomicU64::new(0));
        Self { folder, about, side, made, lock: None, read, written, models: OnceLock::new(), versions: None }
    }

    fn unlock(&self) {
        let _ = self.folder.remove(LOCK);
    }

    /// Refuses writing, unless the hologram was created or resumed.
    fn locked(&self) -> Result<(), HologramError> {
        match self.lock {
            Some(_) => Ok(()),
            None => Err(HologramError::Inconsistent(reason!(
                "not-resumed",
                "it is open for reading only. Resume it to continue it"
            ))),
        }
    }

    /// Returns everything but the phases.
    pub fn about(&self) -> &Hologram {
        &self.about
    }

    /// Returns the side of a tile, in pixels.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Returns the progress, or none if the hologram is finished.
    pub fn made(&self) -> Option<&Made> {
        self.made.as_ref()
    }

    /// Returns the bytes of tiles that were read and written since it was opened.
    pub fn moved(&self) -> [u64; 2] {
        [self.read.load(Relaxed), self.written.load(Relaxed)]
    }

    /// Returns the phases of a rectangle that begins at (row, column), with the axes (frames, rows, columns).
    ///
    /// # Errors
    /// Returns [`HologramError::Damaged`] or [`HologramError::File`].
    ///
    /// # Panics
    /// Panics if the rectangle is not inside the hologram, which is a mistake of the caller.
    pub fn read(&self, color: usize, at: [usize; 2], size: [usize; 2]) -> Result<Vec<f32>, HologramError> {
        check_memory(self.folder.path(), &[self.about.frames, size[0], size[1]])?;
        let (mut out, pixels) = (vec![0.0f32; self.about.frames * size[0] * size[1]], size[0] * size[1]);
        assert!(at[0] + size[0] <= self.about.height && at[1] + size[1] <= self.about.width, "inside the hologram");
        // Only one row of tiles at a time is in memory in addition to the result.
        let ([rows, columns], side) = (self.range(at, size), self.side);
        for row in rows {
            let tiles: Vec<Vec<f32>> = columns
                .clone()
                .into_par_iter()
                .map(|column| self.tile(color, row, column))
                .collect::<Result<_, _>>()?;
            let (first, end) = ((row * side).max(at[0]), ((row + 1) * side).min(at[0] + size[0]));
            for (column, tile) in columns.clone().zip(&tiles) {
                let (left, right) = ((column * side).max(at[1]), ((column + 1) * side).min(at[1] + size[1]));
                for frame in 0..self.about.frames {
                    for y in first..end {
                        let from = (frame * side + y - row * side) * side + left - column * side;
                        let to = frame * pixels + (y - at[0]) * size[1] + left - at[1];
                        out[to..to + right - left].copy_from_slice(&tile[from..from + right - left]);
                    }
                }
            }
        }
        Ok(out)
    }

    /// Loads all of it into memory. For a finished hologram, the presence and length of all tiles are checked before
    /// any is read.
    pub(super) fn into_hologram(self) -> Result<Hologram, HologramError> {
        let values = self.about.frames * self.side * self.side;
        for place in self.all_places().filter(|_| self.made.is_none()) {
            check_length(&self.folder, &self.name(place), values, true)?;
        }
        let mut hologram = self.about.clone();
        for (color, of) in hologram.colors.iter_mut().enumerate() {
            of.phases = self.read(color, [0, 0], [self.about.height, self.about.width])?;
        }
        Ok(hologram)
    }

    /// Replaces the phases of a rectangle of whole tiles together with the progress. An interruption leaves both or
    /// neither. `phases` has the axes (frames, rows, columns).
    ///
    /// # Errors
    /// Returns [`HologramError::File`], for example with [`FileError::Full`](crate::files::FileError::Full). Then the
    /// old content remains.
    ///
    /// # Panics
    /// Panics if the rectangle is not of whole tiles, or the number of phases is wrong, which is a mistake of the
    /// caller.
    pub fn commit(
        &mut self,
        done: u64,
        color: usize,
        at: [usize; 2],
        size: [usize; 2],
        phases: &[f32],
    ) -> Result<(), HologramError> {
        self.locked()?;
        let pending: Vec<[usize; 3]> = self.places(color, at, size).collect();
        self.folder.make(STAGED).map_err(|e| unwritable(&self.folder, STAGED, e))?;
        pending.par_iter().try_for_each(|&[color, row, column]| {
            let tile = self.cut(at, size, phases, [row, column]);
            self.stage(done, [color, row, column], &tile)
        })?;
        self.count(done, pending)
    }

    /// Writes a copy of a finished hologram to `path`, with other `metadata` and these rectangles of whole tiles
    /// replaced. The copy appears only when complete, and may replace this hologram. It needs the memory of one tile.
    ///
    /// # Errors
    /// Returns [`HologramError::Inconsistent`] for an unfinished hologram, or [`HologramError::File`]. Then nothing has
    /// changed at `path`.
    ///
    /// # Panics
    /// Panics if a rectangle is not of whole tiles, or its number of phases is wrong, which is a mistake of the caller.
    pub fn copy(&self, path: &Path, metadata: &Metadata, patches: &[Patch]) -> Result<(), HologramError> {
        if self.made.is_some() {
            return Err(HologramError::Inconsistent(reason!(
                "unfinished",
                "it is still being solved. Copy it when it is finished"
            )));
        }
        let about = Hologram { metadata: metadata.clone(), ..self.about.clone() };
        let draft = draft(path, is_hologram)?;
        draft.write(GROUP, |out| out.write_all(&document::group_at(path, &about, None)))?;
        draft.write(ARRAY, |out| out.write_all(&document::array(about.shape(), Some(self.side))))?;
        for place @ [color, row, column] in self.all_places() {
            let name = self.name(place);
            let corner = [row, column].map(|i| i * self.side);
            let over =
                |p: &&Patch| p.color == color && (0..2).all(|k| (p.at[k]..p.at[k] + p.size[k]).contains(&corner[k]));
            match patches.iter().find(over) {
                Some(patch) => {
                    let tile = self.cut(patch.at, patch.size, &patch.phases, [row, column]);
                    draft.write(&name, |out| write_chunk(out, &tile))?;
                    self.written.fetch_add(4 * tile.len() as u64 + 4, Relaxed);
                }
                None => {
                    let mut from = self.folder.file(&name).map_err(|e| unreadable(&self.folder, &name, e))?;
                    let copied = |out: &mut dyn std::io::Write| std::io::copy(&mut from, out).map(|_| ());
                    draft.write(&name, copied)?;
                }
            }
        }
        Ok(draft.put()?)
    }

    /// Returns one tile of a rectangle of whole tiles, whose phases are (frames, rows, columns). It is zero beyond the
    /// hologram's edge.
    fn cut(&self, at: [usize; 2], size: [usize; 2], phases: &[f32], [row, column]: [usize; 2]) -> Vec<f32> {
        let (side, frames, pixels) = (self.side, self.about.frames, size[0] * size[1]);
        let ends = [(at[0] + size[0], self.about.height), (at[1] + size[1], self.about.width)];
        let whole =
            at.iter().all(|v| v.is_multiple_of(side)) && ends.iter().all(|(e, n)| e.is_multiple_of(side) || e == n);
        assert!(whole && phases.len() == frames * pixels, "whole tiles, all of their phases");
        let mut tile = vec![0.0f32; frames * side * side];
        let (high, wide) = (side.min(ends[0].0 - row * side), side.min(ends[1].0 - column * side));
        for frame in 0..frames {
            for y in 0..high {
                let from = frame * pixels + (row * side + y - at[0]) * size[1] + column * side - at[1];
                tile[(frame * side + y) * side..][..wide].copy_from_slice(&phases[from..from + wide]);
            }
        }
        tile
    }

    /// Writes the tiles that were never written, and marks the hologram as finished.
    ///
    /// # Errors
    /// Returns the errors of [`commit`](Self::commit).
    pub fn finish(&mut self) -> Result<(), HologramError> {
        let Some(made) = self.made.clone() else { return Ok(()) };
        self.locked()?;
        let [rows, columns] = self.range([0, 0], [self.about.height, self.about.width]);
        for color in 0..self.about.colors.len() {
            for row in rows.clone() {
                let lacks = |column: &usize| !self.folder.has(&self.name([color, row, *column]));
                let pending: Vec<[usize; 3]> = columns.clone().filter(lacks).map(|c| [color, row, c]).collect();
                self.folder.make(STAGED).map_err(|e| unwritable(&self.folder, STAGED, e))?;
                pending.par_iter().try_for_each(|&place| self.stage(made.done, place, &self.first(place)))?;
                self.count(made.done, pending)?;
            }
        }
        self.empty_staged()?;
        let _ = self.folder.remove_folder(STAGED);
        self.folder.remove(PROGRESS).map_err(|e| unwritable(&self.folder, PROGRESS, e))?;
        self.unlock();
        (self.made, self.lock) = (None, None);
        Ok(())
    }

    /// Makes staged tiles count.
    fn count(&mut self, done: u64, pending: Vec<[usize; 3]>) -> Result<(), HologramError> {
        let (job, total) = self.made.as_ref().map_or((Value::Null, None), |m| (m.job.clone(), m.total));
        let made = Made { done, job, total, pending };
        let written = self.folder.replace(DRAFT, PROGRESS, |out| out.write_all(&to_json(&made)));
        written.map_err(|e| unwritable(&self.folder, PROGRESS, e))?;
        self.made = Some(made);
        self.settle()
    }

    /// Moves the staged tiles that count into place, and removes the others.
    fn settle(&self) -> Result<(), HologramError> {
        let pending = self.made.iter().flat_map(|m| m.pending.iter().map(|place| (m.done, *place)));
        for (done, place) in pending {
            let (from, to) = (staged_name(done, place), self.name(place));
            // A link instead of the folder contains no file.
            if self.folder.file(&from).is_ok() {
                self.folder.rename(&from, &to).map_err(|e| unwritable(&self.folder, &to, e))?;
            }
        }
        self.empty_staged()
    }

    /// Removes staged tiles that do not count, and nothing else.
    fn empty_staged(&self) -> Result<(), HologramError> {
        for (name, kind) in self.folder.entries(STAGED).unwrap_or_default() {
            if let (Some(name), Kind::File) = (name.to_str().filter(|name| is_staged(name)), kind) {
                let name = format!("{STAGED}/{name}");
                self.folder.remove(&name).map_err(|e| unwritable(&self.folder, &name, e))?;
            }
        }
        Ok(())
    }

    fn stage(&self, done: u64, place: [usize; 3], tile: &[f32]) -> Result<(), HologramError> {
        // No tile that counts has this name.
        let name = staged_name(done, place);
        let written = self.folder.write(&name, |out| write_chunk(out, tile));
        written.map_err(|e| unwritable(&self.folder, &name, e))?;
        self.written.fetch_add(4 * tile.len() as u64 + 4, Relaxed);
        Ok(())
    }

    /// Returns one tile with the axes (frames, side, side). It is zero beyond the hologram's edge.
    fn tile(&self, color: usize, row: usize, column: usize) -> Result<Vec<f32>, HologramError> {
        let place = [color, row, column];
        if let Some(versions) = &self.versions {
            return self.version(place, versions.get(&place).copied());
        }
        let (name, values) = (self.name(place), self.about.frames * self.side * self.side);
        let has = |name: &str| self.folder.has(name);
        // A tile may count already without being in its place. A reader does not move it, but its writer may move it
        // meanwhile.
        let staged = self.made.as_ref().filter(|made| made.pending.contains(&place));
        let staged = staged.map(|made| staged_name(made.done, place)).filter(|name| has(name));
        let staged =
            staged.and_then(|name| Some(read_tile(&self.folder, &name, values)).filter(|r| r.is_ok() || has(&name)));
        if staged.is_none() && self.made.is_some() && !has(&name) {
            // The tile is missing because it was never written, or because the whole hologram was replaced.
            return match self.folder.is_replaced() {
                true => Err(HologramError::Replaced { path: self.folder.path().display().to_string() }),
                false => Ok(self.first(place)),
            };
        }
        self.read.fetch_add(4 * values as u64 + 4, Relaxed);
        staged.unwrap_or_else(|| read_tile(&self.folder, &name, values))
    }

    fn first(&self, [color, row, column]: [usize; 3]) -> Vec<f32> {
        let (side, about) = (self.side, &self.about);
        let one = |i: usize| {
            let (frame, y, x) = (i / (side * side), row * side + i / side % side, column * side + i % side);
            let inside = y < about.height && x < about.width;
            if inside { first_phase(about.seed, color, frame, y, x) } else { 0.0 }
        };
        (0..about.frames * side * side).map(one).collect()
    }

    fn name(&self, [color, row, column]: [usize; 3]) -> String {
        chunk_file(color, 0, row, column)
    }

    /// Returns (color, row, column) of the tiles that a rectangle touches.
    fn places(&self, color: usize, at: [usize; 2], size: [usize; 2]) -> impl Iterator<Item = [usize; 3]> {
        let [rows, columns] = self.range(at, size);
        rows.flat_map(move |row| columns.clone().map(move |column| [color, row, column]))
    }

    /// Returns (color, row, column) of all tiles.
    fn all_places(&self) -> impl Iterator<Item = [usize; 3]> {
        let size = [self.about.height, self.about.width];
        (0..self.about.colors.len()).flat_map(move |color| self.places(color, [0, 0], size))
    }

    /// Returns the rows and columns of the tiles that a rectangle touches.
    fn range(&self, at: [usize; 2], size: [usize; 2]) -> [std::ops::Range<usize>; 2] {
        [0, 1].map(|k| at[k] / self.side..(at[k] + size[k]).div_ceil(self.side))
    }
}

/// Returns the path of a staged tile. The number of the commit is in the name, so that a tile which the next commit
/// staged before an interruption does not count for this one.
fn staged_name(done: u64, [color, row, column]: [usize; 3]) -> String {
    format!("{STAGED}/{done}.{color}.{row}.{column}")
}

fn to_json(made: &Made) -> Vec<u8> {
    document::sealed(serde_json::to_value(made).expect("numbers and text"))
}

#[cfg(test)]
#[path = "tiles_tests.rs"]
mod tests;
