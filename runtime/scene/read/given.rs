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
use eyebox_base::files::picture_layers;
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
    let paths: Vec<PathBuf> = pictures.into_iter().map(|name| folder.join(name)).collect();
    let layers = match &values {
        Values::Focus(..) => None,
        Values::Dioptres(_) => layers(&paths)?,
    };
    let (count, what) = match &layers {
        Some(layers) => (layers.len(), "layers in its EXR file"),
        None => (paths.len(), "pictures"),
    };
    if count != wanted || paths.is_empty() {
        let has =
            format!("but the folder has {count} {what}. Give one for each, in the order of the numbers in their names");
        return wrong(match values {
            Values::Focus(..) => reason!("focus-count", "focus_mm has {wanted} depths, {has}"),
            Values::Dioptres(_) => reason!("layers-count", "layers_dioptres has {wanted} vergences, {has}"),
        });
    }
    let pictures = Pictures { stated, paths, file };
    Ok(Some(match values {
        Values::Focus(focus, aperture) => Given::Stack(FocalStack { pictures, focus, aperture }),
        Values::Dioptres(dioptres) => Given::Planes(Planes { pictures, layers, dioptres }),
    }))
}

/// Returns the layers of a single EXR file that are pictures, or `None` if the files are.
fn layers(paths: &[PathBuf]) -> Result<Option<Vec<u16>>, SceneError> {
    let [path] = paths else { return Ok(None) };
    let names = picture_layers(path)?;
    if names.len() < 2 {
        return Ok(None);
    }
    let mut order: Vec<u16> = (0..=u16::MAX).take(names.len()).collect();
    order.sort_by_cached_key(|index| natural::natural(&names[usize::from(*index)]));
    Ok(Some(order))
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

#[cfg(test)]
mod tests {
    use crate::{Request, SceneError, load};
    use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, SmallVec, WritableImage};
    use eyebox_optics::{Color, Display};
    use std::fs;

    const SIDE: usize = 16;

    /// The light of a layer. The near one covers the middle.
    fn value(near: bool, i: usize, channel: usize) -> f32 {
        let (y, x) = (i / SIDE, i % SIDE);
        let opacity = if near && !((4..12).contains(&x) && (4..12).contains(&y)) { 0.0 } else { 1.0 };
        let light = [0.1 + 0.05 * x as f32, 0.9 - 0.05 * y as f32, 0.5];
        if channel == 3 { opacity } else { opacity * light[channel] * if near { 0.5 } else { 1.0 } }
    }

    #[test]
    fn layers_of_an_exr_file_are_those_of_several_files() {
        let here = tempfile::tempdir().unwrap();
        let [several, one] = ["several", "one"].map(|name| here.path().join(name));
        for folder in [&several, &one] {
            fs::create_dir(folder).unwrap();
            fs::write(folder.join("lightfield.toml"), "layers_dioptres = [-0.005, 0.01]").unwrap();
        }
        let mut list: SmallVec<[AnyChannel<FlatSamples>; 4]> = SmallVec::new();
        // The file has the tenth layer before the ninth, by the alphabet.
        for (near, number) in [(false, 9), (true, 10)] {
            let picture = image::Rgba32FImage::from_fn(SIDE as u32, SIDE as u32, |x, y| {
                image::Rgba([0, 1, 2, 3].map(|channel| value(near, y as usize * SIDE + x as usize, channel)))
            });
            picture.save(several.join(format!("plane_{number}.exr"))).unwrap();
            for (channel, name) in ["R", "G", "B", "A"].iter().enumerate() {
                let values = (0..SIDE * SIDE).map(|i| value(near, i, channel)).collect();
                list.push(AnyChannel::new(format!("plane_{number}.{name}").as_str(), FlatSamples::F32(values)));
            }
        }
        let channels = AnyChannels::sort(list);
        Image::from_channels((SIDE, SIDE), channels).write().to_file(one.join("planes.exr")).unwrap();
        let display = Display { height: SIDE, width: SIDE, ..Display::preset("small").unwrap() };
        let request = Request { views: 3, ..Request::new(&display, &[Color::Red, Color::Green]) };
        let of = |folder: &std::path::Path| load(folder.to_str().unwrap(), &request).unwrap();
        let (wanted, found) = (of(&several), of(&one));
        assert_eq!((&wanted.planes, wanted.depth), (&found.planes, found.depth));
        // The near layer moves against the far one.
        let views = &found.planes[0];
        assert!(views[0] != views[views.len() - 1]);
        fs::write(one.join("lightfield.toml"), "layers_dioptres = [-0.005, 0.0, 0.01]").unwrap();
        let refused = load(one.to_str().unwrap(), &request).unwrap_err();
        assert!(
            matches!(&refused, SceneError::Settings { reason, .. } if reason.code() == "layers-count"),
            "{refused}"
        );
    }
}
