//! Reads bare phases from an array (`.npy`, `.npz`), a picture, or a folder of pictures.
//!
//! Pictures hold levels, of which 256 (8 bits) or 65536 (16 bits) are a full turn unless a [`PhaseUnit`] is given.
//! Floats are radians. The names of pictures give color and sub-frame (`green-00.png`, `0-00.png`), or only a running
//! number (`phase_000.png`). A running number counts the sub-frames of one color, or of red, green and blue if the
//! pictures have colors.

use super::chunks::{none, read_whole};
use super::{HologramError, PhaseUnit, Phases};
use crate::files::{FileError, FileKind, Folder, NpyArray, Pixels, Samples, Wanted, read_pixels};
use crate::memory;
use crate::optics::{Color, phase_of_level};
use crate::scene::natural;
use eyebox_base::{Reason, reason};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fs;
use std::path::{Path, PathBuf};

/// The remedy if the unit of the numbers is doubtful.
const UNITS: &str =
    "Set `phase_unit` to the unit of its numbers, as rad, turns, deg, or the number of levels per turn, such as 256";
const JPEG: &str = "it is a JPEG picture, which changes levels. Save phases as PNG, BMP or TIFF";
/// Turns beyond which numbers are hardly radians, but levels or degrees.
const MANY_TURNS: f32 = 8.0;
/// The list in a folder of encoded video frames.
const VIDEO_FRAMES: &str = "frames.json";
/// The largest number of pixels of a picture of phases, which the largest display has.
const MOST_PIXELS: u64 = 1 << 28;

/// Reads phases from an array, from a picture, or from a folder of pictures. Any phase of an array is wrapped, and the
/// axes (row, column) are one sub-frame. `unit` is the unit of the numbers. Without it, floats are radians if they
/// plausibly can be. A full turn is 256 levels of an 8-bit picture, or 65536 levels of a 16-bit picture.
///
/// # Errors
/// - [`HologramError::File`] if a file cannot be read.
/// - [`HologramError::NotAHologram`] for an empty array, for an array without two to four axes, and if the last axis is
///   not a row of pixels. Also for a folder whose pictures are not one per color and sub-frame, all of one size.
/// - [`HologramError::Doubtful`] for numbers that may not be radians or levels.
pub fn load_phases(path: &Path, unit: Option<PhaseUnit>) -> Result<Phases, HologramError> {
    if unit.is_some_and(|u| !(u.turn() > 0.0 && u.turn().is_finite())) {
        return Err(none(path, reason!("phase-unit", "a turn must have a positive number of levels")));
    }
    let unreadable = |e| FileError::read(path, e);
    if fs::metadata(path).map_err(unreadable)?.is_dir() {
        return read_whole(path, |folder| of_folder(folder, unit));
    }
    match FileKind::of(path).map_err(unreadable)? {
        FileKind::Npy | FileKind::Npz => of_array(path, unit),
        found if found.is_picture() => of_pictures(path, &[path.to_path_buf()], unit),
        other => Err(FileError::of_kind(path, other, Wanted::Phases).into()),
    }
}

fn of_array(path: &Path, unit: Option<PhaseUnit>) -> Result<Phases, HologramError> {
    let mut array = NpyArray::only(path, |shape| (2..=4).contains(&shape.len()))?;
    let shape = array.shape.clone();
    let (colors, frames, height, width) = match shape[..] {
        [h, w] => (1, 1, h, w),
        [f, h, w] => (1, f, h, w),
        [c, f, h, w] => (c, f, h, w),
        _ => (0, 0, 0, 0),
    };
    let wrong = |why: &str| {
        let right = "(row, column), (sub-frame, row, column) or (color, sub-frame, row, column)";
        Err(none(path, reason!("shape", "its shape is {shape:?}{why}, not {right}")))
    };
    let count = shape.iter().product();
    if shape.len() == 5 {
        return wrong(", as for views (solve a hologram of a scene first)");
    }
    if count == 0 || colors == 0 {
        return wrong("");
    }
    if shape.len() == 4 && (width <= 4 && colors > 4) {
        return wrong(", as if colors came last (save phases.transpose(3, 2, 0, 1))");
    }
    if shape.len() > 2 && width <= 4 && height >= 4 * width {
        return wrong(
            ", as if colors or sub-frames came last (save numpy.moveaxis(phases, -1, 0), and for colors add [:, None])",
        );
    }
    let what = || format!("{}: phases of shape {shape:?}", path.display());
    memory::check_available(what, memory::bytes_of(&[count, 2], 4), "read a part of it")?;
    let values = array.take(count)?;
    if let Some(at) = values.iter().position(|v| !v.is_finite()) {
        let index = index_of(&shape, at);
        let reason =
            reason!("not-finite", "has {} at index {index:?}: every value must be a finite float32", values[at]);
        return Err(content(path, reason));
    }
    let unit = unit_of(path, &values, unit, !array.kind.starts_with('f'))?;
    let wrap = |part: &[f32]| (None, part.iter().map(|&p| unit.radians(p)).collect());
    let colors = values.chunks(frames * height * width).map(wrap).collect();
    Ok(Phases { file: path.into(), frames, height, width, colors })
}

fn index_of(shape: &[usize], mut at: usize) -> Vec<usize> {
    let mut index = vec![0; shape.len()];
    for (i, n) in index.iter_mut().zip(shape).rev() {
        (*i, at) = (at % n, at / n);
    }
    index
}

fn ends(values: &[f32]) -> [f32; 2] {
    values.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], &v| [l.min(v), h.max(v)])
}

/// Radians beyond which float32 has an error of more than a hundredth of a turn.
const MOST_RADIANS: f32 = 1e5;

/// Refuses numbers that a program gives as radians and that cannot be radians. They are so large that float32 does not
/// resolve a turn, or they are gray levels, which are whole numbers beyond a turn.
///
/// # Errors
/// Returns [`HologramError::NotRadians`] with the range of the numbers.
pub fn check_radians(phases: &[f32]) -> Result<(), HologramError> {
    let [low, high] = ends(phases);
    let most = low.abs().max(high.abs());
    let are_levels = || high > low && most > TAU as f32 && phases.iter().all(|p| p.fract() == 0.0);
    if most > MOST_RADIANS || are_levels() { Err(HologramError::NotRadians { low, high }) } else { Ok(()) }
}

/// Returns the reason why numbers are hardly radians, if they are not.
pub(super) fn far_outside(values: &[f32]) -> Option<Reason> {
    let [low, high] = ends(values);
    let far = low.abs().max(high.abs()) > MANY_TURNS * TAU as f32;
    far.then(|| reason!("not-radians", "its values go from {low} to {high}, far outside a turn in radians"))
}

/// Returns the unit that is given for numbers, or radians if they plausibly can be.
fn unit_of(file: &Path, values: &[f32], unit: Option<PhaseUnit>, integers: bool) -> Result<PhaseUnit, HologramError> {
    match unit {
        Some(unit) => Ok(unit),
        None => doubt(values, integers)
            .map_or(Ok(PhaseUnit::Radians), |found| Err(HologramError::doubtful(file, found, UNITS))),
    }
}

/// Returns the reason why numbers may not be radians, if there is one.
fn doubt(values: &[f32], integers: bool) -> Option<Reason> {
    let [low, high] = ends(values);
    let from = format!("from {low} to {high}");
    if integers || (high > low && values.iter().all(|v| v.fract() == 0.0)) {
        return Some(reason!("whole-numbers", "it holds whole numbers {from}"));
    }
    if let Some(found) = far_outside(values) {
        return Some(found);
    }
    let fills = |a: f32, b: f32| low >= a && high <= b && high - low > 0.9 * (b - a) && values.len() >= 64;
    (fills(0.0, 1.0) || fills(-0.5, 0.5))
        .then(|| reason!("turns", "its values go {from}, which looks like turns, not radians"))
}

/// A color by its name, or by its number. The order follows the array.
type Key = (Option<Color>, usize);

/// Returns true for the file extensions of pictures that keep every level.
fn is_lossless(name: &str) -> bool {
    let ending = name.rsplit_once('.').map_or(String::new(), |(_, e)| e.to_ascii_lowercase());
    ["png", "bmp", "tif", "tiff", "pgm", "ppm", "pnm", "exr"].contains(&ending.as_str())
}

/// Returns the color and sub-frame of a name such as `green-00.png` or `0-00.png`.
fn parse_name(name: &str) -> Option<(Key, usize)> {
    let (color, frame) = name.rsplit_once('.')?.0.split_once('-')?;
    let key = match color {
        "red" => (Some(Color::Red), 0),
        "green" => (Some(Color::Green), 0),
        "blue" => (Some(Color::Blue), 0),
        number => (None, number.parse().ok()?),
    };
    Some((key, frame.parse().ok()?))
}

/// Returns true if a folder holds pictures with names of phases, such as `green-00.png` or `phase_000.png`. A folder of
/// pictures with other names may also be a light field.
pub(super) fn are_named_in(folder: &Path) -> bool {
    let Ok(entries) = std::fs::read_dir(folder) else { return false };
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let mut pictures = names.filter(|name| !name.starts_with('.') && is_lossless(name)).peekable();
    let is_phase = |name: String| name.starts_with("phase") || matches!(parse_name(&name), Some(((Some(_), _), _)));
    pictures.peek().is_some() && pictures.all(is_phase)
}

fn of_folder(opened: &Folder, unit: Option<PhaseUnit>) -> Result<Phases, HologramError> {
    let folder = opened.path();
    let mut names: Vec<String> = opened
        .entries("")
        .map_err(|e| FileError::read(folder, e))?
        .into_iter()
        .filter_map(|(name, _)| name.into_string().ok())
        .filter(|name| !name.starts_with('.'))
        .collect();
    names.sort_by_cached_key(|name| natural(name));
    if names.iter().any(|name| name == VIDEO_FRAMES) {
        let reason = "it holds encoded video frames, with levels for an SLM. Give the hologram of which they were made";
        return Err(none(folder, Reason::new("video-frames", reason)));
    }
    let named = names.iter().any(|name| is_lossless(name) && parse_name(name).is_some());
    let found = match (named, names.iter().any(|name| is_lossless(name))) {
        (true, _) => of_named(folder, &names, unit),
        (false, true) => numbered(folder, &names).and_then(|files| of_pictures(folder, &files, unit)),
        (false, false) => Err(refuse(folder, &names)),
    };
    // Some pictures may have been missing when they were read.
    if opened.is_replaced() {
        return Err(HologramError::Replaced { path: folder.display().to_string() });
    }
    found
}

/// Refuses a folder without pictures of phases, with a message about its first file.
fn refuse(folder: &Path, names: &[String]) -> HologramError {
    const FORMS: &str = "Name pictures of phases green-00.png, 0-00.png or phase_000.png (PNG, BMP, TIFF or PGM)";
    let first = names.iter().map(|name| folder.join(name)).find(|path| path.is_file());
    match first.and_then(|first| Some((FileKind::of(&first).ok()?, first))) {
        Some((FileKind::Jpeg, first)) => content(&first, Reason::new("jpeg", JPEG)),
        Some((kind, first)) if !matches!(kind, FileKind::Text | FileKind::Unknown | FileKind::Empty) => {
            none(folder, reason!("no-pictures", "its first file, {}, is {}. {FORMS}", first.display(), kind.describe()))
        }
        _ => none(folder, reason!("no-pictures", "it holds no pictures. {FORMS}")),
    }
}

/// Returns the pictures of a folder whose names differ only in a running number, in its order.
fn numbered(folder: &Path, names: &[String]) -> Result<Vec<PathBuf>, HologramError> {
    let names: Vec<&String> = names.iter().filter(|name| is_lossless(name)).collect();
    let parts: Vec<_> = names.iter().map(|name| natural(name)).collect();
    let texts = |i: usize| parts[i].iter().map(|(text, _)| text).collect::<Vec<_>>();
    if let Some(other) = (1..names.len()).find(|&i| texts(i) != texts(0)) {
        let reason = reason!(
            "named-differently",
            "{} and {} have different patterns of names. Name sub-frames by a running number",
            names[0],
            names[other]
        );
        return Err(none(folder, reason));
    }
    let changing = |k: usize| parts.iter().any(|p| p[k].1 != parts[0][k].1);
    let numbers: Vec<usize> = (0..parts[0].len()).filter(|&k| changing(k)).collect();
    if let [number, _, ..] = numbers[..] {
        let reason = reason!(
            "several-numbers",
            "names such as {} have several numbers that change, from {} on. Solve views of a scene first. \
             In names of phases, one number counts sub-frames",
            names[0],
            parts[0][number].1
        );
        return Err(none(folder, reason));
    }
    if let Some(&k) = numbers.first()
        && let Some(i) = (1..parts.len()).find(|&i| parts[i][k].1 != parts[i - 1][k].1 + 1)
    {
        let reason = reason!(
            "missing-sub-frame",
            "sub-frames must have consecutive numbers, but {} follows {}",
            names[i],
            names[i - 1]
        );
        return Err(none(folder, reason));
    }
    Ok(names.into_iter().map(|name| folder.join(name)).collect())
}

/// Reads pictures of one color and sub-frame each, by their names.
fn of_named(folder: &Path, names: &[String], unit: Option<PhaseUnit>) -> Result<Phases, HologramError> {
    let mut found: BTreeMap<Key, BTreeMap<usize, &String>> = BTreeMap::new();
    let pictures = names.iter().filter(|name| is_lossless(name));
    for (name, (key, frame)) in pictures.filter_map(|name| Some((name, parse_name(name)?))) {
        if let Some(other) = found.entry(key).or_default().insert(frame, name) {
            return Err(none(folder, reason!("same-sub-frame", "{other} and {name} are the same sub-frame")));
        }
    }
    let frames = found.values().map(BTreeMap::len).max().unwrap_or(0);
    let mut size = None;
    let mut colors = Vec::with_capacity(found.len());
    for (&(color, number), pictures) in &found {
        let mut phases = Vec::new();
        for frame in 0..frames {
            let Some(name) = pictures.get(&frame) else {
                let color = color.map_or_else(|| number.to_string(), |c| c.to_string());
                let what = format!("{color}-{frame:02}.png is missing, with {frames} sub-frames per color");
                return Err(none(folder, Reason::new("missing-sub-frame", what)));
            };
            let file = folder.join(name);
            let levels = levels(&file, &mut size)?;
            if levels.has_color {
                return Err(content(&file, reason!("colors", "has colors, but its name is for a single color")));
            }
            phases.extend(levels.channel(0, unit, &file)?);
        }
        colors.push((color, phases));
    }
    let [height, width] = size.unwrap_or_default();
    Ok(Phases { file: folder.into(), frames, height, width, colors })
}

/// Reads pictures of one sub-frame each, which have one color or three.
fn of_pictures(place: &Path, files: &[PathBuf], unit: Option<PhaseUnit>) -> Result<Phases, HologramError> {
    let mut size = None;
    let read = |file: &PathBuf| Ok((levels(file, &mut size)?, file.clone()));
    let pictures = files.iter().map(read).collect::<Result<Vec<_>, HologramError>>()?;
    let has_color = pictures.iter().any(|(levels, _)| levels.has_color);
    if let Some((_, file)) = pictures.iter().find(|(levels, _)| has_color && levels.channels < 3) {
        return Err(content(file, reason!("gray-and-colors", "is gray, but others have colors. Give one kind")));
    }
    // A single picture may have a name such as green-00.png.
    let color = match files {
        [one] => one.file_name().and_then(|name| parse_name(&name.to_string_lossy())).and_then(|((color, _), _)| color),
        _ => None,
    };
    let named = if has_color { vec![Some(Color::Red), Some(Color::Green), Some(Color::Blue)] } else { vec![color] };
    let mut colors = Vec::new();
    for (channel, color) in named.into_iter().enumerate() {
        let mut phases = Vec::new();
        for (levels, file) in &pictures {
            phases.extend(levels.channel(channel, unit, file)?);
        }
        colors.push((color, phases));
    }
    let [height, width] = size.unwrap_or_default();
    Ok(Phases { file: place.into(), frames: pictures.len(), height, width, colors })
}

/// Stored levels of one picture.
struct Levels {
    channels: usize,
    has_color: bool,
    samples: Samples,
}

/// Reads a picture, which must have the `size` of the previous ones.
fn levels(file: &Path, size: &mut Option<[usize; 2]>) -> Result<Levels, HologramError> {
    if FileKind::of(file).map_err(|e| FileError::read(file, e))? == FileKind::Jpeg {
        return Err(content(file, Reason::new("jpeg", JPEG)));
    }
    let picture = read_pixels(file, Wanted::Phases, MOST_PIXELS)?;
    let [h, w] = *size.get_or_insert([picture.height, picture.width]);
    if [h, w] != [picture.height, picture.width] {
        let reason = reason!("size", "it has {}x{} pixels, but the others have {h}x{w}", picture.height, picture.width);
        return Err(none(file, reason));
    }
    let Pixels { channels, .. } = picture;
    let has_alpha = picture.has_alpha();
    let (opaque, gray) = match &picture.samples {
        Samples::U8(v) => survey(v, channels, u8::MAX),
        Samples::U16(v) => survey(v, channels, u16::MAX),
        Samples::F32(v) => survey(v, channels, 1.0),
    };
    if has_alpha && !opaque {
        let what = "has pixels that are not opaque. Save phases without transparency";
        return Err(content(file, Reason::new("not-opaque", what)));
    }
    Ok(Levels { channels, has_color: picture.has_color() && !gray, samples: picture.samples })
}

/// Returns two flags, true if all pixels are opaque and true if all are gray.
fn survey<T: PartialEq + Copy>(values: &[T], channels: usize, full: T) -> (bool, bool) {
    let pixels = values.chunks_exact(channels);
    let opaque = pixels.clone().all(|p| p[channels - 1] == full);
    (opaque, channels < 3 || pixels.clone().all(|p| p[0] == p[1] && p[0] == p[2]))
}

impl Levels {
    /// Returns the phases of one channel in radians.
    fn channel(&self, channel: usize, unit: Option<PhaseUnit>, file: &Path) -> Result<Vec<f32>, HologramError> {
        let (values, turn): (Vec<f32>, f64) = match &self.samples {
            Samples::U8(v) => (v.iter().skip(channel).step_by(self.channels).map(|v| f32::from(*v)).collect(), 256.0),
            Samples::U16(v) => {
                (v.iter().skip(channel).step_by(self.channels).map(|v| f32::from(*v)).collect(), 65536.0)
            }
            Samples::F32(v) => {
                let values: Vec<f32> = v.iter().skip(channel).step_by(self.channels).copied().collect();
                if let Some(bad) = values.iter().find(|v| !v.is_finite()) {
                    let reason = reason!("not-finite", "has the value {bad}, but every value must be a finite float32");
                    return Err(content(file, reason));
                }
                let unit = unit_of(file, &values, unit, false)?;
                return Ok(values.into_iter().map(|v| unit.radians(v)).collect());
            }
        };
        if let Some(unit) = unit {
            return Ok(values.into_iter().map(|v| unit.radians(v)).collect());
        }
        let full = turn as f32 - 1.0;
        let ends = [0.0, full].map(|end| values.contains(&end));
        if ends == [true, true] && values.len() >= 64 && values.iter().all(|v| *v == 0.0 || *v == full) {
            let found = reason!("two-levels", "it holds only 0 and {full}, like a hologram of two phases");
            let decide =
                format!("Set `phase_unit` to the number of levels per turn, {} for 0 and half a turn", 2.0 * full);
            return Err(HologramError::doubtful(file, found, &decide));
        }
        let unit = PhaseUnit::Levels(turn);
        let eight = turn == 256.0;
        Ok(values.into_iter().map(|v| if eight { phase_of_level(v as u8) } else { unit.radians(v) }).collect())
    }
}

/// Returns the error for a problem in the content of a file of phases.
fn content(file: &Path, reason: Reason) -> HologramError {
    FileError::content(file, reason).into()
}

impl HologramError {
    pub(super) fn doubtful(path: &Path, reason: Reason, decide: &str) -> Self {
        Self::Doubtful { path: path.display().to_string(), reason, decide: decide.into() }
    }
}
