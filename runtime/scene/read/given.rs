//! Finds the pictures of a folder whose settings give a number for each picture, in the order of the numbers in their
//! names. They are focal stacks and multi-plane images.

use crate::read::pictures::Pictures;
use crate::read::planes::Planes;
use crate::read::settings::{self, SETTINGS};
use crate::read::stack::FocalStack;
use crate::read::views::Read;
use crate::{Request, SceneError};
use crate::{light_field::natural, read::names};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use std::path::{Path, PathBuf};

/// The values that the settings give.
enum Values {
    /// The depth at which each picture is sharp, and the diameter of the aperture, in meters.
    Focus(Vec<f64>, f64),
    /// Vergence of each picture in diopters.
    Dioptres(Vec<f64>),
}

/// A folder whose settings make one scene of its pictures.
pub(crate) enum Given {
    Stack(FocalStack),
    Planes(Planes),
}

/// Returns the scene that the settings of a folder make of its pictures. It returns `None` for other folders.
///
/// # Errors
/// [`SceneError::Settings`] if the numbers of values and pictures differ, or if nothing states an aperture.
pub(crate) fn find(folder: &Path) -> Result<Option<Given>, SceneError> {
    let file = folder.join(SETTINGS[0]);
    if !file.exists() {
        return Ok(None);
    }
    let stated = settings::read(folder, &[SETTINGS[0].into()])?;
    let wrong = |reason: Reason| Err(SceneError::Settings { file: file.display().to_string(), reason });
    let values = match (&stated.focus, stated.aperture, &stated.layers) {
        (None, None, None) => return Ok(None),
        (Some(focus), Some(aperture), _) => Values::Focus(focus.clone(), aperture),
        (None, None, Some(dioptres)) => Values::Dioptres(dioptres.clone()),
        (Some(_), None, _) => {
            return wrong(reason!(
                "focus-without-aperture",
                "focus_mm needs aperture_mm, the diameter of the pupil that saw the pictures, as in aperture_mm = 12"
            ));
        }
        (None, Some(_), _) => {
            return wrong(reason!(
                "aperture-without-focus",
                "aperture_mm needs focus_mm, the depth at which each picture is sharp, as in focus_mm = [-3, 0, 3]"
            ));
        }
    };
    let is_one = |name: &String| match &stated.files {
        Some(files) => names::matches(files, name),
        None => !names::is_auxiliary(name),
    };
    let mut pictures = natural::files(folder)?;
    pictures.retain(|name| natural::is_picture(name) && is_one(name));
    let wanted = match &values {
        Values::Focus(values, _) | Values::Dioptres(values) => values.len(),
    };
    if pictures.len() != wanted || pictures.is_empty() {
        let has = format!(
            "but the folder has {} pictures. Give one for each, in the order of the numbers in their names",
            pictures.len()
        );
        return wrong(match values {
            Values::Focus(..) => reason!("focus-count", "focus_mm has {wanted} depths, {has}"),
            Values::Dioptres(_) => reason!("layers-count", "layers_dioptres has {wanted} vergences, {has}"),
        });
    }
    let paths = pictures.into_iter().map(|name| folder.join(name)).collect();
    let pictures = Pictures { stated, paths, file };
    Ok(Some(match values {
        Values::Focus(focus, aperture) => Given::Stack(FocalStack { pictures, focus, aperture }),
        Values::Dioptres(dioptres) => Given::Planes(Planes { pictures, dioptres }),
    }))
}

impl Given {
    fn pictures(&self) -> &Pictures {
        match self {
            Self::Stack(stack) => &stack.pictures,
            Self::Planes(planes) => &planes.pictures,
        }
    }

    /// Returns the files that reading needs, with the settings file first.
    pub fn files(&self) -> Vec<PathBuf> {
        let Pictures { paths, file, .. } = self.pictures();
        [file].into_iter().chain(paths).cloned().collect()
    }

    /// Returns rows and columns of the pictures, which have one size.
    pub fn size(&self) -> Result<[usize; 2], SceneError> {
        self.pictures().size()
    }

    /// Reads the pictures and makes views of them.
    pub fn read(&self, folder: &Path, request: &Request) -> Result<Read, SceneError> {
        match self {
            Self::Stack(stack) => stack.read(folder, request),
            Self::Planes(planes) => planes.read(folder, request),
        }
    }
}
