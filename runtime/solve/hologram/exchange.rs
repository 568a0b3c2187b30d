//! Bare phases, for other programs: `.npy`, and a folder of 8-bit grey PNGs. Reading is in `phase_files`.
//!
//! `.npy` is written as float32 radians, (sub-frame, row, column) for one colour and (colour, sub-frame, row, column) for
//! more.
//! A PNG folder has one picture per colour and sub-frame, `green-00.png`, level = round(phase / 2 pi x 256) mod 256;
//! a colour without a name is called by its number, `0-00.png`.

use super::chunks::none;
use super::{ColorHologram, Hologram, HologramError, Metadata};
use crate::files::{FileError, FolderDraft, encode_png8, holds_only_own, write_listed, write_npy};
use crate::optics::{Color, Display, Geometry, level_of_phase, wrap_phase};
use eyebox_base::{Reason, reason};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Sub-frames that a last axis may count, at most: a row of pixels is longer.
const MOST_FRAMES: usize = 64;

/// Phases without their optics.
#[derive(Debug, Clone, PartialEq)]
pub struct Phases {
    /// Where they were read from.
    pub file: PathBuf,
    /// Sub-frames.
    pub frames: usize,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Per colour: its name where the file tells it, and (sub-frame, row, column) radians in [-pi, pi).
    pub colors: Vec<(Option<Color>, Vec<f32>)>,
}

/// What the numbers of a file of phases mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PhaseUnit {
    /// Radians.
    Radians,
    /// Full turns.
    Turns,
    /// Degrees.
    Degrees,
    /// Levels, so many of which are a full turn.
    Levels(f64),
}

impl PhaseUnit {
    /// A full turn in this unit.
    pub(super) fn turn(self) -> f64 {
        match self {
            Self::Radians => TAU,
            Self::Turns => 1.0,
            Self::Degrees => 360.0,
            Self::Levels(levels) => levels,
        }
    }

    /// Radians in [-pi, pi).
    pub(super) fn radians(self, value: f32) -> f32 {
        match self {
            Self::Radians => wrap_phase(value),
            unit => wrap_phase(((f64::from(value) / unit.turn()).rem_euclid(1.0) * TAU) as f32),
        }
    }
}

impl Phases {
    /// The hologram that they are for optics given beside them: pitch, focal length and wavelengths in metres, one wavelength
    /// a colour. Its exposures are not known.
    ///
    /// # Errors
    /// [`HologramError::NotAHologram`] for another number of wavelengths, [`HologramError::Inconsistent`] for optics that
    /// cannot be.
    pub fn with_optics(
        self,
        pitch: f64,
        focal_length: f64,
        geometry: Geometry,
        wavelengths: &[f64],
    ) -> Result<Hologram, HologramError> {
        if self.colors.len() != wavelengths.len() {
            let (has, given) = (self.colors.len(), wavelengths.len());
            let reason = reason!("wavelengths-count", "it has {has} colours, {given} wavelengths were given");
            return Err(none(&self.file, reason));
        }
        self.check_axes(None)?;
        let Self { frames, height, width, colors, .. } = self;
        let colors = (colors.into_iter().zip(wavelengths))
            .map(|((color, phases), &wavelength)| ColorHologram::bare(color, wavelength, phases))
            .collect();
        let hologram = Hologram {
            frames,
            height,
            width,
            pitch,
            focal_length,
            geometry,
            colors,
            metadata: Metadata { exposure_assumed: true, ..Metadata::default() },
            ..Hologram::default()
        };
        hologram.check().map_err(|e| none(&self.file, Reason::of(&e)))?;
        Ok(hologram)
    }

    /// The hologram that they are on a display, which has as many pixels as they. Phases of one colour are for `color`, or
    /// for the only colour that the display has; of those of several, all of the display's in its order, `color` alone is
    /// taken. Its exposures are not known.
    ///
    /// # Errors
    /// [`HologramError::Doubtful`] where nothing says which colours they are for, and for phases that lie across the
    /// display; [`HologramError::NotAHologram`] for colours that the display, or the file, does not have;
    /// [`HologramError::Optics`].
    pub fn on(self, display: &Display, color: Option<Color>) -> Result<Hologram, HologramError> {
        let names = self.names(display, color)?;
        let [rows, columns] = [display.height, display.width];
        if (self.height, self.width) != (rows, columns) {
            self.check_axes(Some([rows, columns]))?;
        }
        let turned = !display.encoding.rotation_deg.is_multiple_of(180);
        let (height, width) = if turned { (display.width, display.height) } else { (display.height, display.width) };
        if height != width && (self.height, self.width) == (width, height) {
            let (h, w) = (self.height, self.width);
            let found = reason!("across", "its {h} rows and {w} columns lie across the display '{}'", display.name);
            let decide = format!(
                "if its axes are exchanged, give numpy.swapaxes(phases, -1, -2); otherwise `size` {h}x{w} takes it as it is"
            );
            return Err(HologramError::doubtful(&self.file, found, &decide));
        }
        let display = Display { height: self.height, width: self.width, ..display.clone() };
        let of = |(name, (_, phases)): (Color, (_, Vec<f32>))| {
            Ok(ColorHologram::bare(Some(name), display.optics(name)?.wavelength, phases))
        };
        let wanted = names.into_iter().zip(self.colors).filter(|(name, _)| color.is_none_or(|c| c == *name));
        let colors = wanted.map(of).collect::<Result<Vec<_>, HologramError>>()?;
        if let (Some(color), true) = (color, colors.is_empty()) {
            return Err(none(&self.file, reason!("no-such-color", "it has no {color} part")));
        }
        let mut hologram = Hologram::on(&display, self.frames, colors);
        hologram.metadata.exposure_assumed = true;
        hologram.check().map_err(|e| none(&self.file, Reason::of(&e)))?;
        Ok(hologram)
    }

    /// Refuses phases whose last axis counts sub-frames or colors: by the display's rows and columns, or because nobody has so many
    /// sub-frames of so few columns.
    fn check_axes(&self, display: Option<[usize; 2]>) -> Result<(), HologramError> {
        let Self { frames, height, width, colors, .. } = self;
        let is_display = |a: usize, b: usize| display.is_some_and(|[h, w]| (h, w) == (a, b) || (w, h) == (a, b));
        let few = *width <= MOST_FRAMES && *frames >= 2 * width && *height >= 2 * width;
        if is_display(*height, *width) || !(is_display(*frames, *height) || few) {
            return Ok(());
        }
        let found = reason!("sub-frames-last", "it would be {frames} sub-frames of {height}x{width} pixels");
        let n = colors.len();
        let decide = match n {
            1 => "if the last axis counts sub-frames, save numpy.moveaxis(phases, -1, 0)".into(),
            _ => format!(
                "if the last axis counts sub-frames and the first {n} colors, save numpy.moveaxis(phases, -1, 1)"
            ),
        };
        Err(HologramError::doubtful(&self.file, found, &decide))
    }

    /// Which of a display's colours each of theirs is for.
    fn names(&self, display: &Display, color: Option<Color>) -> Result<Vec<Color>, HologramError> {
        let known: Vec<Color> = display.wavelengths.iter().map(|w| w.color).collect();
        let has = self.colors.len();
        let named: Option<Vec<Color>> = self.colors.iter().map(|c| c.0).collect();
        match (named, color) {
            (Some(names), _) => Ok(names),
            (None, Some(color)) if has == 1 => Ok(vec![color]),
            (None, _) if has == known.len() => Ok(known),
            _ => {
                let all = known.iter().map(Color::to_string).collect::<Vec<_>>().join(", ");
                let (name, f, h, w) = (&display.name, self.frames, self.height, self.width);
                let found = match has {
                    1 => reason!(
                        "colors-not-named",
                        "it has one colour, {f} sub-frames, and the display '{name}' has {all}"
                    ),
                    _ => reason!("colors-not-named", "it has {has} colours, and the display '{name}' has {all}"),
                };
                let n = known.len();
                let decide = format!("say which one with `color`, or give ({n}, sub-frame, {h}, {w}) for all of them");
                Err(HologramError::doubtful(&self.file, found, &decide))
            }
        }
    }
}

impl ColorHologram {
    /// Phases of which nobody knows the exposure: 1 is as good as another.
    pub(crate) fn bare(color: Option<Color>, wavelength: f64, phases: Vec<f32>) -> Self {
        Self { color, wavelength, exposure: 1.0, efficiency: 1.0, phases }
    }
}

/// Writes phases as `.npy`.
///
/// # Errors
/// [`HologramError::File`].
pub fn save_phases(hologram: &Hologram, file: &Path) -> Result<(), HologramError> {
    let shape = hologram.shape();
    let shape = if shape[0] == 1 { &shape[1..] } else { &shape[..] };
    let values: Vec<f32> = hologram.colors.iter().flat_map(|c| c.phases.iter().map(|&p| wrap_phase(p))).collect();
    Ok(write_npy(file, shape, &values)?)
}

impl Hologram {
    /// Writes one 8-bit grey PNG per colour and sub-frame into the folder `folder`, which appears whole, and a list of them. A
    /// folder that this made, and nobody changed, is replaced; any other that is not empty is left alone.
    ///
    /// # Errors
    /// [`HologramError::Inconsistent`], [`HologramError::File`].
    pub fn save_pngs(&self, folder: &Path) -> Result<(), HologramError> {
        self.check()?;
        let draft = FolderDraft::new(folder, holds_only_own)?;
        let picture = |(i, frame): (usize, usize)| {
            let levels: Vec<u8> = self.frame(i, frame).iter().map(|&p| level_of_phase(p)).collect();
            let color = self.colors[i].color.map_or_else(|| i.to_string(), |c| c.to_string());
            let (name, mut bytes) = (format!("{color}-{frame:02}.png"), Vec::new());
            let encoded = encode_png8(&mut bytes, self.height, self.width, 1, &levels);
            encoded.map(|()| (name.clone(), bytes)).map_err(|e| FileError::write(&folder.join(name), e))
        };
        let all = (0..self.colors.len()).flat_map(|i| (0..self.frames).map(move |frame| (i, frame)));
        write_listed(&draft, all.map(picture))?;
        Ok(draft.put()?)
    }
}
