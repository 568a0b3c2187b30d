//! Fits a user's calibration, an affine map from tracker coordinates to meters in the pupil plane.

use super::GazeError;
use crate::trackers::{Unit, UnitText};
use eyebox_base::error::Reason;
use eyebox_base::files::{self, read};
use eyebox_base::reason;
use eyebox_optics::linear;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// An affine map of the plane, with rows for x and y of (x, y, 1).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Affine {
    /// Coefficients of the mapped x.
    pub x: [f64; 3],
    /// Coefficients of the mapped y.
    pub y: [f64; 3],
}

impl Affine {
    /// Returns the point that this map assigns to a point.
    pub fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.x, self.y].map(|row| row[0] * x + row[1] * y + row[2])
    }
}

/// One fixation, with the tracker's reading and the true place of the pupil.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Tracker coordinates, in the tracker's unit.
    pub tracker: [f64; 2],
    /// Position in the pupil plane, meters.
    pub pupil: [f64; 2],
}

/// A map and the quality of its fit. [`Calibration::load`] checks the numbers of a file, and deserialization alone does
/// not.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "FitText", into = "FitText")]
pub struct Fit {
    /// The map from tracker coordinates to meters.
    pub map: Affine,
    /// The unit of the tracker's coordinates.
    pub unit: Unit,
    /// Root mean square distance at the fixations, meters.
    pub residual: f64,
    /// Number of fixations that were used, and of dropped outliers.
    pub used: [usize; 2],
}

/// Largest root mean square distance of an accepted calibration, meters.
const LIMIT: f64 = 1.5e-3;
/// Largest accepted share of the pupils' distances from their middle that the map leaves. A tracker that does not
/// follow the eye leaves half of them with four fixations, and more with more.
const LEFT: f64 = 0.4;
/// Least distance of an outlier from the map of the others, meters.
const OUTLIER: f64 = 0.5e-3;

impl Fit {
    /// Fits the map by least squares. A fixation is dropped if it is three times as far from the map of the others as
    /// they are themselves. At most a quarter of the fixations is dropped.
    ///
    /// # Errors
    /// [`GazeError::TooFew`] or [`GazeError::Disagree`] if the fixations do not determine a map.
    pub fn new(pairs: &[Pair], unit: Unit) -> Result<Self, GazeError> {
        let finite = |p: &&Pair| p.tracker.iter().chain(&p.pupil).all(|v| v.is_finite());
        let mut kept: Vec<Pair> = pairs.iter().filter(finite).copied().collect();
        let least = kept.len() - kept.len() / 4;
        loop {
            // Three fixations fit any tracker exactly, so they cannot show if it follows the eye.
            let enough = Some(&kept).filter(|kept| kept.len() > 3);
            let map = enough
                .and_then(|kept| solve(kept))
                .ok_or_else(|| GazeError::TooFew(format!(": there are {}", kept.len())))?;
            // With four fixations, each one looks like an outlier of the map of the other three.
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

/// Root mean square distance of the pupils from their middle, meters.
fn spread(pairs: &[Pair]) -> f64 {
    let n = pairs.len().max(1) as f64;
    let middle = [0, 1].map(|i| pairs.iter().map(|p| p.pupil[i]).sum::<f64>() / n);
    (pairs.iter().map(|p| (p.pupil[0] - middle[0]).powi(2) + (p.pupil[1] - middle[1]).powi(2)).sum::<f64>() / n).sqrt()
}

/// Least squares around the mean, so that the unit and the origin do not matter. The result is `None` if the points are
/// on a line.
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
    // Compares the square of the cloud's narrow side with the square of its long side.
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
    /// Name of the user.
    pub user: String,
    /// Name of the tracker that it was made with ([`Source::tracker`](crate::trackers::Source::tracker)), if it states
    /// one.
    pub tracker: Option<String>,
    /// Map of the left eye.
    pub left: Option<Fit>,
    /// Map of the right eye.
    pub right: Option<Fit>,
    /// Map of the combined reading.
    pub combined: Option<Fit>,
}

/// A map in a file, in millimeters of the pupil plane per unit of the tracker.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FitText {
    /// Unit of the tracker's readings.
    #[serde(with = "UnitText")]
    unit: Unit,
    /// The pupil's x in millimeters, as the factor of the reading's x, the factor of its y, and a constant.
    x_mm: [f64; 3],
    /// The pupil's y in the same form.
    y_mm: [f64; 3],
    /// Root mean square distance at the targets, millimeters.
    residual_mm: f64,
    /// Number of targets that were used, and of dropped outliers.
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
    /// [`GazeError::File`], which names file, line and key.
    pub fn load(file: &Path) -> Result<Self, GazeError> {
        let text = read::text(file, read::TEXT).map_err(|e| GazeError::file(file, e.to_string()))?;
        Self::from_toml(&text).map_err(|reason| GazeError::file(file, reason))
    }

    /// Writes a user's file completely or not at all.
    ///
    /// # Errors
    /// [`GazeError::File`] if it cannot be written.
    pub fn save(&self, file: &Path) -> Result<(), GazeError> {
        let text = self.to_toml();
        files::write_file(file, |out| out.write_all(text.as_bytes())).map_err(|e| GazeError::file(file, e.to_string()))
    }

    /// Reads the text of a calibration file.
    ///
    /// # Errors
    /// The problem, with its line or key.
    pub fn from_toml(text: &str) -> Result<Self, Reason> {
        let found: Self = read::toml(text)?;
        let maps = [("left", found.left), ("right", found.right), ("combined", found.combined)];
        for (name, fit) in maps.iter().filter_map(|(name, fit)| Some((name, fit.as_ref()?))) {
            let mut numbers = fit.map.x.iter().chain(&fit.map.y).chain([&fit.residual]);
            if !numbers.all(|v| v.is_finite()) || fit.residual < 0.0 {
                return Err(reason!(
                    "not-finite",
                    "{name}: every number must be finite, and the residual not negative"
                ));
            }
        }
        if maps.iter().all(|(_, fit)| fit.is_none()) {
            return Err(reason!("no-map", "no map: give [left], [right] or [combined]"));
        }
        Ok(found)
    }

    /// A note for the user if the calibration was made with another tracker than the one of this name. Two trackers of
    /// one unit place the same reading differently, and a sample does not show this.
    pub fn note_on(&self, tracker: &str) -> Option<String> {
        let made_with = self.tracker.as_deref().filter(|made_with| *made_with != tracker)?;
        Some(format!(
            "the calibration of {} was made with the tracker {made_with}, but this one is {tracker}: the pupils are in \
             wrong places unless both are the same. Calibrate again",
            self.user
        ))
    }

    /// The text of a calibration file.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }
}
