//! Stores the tiles of a hologram that several programs make at once.
//!
//! The parts of the job are numbered from 1, in the order in which a single program does them. A part reads each tile
//! as the previous part that changed it left it, even if a later part has changed it since. It writes its own version
//! to `staged/` under its number, or to the tile's place if no later part changes that tile. So a part can be done
//! again, or by two programs at once, and there is no merge step.

use super::super::HologramError;
use super::super::chunks::{own_draft, read_tile, unwritable, write_chunk};
use super::{STAGED, Tiles, staged_name};
use eyebox_base::reason;
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::atomic::Ordering::Relaxed;

/// The version of a tile that a part of the job reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TileVersion {
    /// The tile before any part changed it.
    First,
    /// The tile after this part, which was not the last to change it.
    Of(u64),
    /// The tile after the last part, in its place.
    Last,
}

impl Tiles {
    /// Returns the same hologram for a part of its job, for reading. `versions` lists each tile (color, row, column)
    /// that the part reads. It must not read other tiles.
    pub fn as_found(&self, versions: HashMap<[usize; 3], TileVersion>) -> Self {
        Self { versions: Some(versions), ..self.described(|_| ()) }
    }

    /// Returns true if a part is done.
    pub fn has_part(&self, part: u64) -> bool {
        self.folder.has(&done_name(part))
    }

    /// Writes the result of a part for a rectangle of whole tiles, and marks the part as done. All of it is on the disk
    /// when this returns. `phases` has the axes (frames, rows, columns). `is_last` returns true for the tiles (row,
    /// column) that no later part changes.
    ///
    /// # Errors
    /// Returns [`HologramError::File`] if a file cannot be written.
    ///
    /// # Panics
    /// Panics if the rectangle is not of whole tiles, or the number of phases is wrong, which is a mistake of the
    /// caller.
    pub fn leave(
        &self,
        part: u64,
        color: usize,
        [at, size]: [[usize; 2]; 2],
        phases: &[f32],
        is_last: &(dyn Fn([usize; 2]) -> bool + Sync),
    ) -> Result<(), HologramError> {
        let all: Vec<[usize; 3]> = self.places(color, at, size).collect();
        all.into_par_iter().try_for_each(|place @ [_, row, column]| {
            let name = if is_last([row, column]) { self.name(place) } else { staged_name(part, place) };
            let tile = self.cut(at, size, phases, [row, column]);
            self.written.fetch_add(4 * tile.len() as u64 + 4, Relaxed);
            self.put_staged(&name, &|out| write_chunk(out, &tile))
        })?;
        self.put_staged(&done_name(part), &|_| Ok(()))
    }

    /// Removes the version of a tile after a part. No program reads it again.
    ///
    /// # Errors
    /// Returns [`HologramError::File`] if a file cannot be removed.
    pub fn forget(&self, part: u64, place: [usize; 3]) -> Result<(), HologramError> {
        let name = staged_name(part, place);
        if !self.folder.has(&name) {
            return Ok(());
        }
        self.folder.remove(&name).map_err(|e| unwritable(&self.folder, &name, e))
    }

    /// Returns true if every tile is in its place. Then all parts are done.
    pub fn is_whole(&self) -> bool {
        self.all_places().all(|place| self.folder.has(&self.name(place)))
    }

    fn put_staged(
        &self,
        name: &str,
        fill: &dyn Fn(&mut dyn std::io::Write) -> std::io::Result<()>,
    ) -> Result<(), HologramError> {
        let draft = format!("{STAGED}/{}", own_draft());
        self.folder.replace(&draft, name, fill).map_err(|e| unwritable(&self.folder, name, e))
    }

    pub(super) fn version(&self, place: [usize; 3], version: Option<TileVersion>) -> Result<Vec<f32>, HologramError> {
        let name = match version {
            Some(TileVersion::First) => return Ok(self.first(place)),
            Some(TileVersion::Of(part)) => staged_name(part, place),
            Some(TileVersion::Last) => self.name(place),
            None => {
                let reason =
                    reason!("tile-not-needed", "a part of its job reads the tile {place:?}, which it should not need");
                return Err(HologramError::Inconsistent(reason));
            }
        };
        let values = self.about.frames * self.side * self.side;
        self.read.fetch_add(4 * values as u64 + 4, Relaxed);
        read_tile(&self.folder, &name, values)
    }
}

/// Returns the path of the file that marks a part as done.
fn done_name(part: u64) -> String {
    format!("{STAGED}/{part}")
}
