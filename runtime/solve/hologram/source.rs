//! Holds phases that are in memory, in tiles on the disk, or in a sequence.

use super::chunks::read_whole;
use super::tiles::Tiles;
use super::{Hologram, HologramError, Metadata, Sequence};
use crate::optics::{Obstruction, OpticsError, Prescription};
use eyebox_base::error::Reason;
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

/// The phases of a hologram, in memory or on the disk.
#[derive(Debug, Clone)]
pub enum PhaseSource<'a> {
    /// All phases are in memory.
    Whole(Box<Cow<'a, Hologram>>),
    /// The phases are in tiles on the disk. Only the tiles under a pupil are read.
    Tiled(Arc<Tiles>),
}

impl PhaseSource<'_> {
    /// Returns the same phases with changed metadata.
    fn described(self, change: impl FnOnce(&mut Metadata)) -> Self {
        match self {
            Self::Whole(hologram) => {
                let mut hologram = hologram.into_owned();
                change(&mut hologram.metadata);
                hologram.into()
            }
            Self::Tiled(tiles) => Self::Tiled(Arc::new(tiles.described(change))),
        }
    }

    /// Returns the same phases on an ideal display lit by a laser on the axis, without the model of their own display.
    pub fn on_ideal_display(self) -> Self {
        self.described(|metadata| {
            metadata.model.clear();
            metadata.source.clear();
            metadata.mask = None;
            metadata.picture = Default::default();
        })
    }

    /// Returns the same phases for another eye, or for a perfect one.
    ///
    /// # Errors
    /// Returns [`HologramError::Optics`] for a hologram in tiles, unless the eye is perfect.
    pub fn seen_by(self, eye: Option<Prescription>) -> Result<Self, HologramError> {
        let eye = eye.filter(|eye| !eye.is_perfect());
        match self {
            Self::Tiled(_) if eye.is_some() => {
                let reason = "a hologram in tiles can be simulated for a perfect eye only";
                Err(OpticsError::Prescription { reason: Reason::new("eye-of-tiles", reason) }.into())
            }
            Self::Tiled(_) => Ok(self),
            Self::Whole(_) => Ok(self.described(|metadata| metadata.prescription = eye)),
        }
    }

    /// Returns the same phases for an eye with an obstruction in its pupil, or with a clear pupil.
    #[must_use]
    pub fn obstructed(self, obstruction: Option<Obstruction>) -> Self {
        // This avoids a copy of all phases.
        if self.about().metadata.obstruction == obstruction {
            return self;
        }
        self.described(|metadata| metadata.obstruction = obstruction)
    }

    /// Opens the hologram at `path`.
    ///
    /// # Errors
    /// Returns [`HologramError::NotAHologram`] for a sequence, [`HologramError::Damaged`] or [`HologramError::File`].
    pub fn open(path: &Path) -> Result<Self, HologramError> {
        // Both are decided in one folder, which another may replace at any time.
        read_whole(path, |folder| match Tiles::are_in(folder) {
            Ok(true) => Ok(Self::Tiled(Arc::new(Tiles::of_folder(folder)?))),
            _ => Ok(Hologram::load_from(folder)?.into()),
        })
    }

    /// Returns everything but the phases, which may be missing here.
    pub fn about(&self) -> &Hologram {
        match self {
            Self::Whole(hologram) => hologram,
            Self::Tiled(tiles) => tiles.about(),
        }
    }
}

impl Hologram {
    /// Loads the hologram at `path`, or hologram `at` of a sequence, with all of its phases.
    ///
    /// # Errors
    /// Returns the errors of [`load`](Self::load) and [`Sequence::load`].
    pub fn load_at(path: &Path, at: Option<u64>) -> Result<Self, HologramError> {
        match at {
            Some(at) => Sequence::open(path)?.load(at),
            None => Self::load(path),
        }
    }
}

impl<'a> From<&'a Hologram> for PhaseSource<'a> {
    fn from(hologram: &'a Hologram) -> Self {
        Self::Whole(Box::new(Cow::Borrowed(hologram)))
    }
}

impl From<Hologram> for PhaseSource<'_> {
    fn from(hologram: Hologram) -> Self {
        Self::Whole(Box::new(Cow::Owned(hologram)))
    }
}
