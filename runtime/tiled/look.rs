//! What an eye sees of a hologram in tiles, and what it should see: only the tiles under the pupil are read.

use super::{TiledError, Views};
use crate::engine::{Buffer, Engine, Purpose};
use crate::evaluate::centered;
use crate::hologram::Tiles;
use crate::optics::{Optics, Pupil, WindowFactor};
use crate::plan::{Comparison, Kernel, Planner};
use crate::scene::crop_share;
use std::ops::Range;
use std::sync::Arc;

/// One colour through one pupil.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    /// Intensity over the pupil's share of the SLM, without exposure: the picture, its axis in the middle, row-major.
    pub image: Vec<f32>,
    /// Its rows, and its columns: as many as the pupil resolves, times the window's factor.
    pub size: usize,
}

/// What the pupil sees of colour `color`. Sub-frames go one after the other: memory follows the pupil's area.
///
/// # Errors
/// [`TiledError`].
pub fn look(
    tiles: &Tiles,
    color: usize,
    pupil: &Pupil,
    factor: WindowFactor,
    engine: &mut dyn Engine,
) -> Result<Seen, TiledError> {
    look_frames(tiles, color, 0..tiles.about().frames, pupil, factor, engine)
}

/// The same of some sub-frames alone.
///
/// # Errors
/// [`TiledError`].
///
/// # Panics
/// If there are no such sub-frames: the caller's mistake.
pub fn look_frames(
    tiles: &Tiles,
    color: usize,
    frames: Range<usize>,
    pupil: &Pupil,
    factor: WindowFactor,
    engine: &mut dyn Engine,
) -> Result<Seen, TiledError> {
    let about = tiles.about();
    assert!(!frames.is_empty() && frames.end <= about.frames, "sub-frames {frames:?} of {}", about.frames);
    let whole = about.optics(color)?;
    let (at, size) = under(&whole, pupil);
    let piece = whole.piece(at, size);
    let share = about.picture_share(color);
    let planner = Planner::new(piece, 1, factor);
    let all = Planner { frames: frames.len(), ..planner.clone() };
    let mut pupil_pass = all.pupil_pass(pupil, &Comparison::default());
    pupil_pass.intensity.frames = 1;
    let mut step = planner.view_step(vec![pupil_pass]);
    let phases = tiles.read(color, at, size)?;
    engine.load(&planner.shape(Purpose::View), None)?;
    for (f, frame) in phases.chunks_exact(size[0] * size[1]).skip(frames.start).take(frames.len()).enumerate() {
        engine.write(Buffer::Phases, frame)?;
        engine.run(&step)?;
        if f == 0 {
            step.list.retain(|d| d.kernel != Kernel::Transfer);
            step.pupil_passes[0].intensity.accumulate = 1;
        }
    }
    let n = step.pupil_passes[0].window.rows;
    Ok(Seen { image: picture(engine.read(Buffer::Image(0))?, n, share), size: n })
}

/// What the pupil should see, in the samples of [`look`].
///
/// # Errors
/// [`TiledError`].
pub fn photograph_of(
    tiles: &Tiles,
    color: usize,
    views: &Views,
    pupil: &Pupil,
    factor: WindowFactor,
    engine: &mut dyn Engine,
) -> Result<Seen, TiledError> {
    photograph_at(&tiles.about().optics(color)?, views, pupil, factor, engine)
}

/// What the pupil should see on the far-field SLM of `whole`.
///
/// # Errors
/// [`TiledError`].
pub fn photograph_at(
    whole: &Optics,
    views: &Views,
    pupil: &Pupil,
    factor: WindowFactor,
    engine: &mut dyn Engine,
) -> Result<Seen, TiledError> {
    let (at, size) = under(whole, pupil);
    let image = shot(&whole.piece(at, size), views, pupil, factor, engine)?;
    let n = (image.len() as f64).sqrt().round() as usize;
    Ok(Seen { image: picture(image, n, views.share()), size: n })
}

/// The photograph in the samples of a window on `grid`, its axis first.
pub(super) fn shot(
    grid: &Optics,
    views: &Views,
    pupil: &Pupil,
    factor: WindowFactor,
    engine: &mut dyn Engine,
) -> Result<Vec<f32>, TiledError> {
    let (pyramid, seen) = views.around([pupil.x, pupil.y], pupil.diameter);
    let planner = Planner { views: Some(seen), ..Planner::new(*grid, 1, factor) };
    let step = planner.photograph_step(vec![planner.pupil_pass(pupil, &Comparison::default())]);
    engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&pyramid)))?;
    engine.run(&step)?;
    Ok(engine.read(Buffer::Target(0))?)
}

/// The rectangle of pixels under a pupil: its first, and its size.
fn under(whole: &Optics, pupil: &Pupil) -> ([usize; 2], [usize; 2]) {
    let first = whole.first_bin();
    let axis = |s: f64, first: i64, n: usize| {
        let pixel = |at: f64| (at / whole.pitch - first as f64).clamp(0.0, n as f64 - 1.0);
        let (low, high) = (pixel(s - pupil.diameter / 2.0).floor(), pixel(s + pupil.diameter / 2.0).ceil());
        (low as usize, (high - low) as usize + 1)
    };
    let ((top, rows), (left, columns)) = (axis(pupil.y, first.0, whole.height), axis(pupil.x, first.1, whole.width));
    ([top, left], [rows, columns])
}

fn picture(image: Vec<f32>, n: usize, share: f64) -> Vec<f32> {
    let image = centered(&image, n, n);
    if share < 1.0 { crop_share(&image, n, n, share) } else { image }
}
