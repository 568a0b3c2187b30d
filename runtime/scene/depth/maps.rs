//! Assigns depth maps to pictures.

use crate::{SceneError, formats::video, light_field::natural};
use std::path::{Path, PathBuf};

/// Returns the map of each picture. `given` is one map per picture, or one folder with a map of each picture's name or
/// running number, or one video with one frame per picture. Without maps, the result is empty.
///
/// # Errors
/// [`SceneError::Maps`] if the maps and the pictures do not correspond one to one, and the errors of reading a folder.
pub fn depth_maps(pictures: &[String], given: &[PathBuf]) -> Result<Vec<PathBuf>, SceneError> {
    let wrong = |what: String| Err(SceneError::Maps { what });
    if let Some(folder) = pictures.iter().find(|picture| !given.is_empty() && Path::new(picture).is_dir()) {
        return Err(SceneError::Request {
            what: "the picture of the depth map",
            value: format!("the folder {folder}"),
            must: "one picture of it, because every picture has a map of its own and views in a folder need no map",
        });
    }
    match given {
        [] => Ok(Vec::new()),
        [folder] if folder.is_dir() => {
            let maps = maps_in(folder, pictures)?;
            if pictures.iter().any(|picture| video::named(Path::new(picture)).is_some()) {
                return of_frames(pictures, maps.len(), &folder.display().to_string(), |i| maps[i].clone());
            }
            pictures.iter().map(|picture| of(Path::new(picture), folder, &maps)).collect()
        }
        [one] if one.is_file() && matches!(video::named(one), Some((_, None))) => {
            of_frames(pictures, video::count(one)?, &one.display().to_string(), |i| video::frame(one, i).into())
        }
        [one] if pictures.iter().all(|p| *p == pictures[0]) => Ok(vec![one.clone(); pictures.len()]),
        [one] => wrong(format!("{} is one map of {} different pictures", one.display(), pictures.len())),
        many if many.len() == pictures.len() => Ok(many.to_vec()),
        many => wrong(format!("{} maps are given for {} pictures", many.len(), pictures.len())),
    }
}

/// Returns the maps in a folder, in the order of their numbers. If the folder has the pictures too, only files whose
/// names mark maps count.
fn maps_in(folder: &Path, pictures: &[String]) -> Result<Vec<PathBuf>, SceneError> {
    let names = natural::files(folder)?;
    let holds_pictures = pictures.iter().any(|picture| Path::new(picture).parent() == Some(folder));
    let is_map =
        |name: &&String| !holds_pictures || ["depth", "disp"].iter().any(|word| name.to_lowercase().contains(word));
    Ok(names.iter().filter(is_map).map(|name| folder.join(name)).collect())
}

/// Returns the map of each picture if the maps are frames. It is the map of the same frame, or the next one in order.
fn of_frames(
    pictures: &[String],
    count: usize,
    what: &str,
    map: impl Fn(usize) -> PathBuf,
) -> Result<Vec<PathBuf>, SceneError> {
    let frame = |(i, picture): (usize, &String)| match video::named(Path::new(picture)) {
        Some((_, frame)) => frame.unwrap_or(0),
        None => i,
    };
    let wanted: Vec<usize> = pictures.iter().enumerate().map(frame).collect();
    match wanted.iter().find(|frame| **frame >= count) {
        Some(frame) => {
            Err(SceneError::Maps { what: format!("{what}: {count} maps, but none for picture {frame}, from 0 on") })
        }
        None => Ok(wanted.into_iter().map(map).collect()),
    }
}

/// Returns the only map with the picture's name, otherwise the only one with its running number.
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
