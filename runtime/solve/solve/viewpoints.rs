//! What each method looks through, one viewpoint after the other.

use super::method::Method;
use super::motion::Motion;
use super::problem::Problem;
use super::sampling::{Points, Sampler};
use super::settings::Settings;
use crate::optics::Pupil;
use crate::plan::Viewpoint;
use std::sync::Arc;

/// What a method looks through, one after the other: the same for the same seed.
pub(super) struct Viewpoints {
    sampler: Sampler,
    kind: Kind,
    /// How eyes and content move, and where that is drawn from.
    motion: Motion,
    moves: Points,
    frames: usize,
}

enum Kind {
    Pupils,
    /// Views that are supervised, and the STFT's window and filter; without them, each view's disc.
    Views {
        views: Vec<(usize, Pupil)>,
        stft: Option<(usize, f64)>,
    },
}

impl Viewpoints {
    /// Of `settings.method`, with another seed if the settings' own is not to be used.
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
                    // Around the cell: the discs of neighbours leave no gap where light could hide.
                    (view, Pupil { x, y, diameter: std::f64::consts::SQRT_2 * grid.cell, depth: 0.0 })
                };
                // A view whose frequency the filter stops is not asked for.
                let inside = |(_, p): &(usize, Pupil)| p.x.hypot(p.y) <= filter / 2.0;
                let mut views: Vec<_> = (0..grid.rows * grid.columns).map(disc).filter(inside).collect();
                if views.is_empty() {
                    views.push(disc(grid.rows / 2 * grid.columns + grid.columns / 2));
                }
                Kind::Views { views, stft: settings.method.is_stft().then_some((samples, filter)) }
            }
            _ => Kind::Pupils,
        };
        // Numbers of their own: what does not move is drawn as ever.
        let moves = Points::new(settings.sequence, seed ^ 0x6d6f_7469_6f6e);
        Self { sampler, kind, motion: settings.motion, moves, frames: settings.solved_frames() }
    }

    /// The next one.
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

    /// How many of a step's viewpoints overlap at a bin, on average, where the kernel `overlap` does not count them: the
    /// power of the STFT's windows, which tile the spectrum `count` views to a full set.
    pub(super) fn overlap(&self, batch: usize) -> Option<f64> {
        let Kind::Views { views, stft: Some((samples, _)) } = &self.kind else { return None };
        // Hann: sum of squares 3/8 (n + 1), square of the sum (n + 1)^2 / 4; n windows to an axis.
        let n = *samples as f64;
        let axis = n * 1.5 / (n + 1.0);
        Some(axis * axis * batch as f64 / views.len() as f64)
    }
}
