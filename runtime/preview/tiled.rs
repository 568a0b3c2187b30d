//! What is seen, and should be seen, of a far field in tiles: what is read and computed follows the pupil, and the
//! hologram may be larger than memory.

use super::PreviewError;
use super::eye::Detail;
use super::picture::Plane;
use crate::engine::Engine;
use crate::evaluate;
use crate::hologram::Tiles;
use crate::optics::{Pupil, WindowFactor};
use crate::tiled::{self, Views};

/// Pixels of the SLM across the pupil of a coarse picture.
const ACROSS: f64 = 384.0;

/// Each colour through the pupil, as `eyebox view` has it: what the pupil resolves, two samples averaged to one along each
/// axis. A coarse picture is what the middle of the pupil sees: fewer tiles, fewer details, the same parallax and light.
pub(super) fn look(
    tiles: &Tiles,
    frame: Option<usize>,
    pupil: &Pupil,
    detail: Detail,
    engine: &mut dyn Engine,
) -> Result<Vec<Plane>, PreviewError> {
    let about = tiles.about();
    let pupil = match detail {
        Detail::Whole => *pupil,
        Detail::Coarse => Pupil { diameter: (ACROSS * about.pitch).min(pupil.diameter / 2.0), ..*pupil },
    };
    let frames = frame.map_or(0..about.frames, |f| f..f + 1);
    let one = |color| {
        let seen = tiled::look_frames(tiles, color, frames.clone(), &pupil, WindowFactor::Two, engine)?;
        Ok(pooled(&seen))
    };
    (0..about.colors.len()).map(one).collect()
}

/// The scene's photograph in each colour, in the samples of a whole picture.
pub(super) fn photograph(
    tiles: &Tiles,
    views: &[Views],
    pupil: &Pupil,
    engine: &mut dyn Engine,
) -> Result<Vec<Plane>, PreviewError> {
    let one = |(color, views): (usize, &Views)| {
        Ok(pooled(&tiled::photograph_of(tiles, color, views, pupil, WindowFactor::Two, engine)?))
    };
    views.iter().enumerate().map(one).collect()
}

fn pooled(seen: &tiled::Seen) -> Plane {
    let n = (seen.size / 2).max(1);
    Plane { rows: n, columns: n, values: evaluate::pool2(&seen.image, seen.size, seen.size) }
}
