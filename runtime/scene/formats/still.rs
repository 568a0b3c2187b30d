//! Reads one picture, which is a file of its own or a frame of a video.

use crate::formats::halves::Half;
use crate::formats::options::{self, Options};
use crate::formats::tone::{Reading, Tone};
use crate::formats::video_color::Matrix;
use crate::light_field::light::{FullScale, Picture};
use crate::light_field::near::GrayValues;
use crate::{SceneError, formats::picture, formats::video};
use eyebox_base::files::{Wanted, picture_orientation};
use eyebox_optics::Color;
use std::path::{Path, PathBuf};

/// Returns rows and columns, from the header alone.
pub(crate) fn size(path: &Path) -> Result<[usize; 2], SceneError> {
    let whole = match video::named(path) {
        Some((file, _)) => video::size(&file)?,
        None => picture::size(parts(path)?.0, picture::ONE)?,
    };
    Ok(half_of(path).map_or(whole, |half| half.size(whole)))
}

/// Reads the planes of `colors` in linear light.
pub(crate) fn read(path: &Path, colors: &[Color]) -> Result<Picture, SceneError> {
    let whole = match video::named(path) {
        Some((file, frame)) => video::read(&file, frame.unwrap_or(0), colors, Matrix::stated(path))?,
        None => {
            let (file, tone) = parts(path)?;
            let reading = Reading::new(tone);
            let picture = picture::read(file, picture::ONE, colors, &reading)?;
            reading.judge(file, FullScale::File)?;
            picture
        }
    };
    Ok(match half_of(path) {
        Some(half) => half.picture(whole),
        None => whole,
    })
}

/// Returns the EXIF orientation by which a picture is rotated, 1 to 8. The value 1 means as stored.
pub(crate) fn orientation(path: &Path) -> Result<u8, SceneError> {
    if video::named(path).is_some() { Ok(1) } else { Ok(picture_orientation(parts(path)?.0, Wanted::Scene)?) }
}

/// Returns the half that a source shows. It is the one that `half` names, or the other half if `depth` names one.
fn half_of(source: &Path) -> Option<Half> {
    let half = |key: &str| query(source)?.split('&').find_map(|part| Half::named(part.strip_prefix(key)?).ok());
    half("half=").or_else(|| half("depth=").map(Half::other))
}

fn query(source: &Path) -> Option<&str> {
    let text = source.to_str()?;
    match options::parts(text).1 {
        "" => None,
        query => Some(query),
    }
}

/// Returns the source of the depth map that a picture has in one of its halves.
pub(crate) fn map_in(source: &Path) -> Option<PathBuf> {
    let query = query(source)?;
    if !query.split('&').any(|part| part.starts_with("depth=")) {
        return None;
    }
    let halves =
        query.split('&').map(|part| part.strip_prefix("depth=").map_or(part.to_owned(), |half| format!("half={half}")));
    let halves: Vec<String> = halves.collect();
    Some(format!("{}?{}", options::parts(source.to_str()?).0.display(), halves.join("&")).into())
}

/// Returns the file of a picture, and the statements after its question mark.
fn parts(path: &Path) -> Result<(&Path, Tone), SceneError> {
    let Some(text) = path.to_str() else { return Ok((path, Tone::default())) };
    let (file, query) = options::parts(text);
    let options = Options::parse(query, false);
    let options = options.map_err(|reason| SceneError::Options { scene: text.into(), reason })?;
    Ok((file, options.tone))
}

/// Reads the stored values of a gray picture.
pub(crate) fn stored(path: &Path) -> Result<GrayValues, SceneError> {
    let half = half_of(path);
    match video::named(path) {
        None => picture::stored(parts(path)?.0, half),
        Some((file, frame)) => {
            let whole = video::stored(&file, frame.unwrap_or(0))?;
            Ok(match half {
                Some(half) => half.values(whole),
                None => whole,
            })
        }
    }
}
