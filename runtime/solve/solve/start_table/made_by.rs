//! Everything that decides a table.

use crate::optics::{Laser, Optics};
use crate::solve::problem::Problem;
use serde::Serialize;

/// Side of the tile, pixels: a smaller one makes narrow pupils uneven, a larger one takes more steps to the same noise.
pub(super) const SIDE: usize = 64;
/// Steps of the first level, and of each other.
const STEPS: [usize; 2] = [800, 100];
/// Pupils of a step.
const PUPILS: usize = 32;
/// Diameters of the pupils that see an even picture, meters.
const DIAMETERS: [f64; 2] = [2.2e-3, 12e-3];
/// Depths on which they focus, meters.
const DEPTH: [f64; 2] = [-2e-3, 2e-3];

/// Everything that decides a table.
#[derive(Debug, Clone, Serialize)]
pub(super) struct MadeBy {
    version: String,
    pub side: usize,
    pub frames: usize,
    wavelength: f64,
    pitch: f64,
    focal_length: f64,
    eyebox: f64,
    pub depth: [f64; 2],
    pub diameters: [f64; 2],
    pub steps: [usize; 2],
    pub pupils: usize,
    /// The display's faults, its source and the eye, where the table is fitted through them.
    through: String,
    /// Of a drive that colors share: what each of them is, the first one's again among them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    shared_by: Vec<SharedBy>,
}

/// One of the colors that share a drive.
#[derive(Debug, Clone, Serialize)]
struct SharedBy {
    wavelength: f64,
    slope: f64,
    powers: Vec<f64>,
    through: String,
}

impl MadeBy {
    pub(super) fn of(problem: &Problem, frames: usize) -> Self {
        let Optics { wavelength, pitch, focal_length, .. } = problem.optics;
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            side: SIDE,
            frames,
            wavelength,
            pitch,
            focal_length,
            eyebox: problem.eyebox,
            depth: DEPTH,
            diameters: DIAMETERS.map(|d| d.min(problem.eyebox)),
            steps: STEPS,
            pupils: PUPILS,
            through: through(problem),
            shared_by: Vec::new(),
        }
    }

    /// Of the drive that colors share in the light of these lasers; none for no color.
    pub(super) fn of_shared(colors: &[&Problem], lasers: &[Laser]) -> Option<Self> {
        let one = |(problem, laser): (&&Problem, &Laser)| SharedBy {
            wavelength: problem.optics.wavelength,
            slope: laser.slope,
            powers: laser.powers.clone(),
            through: through(problem),
        };
        let shared_by = colors.iter().zip(lasers).map(one).collect();
        Some(Self { shared_by, ..Self::of(colors.first()?, lasers.first()?.powers.len()) })
    }

    /// Of another tile and other steps.
    #[cfg(any(test, feature = "test-hooks"))]
    pub(super) fn sized(self, side: usize, steps: [usize; 2]) -> Self {
        Self { side, steps, ..self }
    }

    pub(super) fn text(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }
}

/// The faults, the source and the eye, with every digit of every number.
fn through(problem: &Problem) -> String {
    let tile = Optics { height: SIDE, width: SIDE, ..problem.optics };
    let model = problem.model.as_ref().and_then(|model| model.tile(tile));
    let model = model.as_ref().map(|model| model.model());
    let eye = problem.eye.as_ref().map(|eye| eye.prescription());
    format!("{model:?} {eye:?} {:?}", problem.modes)
}
