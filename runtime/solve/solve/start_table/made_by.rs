//! Everything that decides a table.

use crate::optics::Optics;
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
}

impl MadeBy {
    pub(super) fn of(problem: &Problem, frames: usize) -> Self {
        let Optics { wavelength, pitch, focal_length, .. } = problem.optics;
        let tile = Optics { height: SIDE, width: SIDE, ..problem.optics };
        let model = problem.model.as_ref().and_then(|model| model.tile(tile));
        let model = model.as_ref().map(|model| model.model());
        let eye = problem.eye.as_ref().map(|eye| eye.prescription());
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
            // Every digit of every number.
            through: format!("{model:?} {eye:?} {:?}", problem.modes),
        }
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
