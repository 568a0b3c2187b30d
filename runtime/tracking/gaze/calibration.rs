//! A user's calibration: tracker coordinates to metres in the pupil plane, affine, from a few fixations.

use super::GazeError;
use crate::trackers::{Unit, UnitText};
use eyebox_base::error::Reason;
use eyebox_base::files::{self, read};
use eyebox_base::reason;
use eyebox_optics::linear;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// An affine map of the plane: rows x and y of (x, y, 1).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Affine {
    /// Row of x.
    pub x: [f64; 3],
    /// Row of y.
    pub y: [f64; 3],
}

impl Affine {
    /// Where a point goes.
    pub fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.x, self.y].map(|row| row[0] * x + row[1] * y + row[2])
    }
}

/// One fixation: what the tracker said, and where the pupil was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Tracker coordinates, in the tracker's unit.
    pub tracker: [f64; 2],
    /// Metres in the pupil plane.
    pub pupil: [f64; 2],
}

/// A map and how well it fits. [`Calibration::load`] checks the numbers of a file, and deserialization alone does not.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "FitText", into = "FitText")]
pub struct Fit {
    /// Tracker coordinates to metres.
    pub map: Affine,
    /// The tracker's unit.
    pub unit: Unit,
    /// Root mean square of what is left at the fixations, metres.
    pub residual: f64,
    /// Fixations used, and given up as outliers.
    pub used: [usize; 2],
}

/// Fixations that are this far off together are no calibration, metres.
const LIMIT: f64 = 1.5e-3;
/// A map leaves no larger share of the distances of the pupils from their middle. A tracker that shows nothing of the eye leaves
/// half of them with four fixations, and more with more.
const LEFT: f64 = 0.4;
/// An outlier is at least this far from what the others say, metres.
const OUTLIER: f64 = 0.5e-3;

impl Fit {
    /// Fits the map by least squares. A fixation that lies three times as far from what the others say as they among
    /// themselves is left out, a quarter of them at most.
    ///
    /// # Errors
    /// [`GazeError::TooFew`], [`GazeError::Disagree`].
    pub fn new(pairs: &[Pair], unit: Unit) -> Result<Self, GazeError> {
        let finite = |p: &&Pair| p.tracker.iter().chain(&p.pupil).all(|v| v.is_finite());
        let mut kept: Vec<Pair> = pairs.iter().filter(finite).copied().collect();
        let least = kept.len() - kept.len() / 4;
        loop {
            // Three fixations fit any tracker exactly: nothing would show whether it follows the eye.
            let enough = Some(&kept).filter(|kept| kept.len() > 3);
            let map = enough
                .and_then(|kept| solve(kept))
                .ok_or_else(|| GazeError::TooFew(format!(": there are {}", kept.len())))?;
            // With four, every one agrees with a map of the other three but one's own.
            if kept.len() > least && kept.len() >= 5 {
                let worst = (0..kept.len())
                    .filter_map(|i| {
                        let mut others = kept.clone();
                        let one = others.swap_remove(i);
                        let map = solve(&others)?;
                        Some((i, off(&map, &one), rms(&map, &others)))
                    })
                    .filter(|(_, far, rest)| *far > OUTLIER && *far > 3.0 * rest)
                    .max_by(|a, b| (a.1 / (a.2 + 1e-5)).total_cmp(&(b.1 / (b.2 + 1e-5))));
                if let Some((i, ..)) = worst {
                    kept.swap_remove(i);
                    continue;
                }
            }
            let (residual, limit) = (rms(&map, &kept), LIMIT.min(LEFT * spread(&kept)));
            if residual > limit || !residual.is_finite() {
                return Err(GazeError::Disagree { rms_mm: residual * 1e3, limit_mm: limit * 1e3 });
            }
            return Ok(Self { map, unit, residual, used: [kept.len(), pairs.len() - kept.len()] });
        }
    }
}

fn off(map: &Affine, pair: &Pair) -> f64 {
    let [x, y] = map.apply(pair.tracker);
    (x - pair.pupil[0]).hypot(y - pair.pupil[1])
}

fn rms(map: &Affine, pairs: &[Pair]) -> f64 {
    (pairs.iter().map(|p| off(map, p).powi(2)).sum::<f64>() / pairs.len().max(1) as f64).sqrt()
}

/// Root mean square distance of the pupils from their middle.
fn spread(pairs: &[Pair]) -> f64 {
    let n = pairs.len().max(1) as f64;
    let middle = [0, 1].map(|i| pairs.iter().map(|p| p.pupil[i]).sum::<f64>() / n);
    (pairs.iter().map(|p| (p.pupil[0] - middle[0]).powi(2) + (p.pupil[1] - middle[1]).powi(2)).sum::<f64>() / n).sqrt()
}

/// Least squares around the mean, so that no unit or origin spoils the numbers; `None` where the points are on a line.
fn solve(pairs: &[Pair]) -> Option<Affine> {
    if pairs.len() < 3 {
        return None;
    }
    let n = pairs.len() as f64;
    let mean = |f: fn(&Pair) -> f64| pairs.iter().map(f).sum::<f64>() / n;
    let centre = [mean(|p| p.tracker[0]), mean(|p| p.tracker[1])];
    let target = [mean(|p| p.pupil[0]), mean(|p| p.pupil[1])];
    let (mut xx, mut xy, mut yy, mut right) = (0.0, 0.0, 0.0, [[0.0; 2]; 2]);
    for p in pairs {
        let [x, y] = [p.tracker[0] - centre[0], p.tracker[1] - centre[1]];
        (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        for (i, row) in right.iter_mut().enumerate() {
            let t = p.pupil[i] - target[i];
            *row = [row[0] + x * t, row[1] + y * t];
        }
    }
    let determinant = xx * yy - xy * xy;
    // The narrow side of the cloud against its long side, squared.
    if !(determinant > 1e-4 * (xx + yy).powi(2) && determinant.is_finite()) {
        return None;
    }
    let row = |i: usize| {
        let slopes = linear::solve(&[vec![xx, xy], vec![xy, yy]], &right[i])?;
        Some([slopes[0], slopes[1], target[i] - slopes[0] * centre[0] - slopes[1] * centre[1]])
    };
    Some(Affine { x: row(0)?, y: row(1)? })
}

/// The maps of one user, as they are in a file.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Whose eyes.
    pub user: String,
    /// Name of the tracker that it was made with ([`Source::tracker`](crate::trackers::Source::tracker)), if it states one.
    pub tracker: Option<String>,
    /// Of the left eye.
    pub left: Option<Fit>,
    /// Of the right one.
    pub right: Option<Fit>,
    /// Of both.
    pub combined: Option<Fit>,
}

/// A map in a file, in millimetres of the pupil plane per unit of the tracker.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FitText {
    /// Unit of the tracker's readings.
    #[serde(with = "UnitText")]
    unit: Unit,
    /// The pupil's x in millimetres: constant, times the reading's x, times its y.
    x_mm: [f64; 3],
    /// Its y likewise.
    y_mm: [f64; 3],
    /// What is left of the targets, millimetres RMS.
    residual_mm: f64,
    /// Targets that were used, and shown.
    #[serde(default)]
    used: [usize; 2],
}

impl From<FitText> for Fit {
    fn from(text: FitText) -> Self {
        let scale = text.unit.of_stated();
        let row = |r: [f64; 3]| [r[0] * 1e-3 / scale, r[1] * 1e-3 / scale, r[2] * 1e-3];
        let map = Affine { x: row(text.x_mm), y: row(text.y_mm) };
        Self { map, unit: text.unit, residual: text.residual_mm * 1e-3, used: text.used }
    }
}

impl From<Fit> for FitText {
    fn from(fit: Fit) -> Self {
        let scale = fit.unit.of_stated();
        let row = |r: [f64; 3]| [r[0] * 1e3 * scale, r[1] * 1e3 * scale, r[2] * 1e3];
        let (x_mm, y_mm) = (row(fit.map.x), row(fit.map.y));
        Self { unit: fit.unit, x_mm, y_mm, residual_mm: fit.residual * 1e3, used: fit.used }
    }
}

impl Calibration {
    /// Reads a user's file.
    ///
    /// # Errors
    /// [`GazeError::File`], naming file, line and key.
    pub fn load(file: &Path) -> Result<Self, GazeError> {
        let text = read::text(file, read::TEXT).map_err(|e| GazeError::file(file, e.to_string()))?;
        Self::from_toml(&text).map_err(|reason| GazeError::file(file, reason))
    }

    /// Writes a user's file, whole or not at all.
    ///
    /// # Errors
    /// [`GazeError::File`].
    pub fn save(&self, file: &Path) -> Result<(), GazeError> {
        let text = self.to_toml();
        files::write_file(file, |out| out.write_all(text.as_bytes())).map_err(|e| GazeError::file(file, e.to_string()))
    }

    /// Reads the text of such a file.
    ///
    /// # Errors
    /// What is wrong, with its line or key.
    pub fn from_toml(text: &str) -> Result<Self, Reason> {
        let found: Self = read::toml(text)?;
        let maps = [("left", found.left), ("right", found.right), ("combined", found.combined)];
        for (name, fit) in maps.iter().filter_map(|(name, fit)| Some((name, fit.as_ref()?))) {
            let mut numbers = fit.map.x.iter().chain(&fit.map.y).chain([&fit.residual]);
            if !numbers.all(|v| v.is_finite()) || fit.residual < 0.0 {
                return Err(reason!("not-finite", "{name}: every number must be finite, the residual not negative"));
            }
        }
        if maps.iter().all(|(_, fit)| fit.is_none()) {
            return Err(reason!("no-map", "no map: give [left], [right] or [combined]"));
        }
        Ok(found)
    }

    /// A note for people if it was made with another tracker than the one of this name. Two trackers of one unit place the same
    /// reading differently, which nothing in a sample shows.
    pub fn note_on(&self, tracker: &str) -> Option<String> {
        let made_with = self.tracker.as_deref().filter(|made_with| *made_with != tracker)?;
        Some(format!(
            "the calibration of {} was made with the tracker {made_with}, and this one is {tracker}: its pupils are in wrong \
             places unless it is the same; calibrate it anew",
            self.user
        ))
    }

    /// The text of such a file.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }
}
