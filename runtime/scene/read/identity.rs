//! Computes the digest of a scene's files, by which a hologram recognizes its scene.
//!
//! The digest covers contents and not names or dates. A folder that was moved or renamed therefore stays the same
//! scene, and one changed view makes it another. Files that loading does not read do not count.

use super::splats;
use crate::formats::options::parts;
use crate::read::source::{Source, ViewSource};
use crate::splats::format::Format;
use crate::{
    LightField, SceneError,
    formats::video,
    read::folder,
    read::frames,
    read::given,
    read::settings::{self, SETTINGS},
};
use eyebox_base::files::{self, Digester};
use eyebox_optics::Color;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Returns the digest of all files that loading a scene reads, without its depth map. A built-in scene returns `None`,
/// because its name identifies it completely.
///
/// # Errors
/// [`SceneError`] for a source that does not exist or cannot be read.
pub fn digest(source: &str) -> Result<Option<String>, SceneError> {
    let read = match Source::of(source)? {
        Source::BuiltIn(_) => return Ok(None),
        Source::Picture(path) => return digest_of_picture(path).map(Some),
        Source::Splats(_, Format::BuiltIn, _) => return Ok(None),
        Source::Splats(path, _, options) => {
            // The options place the camera, so they are a part of the scene.
            let mut all = vec![parts(source).1.to_owned()];
            for file in splats::files(path, &options) {
                all.push(digest_of_file(&file)?);
            }
            return Ok(Some(digest_of_parts(all.iter().map(String::as_bytes))));
        }
        Source::Views(ViewSource::Folder(path)) => in_folder(path)?,
        Source::Views(ViewSource::Array(path, options) | ViewSource::Mosaic(path, _, options)) => {
            // The settings of a folder may be for other files than this one.
            let beside = path.with_file_name(SETTINGS[0]);
            let stated = settings::beside(path, &options)? != settings::with(&options, Default::default());
            [path.into()].into_iter().chain(stated.then_some(beside)).collect()
        }
    };
    let digests = read.par_iter().map(|file| digest_of_file(file)).collect::<Result<Vec<_>, _>>()?;
    Ok(Some(digest_of_parts(digests.iter().map(String::as_bytes))))
}

/// Returns the digest of a picture or depth map, or of one frame of a video.
///
/// # Errors
/// [`SceneError`] for a file that cannot be read.
pub fn digest_of_picture(path: &Path) -> Result<String, SceneError> {
    let Some((file, frame)) = video::named(path) else {
        // Options about the values follow a question mark.
        return digest_of_file(path.to_str().map_or(path, |source| parts(source).0));
    };
    let (head, samples) = video::stored_parts(&file, frame.unwrap_or(0))?;
    Ok(digest_of_parts([head.as_bytes(), &samples]))
}

/// Returns the path of a source and the options after its question mark. A built-in scene returns `None`.
pub fn path_and_options(source: &str) -> Option<(PathBuf, &str)> {
    if source.starts_with("builtin:") {
        return None;
    }
    let (path, options) = parts(source);
    Some((path.into(), options))
}

/// Returns the files of a folder that loading reads. The views come first, in their order, and then the files that
/// determine how they are read.
fn in_folder(path: &Path) -> Result<Vec<PathBuf>, SceneError> {
    if let Some(given) = given::find(path)? {
        return Ok(given.files());
    }
    let found = folder::find(path).map_err(|error| frames::explain(path, error))?;
    let all = crate::light_field::natural::files(path)?;
    let has = |name: &&str| all.iter().any(|file| file == name);
    let said = SETTINGS.iter().copied().find(has);
    let is_truth = |name: &&String| found.stated.disparity.is_none() && settings::is_ground_truth(name);
    let names =
        found.views.files.iter().map(String::as_str).chain(said).chain(all.iter().filter(is_truth).map(|s| &s[..]));
    Ok(names.map(|name| path.join(name)).collect())
}

fn digest_of_file(file: &Path) -> Result<String, SceneError> {
    files::digest_file(file).map_err(|e| SceneError::unreadable(file, &e))
}

impl LightField {
    /// Returns the digest of the views of each color. They identify a light field that was not read from a file.
    pub fn digests(&self) -> BTreeMap<Color, String> {
        let of = |views: &Vec<Vec<f32>>| {
            let bytes = |view: &Vec<f32>| view.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
            let digests: Vec<String> = views.par_iter().map(|view| digest_of_parts([&bytes(view)[..]])).collect();
            let size = format!("{:?} {} {}", self.grid, self.height, self.width);
            digest_of_parts([&size].into_iter().chain(&digests).map(String::as_bytes))
        };
        self.colors.iter().copied().zip(self.planes.iter().map(of)).collect()
    }
}

fn digest_of_parts<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> String {
    let mut whole = Digester::default();
    parts.into_iter().for_each(|part| whole.part(part));
    whole.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox_base::files::{write_npy, write_png};
    use std::fs;

    /// Writes a folder of 2 x 2 views whose light differs from view to view, and from one `seed` to another.
    fn views(folder: &Path, seed: f32) {
        fs::create_dir_all(folder).unwrap();
        for i in 0..4 {
            let view: Vec<f32> = (0..64).map(|p| (p as f32 * 0.01 + i as f32 * 0.05 + seed).fract()).collect();
            write_png(&folder.join(format!("view_{i}.png")), 8, 8, &[&view]).unwrap();
        }
    }

    fn of(path: &Path) -> String {
        digest(path.to_str().unwrap()).unwrap().unwrap()
    }

    #[test]
    fn a_folder_is_what_is_read_of_it() {
        let here = tempfile::tempdir().unwrap();
        let folder = here.path().join("views");
        views(&folder, 0.0);
        let before = of(&folder);
        // Names and files that are not read do not count. Contents, their order and their settings do.
        let renamed = here.path().join("other name");
        fs::rename(&folder, &renamed).unwrap();
        fs::write(renamed.join("README.txt"), "about the views").unwrap();
        assert_eq!(of(&renamed), before);
        let picture = fs::read(renamed.join("view_1.png")).unwrap();
        fs::copy(renamed.join("view_2.png"), renamed.join("view_1.png")).unwrap();
        assert_ne!(of(&renamed), before);
        fs::write(renamed.join("view_2.png"), &picture).unwrap();
        assert_ne!(of(&renamed), before, "two views have changed places");
        views(&renamed, 0.0);
        assert_eq!(of(&renamed), before);
        fs::write(renamed.join("lightfield.toml"), "view_pitch_mm = 2.0").unwrap();
        assert_ne!(of(&renamed), before);
        fs::remove_file(renamed.join("lightfield.toml")).unwrap();
        views(&renamed, 0.3);
        assert_ne!(of(&renamed), before);
        fs::remove_file(renamed.join("view_3.png")).unwrap();
        let rest = digest(renamed.to_str().unwrap());
        assert!(rest.map_or(true, |rest| rest != Some(before)), "a view is missing");
    }

    #[test]
    fn files_are_their_bytes_and_built_in_scenes_their_names() {
        let here = tempfile::tempdir().unwrap();
        let [one, two, clip] = ["one.npy", "two.npy", "clip.y4m"].map(|name| here.path().join(name));
        let light: Vec<f32> = (0..4 * 64).map(|v| v as f32 / 256.0).collect();
        write_npy(&one, &[2, 2, 8, 8], &light).unwrap();
        fs::copy(&one, &two).unwrap();
        assert_eq!(of(&one), of(&two));
        fs::write(here.path().join("lightfield.toml"), "files = \"one.npy\"\nview_pitch_mm = 2.0").unwrap();
        assert_ne!(of(&one), of(&two), "settings are for the file that they name");
        fs::remove_file(here.path().join("lightfield.toml")).unwrap();
        let as_stated = |options: &str| digest(&format!("{}?{options}", one.display())).unwrap().unwrap();
        for options in ["full_scale=255", "linear", "grid=2x2&full_scale=1"] {
            assert_eq!(as_stated(options), of(&one), "{options}: nothing lies beside it");
        }
        assert_eq!(digest("builtin:plane?depth=1").unwrap(), None);
        assert!(digest("no such scene").is_err());
        let frame = |value: u8| [&b"FRAME\n"[..], &[value; 16]].concat();
        fs::write(&clip, [&b"YUV4MPEG2 W4 H4 Cmono\n"[..], &frame(40), &frame(90)].concat()).unwrap();
        let at = |frame: usize| digest(&format!("{}?frame={frame}", clip.display())).unwrap();
        let (first, second) = (at(0), at(1));
        assert_ne!(first, second);
        fs::write(&clip, [&b"YUV4MPEG2 W4 H4 Cmono\n"[..], &frame(40), &frame(91)].concat()).unwrap();
        assert_eq!(at(0), first, "the other frame has changed");
        assert_ne!(at(1), second);
    }
}
