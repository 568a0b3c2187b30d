//! Which scene a hologram was solved from: what identifies it, and where it was.

use super::{Hologram, HologramError};
use crate::files::FileRecord;
use crate::optics::Color;
use crate::scene::{self, LightField, SceneError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// What identifies a scene.
///
/// A scene of files is identified by their contents, a light field of a program's own by its views, and a built-in scene by
/// its name.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SceneRecord {
    /// Its source as it was named.
    pub source: String,
    /// Its file or folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<FileRecord>,
    /// The depth map of a single picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_map: Option<FileRecord>,
    /// Of a light field that was read from no file: the digest of each color's views.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub views: BTreeMap<Color, String>,
}

impl SceneRecord {
    /// The record of a scene that is about to be read, with its depth map.
    ///
    /// # Errors
    /// [`SceneError`] for what cannot be read.
    pub fn of_source(source: &str, depth_map: Option<&Path>) -> Result<Self, SceneError> {
        let file = match (scene::path_and_options(source), scene::digest(source)?) {
            (Some((path, options)), Some(digest)) => Some(FileRecord::new(&path, options, digest)),
            _ => None,
        };
        let mut record = Self { source: source.into(), file, ..Self::default() };
        record.set_depth_map(depth_map)?;
        Ok(record)
    }

    /// The record of a light field of a program's own, which holograms know by `name`.
    pub fn of_views(name: &str, field: &LightField) -> Self {
        Self { source: name.into(), views: field.digests(), ..Self::default() }
    }

    /// It was read with this depth map.
    ///
    /// # Errors
    /// [`SceneError`] for a map that cannot be read.
    pub fn set_depth_map(&mut self, map: Option<&Path>) -> Result<(), SceneError> {
        self.depth_map = map.map(record_of_map).transpose()?;
        Ok(())
    }

    /// A source as it was named, with the options that its own was read with where it has none.
    pub(crate) fn source_of(&self, named: &str) -> String {
        let options = self.file.as_ref().and_then(|file| file.options.as_ref());
        match (options, scene::path_and_options(named)) {
            (Some(options), Some((path, ""))) if path.is_file() => format!("{named}?{options}"),
            _ => named.into(),
        }
    }

    /// Whether its name is all that identifies it.
    pub fn is_only_named(&self) -> bool {
        self.file.is_none() && self.views.is_empty()
    }

    /// Whether both are one scene, in these colors.
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

    /// All records of files that it has.
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
    /// The record of its scene; none where it names none, and where its file is of a version that kept the name alone.
    pub fn scene_record(&self) -> Option<SceneRecord> {
        match self.metadata.scenes.first() {
            Some(record) => Some(record.clone()),
            None if self.scene.starts_with("builtin:") => {
                Some(SceneRecord { source: self.scene.clone(), ..SceneRecord::default() })
            }
            None => None,
        }
    }

    /// It shows this scene.
    pub fn set_scene(&mut self, name: &str, record: SceneRecord) {
        self.scene = name.into();
        self.metadata.scenes = if record.is_only_named() { Vec::new() } else { vec![record] };
    }

    /// Refuses another scene than the one that it shows: by what was read of both, or by their names where its file is of a
    /// version that kept no more. A hologram that names no scene may show any.
    ///
    /// # Errors
    /// [`HologramError::OtherScene`].
    pub fn check_is_of(&self, given: &SceneRecord) -> Result<(), HologramError> {
        let Some(own) = self.scene_record() else { return self.check_name(&given.source) };
        if own.is_same(given, &self.named_colors()) {
            return Ok(());
        }
        let name = |source: &str| if source.is_empty() { "an array".into() } else { source.to_owned() };
        Err(HologramError::OtherScene { shows: name(&own.source), given: name(&given.source) })
    }

    /// The same for a source that is named, which is read for that.
    ///
    /// # Errors
    /// [`HologramError::OtherScene`]; [`HologramError::Scene`] for a source that cannot be read.
    pub fn check_scene(&self, source: &str) -> Result<(), HologramError> {
        let Some(own) = self.scene_record() else { return self.check_name(source) };
        let given = SceneRecord::of_source(source, None)?;
        // Its depth map is found with it.
        self.check_is_of(&SceneRecord { depth_map: own.depth_map, ..given })
    }

    fn check_name(&self, source: &str) -> Result<(), HologramError> {
        if self.scene.is_empty() || scene::is_named(source, &self.scene) {
            return Ok(());
        }
        Err(HologramError::OtherScene { shows: self.scene.clone(), given: source.into() })
    }
}
