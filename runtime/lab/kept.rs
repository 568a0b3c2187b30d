//! Caches each result in its own file, together with all that decided it.
//!
//! A cached result is used again only if the text of its inputs is equal, character by character. Every other result,
//! also one in a damaged file, is computed again and replaced.

use eyebox::low_level::files::{self, FileError};
use eyebox::low_level::optics::Display;
use eyebox::low_level::scene::LightField;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::path::{Path, PathBuf};

#[derive(Serialize, Deserialize)]
struct CachedResult<S, T> {
    made_by: S,
    result: T,
}

/// A folder of cached results.
pub(crate) struct ResultCache {
    folder: PathBuf,
    _made: files::CreatedDirGuard,
}

impl ResultCache {
    /// Opens the cache in this folder and creates the folder if it does not exist.
    pub fn new(folder: PathBuf) -> Result<Self, FileError> {
        let _made = files::CreatedDirGuard::new(&folder)?;
        Ok(Self { folder, _made })
    }

    /// Returns the result with this name if its inputs are equal to `made_by`.
    pub fn load<T: DeserializeOwned>(&self, name: &str, made_by: &str) -> Option<T> {
        let file = files::read::bytes(&self.file(name), files::read::RESULTS).ok()?;
        let kept: CachedResult<String, T> = serde_json::from_slice(&file).ok()?;
        (kept.made_by == made_by).then_some(kept.result)
    }

    /// Saves a result atomically.
    pub fn save<T: Serialize>(&self, name: &str, made_by: &str, result: &T) -> Result<(), FileError> {
        files::write_file(&self.file(name), |out| Ok(serde_json::to_writer(out, &CachedResult { made_by, result })?))
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}.json"))
    }
}

/// Refuses a folder that eyebox cannot write into, before any computation. The folder is created if it does not exist.
/// The returned guard removes it again if it is still empty.
///
/// # Errors
/// Returns [`FileError`] if the folder cannot be created or written.
pub fn writable(folder: &Path) -> Result<files::CreatedDirGuard, FileError> {
    let made = files::CreatedDirGuard::new(folder)?;
    files::check_place(&folder.join("report"))?;
    Ok(made)
}

/// Returns all properties of a display that decide a result, as text. This is its file without its name, its controller
/// and its triggers. Displays with the same text give the same results.
pub(crate) fn identity(display: &Display) -> String {
    Display { name: String::new(), ..display.without_apparatus() }.to_toml()
}

/// Returns a checksum of all pixels of all views.
pub(crate) fn checksum(field: &LightField) -> u32 {
    field.planes.iter().flatten().fold(0, |sum, view| append(sum, view))
}

/// Continues the CRC-32C checksum `sum` with the little-endian bytes of these values.
pub(crate) fn append(sum: u32, values: &[f32]) -> u32 {
    let mut bytes = Vec::with_capacity(4 * 4096);
    values.chunks(4096).fold(sum, |sum, some| {
        bytes.clear();
        bytes.extend(some.iter().flat_map(|v| v.to_le_bytes()));
        crc32c::crc32c_append(sum, &bytes)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox::low_level::optics::{Color, Geometry};

    #[test]
    fn only_what_was_made_the_same_way_is_used_again() {
        let here = tempfile::tempdir().unwrap();
        let keep = ResultCache::new(here.path().join("results")).unwrap();
        let made_by = r#"{"version":"1","steps":60}"#;
        keep.save("a", made_by, &vec![1.5, 2.5]).unwrap();
        assert_eq!(keep.load::<Vec<f64>>("a", made_by), Some(vec![1.5, 2.5]));
        assert_eq!(keep.load::<Vec<f64>>("a", r#"{"version":"1","steps":61}"#), None);
        assert_eq!(keep.load::<Vec<f64>>("b", made_by), None);
        assert_eq!(keep.load::<Vec<String>>("a", made_by), None);
        let file = here.path().join("results/a.json");
        let whole = std::fs::read(&file).unwrap();
        std::fs::write(&file, &whole[..whole.len() - 3]).unwrap();
        assert_eq!(keep.load::<Vec<f64>>("a", made_by), None);
    }

    /// A result for one display is never used for another display that differs in one property.
    #[test]
    fn every_part_of_a_display_decides_its_results_but_its_name() {
        let paper = Display::preset("paper").unwrap();
        let text = paper.to_toml();
        assert_eq!(identity(&Display { name: "another".into(), ..paper.clone() }), identity(&paper));
        let with = |section: &str| Display::from_toml(&format!("{text}\n{section}"), "other.toml").unwrap();
        let others = [
            Display { pitch: paper.pitch * 1.01, ..paper.clone() },
            Display { focal_length: paper.focal_length * 1.01, ..paper.clone() },
            Display { levels: 64, ..paper.clone() },
            Display { height: paper.height / 2, ..paper.clone() },
            Display { geometry: Geometry::FarField, ..paper.clone() },
            Display { wavelengths: paper.wavelengths[..2].to_vec(), ..paper.clone() },
            Display { dispersion: [(Color::Green, 1.3)].into(), ..paper.clone() },
            with("[model.all]\ncrosstalk = [[1.2, 2.0], [1.2, 2.0], [1.2, 2.0], [1.2, 2.0]]"),
            with("[source.all]\nkind = \"led\""),
            with("[prescription]\nsphere = -2.0"),
            with("[mask]\nfactor = 2\nseed = 1"),
            with("[mask]\nfactor = 2\nseed = 2"),
            with("[viewing]\nluminance_cd_m2 = 90.0"),
        ];
        let all: std::collections::HashSet<String> = others.iter().chain([&paper]).map(identity).collect();
        assert_eq!(all.len(), others.len() + 1);
    }

    #[test]
    fn a_folder_that_cannot_be_is_refused() {
        let here = tempfile::tempdir().unwrap();
        writable(&here.path().join("new/folder")).unwrap();
        assert!(!here.path().join("new").exists(), "the attempt leaves no folder");
        std::fs::write(here.path().join("file"), "x").unwrap();
        let in_the_way = writable(&here.path().join("file/folder"));
        assert!(matches!(&in_the_way, Err(FileError::Taken { path, .. }) if path.ends_with("file")), "{in_the_way:?}");
    }
}
