//! Draws the viewpoints of each method, one after the other.

use super::method::Method;
use super::motion::Motion;
use super::problem::Problem;
use super::sampling::{Points, Sampler};
use super::settings::Settings;
use crate::optics::Pupil;
use crate::plan::Viewpoint;
use std::sync::Arc;

/// The viewpoints of a method, which are the same for the same seed.
pub(super) struct Viewpoints {
    sampler: Sampler,
    kind: Kind,
    /// The movement of eyes and content, and the source of its random numbers.
    motion: Motion,
    moves: Points,
    frames: usize,
}

enum Kind {
    Pupils,
    /// Supervised views, and the window and filter of the STFT. Without these, each view has its disc.
    Views {
        views: Vec<(usize, Pupil)>,
        stft: Option<(usize, f64)>,
    },
}

impl Viewpoints {
    /// Starts the viewpoints of `settings.method` with this seed instead of the settings' own.
    pub(super) fn new(problem: &Problem, settings: &Settings, seed: u64) -> Self {
        let mut range = settings.pupil_range(problem.eyebox);
        if settings.method != Method::Slfh {
            range.diameter = [problem.eyebox; 2];
        }
        let sampler = Sampler::new(range, settings.sequence, seed).over(Arc::clone(&problem.regions));
        let filter = match settings.method {
            Method::StftUnfiltered => f64::INFINITY,
            _ => settings.stft_filter * problem.eyebox,
        };
        let kind = match settings.method {
            Method::Stft | Method::StftUnfiltered | Method::StftExact => {
                let grid = &problem.views;
                let samples = settings.stft_samples.unwrap_or(grid.rows.max(grid.columns));
                let disc = |view| {
                    let (x, y) = grid.position(view);
                    // It is the circle around the cell, so that neighboring discs leave no gap in which light could
                    // hide.
                    (view, Pupil { x, y, diameter: std::f64::consts::SQRT_2 * grid.cell, depth: 0.0 })
                };
                // A view whose frequency the filter stops is not supervised.
                let inside = |(_, p): &(usize, Pupil)| p.x.hypot(p.y) <= filter / 2.0;
                let mut views: Vec<_> = (0..grid.rows * grid.columns).map(disc).filter(inside).collect();
                if views.is_empty() {
                    views.push(disc(grid.rows / 2 * grid.columns + grid.columns / 2));
                }
                Kind::Views { views, stft: settings.method.is_stft().then_some((samples, filter)) }
            }
            _ => Kind::Pupils,
        };
        // These numbers are separate, so that a static scene has the same draws as before.
        let moves = Points::new(settings.sequence, seed ^ 0x6d6f_7469_6f6e);
        Self { sampler, kind, motion: settings.motion, moves, frames: settings.solved_frames() }
    }

    /// Returns the next viewpoint.
    pub(super) fn draw(&mut self) -> Viewpoint {
        let Kind::Views { views, stft } = &self.kind else {
            let pupil = self.sampler.draw();
            return if self.motion.is_still() {
                Viewpoint::Pupil(pupil)
            } else {
                self.motion.viewpoint(pupil, self.frames, self.moves.draw())
            };
        };
        let at = self.sampler.point()[0];
        let (view, pupil) = views[((at * views.len() as f64) as usize).min(views.len() - 1)];
        match *stft {
            Some((samples, filter)) => Viewpoint::Stft { view, samples, filter },
            None => Viewpoint::Pupil(pupil),
        }
    }

    /// Returns the mean number of a step's viewpoints that overlap at a bin, if the kernel `overlap` does not count
    /// them.
    ///
    /// It is the power of the STFT's windows. All views together tile the spectrum once.
    pub(super) fn overlap(&self, batch: usize) -> Option<f64> {
        let Kind::Views { views, stft: Some((samples, _)) } = &self.kind else { return None };
        // For a Hann window the sum of squares is 3/8 (n + 1) and the square of the sum is (n + 1)^2 / 4, with n
        // windows per axis.
        let n = *samples as f64;
        let axis = n * 1.5 / (n + 1.0);
        Some(axis * axis * batch as f64 / views.len() as f64)
    }
}
