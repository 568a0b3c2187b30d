//! Bare phases, for other programs: `.npy`, and a folder of 8-bit grey PNGs.
//!
//! `.npy` is float32 radians, (sub-frame, row, column) for one colour and (colour, sub-frame, row, column) for more.
//! A PNG folder has one picture per colour and sub-frame, `green-00.png`, level = round(phase / 2 pi x 256) mod 256;
//! a colour without a name is called by its number, `0-00.png`.

use super::{ColorHologram, Hologram, HologramError, Metadata, level_of_phase, phase_of_level, wrap_phase};
use crate::files::{FileError, FolderDraft, encode_grey8, read_grey8, read_npy, write_npy};
use crate::optics::{Color, Display, Geometry};
use std::{collections::BTreeMap, fs, path::Path};

/// Phases without their optics.
#[derive(Debug, Clone, PartialEq)]
pub struct Phases {
    /// Sub-frames.
    pub frames: usize,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Per colour: its name where the file tells it, and (sub-frame, row, column) radians in [-pi, pi).
    pub colors: Vec<(Option<Color>, Vec<f32>)>,
}

impl Phases {
    /// The hologram that they are for optics given beside them: pitch, focal length and wavelengths in metres, one wavelength
    /// a colour. Its exposures are 1.
    ///
    /// # Errors
    /// [`HologramError::Inconsistent`] for another number of wavelengths, and for optics that cannot be.
    pub fn with_optics(
        self,
        pitch: f64,
        focal_length: f64,
        geometry: Geometry,
        wavelengths: &[f64],
    ) -> Result<Hologram, HologramError> {
        if self.colors.len() != wavelengths.len() {
            let (has, given) = (self.colors.len(), wavelengths.len());
            return Err(HologramError::Inconsistent(format!("it has {has} colours, {given} wavelengths were given")));
        }
        let Self { frames, height, width, colors } = self;
        let colors = (colors.into_iter().zip(wavelengths))
            .map(|((color, phases), &wavelength)| ColorHologram {
                color,
                wavelength,
                exposure: 1.0,
                efficiency: 1.0,
                phases,
            })
            .collect();
        let hologram = Hologram {
            frames,
            height,
            width,
            pitch,
            focal_length,
            geometry,
            colors,
            seed: 0,
            version: String::new(),
            display: String::new(),
            display_wavelengths: Vec::new(),
            scene: String::new(),
            metadata: Metadata::default(),
        };
        hologram.check()?;
        Ok(hologram)
    }

    /// The hologram that they are on a display, in some of its colours; the SLM has as many pixels as they. Exposures are 1.
    ///
    /// # Errors
    /// [`HologramError::Inconsistent`] for another number of colours; [`HologramError::Optics`].
    pub fn on(self, display: &Display, colors: &[Color]) -> Result<Hologram, HologramError> {
        if self.colors.len() != colors.len() {
            let (has, given) = (self.colors.len(), colors.len());
            return Err(HologramError::Inconsistent(format!("it has {has} colours, the display has {given}")));
        }
        let display = Display { height: self.height, width: self.width, ..display.clone() };
        let of = |(&color, (_, phases)): (&Color, (_, Vec<f32>))| {
            let wavelength = display.optics(color)?.wavelength;
            Ok(ColorHologram { color: Some(color), wavelength, exposure: 1.0, efficiency: 1.0, phases })
        };
        let solved = colors.iter().zip(self.colors).map(of).collect::<Result<_, HologramError>>()?;
        let hologram = Hologram::on(&display, self.frames, solved);
        hologram.check()?;
        Ok(hologram)
    }
}

/// Writes phases as `.npy`.
///
/// # Errors
/// [`HologramError::File`].
pub fn save_phases(hologram: &Hologram, file: &Path) -> Result<(), HologramError> {
    let shape = [hologram.colors.len(), hologram.frames, hologram.height, hologram.width];
    let shape = if shape[0] == 1 { &shape[1..] } else { &shape[..] };
    let values: Vec<f32> = hologram.colors.iter().flat_map(|c| c.phases.iter().map(|&p| wrap_phase(p))).collect();
    Ok(write_npy(file, shape, &values)?)
}

/// Reads phases from an `.npy` (any phase is wrapped; (row, column) is one sub-frame) or from a folder of PNGs.
///
/// # Errors
/// [`HologramError::File`]; [`HologramError::NotAHologram`] for an array of other than two to four axes, an empty one,
/// and a folder whose pictures are not one per colour and sub-frame, all of one size.
pub fn load_phases(path: &Path) -> Result<Phases, HologramError> {
    if fs::metadata(path).map_err(|e| FileError::read(path, e))?.is_dir() {
        return load_pngs(path);
    }
    let array = read_npy(path)?;
    if array.integers {
        return Err(none(path, "it holds integers, and phases are floats, in radians".into()));
    }
    let (colors, frames, height, width) = match array.shape[..] {
        [h, w] => (1, 1, h, w),
        [f, h, w] => (1, f, h, w),
        [c, f, h, w] => (c, f, h, w),
        _ => (0, 0, 0, 0),
    };
    if array.values.is_empty() || colors == 0 {
        let reason =
            format!("its shape is {:?}, not (sub-frame, row, column), optionally with colours first", array.shape);
        return Err(none(path, reason));
    }
    let wrap = |part: &[f32]| (None, part.iter().map(|&p| wrap_phase(p)).collect());
    Ok(Phases { frames, height, width, colors: array.values.chunks(frames * height * width).map(wrap).collect() })
}

impl Hologram {
    /// Writes one 8-bit grey PNG per colour and sub-frame into the folder `folder`, which appears whole. A folder of
    /// such pictures is replaced; any other that is not empty is left alone.
    ///
    /// # Errors
    /// [`HologramError::Inconsistent`], [`HologramError::File`].
    pub fn save_pngs(&self, folder: &Path) -> Result<(), HologramError> {
        self.check()?;
        let draft = FolderDraft::new(folder, |there| {
            fs::read_dir(there).is_ok_and(|mut entries| {
                entries.all(|e| e.is_ok_and(|e| e.file_name().to_str().and_then(parse_name).is_some()))
            })
        })?;
        for (i, c) in self.colors.iter().enumerate() {
            for frame in 0..self.frames {
                let levels: Vec<u8> = self.frame(i, frame).iter().map(|&p| level_of_phase(p)).collect();
                let color = c.color.map_or_else(|| i.to_string(), |c| c.to_string());
                let name = format!("{color}-{frame:02}.png");
                draft.write(&name, |out| encode_grey8(out, self.height, self.width, &levels))?;
            }
        }
        Ok(draft.put()?)
    }
}

/// Colours by their name, or by their number: either way in the order of the array.
type Key = (Option<Color>, usize);

fn parse_name(name: &str) -> Option<(Key, usize)> {
    let (color, frame) = name.strip_suffix(".png")?.split_once('-')?;
    let key = match color {
        "red" => (Some(Color::Red), 0),
        "green" => (Some(Color::Green), 0),
        "blue" => (Some(Color::Blue), 0),
        number => (None, number.parse().ok()?),
    };
    Some((key, frame.parse().ok()?))
}

fn load_pngs(folder: &Path) -> Result<Phases, HologramError> {
    let mut found: BTreeMap<Key, BTreeMap<usize, String>> = BTreeMap::new();
    for entry in fs::read_dir(folder).map_err(|e| FileError::read(folder, e))? {
        let name = entry.map_err(|e| FileError::read(folder, e))?.file_name().to_string_lossy().into_owned();
        let Some((key, frame)) = parse_name(&name) else { continue };
        if let Some(other) = found.entry(key).or_default().insert(frame, name.clone()) {
            return Err(none(folder, format!("{other} and {name} are the same sub-frame")));
        }
    }
    let Some(frames) = found.values().map(BTreeMap::len).max() else {
        return Err(none(folder, "it holds no pictures named like green-00.png or 0-00.png".into()));
    };
    let mut size = None;
    let mut colors = Vec::with_capacity(found.len());
    for (&(color, number), pictures) in &found {
        let mut phases = Vec::new();
        for frame in 0..frames {
            let Some(name) = pictures.get(&frame) else {
                let color = color.map_or_else(|| number.to_string(), |c| c.to_string());
                return Err(none(folder, format!("{color}-{frame:02}.png is missing of {frames} sub-frames a colour")));
            };
            let file = folder.join(name);
            let (height, width, levels) = read_grey8(&file)?;
            let (h, w) = *size.get_or_insert((height, width));
            if (h, w) != (height, width) {
                return Err(none(&file, format!("it is {height}x{width} pixels, the others {h}x{w}")));
            }
            phases.extend(levels.into_iter().map(phase_of_level));
        }
        colors.push((color, phases));
    }
    let (height, width) = size.expect("there is at least one picture");
    Ok(Phases { frames, height, width, colors })
}

fn none(path: &Path, reason: String) -> HologramError {
    HologramError::NotAHologram { path: path.display().to_string(), reason }
}
