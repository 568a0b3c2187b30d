//! A folder of views.

use super::resize::{Fit, Resize};
use super::{LightField, SceneError, names, picture, settings};
use crate::memory;
use crate::optics::Color;
use rayon::prelude::*;
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Loads the views of `colors`, decoding in parallel, at their own resolution or, each as soon as it is read, at another:
/// no more than a few views are ever held at their own.
///
/// # Errors
/// Every [`SceneError`] that a file can cause; it names the file.
pub(super) fn load(folder: &Path, colors: &[Color], size: Option<[usize; 2]>) -> Result<LightField, SceneError> {
    let Listed { all, stated, views, paths, size: own } = list(folder)?;
    let [height, width] = size.unwrap_or(own);
    let counts = [paths.len(), colors.len(), height, width];
    let what = || format!("{} views of {height} x {width} pixels", paths.len());
    memory::promise(what, memory::bytes_of(&counts, 4), "take a smaller --size, or fewer views")?;
    let resize = size.filter(|size| *size != own).map(|size| Resize::new(own, size, Fit::default()));
    let read = |path: &PathBuf| -> Result<Vec<Vec<f32>>, SceneError> {
        let planes = picture::read(path, colors, stated.transfer)?.planes;
        Ok(match &resize {
            Some(resize) => planes.iter().map(|plane| resize.apply(plane)).collect(),
            None => planes,
        })
    };
    // One picture per task: their order in time does not matter, the first error in order is reported.
    let one_by_one = own[0] * own[1] > picture::MANY_PIXELS;
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
    Ok(LightField {
        name: name.file_name().map_or("light field".into(), |n| n.to_string_lossy().into_owned()),
        grid: views.grid,
        height,
        width,
        colors: colors.to_vec(),
        planes,
        view_pitch: stated.view_pitch,
        disparity: scaled(disparity),
        depth: scaled(stated.depth),
    })
}

/// What a folder holds, by names and headers alone.
pub(super) struct Listed {
    all: Vec<String>,
    stated: settings::Settings,
    views: names::Arrangement,
    paths: Vec<PathBuf>,
    /// Rows and columns of every view.
    pub size: [usize; 2],
}

/// Finds the views without decoding any.
///
/// # Errors
/// As [`load`].
pub(super) fn list(folder: &Path) -> Result<Listed, SceneError> {
    let unreadable = |e: std::io::Error| SceneError::unreadable(folder, &e);
    let mut files: Vec<names::Named> = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        // Names that are not text cannot be views; links count as what they lead to.
        let Ok(name) = entry.file_name().into_string() else { continue };
        if let Some(found) = fs::metadata(entry.path()).ok().filter(fs::Metadata::is_file) {
            files.push((name, found.len()));
        }
    }
    files.sort();
    let all: Vec<String> = files.iter().map(|(name, _)| name.clone()).collect();
    let stated = settings::read(folder, &all)?;
    let views = names::arrange(folder, &files, stated.grid)?;

    // Headers first: a view of another size is found before anything is decoded.
    let paths: Vec<_> = views.files.iter().map(|name| folder.join(name)).collect();
    let sizes: Vec<_> = paths.par_iter().map(|path| picture::size(path)).collect::<Result<_, _>>()?;
    let [height, width] = sizes[0];
    if let Some(i) = sizes.iter().position(|&s| s != sizes[0]) {
        return Err(SceneError::Size {
            file: paths[i].display().to_string(),
            height: sizes[i][0],
            width: sizes[i][1],
            other: views.files[0].clone(),
            other_height: height,
            other_width: width,
        });
    }
    Ok(Listed { all, stated, views, paths, size: [height, width] })
}
