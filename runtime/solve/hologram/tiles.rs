//! Holograms larger than memory: phases in square tiles on the disk, each with all sub-frames, that are read and written a
//! rectangle at a time.
//!
//! A hologram in the making is a hologram already: tiles that were never written hold the first phases, which are a
//! function of seed and place ([`first_phase`]) and take no room. Beside it lies `progress.json`. A [`commit`](Tiles::commit)
//! replaces any number of tiles and the progress together: new tiles are written to `staged/`, then `progress.json` is
//! replaced, and says which of them count, then they are moved into place. Killed before the middle step the old state
//! stands, after it the new one: [`resume`](Tiles::resume) moves what was left, and removes what does not count. One program
//! at a time makes a hologram, and holds a lock; others may look at it meanwhile ([`open`](Tiles::open)) and change nothing.

mod around;
mod versions;

pub use versions::TileVersion;

use super::chunks::{
    ARRAY, GROUP, LOCK, check_is_one, check_length, check_memory, chunk_file, damaged, draft, is_hologram, is_staged,
    lock, none, open_folder, read_document, read_tile, read_whole, unreadable, unwritable, write_chunk,
};
use super::{Hologram, HologramError, Metadata, document};
use crate::files::{Folder, Kind};
use crate::optics::{Geometry, wrap_phase};
use crate::plan::ModelTables;
use eyebox_base::random::{GOLDEN, mix};
use eyebox_base::{Reason, reason};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::HashMap;
use std::fs::File;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, OnceLock};

const PROGRESS: &str = "progress.json";
const STAGED: &str = "staged";
/// Where the progress is written until it is whole: killed on the way, it leaves this where everything that does not count is
/// removed.
const DRAFT: &str = "staged/.eyebox-progress.part";

/// How far a hologram in the making is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Made {
    /// Parts of the job that are done.
    pub done: u64,
    /// What the job is: a hologram is resumed by the same job alone.
    pub job: Value,
    /// How many parts it has, where that was said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub total: Option<u64>,
    /// Tiles (colour, row, column) that were staged with it.
    pending: Vec<[usize; 3]>,
}

/// A hologram in tiles.
#[derive(Debug)]
pub struct Tiles {
    /// Held open: whatever comes to stand in its place, tiles are of this one.
    folder: Folder,
    about: Hologram,
    side: usize,
    made: Option<Made>,
    /// Held while this program makes the hologram.
    lock: Option<File>,
    read: AtomicU64,
    written: AtomicU64,
    /// Of each colour, what its display does to the light: made when it is first asked for.
    models: OnceLock<Vec<Option<Arc<ModelTables>>>>,
    /// Of one part of its job: where its tiles are. None for each in its place.
    versions: Option<HashMap<[usize; 3], TileVersion>>,
}

/// A rectangle of whole tiles with other phases.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    /// Which of the hologram's colours.
    pub color: usize,
    /// Row and column of its first pixel.
    pub at: [usize; 2],
    /// Rows and columns.
    pub size: [usize; 2],
    /// (sub-frame, row, column), radians.
    pub phases: Vec<f32>,
}

/// The first phase of a pixel: uniform in [-pi, pi), a function of seed and place alone.
pub(crate) fn first_phase(seed: u64, color: usize, frame: usize, row: usize, column: usize) -> f32 {
    // Two rounds of a bijective mixer over what tells pixels apart.
    let plane = mix(seed.wrapping_add(GOLDEN) ^ ((color as u64) << 32 | frame as u64));
    let bits = mix(plane.wrapping_add(((row as u64) << 32 | column as u64).wrapping_mul(GOLDEN)));
    let turns = (bits >> 40) as f32 / (1u64 << 24) as f32 - 0.5;
    wrap_phase(turns * std::f32::consts::TAU)
}

impl Tiles {
    /// A new hologram: what `about` says (its phases are not looked at), in tiles of `side` x `side` pixels, made by a `job`
    /// of `total` parts. One that stands at `path` is replaced.
    ///
    /// # Errors
    /// [`HologramError::Inconsistent`]; [`HologramError::File`].
    pub fn create(path: &Path, about: &Hologram, side: usize, job: Value, total: u64) -> Result<Self, HologramError> {
        let mut side = side.clamp(1, 1 << 14);
        // One tile that is the whole of one sub-frame would be told from no tiles by nothing.
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

    /// A hologram in the making, to go on with; a commit that was cut off is completed or forgotten. A finished one is
    /// opened.
    ///
    /// # Errors
    /// As [`open`](Self::open); [`HologramError::Busy`] where another program makes it.
    pub fn resume(path: &Path) -> Result<Self, HologramError> {
        let tiles = Self::open(path)?;
        // Who was killed at its very end left the lock.
        if tiles.made.is_none() && !tiles.folder.has(LOCK) {
            return Ok(tiles);
        }
        let lock = lock(&tiles.folder)?;
        // Whoever held it a moment ago may have gone on.
        let tiles = Self { lock: Some(lock), ..Self::of_folder(&tiles.folder)? };
        if tiles.made.is_some() {
            tiles.settle()?;
        } else {
            tiles.unlock();
        }
        Ok(tiles)
    }

    /// A hologram in tiles, finished or not, to be looked at.
    ///
    /// # Errors
    /// [`HologramError::NotAHologram`] where it is none in tiles; [`HologramError::Damaged`].
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
            return Err(damaged(&file, reason!("shape", "its shape is {shape:?}, not that of zarr.json")));
        }
        if about.geometry != Geometry::FarField {
            let what = "its shape is that of tiles, which hold far fields, and zarr.json is a relay's";
            return Err(damaged(&file, Reason::new("tiles-of-a-relay", what)));
        }
        // A tile is held as a whole.
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

    /// To be looked at.
    fn looking(folder: Folder, about: Hologram, side: usize, made: Option<Made>) -> Self {
        let (read, written) = (AtomicU64::new(0), AtomicU64::new(0));
        Self { folder, about, side, made, lock: None, read, written, models: OnceLock::new(), versions: None }
    }

    fn unlock(&self) {
        let _ = self.folder.remove(LOCK);
    }

    /// Only one that was created or resumed is written to.
    fn locked(&self) -> Result<(), HologramError> {
        match self.lock {
            Some(_) => Ok(()),
            None => Err(HologramError::Inconsistent(reason!(
                "not-resumed",
                "it was opened to be looked at: resume it to go on with it"
            ))),
        }
    }

    /// Whether a folder is a hologram in tiles.
    pub fn is_tiled(path: &Path) -> bool {
        let document = open_folder(path).and_then(|folder| read_document(&folder, ARRAY));
        document.is_ok_and(|bytes| document::read_array(&bytes, true).is_ok_and(|array| array.side.is_some()))
    }

    /// Everything but the phases.
    pub fn about(&self) -> &Hologram {
        &self.about
    }

    /// Pixels along a tile's side.
    pub fn side(&self) -> usize {
        self.side
    }

    /// How far it is; none where it is finished.
    pub fn made(&self) -> Option<&Made> {
        self.made.as_ref()
    }

    /// Bytes of tiles that were read and written since it was opened.
    pub fn moved(&self) -> [u64; 2] {
        [self.read.load(Relaxed), self.written.load(Relaxed)]
    }

    /// The phases of a rectangle that begins at (row, column): (frames, rows, columns).
    ///
    /// # Errors
    /// [`HologramError::Damaged`]; [`HologramError::File`].
    ///
    /// # Panics
    /// If the rectangle is not inside the hologram: the caller's mistake.
    pub fn read(&self, color: usize, at: [usize; 2], size: [usize; 2]) -> Result<Vec<f32>, HologramError> {
        check_memory(self.folder.path(), &[self.about.frames, size[0], size[1]])?;
        let (mut out, pixels) = (vec![0.0f32; self.about.frames * size[0] * size[1]], size[0] * size[1]);
        assert!(at[0] + size[0] <= self.about.height && at[1] + size[1] <= self.about.width, "inside the hologram");
        // One row of tiles at a time is in memory beside the result.
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

    /// All of it in memory; that every tile of a finished one is there, and as long as it must be, is known before any is read.
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

    /// Replaces the phases of a rectangle of whole tiles, and the progress with them: both or neither, whenever it is cut
    /// off. `phases` is (frames, rows, columns).
    ///
    /// # Errors
    /// [`HologramError::File`], [`FileError::Full`](crate::files::FileError::Full) among it: then what stood there stands there still.
    ///
    /// # Panics
    /// If the rectangle is none of whole tiles, or the phases are not as many: the caller's mistake.
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

    /// A copy of a finished hologram at `path`, described by `metadata`, and these rectangles of whole tiles replaced; it appears
    /// whole or not at all, in the place of this one too. Memory is a tile's.
    ///
    /// # Errors
    /// [`HologramError::Inconsistent`] for one in the making; [`HologramError::File`]; then nothing has changed at `path`.
    ///
    /// # Panics
    /// If a rectangle is none of whole tiles, or its phases are not as many: the caller's mistake.
    pub fn copy(&self, path: &Path, metadata: &Metadata, patches: &[Patch]) -> Result<(), HologramError> {
        if self.made.is_some() {
            return Err(HologramError::Inconsistent(reason!(
                "unfinished",
                "it is still being solved: it is copied when it is finished"
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

    /// The tile of a rectangle of whole tiles, whose phases are (frames, rows, columns): beyond the hologram's edge, zeros.
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

    /// Writes what was never touched, and says that it is finished.
    ///
    /// # Errors
    /// As [`commit`](Self::commit).
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
            // A link in the place of the folder has no file in it.
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
        // Of this name there is none that counts.
        let name = staged_name(done, place);
        let written = self.folder.write(&name, |out| write_chunk(out, tile));
        written.map_err(|e| unwritable(&self.folder, &name, e))?;
        self.written.fetch_add(4 * tile.len() as u64 + 4, Relaxed);
        Ok(())
    }

    /// One tile: (frames, side, side); beyond the hologram's edge, zeros.
    fn tile(&self, color: usize, row: usize, column: usize) -> Result<Vec<f32>, HologramError> {
        let place = [color, row, column];
        if let Some(versions) = &self.versions {
            return self.version(place, versions.get(&place).copied());
        }
        let (name, values) = (self.name(place), self.about.frames * self.side * self.side);
        let has = |name: &str| self.folder.has(name);
        // What counts already and was not moved yet: whoever looks does not move it, and it may be moved meanwhile.
        let staged = self.made.as_ref().filter(|made| made.pending.contains(&place));
        let staged = staged.map(|made| staged_name(made.done, place)).filter(|name| has(name));
        let staged =
            staged.and_then(|name| Some(read_tile(&self.folder, &name, values)).filter(|r| r.is_ok() || has(&name)));
        if staged.is_none() && self.made.is_some() && !has(&name) {
            // Nothing is there, for it was never touched, or because all of the hologram is gone.
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

    /// (colour, row, column) of the tiles that a rectangle touches.
    fn places(&self, color: usize, at: [usize; 2], size: [usize; 2]) -> impl Iterator<Item = [usize; 3]> {
        let [rows, columns] = self.range(at, size);
        rows.flat_map(move |row| columns.clone().map(move |column| [color, row, column]))
    }

    /// Those of all tiles.
    fn all_places(&self) -> impl Iterator<Item = [usize; 3]> {
        let size = [self.about.height, self.about.width];
        (0..self.about.colors.len()).flat_map(move |color| self.places(color, [0, 0], size))
    }

    /// Rows and columns of the tiles that a rectangle touches.
    fn range(&self, at: [usize; 2], size: [usize; 2]) -> [std::ops::Range<usize>; 2] {
        [0, 1].map(|k| at[k] / self.side..(at[k] + size[k]).div_ceil(self.side))
    }
}

/// Where a tile is staged. The commit is part of the name: a tile that the next one had staged when it was cut off must not count for this one.
fn staged_name(done: u64, [color, row, column]: [usize; 3]) -> String {
    format!("{STAGED}/{done}.{color}.{row}.{column}")
}

fn to_json(made: &Made) -> Vec<u8> {
    document::sealed(serde_json::to_value(made).expect("numbers and text"))
}

#[cfg(test)]
#[path = "tiles_tests.rs"]
mod tests;
