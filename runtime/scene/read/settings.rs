//! Reads the settings of a folder of views from `lightfield.toml` or `parameters.cfg`.
//!
//! `parameters.cfg` and the ground-truth disparity map come from the 4D Light Field Benchmark.

use crate::formats::options::Options;
use crate::light_field::cameras::{FirstTile, Positions, PositionsToml};
use crate::{Order, SceneError, formats::pfm, formats::tone::Tone, light_field::light::Transfer, read::names};
use eyebox_base::error::Reason;
use eyebox_base::files::read;
use eyebox_base::reason;
use eyebox_optics::{check_usual_aperture, check_usual_depths, check_usual_view_pitch};
use serde::Deserialize;
use std::path::Path;

/// Files that determine how the views of a folder are read.
pub(crate) const SETTINGS: [&str; 2] = ["lightfield.toml", "parameters.cfg"];

/// The stated facts about a folder's views. Lengths are in meters, and disparities in pixels of the original views.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Settings {
    pub grid: Option<[usize; 2]>,
    /// A pattern for the names of the views.
    pub files: Option<String>,
    /// True if every second row of a running number runs backwards, if that is stated.
    pub serpentine: Option<bool>,
    /// The true order of the views, if it is stated.
    pub order: Option<Order>,
    pub view_pitch: Option<f64>,
    pub disparity: Option<[f64; 2]>,
    pub depth: Option<[f64; 2]>,
    pub tone: Tone,
    /// Rows and columns of the views to use, in the middle of the grid.
    pub keep: Option<[usize; 2]>,
    /// Rows and columns of the tiles in which one row of cameras is laid out.
    pub tiles: Option<[usize; 2]>,
    /// The tile of the leftmost camera.
    pub first: Option<FirstTile>,
    /// Positions of the cameras in the pupil plane, in meters.
    pub positions: Option<Positions>,
    /// Depth at which each picture of a focal stack is sharp, in meters.
    pub focus: Option<Vec<f64>>,
    /// Diameter of the aperture of a focal stack, in meters.
    pub aperture: Option<f64>,
    /// Vergence of each picture of a multi-plane image, in diopters.
    pub layers: Option<Vec<f64>>,
}

/// The contents of `lightfield.toml`, with lengths in millimeters and otherwise as in [`Settings`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Toml {
    /// Rows and columns of views.
    grid: Option<[usize; 2]>,
    /// A pattern for the names of the views, in which `*` matches any text. If it has a `/`, it matches files in the
    /// folders of the folder.
    files: Option<String>,
    /// True if every second row of running numbers runs backwards.
    serpentine: Option<bool>,
    /// True if rows and columns of views are exchanged.
    transpose: Option<bool>,
    /// True if the first row of views is the lowest.
    flip_rows: Option<bool>,
    /// True if the first column of views is the rightmost.
    flip_columns: Option<bool>,
    /// Distance of neighboring views in the pupil plane, in millimeters.
    view_pitch_mm: Option<f64>,
    /// Smallest and largest disparity between neighboring views, in pixels. Positive is nearer.
    disparity: Option<[f64; 2]>,
    /// Smallest and largest depth in millimeters. Positive is nearer.
    depth_mm: Option<[f64; 2]>,
    /// Transfer function of the stored values.
    transfer: Option<Transfer>,
    /// The stored value of white.
    full_scale: Option<f32>,
    /// Rows and columns of the views to use, in the middle of the grid.
    keep: Option<[usize; 2]>,
    /// Rows and columns of the tiles in which one row of cameras is laid out.
    tiles: Option<[usize; 2]>,
    /// The tile of the leftmost camera.
    first: Option<FirstTile>,
    /// Positions of the cameras in the pupil plane, in millimeters.
    positions_mm: Option<PositionsToml>,
    /// Depth at which each picture of a focal stack is sharp, in millimeters.
    focus_mm: Option<Vec<f64>>,
    /// Diameter of the aperture of a focal stack, in millimeters.
    aperture_mm: Option<f64>,
    /// Vergence of each picture of a multi-plane image, in diopters.
    layers_dioptres: Option<Vec<f64>>,
}

/// Reads `lightfield.toml` if it exists, otherwise `parameters.cfg` if that exists. `names` are the files of the
/// folder.
pub(crate) fn read(folder: &Path, names: &[String]) -> Result<Settings, SceneError> {
    type Parse = fn(&str) -> Result<Settings, Reason>;
    for (name, parse) in [("lightfield.toml", from_toml as Parse), ("parameters.cfg", from_cfg)] {
        if names.iter().any(|n| n == name) {
            let path = folder.join(name);
            let text = read::text(&path, read::TEXT).map_err(|e| SceneError::unreadable(&path, &e))?;
            return parse(&text).map_err(|reason| SceneError::Settings { file: path.display().to_string(), reason });
        }
    }
    Ok(Settings::default())
}

/// Returns the settings of a file of many views, from the `lightfield.toml` in its folder and the options after its
/// name. The options take precedence. A `lightfield.toml` whose `files` exclude the file does not count.
pub(crate) fn beside(file: &Path, options: &Options) -> Result<Settings, SceneError> {
    const NAME: &str = "lightfield.toml";
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let stated = if folder.join(NAME).exists() { read(folder, &[NAME.into()])? } else { Settings::default() };
    let its = file.file_name().map(|name| name.to_string_lossy());
    let others = stated.files.as_ref().is_some_and(|files| its.is_none_or(|name| !names::matches(files, &name)));
    let stated = if others { Settings::default() } else { stated };
    Ok(with(options, stated))
}

/// Returns the settings with the options after the name of a file, which take precedence.
pub(crate) fn with(options: &Options, stated: Settings) -> Settings {
    let Tone { transfer, full_scale } = options.tone;
    let tone = Tone { transfer: transfer.or(stated.tone.transfer), full_scale: full_scale.or(stated.tone.full_scale) };
    Settings { grid: options.grid.or(stated.grid), tone, ..stated }
}

/// Returns true if a file is a map of true disparities, by its name.
pub(crate) fn is_ground_truth(name: &str) -> bool {
    name.starts_with("gt_disp") && name.ends_with(".pfm")
}

/// Returns the disparity range of a `gt_disp*.pfm` in the folder of views of `size`, with the `lowres` map first. A map
/// of another size is ignored, because it does not describe the pixels of the views.
pub(crate) fn ground_truth(folder: &Path, names: &[String], size: [usize; 2]) -> Result<Option<[f64; 2]>, SceneError> {
    let mut maps: Vec<&String> = names.iter().filter(|name| is_ground_truth(name)).collect();
    maps.sort_by_key(|n| (!n.contains("lowres"), n.as_str()));
    for name in maps {
        let path = folder.join(name);
        let bytes = read::bytes(&path, read::PICTURE).map_err(|e| SceneError::unreadable(&path, &e))?;
        let map =
            pfm::parse(&bytes).map_err(|reason| SceneError::Corrupt { file: path.display().to_string(), reason })?;
        if [map.height, map.width] == size {
            // Benchmarks mark pixels without a value by infinity.
            let known = || map.values.iter().filter(|v| v.is_finite()).map(|&v| f64::from(v));
            let (low, high) = known().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            return Ok((low <= high).then_some([low, high]));
        }
    }
    Ok(None)
}

/// The largest number of pictures in a focal stack.
const MOST_FOCUSED: usize = 64;

fn focus(depths: Option<Vec<f64>>) -> Result<Option<Vec<f64>>, Reason> {
    let Some(depths) = depths else { return Ok(None) };
    if !(2..=MOST_FOCUSED).contains(&depths.len()) || depths.iter().any(|z| !z.is_finite() || z.abs() > 1e6) {
        return Err(reason!(
            "focus-count",
            "focus_mm is {depths:?}, but it must be 2 to {MOST_FOCUSED} depths, one for each picture"
        ));
    }
    if depths.iter().enumerate().any(|(i, z)| depths[..i].contains(z)) {
        return Err(reason!("focus-same", "focus_mm is {depths:?}, but each picture must have a depth of its own"));
    }
    let depths: Vec<f64> = depths.into_iter().map(|z| z * 1e-3).collect();
    let ends = depths.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], z| [a.min(*z), b.max(*z)]);
    check_usual_depths(ends).map_err(|e| reason!("focus", "focus_mm: {e}"))?;
    Ok(Some(depths))
}

fn aperture(diameter: Option<f64>) -> Result<Option<f64>, Reason> {
    let diameter = diameter.map(|mm| mm * 1e-3);
    diameter.map_or(Ok(()), check_usual_aperture).map_err(|e| reason!("aperture", "aperture_mm: {e}"))?;
    Ok(diameter)
}

fn layers(dioptres: Option<Vec<f64>>, is_stack: bool) -> Result<Option<Vec<f64>>, Reason> {
    match dioptres {
        Some(_) if is_stack => Err(reason!(
            "layers-and-focus",
            "focus_mm is for a focal stack and layers_dioptres for layers. Leave out one"
        )),
        Some(all) if !all.iter().all(|v| v.is_finite()) => {
            Err(reason!("layers", "layers_dioptres must have finite numbers"))
        }
        other => Ok(other),
    }
}

fn range(key: &str, value: Option<[f64; 2]>, unit: f64) -> Result<Option<[f64; 2]>, Reason> {
    match value {
        Some([a, b]) if !(a.is_finite() && b.is_finite() && a <= b) => {
            Err(reason!("range", "{key} is [{a}, {b}], but it must be two finite numbers, the smaller first"))
        }
        _ => Ok(value.map(|r| r.map(|v| v * unit))),
    }
}

/// Returns the stated tiles. Refuses other statements that contradict them.
fn cameras(read: &Toml) -> Result<Option<[usize; 2]>, Reason> {
    if let (Some(_), Some(_)) = (&read.positions_mm, read.tiles.or(read.grid)) {
        return Err(reason!(
            "positions-and-grid",
            "positions_mm has the position of each camera. Leave out `grid` and `tiles`"
        ));
    }
    if read.positions_mm.is_some() && (read.view_pitch_mm.is_some() || read.disparity.is_some()) {
        let reason = "positions_mm has the distances of the cameras. Leave out `view_pitch_mm` and `disparity`";
        return Err(Reason::new("positions-and-pitch", reason));
    }
    let Some([rows, columns]) = read.tiles else { return Ok(None) };
    let count = rows.checked_mul(columns).filter(|count| *count > 1);
    if count.is_none() || read.grid.is_some_and(|grid| Some(grid) != count.map(|count| [1, count])) {
        return Err(reason!(
            "tiles",
            "tiles is [{rows}, {columns}], but it must be rows and columns of the tiles of one row of cameras, \
             without another `grid`"
        ));
    }
    Ok(read.tiles)
}

fn from_toml(text: &str) -> Result<Settings, Reason> {
    let read: Toml = eyebox_base::files::read::toml(text)?;
    if let Some(pitch) = read.view_pitch_mm {
        if !(pitch.is_finite() && pitch > 0.0) {
            return Err(reason!("view-pitch", "view_pitch_mm is {pitch}, but it must be positive"));
        }
        check_usual_view_pitch(pitch * 1e-3).map_err(|e| reason!("view-pitch", "view_pitch_mm: {e}"))?;
    }
    if let Some([rows, columns]) = read.grid
        && (rows == 0 || columns == 0)
    {
        return Err(reason!("grid", "grid is [{rows}, {columns}], but it must be rows and columns of at least 1"));
    }
    if let Some(white) = read.full_scale.filter(|v| !(v.is_finite() && *v > 0.0)) {
        return Err(reason!(
            "full-scale",
            "full_scale is {white}, but it must be a positive number, the stored value of white"
        ));
    }
    let depth = range("depth_mm", read.depth_mm, 1e-3)?;
    depth.map_or(Ok(()), check_usual_depths).map_err(|e| reason!("depth", "depth_mm: {e}"))?;
    let tiles = cameras(&read)?;
    let is_stack = read.focus_mm.is_some();
    let says_order = [read.transpose, read.flip_rows, read.flip_columns].iter().any(Option::is_some);
    let order = Order {
        transpose: read.transpose.unwrap_or(false),
        flip_rows: read.flip_rows.unwrap_or(false),
        flip_columns: read.flip_columns.unwrap_or(false),
    };
    Ok(Settings {
        grid: read.grid,
        files: read.files,
        serpentine: read.serpentine,
        order: says_order.then_some(order),
        view_pitch: read.view_pitch_mm.map(|p| p * 1e-3),
        disparity: range("disparity", read.disparity, 1.0)?,
        depth,
        tone: Tone { transfer: read.transfer, full_scale: read.full_scale },
        keep: read.keep,
        tiles,
        first: read.first,
        positions: read.positions_mm.map(PositionsToml::metres).transpose()?,
        focus: focus(read.focus_mm)?,
        aperture: aperture(read.aperture_mm)?,
        layers: layers(read.layers_dioptres, is_stack)?,
    })
}

/// Reads the benchmark's file. It describes its cameras in detail, and only the number of views and the disparities are
/// needed here.
fn from_cfg(text: &str) -> Result<Settings, Reason> {
    let number = |key: &str| -> Result<Option<f64>, Reason> {
        for (i, line) in text.lines().enumerate() {
            let Some((name, value)) = line.split_once('=') else { continue };
            if name.trim() == key {
                let value = value.trim();
                let read = value.parse::<f64>().ok().filter(|v| v.is_finite());
                return read
                    .map(Some)
                    .ok_or_else(|| reason!("number", "line {}: {key} is {value:?}, but it must be a number", i + 1));
            }
        }
        Ok(None)
    };
    let pair = |a: &str, b: &str| Ok::<_, Reason>(number(a)?.zip(number(b)?).map(|(a, b)| [a, b]));
    let grid = match pair("num_cams_y", "num_cams_x")? {
        Some(counts) if counts.iter().any(|&n| n.fract() != 0.0 || !(1.0..=65536.0).contains(&n)) => {
            return Err(reason!(
                "cameras-count",
                "num_cams_y, num_cams_x are {counts:?}, but they must be whole numbers of at least 1"
            ));
        }
        counts => counts.map(|c| c.map(|n| n as usize)),
    };
    Ok(Settings {
        grid,
        disparity: range("disp_min, disp_max", pair("disp_min", "disp_max")?, 1.0)?,
        ..Settings::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn toml_is_read_and_unknown_keys_are_named() {
        assert_eq!(from_toml("files = \"a*\"").unwrap().order, None);
        let order = from_toml("flip_rows = false\ntranspose = true").unwrap().order;
        assert_eq!(order, Some(Order { transpose: true, ..Order::default() }));
        let text = "view_pitch_mm = 2.5\ndisparity = [-1, 1.5]\ndepth_mm = [-2.0, 3.0]\ntransfer = \"linear\"\ngrid = [3, 4]\n";
        let read = from_toml(text).unwrap();
        assert_eq!(read.view_pitch, Some(2.5e-3));
        assert_eq!((read.disparity, read.grid), (Some([-1.0, 1.5]), Some([3, 4])));
        assert_eq!(read.depth, Some([-2.0e-3, 3.0e-3]));
        assert_eq!(read.tone.transfer, Some(Transfer::Linear));
        let error = from_toml("view_pitch_mm = 2\nviewpitch = 3\n").unwrap_err();
        assert!(error.text().contains("line 2") && error.text().contains("viewpitch"), "{error}");
        for bad in
            ["view_pitch_mm = 0", "view_pitch_mm = nan", "disparity = [2, 1]", "depth_mm = [0, inf]", "grid = [0, 1]"]
        {
            let key = bad.split(' ').next().unwrap();
            assert!(from_toml(bad).unwrap_err().text().contains(key), "{bad}");
        }
    }

    /// Lengths in millimeters are given in meters or micrometers by mistake.
    #[test]
    fn lengths_in_another_unit_are_refused_with_what_is_probably_meant() {
        let cases = [
            ("view_pitch_mm = 0.0022", "2.2"),
            ("view_pitch_mm = 2200", "2.2"),
            ("depth_mm = [-0.003, 0.005]", "-3 to 5"),
            ("depth_mm = [0, 0.0014]", "0 to 1.4 mm"),
            ("depth_mm = [-6e-6, -2e-6]", "-6 to -2 mm"),
            ("focus_mm = [-0.003, 0, 0.003]\naperture_mm = 12", "-3 to 3 mm"),
            ("focus_mm = [-3, 0, 3]\naperture_mm = 0.012", "12"),
            ("focus_mm = [-3, 0, 3]\naperture_mm = 12000", "12"),
            ("focus_mm = [-3, 0, 3]\naperture_mm = 1.2e-5", "12"),
            ("focus_mm = [-3, 0, 3]\naperture_mm = 0", "aperture_mm"),
        ];
        for (text, meant) in cases {
            let error = from_toml(text).unwrap_err();
            assert!(error.text().contains(meant), "{text}: {error}");
        }
        for text in ["depth_mm = [0, 0]", "depth_mm = [-0.1, 0.1]", "focus_mm = [0.5, 0]\naperture_mm = 3"] {
            assert!(from_toml(text).is_ok(), "{text}");
        }
    }

    #[test]
    fn the_benchmarks_file_is_read() {
        let text = "[intrinsics]\nfocal_length_mm = 100\n[extrinsics]\nnum_cams_x = 9\nnum_cams_y = 7\n\
                    [meta]\nscene = x\ndisp_min = -2.1\ndisp_max =  3.2 \n";
        let read = from_cfg(text).unwrap();
        assert_eq!((read.disparity, read.grid), (Some([-2.1, 3.2]), Some([7, 9])));
        assert_eq!(from_cfg("disp_min = x\ndisp_max = 1").unwrap_err().code(), "number");
        assert_eq!(from_cfg("").unwrap(), Settings::default());
    }
}
