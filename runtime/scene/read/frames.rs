//! Finds the frames of a sequence in a video, or in a folder of pictures or light fields.

use crate::light_field::natural::{files, is_picture, natural};
use crate::read::names::{is_auxiliary, square};
use crate::{SceneError, formats::video, read::folder, read::given};
use eyebox_base::files::{FileError, FileKind};
use eyebox_base::reason;
use std::fs;
use std::path::{Path, PathBuf};

/// Returns the frames of a source that is a sequence by itself. These are the frames of a video, the pictures of a
/// folder if depth maps are given, or the light fields in a folder. A single scene returns `None`.
///
/// # Errors
/// The errors of reading folders and videos, and of [`frames`]. [`SceneError::Empty`] for a folder without pictures.
pub fn sequence(source: &str, maps: &[PathBuf]) -> Result<Option<Vec<String>>, SceneError> {
    let path = Path::new(source);
    if path.is_dir() {
        // A folder with a focal stack or with layers is one scene.
        if given::find(path)?.is_some() {
            return Ok(None);
        }
        return if maps.is_empty() { frames(path) } else { pictures(path).map(Some) };
    }
    match video::named(path) {
        Some((file, None)) if file.is_file() => {
            let count = video::count(&file)?;
            Ok(Some((0..count).map(|i| video::frame(path, i)).collect()))
        }
        _ => Ok(None),
    }
}

/// Returns the pictures in a folder that are not maps, in the order of the numbers in their names.
fn pictures(folder: &Path) -> Result<Vec<String>, SceneError> {
    let mut found: Vec<String> = files(folder)?.into_iter().filter(|name| is_picture(name)).collect();
    // The folder has maps only, or pairs of pictures and maps.
    if found.iter().any(|name| !is_auxiliary(name)) {
        found.retain(|name| !is_auxiliary(name));
    }
    if found.is_empty() {
        return Err(SceneError::Empty { folder: folder.display().to_string() });
    }
    Ok(found.into_iter().filter_map(|name| folder.join(name).to_str().map(str::to_owned)).collect())
}

/// Returns the folders in a folder that has no views of its own, in the order of the numbers in their names. It returns
/// `None` if there are none, or if the folder is a light field itself.
///
/// # Errors
/// [`SceneError::Rows`] if the folders may also be the rows of one light field, and the errors of reading folders.
pub fn frames(folder: &Path) -> Result<Option<Vec<String>>, SceneError> {
    match folder::find(folder).map_err(|error| explain(folder, error)) {
        Err(SceneError::Empty { .. } | SceneError::Deeper { .. }) => {
            Ok(Some(folders(folder)?).filter(|found| !found.is_empty()))
        }
        Ok(_) => Ok(None),
        Err(error) => Err(error),
    }
}

fn folders(folder: &Path) -> Result<Vec<String>, SceneError> {
    let entries = fs::read_dir(folder).map_err(|e| SceneError::unreadable(folder, &e))?.flatten();
    let mut found: Vec<String> = entries
        .filter(|e| e.path().is_dir() && !e.file_name().to_string_lossy().starts_with(['.', '_']))
        .filter_map(|e| e.path().to_str().map(str::to_owned))
        .collect();
    found.sort_by_cached_key(|name| natural(name));
    Ok(found)
}

/// Refuses a folder whose first file is of a kind that other programs use for views, but that is not read in a folder.
fn unread(folder: &Path) -> Option<SceneError> {
    let first = files(folder).ok()?.into_iter().next()?;
    let path = folder.join(first);
    let found = FileKind::of(&path).ok()?;
    let may_be_view = matches!(
        found,
        FileKind::OtherPicture(_) | FileKind::CameraRaw | FileKind::Gif | FileKind::Video(_) | FileKind::Npy
    );
    may_be_view.then(|| FileError::of_all(folder, &path, found).into())
}

/// Returns the error of a folder without views. Its folders may be the rows of one light field. Each then has the same
/// number of views, in one row by their names. A running number can also be a square, which counts unless there are as
/// many folders as views in each.
pub(crate) fn explain(folder: &Path, error: SceneError) -> SceneError {
    if !matches!(error, SceneError::Empty { .. }) {
        return error;
    }
    if let Some(other) = unread(folder) {
        return other;
    }
    if folder.join("zarr.json").exists() {
        let reason = reason!(
            "hologram-not-scene",
            "it is a hologram and not a scene. Give a folder of views, a picture with a depth map, or builtin:NAME"
        );
        return SceneError::Corrupt { file: folder.display().to_string(), reason };
    }
    let found = folders(folder).unwrap_or_default();
    let in_one_row = |found: folder::Found| -> Option<usize> {
        let (views, grid) = (found.views, found.stated.grid);
        let count = views.files.len();
        let square = views.running && square(count).is_some();
        (grid.is_none() && count > 1 && (views.grid.contains(&1) || square)).then_some(count)
    };
    let counts =
        || found.iter().map(|f| folder::find(Path::new(f)).ok().and_then(in_one_row)).collect::<Option<Vec<_>>>();
    match counts().as_deref() {
        Some([first, rest @ ..])
            if !rest.is_empty()
                && rest.iter().all(|n| n == first)
                && (square(*first).is_none() || *first == found.len()) =>
        {
            let name = folder.display().to_string();
            SceneError::Rows { folder: name, rows: found.len(), columns: *first, first: found[0].clone() }
        }
        _ => match found.iter().find(|inner| folder::find(Path::new(inner)).is_ok()) {
            Some(inner) => SceneError::Deeper { folder: folder.display().to_string(), inner: inner.clone() },
            None => error,
        },
    }
}
