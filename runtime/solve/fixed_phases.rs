//! Phases that any picture can begin with where nothing else fits it: fixed random phases, fitted once per display so that every
//! pupil sees an even picture through them. A step of the projection (OPTICS 6b) from there is a phase retrieval of one step: each
//! retinal field, whose amplitude is even, is multiplied by the picture's, goes back to the SLM, and its phase is taken.
//!
//! From random phases the same step leaves their speckle in the picture. Optimised random phases do not (A. Velez-Zea,
//! J. F. Barrera-Ramirez and R. Torroba, "Optimized random phase only holograms", Optics Letters 43, 2018, for one plane): here
//! they are even through pupils anywhere in the eyebox, at all depths, and over all sub-frames together.

#[cfg(test)]
mod tests;

use super::error::SolveError;
use super::outcome::Flow;
use super::problem::Problem;
use super::settings::Settings;
use super::solver::solve;
use crate::engine::cpu::CpuEngine;
use crate::files::{cache_folder, read, write_file};
use crate::optics::{Geometry, Optics, Padding};
use crate::scene::{Pyramid, ViewGrid};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// Side of the tile that is fitted, pixels. It is laid out over the SLM again and again: fitting takes as long for any display.
const TILE: usize = 128;
/// Share of the light that pupils see: the rest goes into the eyebox's corners (OPTICS 6c).
const EFFICIENCY: f64 = 0.35;
/// Diameters of the pupils that see it evenly, metres; steps, and pupils of each.
const DIAMETERS: [f64; 2] = [2.5e-3, 8e-3];
const STEPS: usize = 60;
const PUPILS: usize = 16;

/// What decides a tile, to the letter.
#[derive(Debug, Clone, Serialize)]
struct MadeBy {
    version: String,
    tile: usize,
    frames: usize,
    wavelength: f64,
    pitch: f64,
    focal_length: f64,
    eyebox: f64,
    depth: [f64; 2],
    efficiency: f64,
    steps: usize,
}

impl MadeBy {
    fn of(problem: &Problem, frames: usize, depth: [f64; 2]) -> Self {
        let Optics { wavelength, pitch, focal_length, .. } = problem.optics;
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            tile: TILE,
            frames,
            wavelength,
            pitch,
            focal_length,
            eyebox: problem.eyebox,
            depth,
            efficiency: EFFICIENCY,
            steps: STEPS,
        }
    }

    fn text(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }

    /// Solves an even picture on a display of this kind, without anything that its panel or its eye adds.
    fn fit(&self, problem: &Problem) -> Result<Vec<f32>, SolveError> {
        let side = self.tile;
        let tile = Problem {
            optics: Optics { height: side, width: side, ..problem.optics },
            padding: Padding::default(),
            views: ViewGrid { rows: 1, columns: 1, cell: problem.eyebox },
            center: [0.0; 2],
            pyramid: Arc::new(Pyramid::new(&[vec![1.0f32; side * side]], side, side)),
            mean: 1.0,
            share: 1.0,
            model: None,
            eye: None,
            modes: Arc::new([]),
            regions: Arc::new([]),
            choice: None,
            ..problem.clone()
        };
        let settings = Settings {
            frames: self.frames,
            steps: self.steps,
            pupils: PUPILS,
            efficiency: Some(self.efficiency),
            diameter: DIAMETERS.map(|d| d.min(problem.eyebox)),
            depth: self.depth,
            ..Settings::default()
        };
        Ok(solve(&tile, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue)?.phases)
    }

    /// The tile that a file keeps, if it was made by this: a file that cannot be read, is damaged or is another's is none.
    fn load(&self, file: &Path) -> Option<Vec<f32>> {
        let kept: Kept = serde_json::from_slice(&read::bytes(file, read::RESULTS).ok()?).ok()?;
        let ours = kept.made_by == self.text() && kept.phases.len() == self.frames * self.tile * self.tile;
        ours.then(|| kept.phases())
    }
}

/// A tile on the disk: phases as binary angles, 65536 to a turn.
#[derive(Serialize, Deserialize)]
struct Kept {
    /// What decides it, as text: numbers are the same only where every digit is.
    made_by: String,
    phases: Vec<u16>,
}

impl Kept {
    /// What was fitted and what is kept are the same, to the bit.
    fn phases(&self) -> Vec<f32> {
        self.phases.iter().map(|&angle| phase_of(angle)).collect()
    }

    fn save(&self, file: &Path) {
        // A convenience: what keeps it from being kept is no one's concern.
        let _ = file.parent().map(std::fs::create_dir_all);
        let _ = write_file(file, |out| Ok(serde_json::to_writer(out, self)?));
    }
}

fn phase_of(angle: u16) -> f32 {
    f32::from(angle as i16) * (std::f32::consts::PI / 32768.0)
}

fn angle_of(phase: f32) -> u16 {
    (phase * (32768.0 / std::f32::consts::PI)).round() as i32 as u16
}

/// Phases (frames, height, width), radians, that any picture on this display can begin with: those that the user's cache keeps for
/// the display, or else fitted (seconds, on the CPU) and kept. Eyes focus within `depth`, metres. `fitting` is called before
/// they are fitted. None in the far field, where no tile of the SLM is like another.
///
/// The same display has the same phases, whatever engine refines them.
///
/// # Errors
/// Those of [`solve`].
pub fn fixed_phases(
    problem: &Problem,
    frames: usize,
    depth: [f64; 2],
    fitting: impl FnOnce(),
) -> Result<Option<Vec<f32>>, SolveError> {
    if problem.optics.geometry != Geometry::Relay || problem.optics.mask_factor > 1 {
        return Ok(None);
    }
    let made_by = MadeBy::of(problem, frames, depth);
    let file =
        cache_folder().map(|f| f.join(format!("fixed-phases-{:08x}.json", crc32c::crc32c(made_by.text().as_bytes()))));
    let tile = match file.as_ref().and_then(|file| made_by.load(file)) {
        Some(tile) => tile,
        None => {
            fitting();
            let phases = made_by.fit(problem)?.into_iter().map(angle_of).collect();
            let kept = Kept { made_by: made_by.text(), phases };
            if let Some(file) = file {
                kept.save(&file);
            }
            kept.phases()
        }
    };
    Ok(Some(laid_out(&tile, frames, [problem.optics.height, problem.optics.width])))
}

/// A tile's sub-frames, again and again over an SLM of this size.
fn laid_out(tile: &[f32], frames: usize, [height, width]: [usize; 2]) -> Vec<f32> {
    let side = (tile.len() / frames.max(1)).isqrt();
    let mut phases = Vec::with_capacity(frames * height * width);
    for frame in tile.chunks_exact(side * side) {
        for y in 0..height {
            phases.extend(frame[y % side * side..][..side].iter().cycle().take(width));
        }
    }
    phases
}
