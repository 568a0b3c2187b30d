//! Holds the pictures of a folder that make one scene by its settings.

use crate::SceneError;
use crate::formats::picture;
use crate::read::settings::Settings;
use eyebox_base::files::holds_light;
use std::path::PathBuf;

/// The pictures of a folder with their settings.
pub(crate) struct Pictures {
    pub stated: Settings,
    /// The pictures in the order of their numbers.
    pub paths: Vec<PathBuf>,
    /// The file of the settings.
    pub file: PathBuf,
}

impl Pictures {
    /// Returns rows and columns of the pictures, which have one size.
    pub fn size(&self) -> Result<[usize; 2], SceneError> {
        picture::size_of_all(&self.paths, |first| first.display().to_string())
    }

    /// Returns the conversion of their values to light, for people.
    pub fn transfer(&self) -> String {
        match self.stated.tone.transfer {
            Some(_) => "as stated".into(),
            None => holds_light(&self.paths[0]).map_or("sRGB".into(), |kind| format!("linear ({kind})")),
        }
    }
}
