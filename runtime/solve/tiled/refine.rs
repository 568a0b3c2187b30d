//! Extracts a piece of a hologram in tiles as an ordinary problem, for refinement at the eye.

use super::{TiledError, Views};
use crate::hologram::Tiles;
use crate::optics::{Padding, Pupil, PupilDistribution};
use crate::plan::ModelTables;
use crate::solve::Problem;

/// The position of whole tiles in a far field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileRect {
    /// Row and column of the first pixel.
    pub at: [usize; 2],
    /// Number of rows and columns.
    pub size: [usize; 2],
}

impl TileRect {
    /// Returns the tiles that hold every pupil of `aim` at color `color` of a hologram, seen through `model`.
    ///
    /// # Errors
    /// [`TiledError::Optics`] for a color without optics, and [`TiledError::Unsuitable`] for an aim outside the SLM.
    pub fn around(
        tiles: &Tiles,
        color: usize,
        model: Option<&ModelTables>,
        aim: &PupilDistribution,
    ) -> Result<Self, TiledError> {
        let whole = tiles.about().optics(color)?;
        let (first, side) = (whole.first_bin(), tiles.side() as f64);
        // This is the true position of the iris, with the surroundings from which crosstalk reaches into it.
        let spread = Pupil { x: aim.centre[0], y: aim.centre[1], diameter: 2.0 * aim.reach(), depth: 0.0 };
        let iris = model.map_or(spread, |model| model.model().true_pupil(&spread));
        let around = model.map_or([0; 2], |model| model.reach()).map(|pixels| pixels as f64 * whole.pitch);
        let axis = |s: f64, around: f64, first: i64, n: usize| {
            let tile = |metres: f64| (metres / whole.pitch - first as f64) / side;
            let last = n.div_ceil(tiles.side()) as f64;
            let reach = iris.diameter / 2.0 + around;
            // The SLM ends at its last pixel, and the clamp accepts numbers of any size.
            let (from, to) = (tile(s - reach).floor().max(0.0), (tile(s + reach).ceil()).min(last));
            (from < to).then(|| {
                let (from, to) = (from as usize * tiles.side(), (to as usize * tiles.side()).min(n));
                (from, to - from)
            })
        };
        let nowhere = || TiledError::Unsuitable("the eye: the pupil is outside the SLM".into());
        let (top, rows) = axis(iris.y, around[0], first.0, whole.height).ok_or_else(nowhere)?;
        let (left, columns) = axis(iris.x, around[1], first.1, whole.width).ok_or_else(nowhere)?;
        Ok(Self { at: [top, left], size: [rows, columns] })
    }

    /// Returns true if it holds all of another.
    pub fn covers(&self, other: &Self) -> bool {
        (0..2).all(|i| self.at[i] <= other.at[i] && other.at[i] + other.size[i] <= self.at[i] + self.size[i])
    }

    /// Returns the smallest rectangle that holds both.
    #[must_use]
    pub fn with(&self, other: &Self) -> Self {
        let at = [0, 1].map(|i| self.at[i].min(other.at[i]));
        let end = |one: &Self, i: usize| one.at[i] + one.size[i];
        Self { at, size: [0, 1].map(|i| end(self, i).max(end(other, i)) - at[i]) }
    }

    /// Returns the problem on these tiles, seen through `model`.
    ///
    /// It is a far field of its own on the axis of the whole one. Its eyebox is its side, around its middle.
    ///
    /// # Errors
    /// [`TiledError::Optics`] for a color without optics.
    pub fn problem(
        &self,
        tiles: &Tiles,
        color: usize,
        views: &Views,
        model: Option<&ModelTables>,
    ) -> Result<Problem, TiledError> {
        let Self { at: [top, left], size: [rows, columns] } = *self;
        let whole = tiles.about().optics(color)?;
        let at = [top as i64, left as i64];
        let optics = whole.piece(at, [rows, columns]);
        let model = model.map(|model| model.piece(at, [rows, columns]));
        let extent = rows.max(columns) as f64 * whole.pitch;
        let piece = Pupil { x: optics.center()[0], y: optics.center()[1], diameter: extent, depth: 0.0 };
        let from = model.as_ref().map_or(piece, |model| model.model().asked_pupil(&piece));
        let (pyramid, seen) = views.around([from.x, from.y], from.diameter);
        let level = pyramid.levels.last();
        let mean = level.map_or(0.0, |l| l.views.iter().map(|v| f64::from(*v)).sum::<f64>() / l.views.len() as f64);
        Ok(Problem {
            optics,
            padding: Padding::default(),
            eyebox: optics.eyebox(),
            views: seen.grid,
            center: seen.center,
            mean: mean * seen.unit,
            pyramid,
            share: views.share(),
            model,
            eye: None,
            modes: [].into(),
            regions: [].into(),
            choice: None,
        })
    }
}

/// Returns the tiles that hold every pupil of `aim` at color `color` of a hologram, and the problem on them. `views`
/// are its scene in that color.
///
/// # Errors
/// [`TiledError::Optics`] for a color without optics, and [`TiledError::Unsuitable`] for an aim outside the SLM.
pub fn problem_around(
    tiles: &Tiles,
    color: usize,
    views: &Views,
    aim: &PupilDistribution,
) -> Result<(TileRect, Problem), TiledError> {
    let model = tiles.model(color)?.map(|model| model.for_steps());
    let extent = TileRect::around(tiles, color, model.as_deref(), aim)?;
    Ok((extent, extent.problem(tiles, color, views, model.as_deref())?))
}
