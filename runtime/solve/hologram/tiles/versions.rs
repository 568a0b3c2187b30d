//! Tiles of a hologram that several programs make at once. The job's parts are numbered in the order in which one program does
//! them, from 1. A part finds each tile as the part before it that changed this tile left it, whatever has come of it since, and leaves
//! its own beside it: in `staged/` under its number, or in its place where no later part changes that tile. So a part can be done again,
//! or by two at once, and nothing is joined in the end.

use super::super::HologramError;
use super::super::chunks::{own_draft, read_tile, unwritable, write_chunk};
use super::{STAGED, Tiles, staged_name};
use eyebox_base::reason;
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::atomic::Ordering::Relaxed;

/// How a part of the job finds a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TileVersion {
    /// As it was before any part changed it.
    First,
    /// As a part left it, which was not the last to change it.
    Of(u64),
    /// As the last part left it, in its place.
    Last,
}

impl Tiles {
    /// The same hologram as a part of its job finds it, to be read from: (colour, row, column) of each tile that it reads. Other tiles
    /// it must not read.
    pub fn as_found(&self, versions: HashMap<[usize; 3], TileVersion>) -> Self {
        Self { versions: Some(versions), ..self.described(|_| ()) }
    }

    /// Whether a part is done.
    pub fn has_part(&self, part: u64) -> bool {
        self.folder.has(&done_name(part))
    }

    /// Leaves what a part made of a rectangle of whole tiles, and says that it is done: all of it is on the disk when this returns.
    /// `phases` is (frames, rows, columns); `is_last` tells which tiles (row, column) no later part changes.
    ///
    /// # Errors
    /// [`HologramError::File`].
    ///
    /// # Panics
    /// If the rectangle is none of whole tiles, or the phases are not as many: the caller's mistake.
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

    /// Removes a tile as a part left it: nobody will look for it again.
    ///
    /// # Errors
    /// [`HologramError::File`].
    pub fn forget(&self, part: u64, place: [usize; 3]) -> Result<(), HologramError> {
        let name = staged_name(part, place);
        if !self.folder.has(&name) {
            return Ok(());
        }
        self.folder.remove(&name).map_err(|e| unwritable(&self.folder, &name, e))
    }

    /// Whether every tile is in its place: then all parts are done.
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

/// Says that a part is done.
fn done_name(part: u64) -> String {
    format!("{STAGED}/{part}")
}
