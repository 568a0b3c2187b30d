//! The fit of a table: one even picture after another on a tile that repeats, each from the phases of its neighbor.

use super::kept::Levels;
use super::made_by::MadeBy;
use crate::engine::cpu::CpuEngine;
use crate::optics::{Optics, Padding};
use crate::scene::{Pyramid, ViewGrid};
use crate::solve::error::SolveError;
use crate::solve::optimizer::Optimizer;
use crate::solve::outcome::{Flow, Progress, Warm};
use crate::solve::problem::Problem;
use crate::solve::settings::{FirstPhases, Settings};
use crate::solve::solver::solve_begun_by;
use eyebox_kernels::binary_angle;
use eyebox_kernels::table_start::{LEVELS, level};
use std::sync::Arc;

/// The level that is fitted from random phases; all others follow from their neighbors'.
const FIRST: usize = 7;
/// Gain of the first and the last step of the first level, and of the others.
const GAINS: [[f64; 2]; 2] = [[2.5, 0.3], [1.5, 0.3]];

impl MadeBy {
    /// Fits the levels that are not there: the first, then those above it, then those below it. Ends where `observe` answers false.
    pub(super) fn fit(
        &self,
        problem: &Problem,
        levels: &mut Levels,
        observe: &mut dyn FnMut(f64) -> bool,
    ) -> Result<(), SolveError> {
        let above = (FIRST + 1..LEVELS).map(|at| (at, Some(at - 1)));
        let below = (0..FIRST).rev().map(|at| (at, Some(at + 1)));
        let all = (self.steps[0] + (LEVELS - 1) * self.steps[1]) as f64;
        let mut taken = 0;
        for (at, from) in std::iter::once((FIRST, None)).chain(above).chain(below) {
            let steps = self.steps[usize::from(from.is_some())];
            if levels.0[at].is_none() {
                let mut goes_on = true;
                let mut tell = |step: usize| {
                    goes_on = goes_on && observe((taken + step) as f64 / all);
                    goes_on
                };
                let phases = self.fit_level(problem, at, from.and_then(|from| levels.0[from].as_deref()), &mut tell)?;
                if !goes_on {
                    return Ok(());
                }
                levels.0[at] = Some(binary_angle::pack(&phases));
            }
            taken += steps;
        }
        Ok(())
    }

    /// Solves an even picture of one level on a display of this kind.
    fn fit_level(
        &self,
        problem: &Problem,
        at: usize,
        from: Option<&[u16]>,
        tell: &mut dyn FnMut(usize) -> bool,
    ) -> Result<Vec<f32>, SolveError> {
        let (side, which) = (self.side, usize::from(from.is_some()));
        let optics = Optics { height: side, width: side, ..problem.optics };
        let tile = Problem {
            optics,
            padding: Padding::default(),
            views: ViewGrid { rows: 1, columns: 1, cell: problem.eyebox },
            center: [0.0; 2],
            pyramid: Arc::new(Pyramid::new(&[vec![level(at) as f32; side * side]], side, side)),
            // With an efficiency of one the exposure is 1, whatever the picture.
            mean: 1.0,
            share: 1.0,
            model: problem.model.as_ref().and_then(|model| model.tile(optics)),
            regions: Arc::new([]),
            choice: None,
            ..problem.clone()
        };
        let settings = Settings {
            frames: self.frames,
            steps: self.steps[which],
            pupils: self.pupils,
            efficiency: Some(1.0),
            diameter: self.diameters,
            depth: self.depth,
            optimizer: Optimizer::Projection { gain: GAINS[which], momentum: 0.5, overlap_power: 0.5 },
            first_phases: FirstPhases::Random,
            ..Settings::default()
        };
        let from = from.map(binary_angle::unpack);
        let from = from.as_ref().map(|phases| Warm { phases, progress: 0.0 });
        let mut observe = |progress: &Progress| {
            if tell(progress.step) { Flow::Continue } else { Flow::Stop }
        };
        let mut at_random = |_: f64, _: &mut dyn FnMut(&Progress) -> Flow| Ok(None);
        Ok(solve_begun_by(&tile, &settings, from, &mut at_random, &mut CpuEngine::new(), &mut observe)?.phases)
    }
}
