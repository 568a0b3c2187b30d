//! Reads frames of videos, of colors or of depths. The videos are YUV4MPEG2 (`.y4m`), or of another format that ffmpeg
//! decodes to it.
//!
//! `clip.y4m?frame=12` is the thirteenth frame, and `clip.y4m` alone is the first. The values are Y'CbCr of the stated
//! matrix (`clip.y4m?matrix=bt709`, or `XCOLORMATRIX=BT709` in the file), or of the format's matrix
//! ([`Matrix::usual`]). The range is limited unless the file has `XCOLORRANGE=FULL`. Samples are 4:2:0, 4:2:2, 4:4:4 or
//! gray, of 8 to 16 bits. The decoded values are sRGB.

use crate::SceneError;
use crate::formats::halves::Half;
use crate::formats::video_color::Matrix;
use crate::formats::y4m::Video;
use crate::formats::{decoded, decoder};
use crate::light_field::light::Picture;
use crate::light_field::near::GrayValues;
use eyebox_base::reason;
use eyebox_optics::Color;
use std::path::{Path, PathBuf};

/// Returns the file and the number of the frame that a path names. It returns `None` if the path names no video.
pub(crate) fn named(path: &Path) -> Option<(PathBuf, Option<usize>)> {
    let is_video = |path: &Path| is_y4m(path) || decoder::decodes(path);
    if is_video(path) {
        return Some((path.into(), None));
    }
    let (file, query) = path.to_str()?.rsplit_once('?')?;
    let mut frame = None;
    for part in query.split('&') {
        match part.split_once('=')? {
            ("frame", number) => frame = Some(number.parse().ok()?),
            ("matrix", name) => drop(Matrix::named(name).ok()?),
            ("depth" | "half", name) => drop(Half::named(name).ok()?),
            _ => return None,
        }
    }
    is_video(Path::new(file)).then(|| (file.into(), frame))
}

fn is_y4m(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("y4m"))
}

/// Returns the name of a frame. `video` may have options of its own.
pub(crate) fn frame(video: &Path, frame: usize) -> String {
    let has_options = named(video).is_some_and(|(file, _)| file != video);
    let next = if has_options { '&' } else { '?' };
    format!("{}{next}frame={frame}", video.display())
}

/// Returns the number of frames of a video.
pub(crate) fn count(video: &Path) -> Result<usize, SceneError> {
    if !is_y4m(video) {
        return decoded::count(video);
    }
    let mut video = Video::open(video)?;
    let mut count = 0;
    while video.skip()? {
        count += 1;
    }
    Ok(count)
}

/// Returns rows and columns of a frame.
pub(crate) fn size(video: &Path) -> Result<[usize; 2], SceneError> {
    if is_y4m(video) { Ok(Video::open(video)?.layout.size) } else { decoded::size(video) }
}

/// Reads the planes of `colors` of a frame in linear light. `matrix` is the stated matrix.
pub(crate) fn read(
    video: &Path,
    frame: usize,
    colors: &[Color],
    matrix: Option<Matrix>,
) -> Result<Picture, SceneError> {
    if !is_y4m(video) {
        if matrix.is_some() {
            let reason = reason!("video-matrix-stated", "its file states the matrix, so leave out matrix=");
            return Err(SceneError::Options { scene: video.display().to_string(), reason });
        }
        return decoded::read(video, frame, colors);
    }
    let mut video = Video::open(video)?;
    let bytes = video.frame(frame)?;
    let layout = &video.layout;
    let matrix = match matrix.or(layout.matrix) {
        Some(matrix) => matrix,
        None if layout.chroma.is_none() => Matrix::Bt601,
        None => Matrix::usual(&layout.name, layout.size, layout.of_ffmpeg)?,
    };
    let [height, width] = layout.size;
    let planes = layout.planes(&bytes, colors, matrix);
    let range = if layout.full { "full" } else { "limited" };
    let read_as = match layout.chroma {
        Some(_) => format!("{matrix}, {range} range, sRGB"),
        None => format!("gray, {range} range, sRGB"),
    };
    Ok(Picture { height, width, planes, read_as })
}

/// Reads the luma of a frame, as values of 8 or of 16 bits.
pub(crate) fn stored(video: &Path, frame: usize) -> Result<GrayValues, SceneError> {
    if !is_y4m(video) {
        return decoded::stored(video, frame);
    }
    let mut video = Video::open(video)?;
    let bytes = video.frame(frame)?;
    Ok(video.layout.stored(&bytes, video.layout.bits > 8))
}

/// Returns the data from which a frame is decoded, which are the first line of its file and its samples.
pub(crate) fn stored_parts(video: &Path, frame: usize) -> Result<(String, Vec<u8>), SceneError> {
    if !is_y4m(video) {
        return decoded::stored_parts(video, frame);
    }
    let mut video = Video::open(video)?;
    let samples = video.frame(frame)?;
    Ok((video.head + "\n", samples))
}

#[cfg(test)]
#[path = "video_tests.rs"]
mod tests;
