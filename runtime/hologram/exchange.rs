//! Bare phases, for other programs: `.npy`, and a folder of 8-bit grey PNGs.
//!
//! `.npy` is written as float32 radians, (sub-frame, row, column) for one colour and (colour, sub-frame, row, column) for
//! more; floats and integers in any [`PhaseUnit`] are read.
//! A PNG folder has one picture per colour and sub-frame, `green-00.png`, level = round(phase / 2 pi x 256) mod 256;
//! a colour without a name is called by its number, `0-00.png`.

use super::chunks::{read_whole, unreadable};
use super::{ColorHologram, Hologram, HologramError, Metadata, level_of_phase, phase_of_level, wrap_phase};
use crate::files::{
    FileError, Folder, FolderDraft, Npy, encode_grey8, holds_only_own, read_grey8, read_npy, write_listed, write_npy,
};
use crate::optics::{Color, Display, Geometry};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fs;
use std::path::{Path, PathBuf};

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
    fn turn(self) -> f64 {
        match self {
            Self::Radians => TAU,
            Self::Turns => 1.0,
            Self::Degrees => 360.0,
            Self::Levels(levels) => levels,
        }
    }

    /// Radians in [-pi, pi).
    fn radians(self, value: f32) -> f32 {
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
            return Err(none(&self.file, format!("it has {has} colours, {given} wavelengths were given")));
        }
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
            seed: 0,
            version: String::new(),
            display: String::new(),
            display_wavelengths: Vec::new(),
            scene: String::new(),
            metadata: Metadata { exposure_assumed: true, ..Metadata::default() },
        };
        hologram.check().map_err(|e| none(&self.file, e.to_string()))?;
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
        let turned = !display.encoding.rotation_deg.is_multiple_of(180);
        let (height, width) = if turned { (display.width, display.height) } else { (display.height, display.width) };
        if height != width && (self.height, self.width) == (width, height) {
            let (h, w) = (self.height, self.width);
            let found = format!("its {h} rows and {w} columns lie across the display '{}'", display.name);
            let decide = format!("give (row, column) = ({height}, {width}), or --size {height}x{width} as it is meant");
            return Err(HologramError::doubtful(&self.file, found, &decide));
        }
        let display = Display { height: self.height, width: self.width, ..display.clone() };
        let of = |(name, (_, phases)): (Color, (_, Vec<f32>))| {
            Ok(ColorHologram::bare(Some(name), display.optics(name)?.wavelength, phases))
        };
        let wanted = names.into_iter().zip(self.colors).filter(|(name, _)| color.is_none_or(|c| c == *name));
        let colors = wanted.map(of).collect::<Result<Vec<_>, HologramError>>()?;
        if let (Some(color), true) = (color, colors.is_empty()) {
            return Err(none(&self.file, format!("it has no {color} part")));
        }
        let mut hologram = Hologram::on(&display, self.frames, colors);
        hologram.metadata.exposure_assumed = true;
        hologram.check().map_err(|e| none(&self.file, e.to_string()))?;
        Ok(hologram)
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
                    1 => format!("it has one colour, {f} sub-frames, and the display '{name}' has {all}"),
                    _ => format!("it has {has} colours, and the display '{name}' has {all}"),
                };
                let n = known.len();
                let decide = format!("say which one with --color, or give ({n}, sub-frame, {h}, {w}) for all of them");
                Err(HologramError::doubtful(&self.file, found, &decide))
            }
        }
    }
}

impl ColorHologram {
    /// Phases of which nobody knows the exposure: 1 is as good as another.
    fn bare(color: Option<Color>, wavelength: f64, phases: Vec<f32>) -> Self {
        Self { color, wavelength, exposure: 1.0, efficiency: 1.0, phases }
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

/// Reads phases from an `.npy` (any phase is wrapped; (row, column) is one sub-frame) or from a folder of PNGs. Numbers mean
/// what `unit` says; without it radians in an `.npy`, where they can be that, and 256 levels a turn in pictures.
///
/// # Errors
/// [`HologramError::File`]; [`HologramError::NotAHologram`] for an array of other than two to four axes, an empty one,
/// one whose last axis is no row of pixels, and a folder whose pictures are not one per colour and sub-frame, all of one
/// size; [`HologramError::Doubtful`] for numbers that may well be something else than radians.
pub fn load_phases(path: &Path, unit: Option<PhaseUnit>) -> Result<Phases, HologramError> {
    if unit.is_some_and(|u| !(u.turn() > 0.0 && u.turn().is_finite())) {
        return Err(none(path, "a turn must have a positive number of levels".into()));
    }
    if fs::metadata(path).map_err(|e| FileError::read(path, e))?.is_dir() {
        return read_whole(path, |folder| load_pngs(folder, unit));
    }
    let ending = path.extension().map(|e| e.to_ascii_lowercase());
    if ending.is_some_and(|e| ["png", "bmp", "jpg", "jpeg"].iter().any(|picture| e == *picture)) {
        let lacks = "a picture by itself does not say its colour and sub-frame: a folder of pictures named like green-00.png does";
        return Err(none(path, lacks.into()));
    }
    let array = read_npy(path)?;
    let (colors, frames, height, width) = match array.shape[..] {
        [h, w] => (1, 1, h, w),
        [f, h, w] => (1, f, h, w),
        [c, f, h, w] => (c, f, h, w),
        _ => (0, 0, 0, 0),
    };
    let wrong = |why: &str| {
        let shape = &array.shape;
        let right = "(row, column), (sub-frame, row, column) or (colour, sub-frame, row, column)";
        Err(none(path, format!("its shape is {shape:?}{why}, not {right}")))
    };
    if array.values.is_empty() || colors == 0 {
        return wrong("");
    }
    if array.shape.len() > 2 && width <= 4 && height >= 4 * width {
        return wrong(", as if colours or sub-frames came last");
    }
    let unit = match unit {
        Some(unit) => unit,
        None => match doubt(&array) {
            Some(found) => return Err(HologramError::doubtful(path, found, UNITS)),
            None => PhaseUnit::Radians,
        },
    };
    let wrap = |part: &[f32]| (None, part.iter().map(|&p| unit.radians(p)).collect());
    let colors = array.values.chunks(frames * height * width).map(wrap).collect();
    Ok(Phases { file: path.into(), frames, height, width, colors })
}

/// What decides.
const UNITS: &str =
    "say what its numbers are with --phase-unit: rad, turns, deg, or how many levels are a turn, such as 256";
/// Turns beyond which numbers are hardly radians: levels, degrees.
const MANY_TURNS: f32 = 8.0;

fn ends(values: &[f32]) -> [f32; 2] {
    values.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], &v| [l.min(v), h.max(v)])
}

/// Radians beyond which float32 keeps less than a hundredth of a turn.
const MOST_RADIANS: f32 = 1e5;

/// Refuses numbers that a program gives as radians and that are none: so large that nothing of a turn is left of them, or
/// gray levels, which are whole numbers beyond a turn.
///
/// # Errors
/// [`HologramError::NotRadians`].
pub fn check_radians(phases: &[f32]) -> Result<(), HologramError> {
    let [low, high] = ends(phases);
    let most = low.abs().max(high.abs());
    let are_levels = || high > low && most > TAU as f32 && phases.iter().all(|p| p.fract() == 0.0);
    if most > MOST_RADIANS || are_levels() { Err(HologramError::NotRadians { low, high }) } else { Ok(()) }
}

/// Numbers that are hardly radians.
pub(super) fn far_outside(values: &[f32]) -> Option<String> {
    let [low, high] = ends(values);
    let far = low.abs().max(high.abs()) > MANY_TURNS * TAU as f32;
    far.then(|| format!("its values go from {low} to {high}, far outside a turn in radians"))
}

/// Why an array's numbers may not be radians.
fn doubt(array: &Npy) -> Option<String> {
    let (values, [low, high]) = (&array.values, ends(&array.values));
    let from = format!("from {low} to {high}");
    if array.integers || (high > low && values.iter().all(|v| v.fract() == 0.0)) {
        return Some(format!("it holds whole numbers {from}"));
    }
    if let Some(found) = far_outside(values) {
        return Some(found);
    }
    let fills = |a: f32, b: f32| low >= a && high <= b && high - low > 0.9 * (b - a) && values.len() >= 64;
    (fills(0.0, 1.0) || fills(-0.5, 0.5)).then(|| format!("its values go {from}, which looks like turns, not radians"))
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
            let encoded = encode_grey8(&mut bytes, self.height, self.width, &levels);
            encoded.map(|()| (name.clone(), bytes)).map_err(|e| FileError::write(&folder.join(name), e))
        };
        let all = (0..self.colors.len()).flat_map(|i| (0..self.frames).map(move |frame| (i, frame)));
        write_listed(&draft, all.map(picture))?;
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

fn load_pngs(opened: &Folder, unit: Option<PhaseUnit>) -> Result<Phases, HologramError> {
    let folder = opened.path();
    let mut found: BTreeMap<Key, BTreeMap<usize, String>> = BTreeMap::new();
    for (name, _) in opened.entries("").map_err(|e| FileError::read(folder, e))? {
        let name = name.to_string_lossy().into_owned();
        let Some((key, frame)) = parse_name(&name) else { continue };
        if let Some(other) = found.entry(key).or_default().insert(frame, name.clone()) {
            return Err(none(folder, format!("{other} and {name} are the same sub-frame")));
        }
    }
    if opened.is_replaced() {
        // Some may have been gone when they were listed.
        return Err(HologramError::Replaced { path: folder.display().to_string() });
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
            let open = opened.file(name).map_err(|e| unreadable(opened, name, e))?;
            let (height, width, levels) = read_grey8(open, &file)?;
            let (h, w) = *size.get_or_insert((height, width));
            if (h, w) != (height, width) {
                return Err(none(&file, format!("it is {height}x{width} pixels, the others {h}x{w}")));
            }
            phases.extend(levels.into_iter().map(|level| match unit {
                None => phase_of_level(level),
                Some(unit) => unit.radians(f32::from(level)),
            }));
        }
        colors.push((color, phases));
    }
    let (height, width) = size.expect("there is at least one picture");
    Ok(Phases { file: folder.into(), frames, height, width, colors })
}

fn none(path: &Path, reason: String) -> HologramError {
    HologramError::NotAHologram { path: path.display().to_string(), reason }
}
