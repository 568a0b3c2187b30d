//! Holograms larger than memory: phases in square tiles on the disk, each with all sub-frames, that are read and written a
//! rectangle at a time.
//!
//! A hologram in the making is a hologram already: tiles that were never written hold the first phases, which are a
//! function of seed and place ([`first_phase`]) and take no room. Beside it lies `progress.json`. A [`commit`](Tiles::commit)
//! replaces any number of tiles and the progress together: new tiles are written to `staged/`, then `progress.json` is
//! replaced, and says which of them count, then they are moved into place. Killed before the middle step the old state
//! stands, after it the new one: [`resume`](Tiles::resume) moves what was left, and removes what does not count. One program
//! at a time makes a hologram, and holds a lock; others may look at it meanwhile ([`open`](Tiles::open)) and change nothing.

use super::chunks::{
    ARRAY, GROUP, chunk_file, damaged, is_hologram, is_staged, own_folder, own_way, promise, read_document, read_tile,
    unreadable, write_chunk,
};
use super::{Hologram, HologramError, Metadata, document};
use crate::files::read;
use crate::files::{FileError, FolderDraft, write_file_by_way_of};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fs::{self, File, TryLockError};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

const PROGRESS: &str = "progress.json";
const STAGED: &str = "staged";
const LOCK: &str = "progress.lock";

/// How far a hologram in the making is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Made {
    /// Parts of the job that are done.
    pub done: u64,
    /// What the job is: a hologram is resumed by the same job alone.
    pub job: Value,
    /// Tiles (colour, row, column) that were staged with it.
    pending: Vec<[usize; 3]>,
}

/// A hologram in tiles.
#[derive(Debug)]
pub struct Tiles {
    folder: PathBuf,
    about: Hologram,
    side: usize,
    made: Option<Made>,
    /// Held while this program makes the hologram.
    lock: Option<File>,
    read: AtomicU64,
    written: AtomicU64,
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
    // Two rounds of a bijective mixer (Steele, Lea and Flood 2014) over what tells pixels apart.
    let mix = |z: u64| {
        let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    let plane = mix(seed.wrapping_add(0x9e37_79b9_7f4a_7c15) ^ ((color as u64) << 32 | frame as u64));
    let bits = mix(plane.wrapping_add(((row as u64) << 32 | column as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)));
    let turns = (bits >> 40) as f32 / (1u64 << 24) as f32 - 0.5;
    super::wrap_phase(turns * std::f32::consts::TAU)
}

impl Tiles {
    /// A new hologram: what `about` says (its phases are not looked at), in tiles of `side` x `side` pixels. One that
    /// stands at `path` is replaced.
    ///
    /// # Errors
    /// [`HologramError::Inconsistent`]; [`HologramError::File`].
    pub fn create(path: &Path, about: &Hologram, side: usize, job: Value) -> Result<Self, HologramError> {
        let mut side = side.clamp(1, 1 << 14);
        // One tile that is the whole of one sub-frame would be told from no tiles by nothing.
        if (about.frames, about.height, about.width) == (1, side, side) && side > 1 {
            side = side.div_ceil(2);
        }
        let made = Made { done: 0, job, pending: Vec::new() };
        let draft = FolderDraft::new(path, is_hologram)?;
        let shape = [about.colors.len(), about.frames, about.height, about.width];
        for i in 0..about.colors.len() {
            about.optics(i).map_err(|e| HologramError::Inconsistent(e.to_string()))?;
        }
        draft.write(GROUP, |out| out.write_all(&document::group(about)))?;
        draft.write(ARRAY, |out| out.write_all(&document::array(shape, Some(side))))?;
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
        if tiles.made.is_none() {
            return Ok(tiles);
        }
        let file = path.join(LOCK);
        let lock = File::options().create(true).append(true).open(&file).map_err(|e| FileError::write(&file, e))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(HologramError::Busy { path: path.display().to_string() }),
            // A file system without locks.
            Err(TryLockError::Error(e)) if e.kind() == std::io::ErrorKind::Unsupported => {}
            Err(TryLockError::Error(e)) => return Err(FileError::write(&file, e).into()),
        }
        // Whoever held it a moment ago may have gone on.
        let tiles = Self { lock: Some(lock), ..Self::open(path)? };
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
        let file = path.join(GROUP);
        if !file.exists() {
            let (path, reason) = (path.display().to_string(), "there is no zarr.json".to_owned());
            return Err(HologramError::NotAHologram { path, reason });
        }
        let mut about = document::read_group(&read_document(&file)?).map_err(|e| damaged(&file, e))?;
        let file = path.join(ARRAY);
        let array = document::read_array(&read_document(&file)?, true).map_err(|e| damaged(&file, e))?;
        let (shape, Some(side)) = (array.shape, array.side) else {
            let (path, reason) = (path.display().to_string(), "it is not stored in tiles".to_owned());
            return Err(HologramError::NotAHologram { path, reason });
        };
        let [colors, frames, height, width] = shape;
        if colors != about.colors.len() || colors == 0 || frames == 0 {
            return Err(damaged(&file, format!("its shape is {shape:?}, not that of zarr.json")));
        }
        (about.frames, about.height, about.width) = (frames, height, width);
        // A tile is held as a whole.
        promise(path, &[frames, side, side])?;
        for i in 0..colors {
            let file = path.join(GROUP).display().to_string();
            about.optics(i).map_err(|source| HologramError::FileOptics { file, source })?;
        }
        let file = path.join(PROGRESS);
        let made = if file.exists() {
            let made = document::read_sealed(&read_document(&file)?);
            let made = made.and_then(|value| Made::deserialize(value).map_err(|e| e.to_string()));
            Some(made.map_err(|e| damaged(&file, e))?)
        } else {
            None
        };
        let folder = path.to_path_buf();
        Ok(Self { folder, about, side, made, lock: None, read: AtomicU64::new(0), written: AtomicU64::new(0) })
    }

    fn unlock(&self) {
        let _ = fs::remove_file(self.folder.join(LOCK));
    }

    /// Only one that was created or resumed is written to.
    fn locked(&self) -> Result<(), HologramError> {
        match self.lock {
            Some(_) => Ok(()),
            None => {
                Err(HologramError::Inconsistent("it was opened to be looked at: resume it to go on with it".into()))
            }
        }
    }

    /// Whether a folder is a hologram in tiles.
    pub fn is_tiled(path: &Path) -> bool {
        let document = read_document(&path.join(ARRAY));
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
        promise(&self.folder, &[self.about.frames, size[0], size[1]])?;
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

    /// Replaces the phases of a rectangle of whole tiles, and the progress with them: both or neither, whenever it is cut
    /// off. `phases` is (frames, rows, columns).
    ///
    /// # Errors
    /// [`HologramError::File`], [`FileError::Full`] among it: then what stood there stands there still.
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
        let [rows, columns] = self.range(at, size);
        let pending: Vec<[usize; 3]> =
            rows.flat_map(|row| columns.clone().map(move |column| [color, row, column])).collect();
        own_folder(&self.folder.join(STAGED))?;
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
            return Err(HologramError::Inconsistent(
                "it is still being solved: it is copied when it is finished".into(),
            ));
        }
        let about = Hologram { metadata: metadata.clone(), ..self.about.clone() };
        let draft = FolderDraft::new(path, is_hologram)?;
        let shape = [about.colors.len(), about.frames, about.height, about.width];
        draft.write(GROUP, |out| out.write_all(&document::group(&about)))?;
        draft.write(ARRAY, |out| out.write_all(&document::array(shape, Some(self.side))))?;
        let [rows, columns] = self.range([0, 0], [about.height, about.width]);
        for color in 0..about.colors.len() {
            for (row, column) in rows.clone().flat_map(|r| columns.clone().map(move |c| (r, c))) {
                let name = self.name([color, row, column]);
                let corner = [row, column].map(|i| i * self.side);
                let over = |p: &&Patch| {
                    p.color == color && (0..2).all(|k| (p.at[k]..p.at[k] + p.size[k]).contains(&corner[k]))
                };
                match patches.iter().find(over) {
                    Some(patch) => {
                        let tile = self.cut(patch.at, patch.size, &patch.phases, [row, column]);
                        draft.write(&name, |out| write_chunk(out, &tile))?;
                        self.written.fetch_add(4 * tile.len() as u64 + 4, Relaxed);
                    }
                    None => {
                        let file = self.folder.join(&name);
                        let mut from = read::open(&file).map_err(|e| unreadable(&file, e))?;
                        let copied = |out: &mut dyn std::io::Write| std::io::copy(&mut from, out).map(|_| ());
                        draft.write(&name, copied)?;
                    }
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
                let lacks = |column: &usize| !self.folder.join(self.name([color, row, *column])).exists();
                let pending: Vec<[usize; 3]> = columns.clone().filter(lacks).map(|c| [color, row, c]).collect();
                own_folder(&self.folder.join(STAGED))?;
                pending.par_iter().try_for_each(|&place| self.stage(made.done, place, &self.first(place)))?;
                self.count(made.done, pending)?;
            }
        }
        self.empty_staged()?;
        let _ = fs::remove_dir(self.folder.join(STAGED));
        let file = self.folder.join(PROGRESS);
        fs::remove_file(&file).map_err(|e| FileError::write(&file, e))?;
        self.unlock();
        (self.made, self.lock) = (None, None);
        Ok(())
    }

    /// Makes staged tiles count.
    fn count(&mut self, done: u64, pending: Vec<[usize; 3]>) -> Result<(), HologramError> {
        let job = self.made.as_ref().map_or(Value::Null, |m| m.job.clone());
        let made = Made { done, job, pending };
        // Killed on the way, it leaves its draft where everything that does not count is removed.
        let (drafts, file) = (self.folder.join(STAGED), self.folder.join(PROGRESS));
        write_file_by_way_of(&drafts, &file, |out| out.write_all(&to_json(&made)))?;
        self.made = Some(made);
        self.settle()
    }

    /// Moves the staged tiles that count into place, and removes the others.
    fn settle(&self) -> Result<(), HologramError> {
        let staged = self.folder.join(STAGED);
        let pending = self.made.iter().flat_map(|m| m.pending.iter().map(|place| (m.done, *place)));
        for (done, place) in pending {
            let (from, to) = (staged.join(staged_name(done, place)), self.folder.join(self.name(place)));
            if fs::symlink_metadata(&from).is_ok_and(|there| there.is_file()) {
                own_way(&self.folder, &to)?;
                fs::rename(&from, &to).map_err(|e| FileError::write(&to, e))?;
            }
        }
        self.empty_staged()
    }

    /// Removes staged tiles that do not count, and nothing else.
    fn empty_staged(&self) -> Result<(), HologramError> {
        let staged = self.folder.join(STAGED);
        if !fs::symlink_metadata(&staged).is_ok_and(|there| there.is_dir()) {
            return Ok(());
        }
        for left in fs::read_dir(&staged).into_iter().flatten().flatten() {
            if left.file_name().to_str().is_some_and(is_staged) && left.file_type().is_ok_and(|kind| kind.is_file()) {
                fs::remove_file(left.path()).map_err(|e| FileError::write(&left.path(), e))?;
            }
        }
        Ok(())
    }

    fn stage(&self, done: u64, place: [usize; 3], tile: &[f32]) -> Result<(), HologramError> {
        let file = self.folder.join(STAGED).join(staged_name(done, place));
        let write = || {
            // Of this name there is none that counts; what stands there may be a link.
            let _ = fs::remove_file(&file);
            let mut out = BufWriter::new(File::create_new(&file)?);
            write_chunk(&mut out, tile)?;
            out.into_inner().map_err(std::io::IntoInnerError::into_error)?.sync_all()
        };
        write().map_err(|e| FileError::write(&file, e))?;
        self.written.fetch_add(4 * tile.len() as u64 + 4, Relaxed);
        Ok(())
    }

    /// One tile: (frames, side, side); beyond the hologram's edge, zeros.
    fn tile(&self, color: usize, row: usize, column: usize) -> Result<Vec<f32>, HologramError> {
        let place = [color, row, column];
        let (file, values) = (self.folder.join(self.name(place)), self.about.frames * self.side * self.side);
        // What counts already and was not moved yet: whoever looks does not move it, and it may be moved meanwhile.
        let staged = self.made.as_ref().filter(|made| made.pending.contains(&place));
        let staged = staged.map(|made| self.folder.join(STAGED).join(staged_name(made.done, place)));
        let staged = staged.filter(|file| file.exists()).and_then(|file| read_tile(&file, values).ok());
        if staged.is_none() && !file.exists() && self.made.is_some() {
            return Ok(self.first(place));
        }
        self.read.fetch_add(4 * values as u64 + 4, Relaxed);
        staged.map_or_else(|| read_tile(&file, values), Ok)
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

    /// Rows and columns of the tiles that a rectangle touches.
    fn range(&self, at: [usize; 2], size: [usize; 2]) -> [std::ops::Range<usize>; 2] {
        [0, 1].map(|k| at[k] / self.side..(at[k] + size[k]).div_ceil(self.side))
    }
}

/// The commit is part of the name: a tile that the next one had staged when it was cut off must not count for this one.
fn staged_name(done: u64, [color, row, column]: [usize; 3]) -> String {
    format!("{done}.{color}.{row}.{column}")
}

fn to_json(made: &Made) -> Vec<u8> {
    document::sealed(serde_json::to_value(made).expect("numbers and text"))
}

/// Reads all tiles of one colour of a finished hologram.
pub(super) fn read_all(path: &Path) -> Result<Hologram, HologramError> {
    let tiles = Tiles::open(path)?;
    let mut hologram = tiles.about.clone();
    for color in 0..hologram.colors.len() {
        hologram.colors[color].phases = tiles.read(color, [0, 0], [hologram.height, hologram.width])?;
    }
    Ok(hologram)
}

impl Tiles {
    /// That every tile of a finished hologram is there, and as long as it must be: nothing is read.
    pub(super) fn check(&self) -> Result<(), HologramError> {
        if self.made.is_some() {
            return Ok(());
        }
        let [rows, columns] = self.range([0, 0], [self.about.height, self.about.width]);
        let expected = 4 * (self.about.frames * self.side * self.side) as u64 + 4;
        for color in 0..self.about.colors.len() {
            for (row, column) in rows.clone().flat_map(|r| columns.clone().map(move |c| (r, c))) {
                let file = self.folder.join(self.name([color, row, column]));
                let length = fs::metadata(&file).map_err(|e| unreadable(&file, e))?.len();
                if length != expected {
                    return Err(damaged(&file, format!("it is {length} bytes long, not {expected}")));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
#[path = "tiles_tests.rs"]
mod tests;
