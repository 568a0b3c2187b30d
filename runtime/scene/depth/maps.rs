//! Assigns depth maps to pictures.

use crate::depth::map;
use crate::formats::options::parts;
use crate::light_field::near::{Meaning, Stated};
use crate::{Near, SceneError, formats::video, light_field::natural};
use eyebox_base::files::holds_depth;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Returns the maps of pictures that follow each other, as [`depth_maps`] does. The ends of the depths are the smallest
/// and the largest value of all maps, so that content stays at its depth while other content moves. The path of each map
/// then ends in `?range=LOW,HIGH`. Maps that state their ends and disparities do not change.
///
/// # Errors
/// The errors of [`depth_maps`] and of reading the maps.
pub fn sequence_maps(
    pictures: &[String],
    given: &[PathBuf],
    near: Option<Near>,
    depth: Option<[f64; 2]>,
) -> Result<Vec<PathBuf>, SceneError> {
    let maps = depth_maps(pictures, given)?;
    // All frames of a video have the same ends.
    if maps.iter().all(|map| *map == maps[0]) || video::named(&maps[0]).is_some() {
        return Ok(maps);
    }
    let ends = |path: &PathBuf| {
        let map = map::read(path, Stated { near, depth })?;
        let states_none = matches!(map.meaning, Meaning::Relative(_)) && map.range.is_none();
        Ok(states_none.then(|| map::ends(&map.values)))
    };
    let all = maps.par_iter().map(ends).collect::<Result<Option<Vec<[f32; 2]>>, SceneError>>()?;
    let Some([low, high]) = all.map(|all| map::ends(all.as_flattened())).filter(|[low, high]| low < high) else {
        return Ok(maps);
    };
    tracing::info!("the ends of the depths are {low} and {high} in all depth maps");
    let stated = |map: PathBuf| with_options(&map, &format!("range={low},{high}"));
    Ok(maps.into_iter().map(stated).collect())
}

/// Adds options to the path of a map.
fn with_options(map: &Path, options: &str) -> PathBuf {
    let has_options = map.to_str().is_some_and(|map| !parts(map).1.is_empty());
    format!("{}{}{options}", map.display(), if has_options { '&' } else { '?' }).into()
}

/// Returns a folder of maps and the options after its question mark.
fn folder_of(given: &Path) -> Option<(&Path, &str)> {
    given.to_str().map(parts).filter(|(folder, options)| folder.is_dir() && !options.is_empty())
}

/// Returns the map of each picture. `given` is one map per picture, or one folder with a map of each picture's name or
/// running number, or one video with one frame per picture. A folder of EXR pictures may have the depths in the pictures
/// themselves. Options after the question mark of a folder are options of all its maps. Without maps, the result is empty.
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
    if let [one] = given
        && let Some((folder, options)) = folder_of(one)
    {
        let maps = depth_maps(pictures, &[folder.into()])?;
        return Ok(maps.iter().map(|map| with_options(map, options)).collect());
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

/// Returns the only map with the picture's name, otherwise the only one with its running number, otherwise the picture
/// itself if it has depths and is in the folder of the maps.
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
        ([], []) if picture.parent() == Some(folder) && holds_depth(picture)? => Ok(picture.into()),
        (several, others) => {
            let found = several.len().max(others.len());
            let what = format!("{}: {found} maps in {} have its name or number", picture.display(), folder.display());
            Err(SceneError::Maps { what })
        }
    }
}
