//! The hologram file holds phase frames with their metadata, for one hologram, a sequence or tiles.
//!
//! A [`Hologram`] is the result of a solve and the input of everything after it. It holds phases per color and
//! sub-frame, their optics, the exposure of the solve, and the settings and program that made it. It is stored as a
//! Zarr v3 folder (`store`), which any Zarr library opens. Bare phases are exchanged as `.npy` and as gray PNGs
//! (`exchange`).
//!
//! # The folder
//!
//! ```text
//! x.zarr/
//!   zarr.json                 group; attributes.eyebox: optics, exposure, seed, version, settings
//!   phases/zarr.json          array (color, sub-frame, row, column), float32, radians in [-pi, pi)
//!   phases/c/0/3/0/0          one chunk: sub-frame 3 of color 0, little-endian, then its CRC-32C
//! ```
//!
//! A checksum guards every byte: Zarr's own `crc32c` codec guards the chunks, and `attributes.document_crc32c` guards
//! the two documents. The guarded shape determines which chunks must exist, and their lengths. Each sub-frame is one
//! chunk, so a reader of one sub-frame reads one file. `docs/hologram-format.md` is the full description.
//!
//! A moving scene is a [`Sequence`] of holograms (`sequence`). It is the same folder with a leading axis and one chunk
//! per hologram. It can be played while it grows, by one writer ([`SequenceWriter`]) or by several programs at once
//! ([`SequenceParts`]).
//!
//! A hologram larger than memory is stored in square tiles ([`Tiles`]). Each tile is one chunk with all sub-frames.
//!
//! This module writes the documents and chunks itself and does not use the `zarrs` crate. The build of that crate needs
//! a C library (zlib, for its build script, with any features), and this project must build with cargo alone.

mod chunks;
mod display;
mod document;
mod exchange;
mod foreign;
mod metadata;
mod newest;
mod open;
mod phase_files;
mod scene_record;
mod sequence;
mod sequence_writer;
mod source;
mod store;
mod tiles;

#[cfg(test)]
mod damage_tests;
#[cfg(test)]
mod foreign_tests;
#[cfg(test)]
mod old_files_tests;
#[cfg(all(test, target_os = "linux"))]
mod replaced_tests;
#[cfg(test)]
mod sequence_tests;

pub use exchange::{PhaseUnit, Phases, save_phases};
pub use metadata::{Metadata, Refined, Start, TakenWithCamera};
pub use newest::{NewestHologram, OnScreen};
pub use open::{BareOptics, Opening, Unfinished};
pub use phase_files::{check_radians, load_phases};
pub use scene_record::SceneRecord;
pub use sequence::Sequence;
pub use sequence_writer::{SequenceParts, SequenceWriter};
pub use source::PhaseSource;
pub use tiles::{Made, Patch, TileVersion, Tiles};

use crate::memory::TooLarge;
use crate::{
    files::FileError,
    optics::{Color, Display, Geometry, Optics, OpticsError, Wavelength, drives_of},
    scene::SceneError,
};
use eyebox_base::{Reason, reason};
use std::borrow::Cow;

/// An error of a hologram or of its file.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum HologramError {
    /// Reading or writing a file failed.
    File(#[from] FileError),
    /// A file of the hologram is missing, cut short or changed.
    #[error("{file}: the hologram is damaged: {reason}. Copy it again, or solve it again")]
    Damaged {
        /// The path of the file.
        file: String,
        /// The problem of the file.
        reason: Reason,
    },
    /// The path holds something that is not a hologram.
    #[error("{path}: not a hologram: {reason}")]
    NotAHologram {
        /// The path that was opened.
        path: String,
        /// The content that was found, and the content that is needed.
        reason: Reason,
    },
    /// The content can be read in more than one way.
    #[error("{path}: {reason}. {decide}")]
    Doubtful {
        /// The path that was read.
        path: String,
        /// The content that was found.
        reason: Reason,
        /// The setting that decides between the ways.
        decide: String,
    },
    /// Numbers that are given as radians have values that radians do not have.
    #[error(
        "the phases go from {low} to {high} and are not radians. Scale gray levels and turns to radians, and wrap \
         large ones in float64, for example with numpy.angle(numpy.exp(1j * phases))"
    )]
    NotRadians {
        /// The smallest number found.
        low: f32,
        /// The largest number found.
        high: f32,
    },
    /// Bare phases were given without optics.
    #[error(
        "{path}: bare phases have no optics. Give `display` and `color`, or `pitch`, `wavelength` and `focal_length`"
    )]
    NoOptics {
        /// The path of the phases.
        path: String,
    },
    /// The phases do not fit into memory.
    Memory(#[from] TooLarge),
    /// The file extension names no format.
    #[error("{path}: unsupported file extension. Use .zarr for a whole hologram, or .npy for the phases alone")]
    UnknownEnding {
        /// The path that was given.
        path: String,
    },
    /// Another program is solving the hologram now.
    #[error("{path}: another program is solving it. Wait for it, or end it and continue from its last state")]
    Busy {
        /// The path of the hologram.
        path: String,
    },
    /// The hologram is unfinished, and unfinished holograms were not allowed.
    #[error("{path}: it is unfinished ({how_far}). Repeat the command that makes it")]
    Unfinished {
        /// The path of the hologram.
        path: String,
        /// The state of the work.
        how_far: Unfinished,
    },
    /// The file was replaced or moved repeatedly while it was read, or since it was opened.
    #[error("{path}: another program replaced it while it was read. Try again")]
    Replaced {
        /// The path of the hologram.
        path: String,
    },
    /// The fields of a hologram contradict each other.
    #[error("hologram: {0}")]
    Inconsistent(Reason),
    /// The path holds a sequence that differs from the one to be written.
    #[error("{path}: {reason}")]
    OtherSequence {
        /// The path of the sequence.
        path: String,
        /// The difference, and the remedy.
        reason: Reason,
    },
    /// The optics are impossible, or have no such color or pupil.
    Optics(#[from] OpticsError),
    /// The scene of the comparison could not be read.
    Scene(#[from] SceneError),
    /// The colors have no names, or names that the display does not have.
    #[error("its colors have no names, or names that its display does not have. Its display is not known")]
    NoDisplay,
    /// The hologram shows another scene than the one given.
    #[error(
        "it shows '{shows}', and '{given}' is another scene. Give '{shows}', or set other_scene to compare with \
         '{given}'"
    )]
    OtherScene {
        /// The scene that the hologram names.
        shows: String,
        /// The scene that was given.
        given: String,
    },
    /// The content of the scene changed after the solve.
    #[error(
        "{scene}: it changed after the hologram was solved from it{}. Give the scene as it was, or set \
         other_scene to use this one",
        why.as_ref().map_or(String::new(), |why| format!(" ({why})"))
    )]
    ChangedScene {
        /// The path at which the scene was found.
        scene: String,
        /// The reason why the scene cannot be read, if it cannot.
        why: Option<String>,
    },
    /// The scene is at none of its possible paths.
    #[error("{scene}: the scene that the hologram was solved from does not exist (searched {looked}). Give the scene")]
    SceneNotFound {
        /// The scene as it was named.
        scene: String,
        /// The paths that were searched.
        looked: String,
    },
    /// The hologram names no scene that can be found.
    #[error(
        "{}. Give the scene",
        if *of_array { "it was solved from an array, which no file holds" } else { "it names no scene" }
    )]
    NoScene {
        /// True if it was solved from an array.
        of_array: bool,
    },
    /// The display of the solve cannot be found, or has changed since.
    #[error("the display '{display}', for which the hologram was solved: {why}. Give the display")]
    DisplayNotFound {
        /// The name of the display.
        display: String,
        /// The reason why it cannot be used.
        why: String,
    },
    /// The scene has another size than the picture of the hologram.
    #[error(
        "the scene has {} x {} pixels, but the hologram shows {} x {}. Load the scene for the hologram's display",
        given.0,
        given.1,
        shows.0,
        shows.1
    )]
    OtherSize {
        /// Rows and columns of the scene.
        given: (usize, usize),
        /// Rows and columns of the picture that the hologram shows.
        shows: (usize, usize),
    },
    /// The intended brightness is not known, because bare phases carry no exposure.
    #[error("the exposure is not known. Set `fit_exposure` to fit it to the scene")]
    NoExposure,
    /// The optics in a file are impossible.
    #[error("{file}: {source}")]
    FileOptics {
        /// The path of the file.
        file: String,
        /// The error of the optics.
        source: OpticsError,
    },
}

/// The phases of one color of a hologram.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorHologram {
    /// The color. It is none if only the wavelength is given.
    pub color: Option<Color>,
    /// Wavelength of the laser, in meters.
    pub wavelength: f64,
    /// The exposure, one for the whole eyebox (OPTICS 2). It multiplies the intensity that an eye receives, relative to
    /// a perfect hologram of full scale.
    pub exposure: f64,
    /// Mean of the scene over the exposure. It is the share of the light that is aimed at the places of the pupils
    /// (OPTICS 6c).
    pub efficiency: f64,
    /// Phases in radians in [-pi, pi), with the axes (sub-frame, row, column).
    pub phases: Vec<f32>,
}

/// Phase frames for a display, with the settings and optics of their solve.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Hologram {
    /// Number of sub-frames of the temporal multiplex.
    pub frames: usize,
    /// Number of rows of pixels.
    pub height: usize,
    /// Number of columns of pixels.
    pub width: usize,
    /// Pixel pitch, in meters.
    pub pitch: f64,
    /// Focal length of the relay, in meters.
    pub focal_length: f64,
    /// The position of the SLM relative to the eyebox.
    pub geometry: Geometry,
    /// The colors, usually one to three, each with `frames * height * width` phases.
    pub colors: Vec<ColorHologram>,
    /// Seed of the random initial phase and of the random pupils.
    pub seed: u64,
    /// The version of eyebox that made it.
    pub version: String,
    /// Name of the display.
    pub display: String,
    /// All wavelengths of the display, solved or not. The shortest of them determines the eyebox of the solve. It is
    /// empty if the display is not known.
    pub display_wavelengths: Vec<Wavelength>,
    /// The scene that it shows, as a path or `builtin:NAME`.
    pub scene: String,
    /// The settings and circumstances of the solve.
    pub metadata: Metadata,
}

impl Hologram {
    /// Returns a hologram for a display, with its size and geometry and `frames` sub-frames of these colors. It has no
    /// scene and no solve settings.
    pub fn on(display: &Display, frames: usize, colors: Vec<ColorHologram>) -> Self {
        Self {
            frames,
            height: display.height,
            width: display.width,
            pitch: display.pitch,
            focal_length: display.focal_length,
            geometry: display.geometry,
            colors,
            display: display.name.clone(),
            display_wavelengths: display.wavelengths.clone(),
            metadata: Metadata {
                model: display.model.clone(),
                source: display.source.clone(),
                mask: display.mask.clone(),
                sources: display.sources.clone(),
                picture: display.picture,
                prescription: display.prescription.clone(),
                viewing: display.viewing,
                display_file: display.file.clone(),
                ..Metadata::default()
            },
            ..Self::default()
        }
    }

    /// Returns the numbers of colors, sub-frames, rows and columns.
    pub fn shape(&self) -> [usize; 4] {
        [self.colors.len(), self.frames, self.height, self.width]
    }

    /// Returns the display for which it was made, with its size and optics, 256 levels and no encoding. Its eyebox is
    /// the one from which pupils were drawn.
    ///
    /// # Errors
    /// Returns [`HologramError::NoDisplay`] if the colors have no names, or names that the display does not have.
    pub fn made_for(&self) -> Result<Display, HologramError> {
        let known = |color: Color| self.display_wavelengths.iter().any(|w| w.color == color);
        if !self.colors.iter().all(|c| c.color.is_some_and(known)) {
            return Err(HologramError::NoDisplay);
        }
        Ok(Display {
            name: self.display.clone(),
            height: self.height,
            width: self.width,
            pitch: self.pitch,
            focal_length: self.focal_length,
            geometry: self.geometry,
            wavelengths: self.display_wavelengths.clone(),
            levels: 256,
            rate_hz: None,
            portrait: self.height > self.width,
            dispersion: Default::default(),
            encoding: Default::default(),
            model: self.metadata.model.clone(),
            source: self.metadata.source.clone(),
            mask: self.metadata.mask.clone(),
            sources: self.metadata.sources.clone(),
            picture: self.metadata.picture,
            prescription: self.metadata.prescription.clone(),
            viewing: self.metadata.viewing,
            device: None,
            trigger_out: None,
            trigger_in: None,
            file: self.metadata.display_file.clone(),
        })
    }

    /// Returns the names of its colors, without the colors that have none.
    pub fn named_colors(&self) -> Vec<Color> {
        self.colors.iter().filter_map(|c| c.color).collect()
    }

    /// Returns the indices of the colors whose phases a display receives. They are all colors, unless the colors share
    /// their sub-frames ([`JointColor`](crate::optics::JointColor)). Then it is only the reference color, at which
    /// drives are defined and under whose name the display receives them.
    pub fn sent_colors(&self) -> Vec<usize> {
        let reference = self.metadata.joint_color.as_ref().and_then(|joint| joint.reference());
        let all = 0..self.colors.len();
        match reference.and_then(|color| all.clone().find(|i| self.colors[*i].color == Some(color))) {
            Some(drive) => vec![drive],
            None => all.collect(),
        }
    }

    /// Returns the phases that a display receives for each of its [sent colors](Self::sent_colors). If colors share
    /// their sub-frames, these are the drives as phases of one turn.
    pub fn sent_phases(&self) -> Vec<Cow<'_, [f32]>> {
        match self.slopes_of_hidden_drives() {
            Some(slopes) => vec![Cow::Owned(drives_of(&slopes, |color| &self.colors[color].phases))],
            None => self.sent_colors().into_iter().map(|i| Cow::Borrowed(&self.colors[i].phases[..])).collect(),
        }
    }

    /// Returns the turns of each color's light over all drives, if colors share their sub-frames and no color has the
    /// drives as its phases.
    pub fn slopes_of_hidden_drives(&self) -> Option<Vec<f64>> {
        let lasers = &self.metadata.joint_color.as_ref()?.lasers;
        let slope = |color: &ColorHologram| Some(lasers.get(&color.color?)?.slope);
        let slopes: Vec<f64> = self.colors.iter().map(|color| slope(color).unwrap_or(f64::NAN)).collect();
        Some(slopes).filter(|slopes| !slopes.contains(&1.0))
    }

    /// Returns the optics of color `index`.
    ///
    /// # Errors
    /// Returns the errors of [`Optics::new`].
    pub fn optics(&self, index: usize) -> Result<Optics, OpticsError> {
        let wavelength = self.colors[index].wavelength;
        let optics = Optics::new(self.height, self.width, self.pitch, wavelength, self.focal_length)?;
        let factor = self.metadata.mask.as_ref().map_or(1, |mask| mask.factor);
        Ok(optics.in_geometry(self.geometry).behind_mask(factor))
    }

    /// Returns the share of color `index`'s field of view that the picture takes along each axis (OPTICS 9). The
    /// display's shortest wavelength determines it, or the hologram's shortest if the display is not known.
    pub fn picture_share(&self, index: usize) -> f64 {
        if self.geometry == Geometry::Relay {
            return 1.0;
        }
        let own = self.colors[index].wavelength;
        let known = self.display_wavelengths.iter().map(|w| w.wavelength);
        let shortest = known.chain(self.colors.iter().map(|c| c.wavelength)).fold(own, f64::min);
        shortest / own
    }

    /// Returns the rows and columns of the picture that an eye sees of it.
    pub fn picture_size(&self) -> (usize, usize) {
        self.geometry.picture_size(self.height, self.width)
    }

    /// Returns one sub-frame of one color, with the axes (row, column).
    pub fn frame(&self, color: usize, frame: usize) -> &[f32] {
        let pixels = self.height * self.width;
        &self.colors[color].phases[frame * pixels..(frame + 1) * pixels]
    }

    /// Refuses a hologram that no file should hold.
    ///
    /// # Errors
    /// Returns [`HologramError::Inconsistent`] with the first contradiction.
    pub fn check(&self) -> Result<(), HologramError> {
        let wrong = |reason: Reason| Err(HologramError::Inconsistent(reason));
        let (frames, height, width) = (self.frames, self.height, self.width);
        if self.colors.is_empty() || frames == 0 {
            let count = self.colors.len();
            return wrong(reason!("empty", "it needs at least one color and sub-frame, not {count} and {frames}"));
        }
        self.metadata.check()?;
        if let Some(joint) = &self.metadata.joint_color {
            let names: Vec<Option<Color>> = self.colors.iter().map(|c| c.color).collect();
            joint.check(&names, frames).map_err(HologramError::Inconsistent)?;
        }
        for w in &self.display_wavelengths {
            if let Err(e) = Optics::new(height, width, self.pitch, w.wavelength, self.focal_length) {
                return wrong(reason!("display", "its display's {}: {e}", w.color));
            }
        }
        let expected = height.checked_mul(width).and_then(|n| n.checked_mul(frames));
        for (i, c) in self.colors.iter().enumerate() {
            let name = c.color.map_or_else(|| format!("color {i}"), |c| c.to_string());
            if let Err(e) = self.optics(i) {
                return wrong(reason!("optics", "{name}: {e}"));
            }
            if Some(c.phases.len()) != expected {
                let count = c.phases.len();
                return wrong(reason!("phases-count", "{name} has {count} phases, not {frames} x {height} x {width}"));
            }
            if !(c.exposure.is_finite() && c.exposure > 0.0 && c.efficiency.is_finite()) {
                return wrong(reason!(
                    "exposure",
                    "{name} has the exposure {} and the efficiency {}",
                    c.exposure,
                    c.efficiency
                ));
            }
            if let Some(at) = c.phases.iter().position(|p| !p.is_finite()) {
                let (f, row, column) = (at / (height * width), at / width % height, at % width);
                return wrong(reason!(
                    "phase",
                    "{name} has the phase {} at sub-frame {f}, row {row}, column {column}",
                    c.phases[at]
                ));
            }
        }
        Ok(())
    }
}
