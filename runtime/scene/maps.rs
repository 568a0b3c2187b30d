//! Which depth map belongs to which picture.

use super::SceneError;
use std::fs;
use std::path::{Path, PathBuf};

/// The map of each picture: `given` once per picture, or one folder with a map of each picture's name or running number.
/// None for no maps.
///
/// # Errors
/// [`SceneError::Maps`] where the maps do not belong to the pictures one by one; those of reading a folder.
pub fn depth_maps(pictures: &[String], given: &[PathBuf]) -> Result<Vec<PathBuf>, SceneError> {
    let wrong = |what: String| Err(SceneError::Maps { what });
    match given {
        [] => Ok(Vec::new()),
        [folder] if folder.is_dir() => {
            let maps = files(folder)?;
            pictures.iter().map(|picture| of(Path::new(picture), folder, &maps)).collect()
        }
        [one] if pictures.iter().all(|p| *p == pictures[0]) => Ok(vec![one.clone(); pictures.len()]),
        [one] => wrong(format!("{} is one map of {} different pictures", one.display(), pictures.len())),
        many if many.len() == pictures.len() => Ok(many.to_vec()),
        many => wrong(format!("{} maps are given for {} pictures", many.len(), pictures.len())),
    }
}

/// The files of a folder.
fn files(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    let unreadable = |e: std::io::Error| SceneError::unreadable(folder, &e);
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let hidden = path.file_name().is_none_or(|n| n.to_string_lossy().starts_with('.'));
        if path.is_file() && !hidden {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// The only map of the picture's name, or else the only one of its running number.
fn of(picture: &Path, folder: &Path, maps: &[PathBuf]) -> Result<PathBuf, SceneError> {
    let number = |path: &Path| {
        let stem = path.file_stem()?.to_string_lossy().into_owned();
        let digits = stem.split(|c: char| !c.is_ascii_digit()).rfind(|d| !d.is_empty())?.to_owned();
        digits.parse::<u64>().ok()
    };
    let named: Vec<&PathBuf> = maps.iter().filter(|map| map.file_stem() == picture.file_stem()).collect();
    let wanted = number(picture);
    let numbered: Vec<&PathBuf> = maps.iter().filter(|map| wanted.is_some() && number(map) == wanted).collect();
    match (&named[..], &numbered[..]) {
        ([one], _) | ([], [one]) => Ok((*one).clone()),
        (several, others) => {
            let found = several.len().max(others.len());
            let what = format!("{}: {found} maps in {} have its name or number", picture.display(), folder.display());
            Err(SceneError::Maps { what })
        }
    }
}
