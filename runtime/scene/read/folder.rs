//! Reads a folder of views.

use crate::formats::tone::Reading;
use crate::light_field::cameras::Positions;
use crate::light_field::light::FullScale;
use crate::light_field::shape::{is_serpentine, shape};
use crate::read::views::{self, Frame, Read};
use crate::{LightField, Request, SceneError, formats::picture, light_field::natural, read::names, read::settings};
use eyebox_base::error::Reason;
use eyebox_base::files::holds_light;
use eyebox_base::reason;
use rayon::prelude::*;
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Pictures with more pixels than this are read one at a time, and smaller ones in parallel.
const MANY_PIXELS: usize = 1 << 22;

/// Loads the views in any order and decodes them in parallel. Each is scaled to the display as soon as it is read, so
/// only a few are in memory at their own resolution.
pub(crate) fn read(folder: &Path, request: &Request) -> Result<Read, SceneError> {
    let Listed { found: Found { all, stated, mut views }, paths, size: own } = list(folder)?;
    let frame = Frame::new(own, paths.len(), request)?;
    let reading = Reading::new(stated.tone);
    let read = |path: &PathBuf| Ok(frame.fit(picture::read(path, picture::ONE, request.colors, &reading)?.planes));
    // One picture per task. Their order in time does not matter, because the first error in order is reported.
    let one_by_one = own[0] * own[1] > MANY_PIXELS;
    let read: Vec<_> = if one_by_one { paths.iter().map(read).collect() } else { paths.par_iter().map(read).collect() };
    let read = read.into_iter().collect::<Result<Vec<_>, SceneError>>()?;
    reading.judge(folder, FullScale::Folder)?;
    let disparity = match stated.disparity {
        Some(range) => Some(range),
        None => settings::ground_truth(folder, &all, own)?,
    };
    let mut field = frame.field(folder, views.grid, read, request, &stated, disparity);
    if views.running && stated.tiles.is_none() && stated.positions.is_none() {
        if stated.serpentine.is_none() && is_serpentine(&field, views.grid) {
            let reason = reason!(
                "every-second-row-backwards",
                "every second row runs backwards. Set `serpentine = true` in lightfield.toml"
            );
            return Err(SceneError::NotAGrid { folder: folder.display().to_string(), reason });
        }
        if stated.grid.is_none() && stated.serpentine.is_none() {
            field.grid = rows_and_columns(folder, &field, &mut views)?;
        }
    }
    if let Some(times) = views.proportion.filter(|p| !(0.9..1.1).contains(p)) {
        tracing::warn!(
            "{}: by the coordinates in the names, rows of views are {times:.2} times as far apart as columns. They \
             count as equally far, and depths along rows and columns differ",
            folder.display()
        );
    }
    let linear = holds_light(&folder.join(&views.files[0]));
    views::ordered(folder, field, request, &stated, views.how, own, linear)
}

/// Returns the grid of views that have one running number. It is a square, unless the pictures show another grid.
fn rows_and_columns(
    folder: &Path,
    field: &LightField,
    views: &mut names::Arrangement,
) -> Result<[usize; 2], SceneError> {
    let refuse = |reason| Err(SceneError::NotAGrid { folder: folder.display().to_string(), reason });
    let [rows, columns] = views.grid;
    match shape(field) {
        Some(shown) if views.doubt.is_empty() && shown != views.grid => refuse(reason!(
            "grid-differs",
            "{} views with a running number would be {rows} x {columns}, but their pictures change as in {} x {}. \
             State `grid = [rows, columns]` in lightfield.toml",
            rows * columns,
            shown[0],
            shown[1]
        )),
        Some(shown) => {
            views.how += &format!(", and their pictures change as in {} x {}", shown[0], shown[1]);
            Ok(shown)
        }
        None if views.doubt.is_empty() => Ok(views.grid),
        None => refuse(Reason::new("grid-doubtful", &views.doubt)),
    }
}

/// The content of a folder, by names alone.
pub(crate) struct Found {
    all: Vec<String>,
    pub stated: settings::Settings,
    pub views: names::Arrangement,
}

/// Finds the views by their names.
pub(crate) fn find(folder: &Path) -> Result<Found, SceneError> {
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
    let mut views = match &stated.positions {
        Some(Positions::Each(all)) => names::in_order(folder, &files, all.len(), stated.files.as_deref())?,
        Some(lines) => names::arrange(folder, &files, Some(lines.grid()), stated.files.as_deref())?,
        None => names::arrange(folder, &files, stated.grid.or(stated.tiles), stated.files.as_deref())?,
    };
    if stated.serpentine == Some(true) && stated.tiles.is_none() {
        if !(views.running && views.doubt.is_empty()) {
            let reason = reason!(
                "serpentine",
                "serpentine = true needs views with a running number that fill a grid. State the `grid`"
            );
            return Err(SceneError::Settings { file: folder.join("lightfield.toml").display().to_string(), reason });
        }
        views.files.chunks_mut(views.grid[1]).skip(1).step_by(2).for_each(<[String]>::reverse);
        views.how += ", every second row backwards";
    }
    Ok(Found { all, stated, views })
}

/// Lists the files of a folder, with the prefix `before` in front of their names.
fn files(folder: &Path, before: &str) -> Result<Vec<names::Named>, SceneError> {
    let unreadable = |e: std::io::Error| SceneError::unreadable(folder, &e);
    let mut files: Vec<names::Named> = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        // A link counts as its target.
        let Some(name) = natural::name(&entry)? else { continue };
        if let Some(found) = fs::metadata(entry.path()).ok().filter(fs::Metadata::is_file) {
            files.push((format!("{before}{name}"), found.len()));
        }
    }
    files.sort();
    Ok(files)
}

/// The content of a folder, by names and headers alone.
pub(crate) struct Listed {
    found: Found,
    paths: Vec<PathBuf>,
    /// Rows and columns of every view, in pixels.
    pub size: [usize; 2],
}

/// Finds the views and reads only their headers.
pub(crate) fn list(folder: &Path) -> Result<Listed, SceneError> {
    let found = find(folder)?;
    // Headers come first, so that a view of another size is found before any decoding.
    let files = &found.views.files;
    let paths: Vec<_> = files.iter().map(|name| folder.join(name)).collect();
    let size = picture::size_of_all(&paths, |_| files[0].clone())?;
    Ok(Listed { found, paths, size })
}
