//! One way to open whatever holds phases: a hologram, one of a sequence, or bare phases with what they do not say; and how far one in the
//! making is.

use super::chunks::{GROUP, none};
use super::{Hologram, HologramError, PhaseSource, PhaseUnit, Phases, Sequence, Tiles, load_phases};
use crate::files::FileError;
use crate::optics::{Color, Display, Geometry};
use eyebox_base::{Reason, reason};
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// What is said beside a file of phases. Where it is a hologram, `bare` and `unit` say nothing.
#[derive(Debug, Clone, Default)]
pub struct Opening {
    /// Which hologram of a sequence, from 0.
    pub at: Option<u64>,
    /// The colour that is taken, and the one that bare phases of one colour are for; none for all.
    pub color: Option<Color>,
    /// The optics of bare phases.
    pub bare: Option<BareOptics>,
    /// What the numbers of bare phases are.
    pub unit: Option<PhaseUnit>,
    /// Whether a sequence, or a hologram in tiles, that is still being made is taken as it is; else it is refused.
    pub unfinished: bool,
}

/// Optics of phases that come without.
#[derive(Debug, Clone)]
pub enum BareOptics {
    /// A display's, which has as many pixels as they.
    Display(Box<Display>),
    /// In metres, one wavelength a colour.
    Values {
        /// Pixel pitch.
        pitch: f64,
        /// Focal length.
        focal_length: f64,
        /// Where the SLM stands.
        geometry: Geometry,
        /// Wavelengths.
        wavelengths: Vec<f64>,
    },
}

impl Opening {
    /// The hologram at `path`, with all of its phases.
    ///
    /// # Errors
    /// Those of [`Hologram::load_at`]; those of [`load_phases`], [`Phases::on`] and [`Phases::with_optics`], and
    /// [`HologramError::NoOptics`]; [`HologramError::NotAHologram`] where it has no part in the colour;
    /// [`HologramError::Unfinished`].
    pub fn hologram(&self, path: &Path) -> Result<Hologram, HologramError> {
        let bare = Phases::are_at(path);
        let mut hologram = if bare { self.bare_hologram(path)? } else { self.whole(path)? };
        if let (Some(color), false) = (self.color, bare) {
            hologram.colors.retain(|c| c.color == Some(color));
            if hologram.colors.is_empty() {
                return Err(none(path, reason!("no-such-color", "it has no {color} part")));
            }
        }
        Ok(hologram)
    }

    /// The same, where phases in tiles stay on the disk.
    ///
    /// # Errors
    /// Those of [`hologram`](Self::hologram) and [`PhaseSource::open`].
    pub fn source(&self, path: &Path) -> Result<PhaseSource<'static>, HologramError> {
        if Phases::are_at(path) || self.at.is_some() {
            return Ok(self.hologram(path)?.into());
        }
        let source = PhaseSource::open(path)?;
        self.allow(path, source.unfinished())?;
        match (source, self.color) {
            (PhaseSource::Whole(_), Some(_)) => Ok(self.hologram(path)?.into()),
            (PhaseSource::Tiled(tiles), Some(color)) if tiles.about().named_colors() != [color] => {
                let what = "it is stored in tiles, all colours of which are read: leave out `color`";
                Err(none(path, Reason::new("color-of-tiles", what)))
            }
            (source, _) => Ok(source),
        }
    }

    /// The sequence at `path`, or what is there as a sequence of one.
    ///
    /// # Errors
    /// Those of [`Sequence::open`] and of [`hologram`](Self::hologram).
    pub fn sequence(&self, path: &Path) -> Result<Sequence, HologramError> {
        // Of tiles all at once: a display shows no part of a hologram.
        if Phases::are_at(path) || Tiles::is_tiled(path) {
            return Ok(Sequence::single(path, self.hologram(path)?));
        }
        let mut sequence = Sequence::open(path)?;
        self.allow(path, sequence.unfinished())?;
        match self.color {
            Some(color) if sequence.about().named_colors() != [color] => {
                if !sequence.is_single() {
                    let what = "all colours of a sequence are shown: leave out `color`";
                    return Err(none(path, Reason::new("color-of-sequence", what)));
                }
                Ok(Sequence::single(path, self.hologram(path)?))
            }
            _ => Ok(sequence),
        }
    }

    /// A hologram with all of its phases, which are not bare.
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
            return no(reason!("not-a-sequence", "bare phases are one hologram, not a sequence: leave out `at`"));
        }
        // What is not there is no phases that lack something.
        if let Err(e) = std::fs::metadata(path) {
            if path.to_string_lossy().starts_with("builtin:") {
                return no(reason!("scene", "it is a scene: a hologram is first solved of it"));
            }
            let with_ending = path.with_added_extension("zarr");
            if with_ending.join(GROUP).exists() {
                return no(reason!("nothing-there", "nothing is there; {} is one", with_ending.display()));
            }
            return Err(FileError::read(path, e).into());
        }
        // A hologram is a folder.
        if path.file_name().is_some_and(|name| name == GROUP) {
            let whole = path.parent().unwrap_or(path).display();
            return no(reason!("file-of-a-hologram", "it is one file of a hologram: give its folder {whole}"));
        }
        // What are no phases lacks more than optics.
        let phases = load_phases(path, self.unit).map_err(|error| match only_hologram_in(path) {
            Some(inside) => {
                none(path, reason!("folder-of-a-hologram", "it is a folder that holds one: {}", inside.display()))
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
    /// Whether there are phases without optics at `path`, or nothing that is a hologram.
    pub fn are_at(path: &Path) -> bool {
        let named = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("zarr"));
        !named && !path.join(GROUP).exists()
    }

    /// Returns whether the array or the folder of pictures at `path` has a name of phases. A folder of pictures with other names
    /// may also be a light field.
    pub fn are_named_at(path: &Path) -> bool {
        path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy")) || super::phase_files::are_named_in(path)
    }
}

/// The hologram in a folder that holds one.
fn only_hologram_in(folder: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path());
    let mut holograms = entries.filter(|path| path.join(GROUP).exists());
    holograms.next().filter(|_| holograms.next().is_none())
}

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
