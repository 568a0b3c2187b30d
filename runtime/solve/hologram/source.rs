//! Where phases are: in memory, in tiles on the disk, or in a sequence.

use super::tiles::Tiles;
use super::{Hologram, HologramError, Metadata, Sequence};
use crate::optics::{Obstruction, OpticsError, Prescription};
use eyebox_base::error::Reason;
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

/// The phases of a hologram, wherever they are.
#[derive(Debug, Clone)]
pub enum PhaseSource<'a> {
    /// All in memory.
    Whole(Box<Cow<'a, Hologram>>),
    /// In tiles on the disk: those under a pupil are read.
    Tiled(Arc<Tiles>),
}

impl PhaseSource<'_> {
    /// The same, described otherwise.
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

    /// The same on an ideal display lit by a laser on the axis, whatever the one that it was solved for does to the light.
    pub fn on_ideal_display(self) -> Self {
        self.described(|metadata| {
            metadata.model.clear();
            metadata.source.clear();
            metadata.mask = None;
            metadata.picture = Default::default();
        })
    }

    /// The same as another eye sees it, or a perfect one.
    ///
    /// # Errors
    /// [`HologramError::Optics`] for a hologram in tiles, unless the eye is perfect.
    pub fn seen_by(self, eye: Option<Prescription>) -> Result<Self, HologramError> {
        let eye = eye.filter(|eye| !eye.is_perfect());
        match self {
            Self::Tiled(_) if eye.is_some() => {
                let reason = "a hologram in tiles is looked at by a perfect eye only";
                Err(OpticsError::Prescription { reason: Reason::new("eye-of-tiles", reason) }.into())
            }
            Self::Tiled(_) => Ok(self),
            Self::Whole(_) => Ok(self.described(|metadata| metadata.prescription = eye)),
        }
    }

    /// The same as an eye sees it with an obstruction in its pupil, or with a clear one.
    #[must_use]
    pub fn obstructed(self, obstruction: Option<Obstruction>) -> Self {
        // A copy of all phases is not needed.
        if self.about().metadata.obstruction == obstruction {
            return self;
        }
        self.described(|metadata| metadata.obstruction = obstruction)
    }

    /// The hologram at `path`.
    ///
    /// # Errors
    /// [`HologramError::NotAHologram`] for a sequence; [`HologramError::Damaged`]; [`HologramError::File`].
    pub fn open(path: &Path) -> Result<Self, HologramError> {
        if Tiles::is_tiled(path) {
            return Ok(Self::Tiled(Arc::new(Tiles::open(path)?)));
        }
        Ok(Hologram::load(path)?.into())
    }

    /// Everything but the phases, which may be missing here.
    pub fn about(&self) -> &Hologram {
        match self {
            Self::Whole(hologram) => hologram,
            Self::Tiled(tiles) => tiles.about(),
        }
    }
}

impl Hologram {
    /// The hologram at `path`, or hologram `at` of a sequence, with all of its phases.
    ///
    /// # Errors
    /// Those of [`load`](Self::load) and [`Sequence::load`].
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
