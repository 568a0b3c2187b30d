//! How far a hologram in the making is.

use super::{HologramError, PhaseSource, Phases, Sequence, Tiles};
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// How far a sequence, or a hologram in tiles, is that is not finished.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Unfinished {
    /// So many are done,
    pub done: u64,
    /// of so many; none where its file does not say.
    pub total: Option<u64>,
    /// What is counted: `holograms` of a sequence, `visits` to the regions of one in tiles.
    pub unit: &'static str,
}

impl fmt::Display for Unfinished {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let of = self.total.map_or_else(String::new, |total| format!(" of {total}"));
        write!(f, "{}{of} {} are done", self.done, self.unit)
    }
}

impl Unfinished {
    /// What is at `path`, if it is not finished; bare phases are.
    ///
    /// # Errors
    /// Those of [`Tiles::open`] and [`Sequence::open`].
    pub fn at(path: &Path) -> Result<Option<Self>, HologramError> {
        if Phases::are_at(path) {
            return Ok(None);
        }
        if Sequence::is_at(path) {
            return Ok(Sequence::open_quietly(path)?.unfinished());
        }
        if Tiles::is_tiled(path) { Ok(Tiles::open(path)?.unfinished()) } else { Ok(None) }
    }

    pub(super) fn refuse(self, path: &Path) -> HologramError {
        HologramError::Unfinished { path: path.display().to_string(), how_far: self }
    }
}

impl Tiles {
    /// How far it is; none where it is finished.
    pub fn unfinished(&self) -> Option<Unfinished> {
        self.made().map(|made| Unfinished { done: made.done, total: made.total, unit: "visits" })
    }
}

impl PhaseSource<'_> {
    /// How far a hologram in tiles is; none where it is finished.
    pub fn unfinished(&self) -> Option<Unfinished> {
        match self {
            Self::Whole(_) => None,
            Self::Tiled(tiles) => tiles.unfinished(),
        }
    }
}

impl Sequence {
    /// How far it is; none where it is finished.
    pub fn unfinished(&mut self) -> Option<Unfinished> {
        let how_far = Unfinished { done: self.count(), total: self.planned(), unit: "holograms" };
        (!self.is_complete()).then_some(how_far)
    }
}
