//! A folder of views.

use super::light::Transfer;
use super::range::Measured;
use super::resize::{Fit, Resize};
use super::shape::{is_serpentine, shape};
use super::{LightField, Order, OrderFound, Parallax, Request, SceneError, names, order, picture, settings};
use crate::memory;
use rayon::prelude::*;
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Pixels of a picture that is read together with others; larger ones are read one at a time.
const MANY_PIXELS: usize = 1 << 22;

/// A folder's views, and how they were read.
pub(super) struct Read {
    pub field: LightField,
    /// How their places were found.
    pub how: String,
    /// The order that is stated, or that of the names.
    pub order: Order,
    /// Whether it is stated.
    pub order_stated: bool,
    /// What the pictures say of it.
    pub order_found: OrderFound,
    pub parallax: Option<Parallax>,
    /// Rows and columns of the pictures as they are.
    pub size: [usize; 2],
    /// How their values become light.
    pub transfer: String,
}

/// Loads the views; those whose pictures contradict the order of their names, where nothing else is stated, are refused.
///
/// # Errors
/// Every [`SceneError`] that a file can cause; it names the file.
pub(super) fn load(folder: &Path, request: &Request) -> Result<LightField, SceneError> {
    let read = read(folder, request)?;
    let name = folder.display().to_string();
    order::check(&name, &read.order_found)?;
    if !read.order_stated && read.field.grid != [1, 1] {
        order::say(&name, &read.order_found);
    }
    Ok(read.field)
}

/// Loads the views in whatever order, decoding in parallel, each scaled to the display as soon as it is read: no more than a
/// few are ever held at their own resolution.
///
/// # Errors
/// As [`load`].
pub(super) fn read(folder: &Path, request: &Request) -> Result<Read, SceneError> {
    let colors = request.colors;
    let Listed { found: Found { all, stated, mut views }, paths, size: own } = list(folder)?;
    let (height, width) = request.display.picture_size();
    let counts = [paths.len(), colors.len(), height, width];
    let what = || format!("{} views of {height} x {width} pixels", paths.len());
    memory::promise(what, memory::bytes_of(&counts, 4), "take a smaller --size, or fewer views")?;
    let size = Some([height, width]);
    let resize = size.filter(|size| *size != own).map(|size| Resize::new(own, size, Fit::default()));
    let read = |path: &PathBuf| -> Result<Vec<Vec<f32>>, SceneError> {
        let planes = picture::read(path, colors, stated.transfer)?.planes;
        Ok(match &resize {
            Some(resize) => planes.iter().map(|plane| resize.apply(plane)).collect(),
            None => planes,
        })
    };
    // One picture per task: their order in time does not matter, the first error in order is reported.
    let one_by_one = own[0] * own[1] > MANY_PIXELS;
    let read: Vec<_> = if one_by_one { paths.iter().map(read).collect() } else { paths.par_iter().map(read).collect() };
    let mut planes: Vec<Vec<Vec<f32>>> = colors.iter().map(|_| Vec::with_capacity(paths.len())).collect();
    for picture in read {
        for (plane, views) in picture?.into_iter().zip(&mut planes) {
            views.push(plane);
        }
    }
    let disparity = match stated.disparity {
        Some(range) => Some(range),
        None => settings::ground_truth(folder, &all, own)?,
    };
    let scaled = |range: Option<[f64; 2]>| range.map(|r| resize.as_ref().map_or(r, |resize| resize.scale_range(r)));
    let name = folder.canonicalize().unwrap_or(folder.into());
    let mut field = LightField {
        name: name.file_name().map_or("light field".into(), |n| n.to_string_lossy().into_owned()),
        grid: views.grid,
        height,
        width,
        colors: colors.to_vec(),
        planes,
        view_pitch: stated.view_pitch,
        disparity: scaled(disparity),
        depth: scaled(stated.depth),
        made: None,
    };
    if views.running {
        if stated.serpentine.is_none() && is_serpentine(&field, views.grid) {
            let reason = "every second row runs backwards: `serpentine = true` in lightfield.toml reads them so".into();
            return Err(SceneError::NotAGrid { folder: folder.display().to_string(), reason });
        }
        if stated.grid.is_none() && stated.serpentine.is_none() {
            field.grid = rows_and_columns(folder, &field, &mut views)?;
        }
    }
    if let Some(times) = views.proportion.filter(|p| !(0.9..1.1).contains(p)) {
        tracing::warn!(
            "{}: by the coordinates in the names rows of views stand {times:.2} times as far apart as columns: they count as \
             equally far, and depths along rows and columns differ",
            folder.display()
        );
    }
    let asked = request.order.or(stated.order);
    let field = asked.unwrap_or_default().apply(field);
    let parallax = Parallax::of(&field);
    let mut order_found = parallax.as_ref().map_or(OrderFound::Unknown, order::judge);
    if asked.is_some()
        && let OrderFound::Other { reason, .. } = &order_found
    {
        tracing::warn!("{}: the order of the views is as stated, though in it {reason}", folder.display());
        order_found = OrderFound::Unknown;
    }
    if let (OrderFound::AsNamedOrReversed, None) = (&order_found, asked)
        && let Some(stated) = stated_disparity(&field, request)
        && let Measured { range: Some(measured), doubt: None } = field.measured()
    {
        order_found = order::by_depths(stated, measured);
    }
    let transfer = match stated.transfer {
        Some(Transfer::Linear) => "linear, as stated",
        Some(Transfer::Srgb) => "sRGB, as stated",
        None if views.files[0].to_lowercase().ends_with("exr") => "linear (EXR)",
        None => "sRGB",
    };
    let (order, order_stated) = (asked.unwrap_or_default(), asked.is_some());
    Ok(Read { field, how: views.how, order, order_stated, order_found, parallax, size: own, transfer: transfer.into() })
}

/// The range of disparities that is stated, as such or as depths, pixels of the light field.
fn stated_disparity(field: &LightField, request: &Request) -> Option<[f64; 2]> {
    let cell = request.view_pitch.unwrap_or_else(|| field.cell(request.display));
    let per_pixel = request.display.focal_length * request.display.picture_pixel() / cell;
    let depths = request.depth.or(field.depth).map(|[a, b]| [a.min(b) / per_pixel, a.max(b) / per_pixel]);
    depths.or(field.disparity)
}

/// The grid of views that have one running number: a square, unless the pictures show another.
fn rows_and_columns(
    folder: &Path,
    field: &LightField,
    views: &mut names::Arrangement,
) -> Result<[usize; 2], SceneError> {
    let refuse = |reason| Err(SceneError::NotAGrid { folder: folder.display().to_string(), reason });
    let [rows, columns] = views.grid;
    match shape(field) {
        Some(shown) if views.doubt.is_empty() && shown != views.grid => refuse(format!(
            "{} views with a running number would be {rows} x {columns}, but their pictures change as in {} x {}: \
             `grid = [rows, columns]` in lightfield.toml decides",
            rows * columns,
            shown[0],
            shown[1]
        )),
        Some(shown) => {
            views.how += &format!("; their pictures change as in {} x {}", shown[0], shown[1]);
            Ok(shown)
        }
        None if views.doubt.is_empty() => Ok(views.grid),
        None => refuse(views.doubt.clone()),
    }
}

/// What a folder holds, by names alone.
pub(super) struct Found {
    all: Vec<String>,
    pub stated: settings::Settings,
    pub views: names::Arrangement,
}

/// Finds the views by their names.
///
/// # Errors
/// As [`load`].
pub(super) fn find(folder: &Path) -> Result<Found, SceneError> {
    let mut files = files(folder, "")?;
    let all: Vec<String> = files.iter().map(|(name, _)| name.clone()).collect();
    let stated = settings::read(folder, &all)?;
    if stated.files.as_ref().is_some_and(|pattern| pattern.contains('/')) {
        let unreadable = |e: std::io::Error| SceneError::unreadable(folder, &e);
        for entry in fs::read_dir(folder).map_err(unreadable)? {
            let entry = entry.map_err(unreadable)?;
            if let Some(name) = entry.file_name().to_str().filter(|_| entry.path().is_dir()) {
                files.append(&mut self::files(&entry.path(), &format!("{name}/"))?);
            }
        }
    }
    let mut views = names::arrange(folder, &files, stated.grid, stated.files.as_deref())?;
    if stated.serpentine == Some(true) {
        if !(views.running && views.doubt.is_empty()) {
            let reason =
                "serpentine = true is for views with a running number that fill a grid: state the `grid`".into();
            return Err(SceneError::Settings { file: folder.join("lightfield.toml").display().to_string(), reason });
        }
        views.files.chunks_mut(views.grid[1]).skip(1).step_by(2).for_each(<[String]>::reverse);
        views.how += ", every second row backwards";
    }
    Ok(Found { all, stated, views })
}

/// The files of a folder, `before` which stands in front of their names.
fn files(folder: &Path, before: &str) -> Result<Vec<names::Named>, SceneError> {
    let unreadable = |e: std::io::Error| SceneError::unreadable(folder, &e);
    let mut files: Vec<names::Named> = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        // Names that are not text cannot be views; links count as what they lead to.
        let Ok(name) = entry.file_name().into_string() else { continue };
        if let Some(found) = fs::metadata(entry.path()).ok().filter(fs::Metadata::is_file) {
            files.push((format!("{before}{name}"), found.len()));
        }
    }
    files.sort();
    Ok(files)
}

/// What a folder holds, by names and headers alone.
pub(super) struct Listed {
    found: Found,
    paths: Vec<PathBuf>,
    /// Rows and columns of every view.
    pub size: [usize; 2],
}

/// Finds the views without decoding any.
///
/// # Errors
/// As [`load`].
pub(super) fn list(folder: &Path) -> Result<Listed, SceneError> {
    let found = find(folder)?;
    // Headers first: a view of another size is found before anything is decoded.
    let files = &found.views.files;
    let paths: Vec<_> = files.iter().map(|name| folder.join(name)).collect();
    let sizes: Vec<_> = paths.par_iter().map(|path| picture::size(path)).collect::<Result<_, _>>()?;
    let [height, width] = sizes[0];
    if let Some(i) = sizes.iter().position(|&s| s != sizes[0]) {
        return Err(SceneError::Size {
            file: paths[i].display().to_string(),
            height: sizes[i][0],
            width: sizes[i][1],
            other: files[0].clone(),
            other_height: height,
            other_width: width,
        });
    }
    Ok(Listed { found, paths, size: [height, width] })
}
