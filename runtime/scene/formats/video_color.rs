//! Converts luma and color differences of a video to red, green and blue.

use crate::SceneError;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use std::path::Path;

/// The matrix of a video.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Matrix {
    /// The matrix of ITU-R BT.601, for standard definition. It is the default of YUV4MPEG2.
    Bt601,
    /// The matrix of ITU-R BT.709, for high definition.
    Bt709,
}

/// Rows and columns from which videos are high definition.
const HIGH_DEFINITION: [usize; 2] = [720, 1280];

pub(crate) fn is_high_definition([rows, columns]: [usize; 2]) -> bool {
    rows >= HIGH_DEFINITION[0] || columns >= HIGH_DEFINITION[1]
}

impl Matrix {
    /// Reads the matrix after the question mark of a source, as in `clip.y4m?matrix=bt709`.
    pub fn stated(source: &Path) -> Option<Self> {
        let (_, query) = source.to_str()?.rsplit_once('?')?;
        query.split('&').find_map(|part| Self::named(part.strip_prefix("matrix=")?).ok())
    }

    /// Reads the name of a matrix.
    pub fn named(name: &str) -> Result<Self, Reason> {
        match name.to_ascii_lowercase().as_str() {
            "bt601" | "smpte170m" | "bt470bg" => Ok(Self::Bt601),
            "bt709" => Ok(Self::Bt709),
            other => Err(reason!(
                "video-matrix",
                "its matrix is {other} instead of bt601 or bt709. Convert it by ffmpeg -i CLIP -vf \
                 scale=out_color_matrix=bt709"
            )),
        }
    }

    /// Determines the matrix of a video whose header states none. Files of ffmpeg have the matrix of the original film
    /// and do not state it. Others follow the format, unless they are high definition.
    ///
    /// # Errors
    /// [`SceneError::Matrix`] if the matrix is not known.
    pub fn usual(file: &str, [rows, columns]: [usize; 2], of_ffmpeg: bool) -> Result<Self, SceneError> {
        if of_ffmpeg || is_high_definition([rows, columns]) {
            return Err(SceneError::Matrix { file: file.into() });
        }
        Ok(Self::Bt601)
    }

    /// Returns red, green and blue of a luma and its color differences, each 0 to 1 for displayable colors.
    pub fn rgb(self, luma: f32, [cb, cr]: [f32; 2]) -> [f32; 3] {
        let [of_red, of_blue] = match self {
            Self::Bt601 => [0.299, 0.114],
            Self::Bt709 => [0.2126, 0.0722],
        };
        let (red, blue) = (luma + 2.0 * (1.0 - of_red) * cr, luma + 2.0 * (1.0 - of_blue) * cb);
        [red, (luma - of_red * red - of_blue * blue) / (1.0 - of_red - of_blue), blue]
    }
}

impl std::fmt::Display for Matrix {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if *self == Self::Bt601 { "BT.601" } else { "BT.709" })
    }
}

/// Refuses the frame structure of interlaced videos.
pub(crate) fn check_interlacing(word: &str) -> Result<(), Reason> {
    match word {
        "t" | "b" | "m" => Err(reason!(
            "interlaced",
            "it is interlaced, so each frame has two points in time. Deinterlace it by ffmpeg -i CLIP -vf yadif"
        )),
        _ => Ok(()),
    }
}

/// Refuses pixels that are not square.
pub(crate) fn check_aspect(word: &str) -> Result<(), Reason> {
    let sides = word.split_once(':').and_then(|(a, b)| Some((a.parse::<u32>().ok()?, b.parse::<u32>().ok()?)));
    match sides {
        Some((wide, high)) if wide != high && wide > 0 && high > 0 => Err(reason!(
            "pixel-aspect",
            "its pixels are {wide}:{high} and not square. Convert it by ffmpeg -i CLIP -vf scale=iw*sar:ih,setsar=1"
        )),
        _ => Ok(()),
    }
}
