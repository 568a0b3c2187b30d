//! Opens anything that holds phases, such as a hologram, one of a sequence, or bare phases with optics.
//!
//! It also determines how much of an unfinished hologram is done.

use super::chunks::{ARRAY, GROUP, none, read_document, read_whole};
use super::{Hologram, HologramError, PhaseSource, PhaseUnit, Phases, Sequence, Tiles, document, load_phases};
use crate::files::{FileError, Folder};
use crate::optics::{Color, Display, Geometry};
use eyebox_base::{Reason, reason};
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// Settings for opening a file of phases. For a hologram, `bare` and `unit` are ignored.
#[derive(Debug, Clone, Default)]
pub struct Opening {
    /// The index of the hologram in a sequence, from 0.
    pub at: Option<u64>,
    /// The only color that is used, which is also the color of bare phases that have one color. None uses all colors.
    pub color: Option<Color>,
    /// The optics of bare phases.
    pub bare: Option<BareOptics>,
    /// The unit of bare phases.
    pub unit: Option<PhaseUnit>,
    /// True if an unfinished sequence or tiled hologram is accepted. Otherwise it is refused.
    pub unfinished: bool,
}

/// The optics of phases that carry none.
#[derive(Debug, Clone)]
pub enum BareOptics {
    /// The optics of a display that has as many pixels as the phases.
    Display(Box<Display>),
    /// Optics as numbers in meters, with one wavelength per color.
    Values {
        /// Pixel pitch, in meters.
        pitch: f64,
        /// Focal length, in meters.
        focal_length: f64,
        /// The position of the SLM relative to the eyebox.
        geometry: Geometry,
        /// Wavelengths in meters, one per color.
        wavelengths: Vec<f64>,
    },
}

impl Opening {
    /// Returns the hologram at `path` with all of its phases.
    ///
    /// # Errors
    /// Returns the errors of [`Hologram::load_at`], [`load_phases`], [`Phases::on`] and [`Phases::with_optics`]. Also
    /// returns [`HologramError::NoOptics`], [`HologramError::Unfinished`], and [`HologramError::NotAHologram`] if the
    /// hologram has no phases of the color.
    pub fn hologram(&self, path: &Path) -> Result<Hologram, HologramError> {
        let bare = Phases::are_at(path);
        let mut hologram = if bare { self.bare_hologram(path)? } else { self.whole(path)? };
        if let (Some(color), false) = (self.color, bare) {
            hologram.colors.retain(|c| c.color == Some(color));
            if hologram.colors.is_empty() {
                return Err(none(path, reason!("no-such-color", "it has no phases of the color {color}")));
            }
        }
        Ok(hologram)
    }

    /// Returns the phases at `path`. Tiles stay on the disk.
    ///
    /// # Errors
    /// Returns the errors of [`hologram`](Self::hologram) and [`PhaseSource::open`].
    pub fn source(&self, path: &Path) -> Result<PhaseSource<'static>, HologramError> {
        if Phases::are_at(path) || self.at.is_some() {
            return Ok(self.hologram(path)?.into());
        }
        let source = PhaseSource::open(path)?;
        self.allow(path, source.unfinished())?;
        match (source, self.color) {
            (PhaseSource::Whole(_), Some(_)) => Ok(self.hologram(path)?.into()),
            (PhaseSource::Tiled(tiles), Some(color)) if tiles.about().named_colors() != [color] => {
                let what = "it is stored in tiles with all their colors. Leave out `color`";
                Err(none(path, Reason::new("color-of-tiles", what)))
            }
            (source, _) => Ok(source),
        }
    }

    /// Returns the sequence at `path`, or a single hologram as a sequence of one.
    ///
    /// # Errors
    /// Returns the errors of [`Sequence::open`] and of [`hologram`](Self::hologram).
    pub fn sequence(&self, path: &Path) -> Result<Sequence, HologramError> {
        // Tiles are loaded all at once, because a display shows no piece of a hologram.
        if Phases::are_at(path) || Tiles::is_tiled(path) {
            return Ok(Sequence::single(path, self.hologram(path)?));
        }
        let mut sequence = Sequence::open(path)?;
        self.allow(path, sequence.unfinished())?;
        match self.color {
            Some(color) if sequence.about().named_colors() != [color] => {
                if !sequence.is_single() {
                    let what = "all colors of a sequence are shown. Leave out `color`";
                    return Err(none(path, Reason::new("color-of-sequence", what)));
                }
                Ok(Sequence::single(path, self.hologram(path)?))
            }
            _ => Ok(sequence),
        }
    }

    /// Returns a hologram, not bare phases, with all of its phases.
    fn whole(&self, path: &Path) -> Result<Hologram, HologramError> {
        if !self.unfinished {
            self.allow(path, Unfinished::at(path)?)?;
        } else if self.at.is_none() && Tiles::is_tiled(path) {
            return Tiles::open(path)?.into_hologram();
        }
        Hologram::load_at(path, self.at)
    }

    fn allow(&self, path: &Path, unfinished: Option<Unfinished>) -> Result<(), HologramError> {
        unfinished.filter(|_| !self.unfinished).map_or(Ok(()), |how_far| Err(how_far.refuse(path)))
    }

    fn bare_hologram(&self, path: &Path) -> Result<Hologram, HologramError> {
        let no = |reason| Err(none(path, reason));
        if self.at.is_some() {
            return no(reason!("not-a-sequence", "bare phases are one hologram, not a sequence. Leave out `at`"));
        }
        // A missing file is reported as missing, not as phases without optics.
        if let Err(e) = std::fs::metadata(path) {
            if path.to_string_lossy().starts_with("builtin:") {
                return no(reason!("scene", "it is a scene. Solve a hologram of it first"));
            }
            let with_ending = path.with_added_extension("zarr");
            if with_ending.join(GROUP).exists() {
                return no(reason!("nothing-there", "it does not exist, but {} is a hologram", with_ending.display()));
            }
            return Err(FileError::read(path, e).into());
        }
        // A hologram is a folder, so a file inside it is refused with the name of its folder.
        if path.file_name().is_some_and(|name| name == GROUP) {
            let whole = path.parent().unwrap_or(path).display();
            return no(reason!("file-of-a-hologram", "it is one file of a hologram. Give its folder {whole}"));
        }
        // The phases are loaded before missing optics are reported, because a file that holds no phases lacks more than
        // optics.
        let phases = load_phases(path, self.unit).map_err(|error| match only_hologram_in(path) {
            Some(inside) => {
                none(path, reason!("folder-of-a-hologram", "it is a folder with the hologram {}", inside.display()))
            }
            None => error,
        })?;
        let missing = || HologramError::NoOptics { path: path.display().to_string() };
        match self.bare.as_ref().ok_or_else(missing)? {
            BareOptics::Display(display) => phases.on(display, self.color),
            BareOptics::Values { pitch, focal_length, geometry, wavelengths } => {
                phases.with_optics(*pitch, *focal_length, *geometry, wavelengths)
            }
        }
    }
}

impl Phases {
    /// Returns true if `path` holds phases without optics, or anything that is not a hologram.
    pub fn are_at(path: &Path) -> bool {
        let named = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("zarr"));
        !named && !path.join(GROUP).exists()
    }

    /// Returns true if the array or the folder of pictures at `path` has a name of phases. A folder of pictures with
    /// other names may also be a light field.
    pub fn are_named_at(path: &Path) -> bool {
        path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy")) || super::phase_files::are_named_in(path)
    }
}

/// Returns the hologram in a folder that holds exactly one.
fn only_hologram_in(folder: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path());
    let mut holograms = entries.filter(|path| path.join(GROUP).exists());
    holograms.next().filter(|_| holograms.next().is_none())
}

/// The state of a sequence or of a tiled hologram that is unfinished.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Unfinished {
    /// The number of units that are done.
    pub done: u64,
    /// The number of all units, or none if the file does not state it.
    pub total: Option<u64>,
    /// The counted unit, which is `holograms` of a sequence, or `visits` to the regions of a tiled hologram.
    pub unit: &'static str,
}

impl fmt::Display for Unfinished {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let of = self.total.map_or_else(String::new, |total| format!(" of {total}"));
        write!(f, "{}{of} {} are done", self.done, self.unit)
    }
}

impl Unfinished {
    /// Returns the state of the hologram at `path` if it is unfinished. Bare phases are always finished.
    ///
    /// # Errors
    /// Returns the errors of [`Tiles::open`] and [`Sequence::open`].
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
    /// Returns true if a folder is a hologram in tiles. If another replaces it meanwhile, the answer is for the other.
    pub fn is_tiled(path: &Path) -> bool {
        read_whole(path, Self::are_in).unwrap_or(false)
    }

    /// Returns true if an open folder is a hologram in tiles, and the error if its description cannot be read.
    pub(super) fn are_in(folder: &Folder) -> Result<bool, HologramError> {
        let bytes = read_document(folder, ARRAY)?;
        Ok(document::read_array(&bytes, true).is_ok_and(|array| array.side.is_some()))
    }

    /// Returns the state of the work, or none if it is finished.
    pub fn unfinished(&self) -> Option<Unfinished> {
        self.made().map(|made| Unfinished { done: made.done, total: made.total, unit: "visits" })
    }
}

impl PhaseSource<'_> {
    /// Returns the state of a tiled hologram, or none if it is finished.
    pub fn unfinished(&self) -> Option<Unfinished> {
        match self {
            Self::Whole(_) => None,
            Self::Tiled(tiles) => tiles.unfinished(),
        }
    }
}

impl Sequence {
    /// Returns the state of the sequence, or none if it is finished.
    pub fn unfinished(&mut self) -> Option<Unfinished> {
        let how_far = Unfinished { done: self.count(), total: self.planned(), unit: "holograms" };
        (!self.is_complete()).then_some(how_far)
    }
}
