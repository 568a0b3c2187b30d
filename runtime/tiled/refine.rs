//! A piece of a hologram in tiles as an ordinary problem: what is refined where the eye is.

use super::{TiledError, Views};
use crate::hologram::Tiles;
use crate::optics::{Padding, PupilDistribution};
use crate::solve::Problem;

/// Where whole tiles lie in a far field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extent {
    /// Row and column of the first pixel.
    pub at: [usize; 2],
    /// Rows and columns.
    pub size: [usize; 2],
}

impl Extent {
    /// The tiles that hold every pupil of `aim` at colour `color` of a hologram.
    ///
    /// # Errors
    /// [`TiledError::Optics`]; [`TiledError::Unsuitable`] for an aim that is nowhere on the SLM.
    pub fn around(tiles: &Tiles, color: usize, aim: &PupilDistribution) -> Result<Self, TiledError> {
        let whole = tiles.about().optics(color)?;
        let (first, side) = (whole.first_bin(), tiles.side() as f64);
        let axis = |s: f64, first: i64, n: usize| {
            let tile = |metres: f64| (metres / whole.pitch - first as f64) / side;
            let last = n.div_ceil(tiles.side()) as f64;
            // Beyond the last pixel there is nothing, and nobody's number is too large to be clamped.
            let (from, to) = (tile(s - aim.reach()).floor().max(0.0), (tile(s + aim.reach()).ceil()).min(last));
            (from < to).then(|| {
                let (from, to) = (from as usize * tiles.side(), (to as usize * tiles.side()).min(n));
                (from, to - from)
            })
        };
        let nowhere = || TiledError::Unsuitable("the eye looks past the SLM: no pixel of it is under the pupil".into());
        let (top, rows) = axis(aim.centre[1], first.0, whole.height).ok_or_else(nowhere)?;
        let (left, columns) = axis(aim.centre[0], first.1, whole.width).ok_or_else(nowhere)?;
        Ok(Self { at: [top, left], size: [rows, columns] })
    }

    /// Whether it holds all of another.
    pub fn covers(&self, other: &Self) -> bool {
        (0..2).all(|i| self.at[i] <= other.at[i] && other.at[i] + other.size[i] <= self.at[i] + self.size[i])
    }
}

/// The tiles that hold every pupil of an aim, and the problem on them.
pub struct Piece {
    /// Row and column of its first pixel.
    pub at: [usize; 2],
    /// Rows and columns.
    pub size: [usize; 2],
    /// A far field of its own, on the whole one's axis; its eyebox is its side, around its middle.
    pub problem: Problem,
}

impl Piece {
    /// Where `aim` looks at colour `color` of a hologram, whose scene in that colour is `views`.
    ///
    /// # Errors
    /// [`TiledError::Optics`]; [`TiledError::Unsuitable`] for an aim that is nowhere on the SLM.
    pub fn around(tiles: &Tiles, color: usize, views: &Views, aim: &PupilDistribution) -> Result<Self, TiledError> {
        let whole = tiles.about().optics(color)?;
        let Extent { at, size: [rows, columns] } = Extent::around(tiles, color, aim)?;
        let optics = whole.piece(at, [rows, columns]);
        let extent = rows.max(columns) as f64 * whole.pitch;
        let (pyramid, seen) = views.around(optics.center(), extent);
        let level = pyramid.levels.last();
        let mean = level.map_or(0.0, |l| l.views.iter().map(|v| f64::from(*v)).sum::<f64>() / l.views.len() as f64);
        let problem = Problem {
            optics,
            padding: Padding::default(),
            eyebox: optics.eyebox(),
            views: seen.grid,
            center: seen.center,
            mean: mean * seen.unit,
            pyramid,
            share: views.share(),
            model: None,
            eye: None,
        };
        Ok(Self { at, size: [rows, columns], problem })
    }
}
