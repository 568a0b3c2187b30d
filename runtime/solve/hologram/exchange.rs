//! Writes bare phases for other programs, as `.npy` or as a folder of 8-bit gray PNGs.
//!
//! Reading is in `phase_files`. `.npy` is written as float32 radians, (sub-frame, row, column) for one color and
//! (color, sub-frame, row, column) for more. A PNG folder has one picture per color and sub-frame, such as
//! `green-00.png`, with level = round(phase / 2 pi x 256) mod 256. A color without a name is given by its number, as in
//! `0-00.png`.

use super::chunks::none;
use super::{ColorHologram, Hologram, HologramError, Metadata};
use crate::files::{FileError, FolderDraft, encode_png8, holds_only_own, write_listed, write_npy};
use crate::optics::{Color, Display, Geometry, level_of_phase, wrap_phase};
use eyebox_base::{Reason, reason};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// The largest number of sub-frames that a last axis may count. A row of pixels is longer.
const MOST_FRAMES: usize = 64;

/// Phases without their optics.
#[derive(Debug, Clone, PartialEq)]
pub struct Phases {
    /// The path from which they were read.
    pub file: PathBuf,
    /// Number of sub-frames per color.
    pub frames: usize,
    /// Number of rows of pixels.
    pub height: usize,
    /// Number of columns of pixels.
    pub width: usize,
    /// For each color, its name if the file names it, and its phases (sub-frame, row, column) in radians in [-pi, pi).
    pub colors: Vec<(Option<Color>, Vec<f32>)>,
}

/// The unit of the numbers in a file of phases.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PhaseUnit {
    /// The phases are in radians.
    Radians,
    /// The phases are in full turns.
    Turns,
    /// The phases are in degrees.
    Degrees,
    /// Gray levels, with the number of levels in a full turn.
    Levels(f64),
}

impl PhaseUnit {
    /// Returns a full turn in this unit.
    pub(super) fn turn(self) -> f64 {
        match self {
            Self::Radians => TAU,
            Self::Turns => 1.0,
            Self::Degrees => 360.0,
            Self::Levels(levels) => levels,
        }
    }

    /// Returns a value in radians in [-pi, pi).
    pub(super) fn radians(self, value: f32) -> f32 {
        match self {
            Self::Radians => wrap_phase(value),
            unit => wrap_phase(((f64::from(value) / unit.turn()).rem_euclid(1.0) * TAU) as f32),
        }
    }
}

impl Phases {
    /// Returns the hologram for the given pitch, focal length and wavelengths, in meters, with one wavelength per
    /// color. Its exposures are not known.
    ///
    /// # Errors
    /// Returns [`HologramError::NotAHologram`] for another number of wavelengths, and [`HologramError::Inconsistent`]
    /// for impossible optics.
    pub fn with_optics(
        self,
        pitch: f64,
        focal_length: f64,
        geometry: Geometry,
        wavelengths: &[f64],
    ) -> Result<Hologram, HologramError> {
        if self.colors.len() != wavelengths.len() {
            let (has, given) = (self.colors.len(), wavelengths.len());
            let reason = reason!("wavelengths-count", "it has {has} colors, but {given} wavelengths were given");
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

    /// Returns the hologram on a display with as many pixels as the phases. Phases of one color are for `color`, or for
    /// the only color of the display. Phases of several colors are for all colors of the display in its order, and only
    /// `color` is kept if it is given. The exposures are not known.
    ///
    /// # Errors
    /// - [`HologramError::Doubtful`] if nothing determines the colors, and for phases that are rotated against the
    ///   display.
    /// - [`HologramError::NotAHologram`] for colors that the display or the file does not have.
    /// - [`HologramError::Optics`] for impossible optics.
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
                "If its axes are exchanged, give numpy.swapaxes(phases, -1, -2). Otherwise set `size` {h}x{w} to \
                 use it as it is"
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
            return Err(none(&self.file, reason!("no-such-color", "it has no phases of the color {color}")));
        }
        let mut hologram = Hologram::on(&display, self.frames, colors);
        hologram.metadata.exposure_assumed = true;
        hologram.check().map_err(|e| none(&self.file, Reason::of(&e)))?;
        Ok(hologram)
    }

    /// Refuses phases whose last axis counts sub-frames or colors. The display's rows and columns show it, or a number
    /// of sub-frames that is implausible for the few columns.
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
            1 => "If the last axis counts sub-frames, save numpy.moveaxis(phases, -1, 0)".into(),
            _ => format!(
                "If the last axis counts sub-frames and the first {n} colors, save numpy.moveaxis(phases, -1, 1)"
            ),
        };
        Err(HologramError::doubtful(&self.file, found, &decide))
    }

    /// Returns the color of the display for each color of the phases.
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
                        "it has one color and {f} sub-frames, but the display '{name}' has {all}"
                    ),
                    _ => reason!("colors-not-named", "it has {has} colors, but the display '{name}' has {all}"),
                };
                let n = known.len();
                let decide = format!("Choose one with `color`, or give ({n}, sub-frame, {h}, {w}) for all of them");
                Err(HologramError::doubtful(&self.file, found, &decide))
            }
        }
    }
}

impl ColorHologram {
    /// Returns a color whose exposure is not known. Then 1 is as good as any other value.
    pub(crate) fn bare(color: Option<Color>, wavelength: f64, phases: Vec<f32>) -> Self {
        Self { color, wavelength, exposure: 1.0, efficiency: 1.0, phases }
    }
}

/// Writes phases as `.npy`.
///
/// # Errors
/// Returns [`HologramError::File`] if the file cannot be written.
pub fn save_phases(hologram: &Hologram, file: &Path) -> Result<(), HologramError> {
    let shape = hologram.shape();
    let shape = if shape[0] == 1 { &shape[1..] } else { &shape[..] };
    let values: Vec<f32> = hologram.colors.iter().flat_map(|c| c.phases.iter().map(|&p| wrap_phase(p))).collect();
    Ok(write_npy(file, shape, &values)?)
}

impl Hologram {
    /// Writes one 8-bit gray PNG per color and sub-frame, and a list of them, into `folder`, which appears only when
    /// complete. A folder that an earlier call made and nobody changed is replaced. Any other folder that is not empty
    /// is refused.
    ///
    /// # Errors
    /// Returns [`HologramError::Inconsistent`] or [`HologramError::File`].
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
