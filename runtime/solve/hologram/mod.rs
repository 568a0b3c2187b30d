//! The hologram file: phase frames with their metadata, whole, in sequences and in tiles.
//!
//! A [`Hologram`] is what a solve ends in and what everything after it starts from: phases per colour and sub-frame,
//! the optics they are meant for, the exposure they were made with, and what made them. It is kept as a Zarr v3 folder
//! (`store`), which any Zarr library opens; bare phases travel as `.npy` and as grey PNGs (`exchange`).
//!
//! # The folder
//!
//! ```text
//! x.zarr/
//!   zarr.json                 group; attributes.eyebox: optics, exposure, seed, version, what made it
//!   phases/zarr.json          array (colour, sub-frame, row, column), float32, radians in [-pi, pi)
//!   phases/c/0/3/0/0          one chunk: sub-frame 3 of colour 0, little-endian, then its CRC-32C
//! ```
//!
//! Every byte is guarded: chunks by Zarr's own `crc32c` codec, the two documents by `attributes.document_crc32c`, and
//! the chunks that have to be there, and their lengths, follow from the guarded shape. One chunk a sub-frame means that
//! a reader of one sub-frame reads one file. `docs/hologram-format.md` is the full description.
//!
//! A moving scene is a [`Sequence`] of holograms (`sequence`): the same folder with a leading axis, one chunk a hologram,
//! that grows ([`SequenceWriter`], or several programs at once, [`SequenceParts`]) and is played while it does.
//!
//! A hologram larger than memory is stored in square tiles ([`Tiles`]): one chunk a tile, with all sub-frames.
//!
//! The documents and chunks are written here, not by the `zarrs` crate, because its build needs a C library (zlib, for
//! its build script, whatever the features), and building this project needs cargo alone.

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

/// What can be wrong with a hologram or its file.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum HologramError {
    /// Reading or writing failed.
    File(#[from] FileError),
    /// A file of the hologram is missing, cut short or changed.
    #[error("{file}: the hologram is damaged: {reason}; copy it again, or solve it again")]
    Damaged {
        /// The file.
        file: String,
        /// What is wrong with it.
        reason: Reason,
    },
    /// There is something, but no hologram.
    #[error("{path}: is no hologram: {reason}")]
    NotAHologram {
        /// The place.
        path: String,
        /// What is there, and what would be right.
        reason: Reason,
    },
    /// It can be read in more than one way.
    #[error("{path}: {reason}: {decide}")]
    Doubtful {
        /// The place.
        path: String,
        /// What was found.
        reason: Reason,
        /// What decides.
        decide: String,
    },
    /// Numbers that are given as radians and are none.
    #[error(
        "the phases go from {low} to {high}, and are no radians: scale gray levels and turns to them, and wrap large ones in \
         float64, as by numpy.angle(numpy.exp(1j * phases))"
    )]
    NotRadians {
        /// The smallest.
        low: f32,
        /// The largest.
        high: f32,
    },
    /// Phases without optics.
    #[error(
        "{path}: bare phases do not say their optics: give `display` and `color`, or `pitch`, `wavelength` and `focal_length`"
    )]
    NoOptics {
        /// The place.
        path: String,
    },
    /// Phases that memory does not hold.
    Memory(#[from] TooLarge),
    /// An ending that names no format.
    #[error(
        "{path}: the ending says no format that a hologram can be written in: use .zarr (everything), or .npy (phases alone)"
    )]
    UnknownEnding {
        /// The place.
        path: String,
    },
    /// It is being made, by someone else.
    #[error("{path}: another program is solving this hologram: wait for it, or end it and go on from where it was")]
    Busy {
        /// The hologram.
        path: String,
    },
    /// It is still being made, and was not asked for as it is.
    #[error("{path}: it is unfinished: {how_far}: repeat the command that makes it")]
    Unfinished {
        /// The hologram.
        path: String,
        /// How far it is.
        how_far: Unfinished,
    },
    /// It was replaced, or moved, again and again while it was read, or since it was opened.
    #[error("{path}: another program replaced it while it was read: do it again")]
    Replaced {
        /// The hologram.
        path: String,
    },
    /// A hologram that contradicts itself.
    #[error("the hologram cannot be: {0}")]
    Inconsistent(Reason),
    /// A sequence that stands there and is another one than is to be written.
    #[error("{path}: {reason}")]
    OtherSequence {
        /// The place.
        path: String,
        /// How it differs, and what to do.
        reason: Reason,
    },
    /// Its optics cannot be, or have no such colour or pupil.
    Optics(#[from] OpticsError),
    /// The scene that it is compared with.
    Scene(#[from] SceneError),
    /// Its colours are not named, or are not those of its display.
    #[error("its colours are not named, or not those of its display: what it was made for is not known")]
    NoDisplay,
    /// It shows another scene than it is compared with.
    #[error("it shows '{shows}', and '{given}' is another scene: give that one, or set other_scene if it is meant")]
    OtherScene {
        /// The scene that it names.
        shows: String,
        /// The one that was given.
        given: String,
    },
    /// Its scene is not what it was when it was solved.
    #[error(
        "{scene}: it is not what the hologram was solved from{}: give the scene as it was, or set other_scene to take this one",
        why.as_ref().map_or(String::new(), |why| format!(" ({why})"))
    )]
    ChangedScene {
        /// Where it was found.
        scene: String,
        /// Why it cannot be read, if it cannot.
        why: Option<String>,
    },
    /// Its scene is at none of the places where it may be.
    #[error("{scene}: the scene that the hologram was solved from is not there (looked at {looked}): give the scene")]
    SceneNotFound {
        /// The scene as it was named.
        scene: String,
        /// Where it was looked for.
        looked: String,
    },
    /// It has no scene that can be found.
    #[error("{}: give the scene", if *of_array { "it was solved from an array, which no file holds" } else { "it does not say of which scene it is" })]
    NoScene {
        /// Whether it was solved from an array.
        of_array: bool,
    },
    /// The display that it was solved for cannot be found, or is another by now.
    #[error("the display '{display}', which the hologram was solved for: {why}: give the display")]
    DisplayNotFound {
        /// Its name.
        display: String,
        /// Why.
        why: String,
    },
    /// A scene of another size.
    #[error("the scene has {} x {} pixels, and {} x {} are seen of the hologram: load it for the hologram's display", given.0, given.1, shows.0, shows.1)]
    OtherSize {
        /// Rows and columns of the scene.
        given: (usize, usize),
        /// Those of what is seen.
        shows: (usize, usize),
    },
    /// How bright it is meant to be is not known: bare phases do not say.
    #[error("how bright it is meant to be is not known: `fit_exposure` fits it to its scene")]
    NoExposure,
    /// Its file's optics cannot be.
    #[error("{file}: {source}")]
    FileOptics {
        /// The file.
        file: String,
        /// Why.
        source: OpticsError,
    },
}

/// The phases of one colour.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorHologram {
    /// Its colour; none where only a wavelength is known.
    pub color: Option<Color>,
    /// Metres.
    pub wavelength: f64,
    /// One exposure for the whole eyebox (OPTICS 2): multiplies the intensity that an eye receives, relative to a
    /// perfect hologram of full scale.
    pub exposure: f64,
    /// Mean of the scene over the exposure: the share of the light that is aimed at where pupils look (OPTICS 6c).
    pub efficiency: f64,
    /// (sub-frame, row, column), radians in [-pi, pi).
    pub phases: Vec<f32>,
}

/// Phase frames for a display, and what they were made for and by.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Hologram {
    /// Sub-frames of a temporal multiplex.
    pub frames: usize,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Pixel pitch, metres.
    pub pitch: f64,
    /// Focal length of the relay, metres.
    pub focal_length: f64,
    /// Where the SLM stands.
    pub geometry: Geometry,
    /// The colours, one to three as a rule, each with `frames * height * width` phases.
    pub colors: Vec<ColorHologram>,
    /// Seed of the random initial phase and of the pupils drawn.
    pub seed: u64,
    /// Version of eyebox that made it.
    pub version: String,
    /// Name of the display.
    pub display: String,
    /// All wavelengths of the display, solved or not: what the shortest reaches is the eyebox that was served. Empty where
    /// no display is known.
    pub display_wavelengths: Vec<Wavelength>,
    /// What it shows: a path or `builtin:NAME`.
    pub scene: String,
    /// How it was made.
    pub metadata: Metadata,
}

impl Hologram {
    /// On a display, of its size and geometry: `frames` sub-frames of these colours, of no scene and made by nobody.
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

    /// Colours, sub-frames, rows, columns.
    pub fn shape(&self) -> [usize; 4] {
        [self.colors.len(), self.frames, self.height, self.width]
    }

    /// The display that it was made for: of its size and optics, with 256 levels and no encoding. Its eyebox is the one that
    /// pupils were drawn in.
    ///
    /// # Errors
    /// [`HologramError::NoDisplay`].
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
            file: self.metadata.display_file.clone(),
        })
    }

    /// The names of its colours; those that have none are left out.
    pub fn named_colors(&self) -> Vec<Color> {
        self.colors.iter().filter_map(|c| c.color).collect()
    }

    /// The colours, by their places, whose phases a display receives: all of them, or, where they share their sub-frames
    /// ([`JointColor`](crate::optics::JointColor)), the one that drives are meant at, by whose name it takes them.
    pub fn sent_colors(&self) -> Vec<usize> {
        let reference = self.metadata.joint_color.as_ref().and_then(|joint| joint.reference());
        let all = 0..self.colors.len();
        match reference.and_then(|color| all.clone().find(|i| self.colors[*i].color == Some(color))) {
            Some(drive) => vec![drive],
            None => all.collect(),
        }
    }

    /// What a display receives of each of its [sent colours](Self::sent_colors): its phases, or, where colours share their sub-frames, the
    /// drives as phases of one turn.
    pub fn sent_phases(&self) -> Vec<Cow<'_, [f32]>> {
        match self.slopes_of_hidden_drives() {
            Some(slopes) => vec![Cow::Owned(drives_of(&slopes, |color| &self.colors[color].phases))],
            None => self.sent_colors().into_iter().map(|i| Cow::Borrowed(&self.colors[i].phases[..])).collect(),
        }
    }

    /// Turns of each colour's light over all drives, where colours share their sub-frames and the drives are the phases of none of them.
    pub fn slopes_of_hidden_drives(&self) -> Option<Vec<f64>> {
        let lasers = &self.metadata.joint_color.as_ref()?.lasers;
        let slope = |color: &ColorHologram| Some(lasers.get(&color.color?)?.slope);
        let slopes: Vec<f64> = self.colors.iter().map(|color| slope(color).unwrap_or(f64::NAN)).collect();
        Some(slopes).filter(|slopes| !slopes.contains(&1.0))
    }

    /// The optics at colour `index`.
    ///
    /// # Errors
    /// Those of [`Optics::new`].
    pub fn optics(&self, index: usize) -> Result<Optics, OpticsError> {
        let wavelength = self.colors[index].wavelength;
        let optics = Optics::new(self.height, self.width, self.pitch, wavelength, self.focal_length)?;
        let factor = self.metadata.mask.as_ref().map_or(1, |mask| mask.factor);
        Ok(optics.in_geometry(self.geometry).behind_mask(factor))
    }

    /// Share of colour `index`'s field of view that the picture takes along each axis (OPTICS 9): that of the display's
    /// shortest wavelength, or of the hologram's where no display is known.
    pub fn picture_share(&self, index: usize) -> f64 {
        if self.geometry == Geometry::Relay {
            return 1.0;
        }
        let own = self.colors[index].wavelength;
        let known = self.display_wavelengths.iter().map(|w| w.wavelength);
        let shortest = known.chain(self.colors.iter().map(|c| c.wavelength)).fold(own, f64::min);
        shortest / own
    }

    /// Rows and columns of what an eye sees of it.
    pub fn picture_size(&self) -> (usize, usize) {
        self.geometry.picture_size(self.height, self.width)
    }

    /// One sub-frame of one colour, (row, column).
    pub fn frame(&self, color: usize, frame: usize) -> &[f32] {
        let pixels = self.height * self.width;
        &self.colors[color].phases[frame * pixels..(frame + 1) * pixels]
    }

    /// Refuses what no file should hold.
    ///
    /// # Errors
    /// [`HologramError::Inconsistent`].
    pub fn check(&self) -> Result<(), HologramError> {
        let wrong = |reason: Reason| Err(HologramError::Inconsistent(reason));
        let (frames, height, width) = (self.frames, self.height, self.width);
        if self.colors.is_empty() || frames == 0 {
            let count = self.colors.len();
            return wrong(reason!("empty", "it has {count} colours and {frames} sub-frames: at least one each"));
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
            let name = c.color.map_or_else(|| format!("colour {i}"), |c| c.to_string());
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
