//! Records the scene from which a hologram was solved, with its identity and its path.

use super::{Hologram, HologramError};
use crate::files::FileRecord;
use crate::optics::Color;
use crate::scene::{self, LightField, SceneError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The identity of a scene.
///
/// The contents of its files identify a scene of files. The views identify a light field of a calling program, and the
/// name identifies a built-in scene.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SceneRecord {
    /// The source as it was named.
    pub source: String,
    /// The file or folder of the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<FileRecord>,
    /// The depth map of a single picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_map: Option<FileRecord>,
    /// The digest of each color's views, for a light field that was read from no file.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub views: BTreeMap<Color, String>,
}

impl SceneRecord {
    /// Returns the record of a scene that is about to be read, with its depth map.
    ///
    /// # Errors
    /// Returns [`SceneError`] for a source that cannot be read.
    pub fn of_source(source: &str, depth_map: Option<&Path>) -> Result<Self, SceneError> {
        let file = match (scene::path_and_options(source), scene::digest(source)?) {
            (Some((path, options)), Some(digest)) => Some(FileRecord::new(&path, options, digest)),
            _ => None,
        };
        let mut record = Self { source: source.into(), file, ..Self::default() };
        record.set_depth_map(depth_map)?;
        Ok(record)
    }

    /// Returns the record of a light field of the calling program, which holograms know by `name`.
    pub fn of_views(name: &str, field: &LightField) -> Self {
        Self { source: name.into(), views: field.digests(), ..Self::default() }
    }

    /// Sets the depth map with which the scene was read.
    ///
    /// # Errors
    /// Returns [`SceneError`] for a map that cannot be read.
    pub fn set_depth_map(&mut self, map: Option<&Path>) -> Result<(), SceneError> {
        self.depth_map = map.map(record_of_map).transpose()?;
        Ok(())
    }

    /// Returns a source as it was named. If it has no options, the options of the recorded source are added.
    pub(crate) fn source_of(&self, named: &str) -> String {
        let options = self.file.as_ref().and_then(|file| file.options.as_ref());
        match (options, scene::path_and_options(named)) {
            (Some(options), Some((path, ""))) if path.is_file() => format!("{named}?{options}"),
            _ => named.into(),
        }
    }

    /// Returns true if only its name identifies it.
    pub fn is_only_named(&self) -> bool {
        self.file.is_none() && self.views.is_empty()
    }

    /// Returns true if both are the same scene, in these colors.
    fn is_same(&self, other: &Self, colors: &[Color]) -> bool {
        match (&self.file, &other.file) {
            (Some(own), Some(given)) => {
                own.digest == given.digest && digest_of(self.depth_map.as_ref()) == digest_of(other.depth_map.as_ref())
            }
            (None, None) if !self.views.is_empty() => {
                colors.iter().all(|color| self.views.get(color).is_some_and(|own| Some(own) == other.views.get(color)))
            }
            (None, None) => other.views.is_empty() && scene::is_named(&other.source, &self.source),
            _ => false,
        }
    }

    /// Returns all records of its files.
    pub(super) fn files_mut(&mut self) -> impl Iterator<Item = &mut FileRecord> {
        self.file.iter_mut().chain(&mut self.depth_map)
    }
}

fn digest_of(file: Option<&FileRecord>) -> Option<&str> {
    file.map(|file| &file.digest[..])
}

fn record_of_map(map: &Path) -> Result<FileRecord, SceneError> {
    let digest = scene::digest_of_picture(map)?;
    let (path, options) = map.to_str().and_then(scene::path_and_options).unwrap_or_else(|| (map.into(), ""));
    Ok(FileRecord::new(&path, options, digest))
}

impl Hologram {
    /// Returns the record of its scene. Returns none if it names no scene, or if its file is of a version that stored
    /// the name alone.
    pub fn scene_record(&self) -> Option<SceneRecord> {
        match self.metadata.scenes.first() {
            Some(record) => Some(record.clone()),
            None if self.scene.starts_with("builtin:") => {
                Some(SceneRecord { source: self.scene.clone(), ..SceneRecord::default() })
            }
            None => None,
        }
    }

    /// Sets the scene that it shows.
    pub fn set_scene(&mut self, name: &str, record: SceneRecord) {
        self.scene = name.into();
        self.metadata.scenes = if record.is_only_named() { Vec::new() } else { vec![record] };
    }

    /// Refuses another scene than its own. It compares the contents of both, or their names if the file is of a version
    /// that stored only the name. A hologram that names no scene may show any.
    ///
    /// # Errors
    /// Returns [`HologramError::OtherScene`] for another scene.
    pub fn check_is_of(&self, given: &SceneRecord) -> Result<(), HologramError> {
        let Some(own) = self.scene_record() else { return self.check_name(&given.source) };
        if own.is_same(given, &self.named_colors()) {
            return Ok(());
        }
        let name = |source: &str| if source.is_empty() { "an array".into() } else { source.to_owned() };
        Err(HologramError::OtherScene { shows: name(&own.source), given: name(&given.source) })
    }

    /// Refuses a named source that is another scene. The source is read for that.
    ///
    /// # Errors
    /// Returns [`HologramError::OtherScene`], or [`HologramError::Scene`] for a source that cannot be read.
    pub fn check_scene(&self, source: &str) -> Result<(), HologramError> {
        let Some(own) = self.scene_record() else { return self.check_name(source) };
        let given = SceneRecord::of_source(source, None)?;
        // The depth map is found together with the scene.
        self.check_is_of(&SceneRecord { depth_map: own.depth_map, ..given })
    }

    fn check_name(&self, source: &str) -> Result<(), HologramError> {
        if self.scene.is_empty() || scene::is_named(source, &self.scene) {
            return Ok(());
        }
        Err(HologramError::OtherScene { shows: self.scene.clone(), given: source.into() })
    }
}
