//! Fits a table by solving one even picture after another on a repeating tile, each from its neighbor's phases.

use super::made_by::Levels;
use super::made_by::MadeBy;
use crate::engine::cpu::CpuEngine;
use crate::optics::{Laser, Optics, Padding, drives_of};
use crate::scene::{Pyramid, ViewGrid};
use crate::solve::error::SolveError;
use crate::solve::joint::{JointProblem, solve_joint};
use crate::solve::optimizer::Optimizer;
use crate::solve::outcome::{Flow, Progress, Warm};
use crate::solve::problem::Problem;
use crate::solve::settings::{FirstPhases, Joint, Settings};
use crate::solve::solver::solve_begun_by;
use eyebox_kernels::binary_angle;
use eyebox_kernels::table_start::{LEVELS, level};
use std::sync::Arc;

/// The level that is fitted from random phases. All others start from the phases of a neighbor.
const FIRST: usize = 7;
/// Gains of the first and the last step. The first pair belongs to the first level, and the second one to the others.
const GAINS: [[f64; 2]; 2] = [[2.5, 0.3], [1.5, 0.3]];

/// Fits one level from its neighbor's phases, if there are any, and reports the number of steps taken. If the report
/// returns `false`, the fit ends.
type FitLevel<'a> =
    dyn FnMut(usize, Option<&[f32]>, &mut dyn FnMut(usize) -> bool) -> Result<Vec<f32>, SolveError> + 'a;

impl MadeBy {
    /// Fits the missing levels, which are the first, then those above it, then those below it. It ends if `observe`
    /// returns false.
    pub(super) fn fit(
        &self,
        problem: &Problem,
        levels: &mut Levels,
        observe: &mut dyn FnMut(f64) -> bool,
    ) -> Result<(), SolveError> {
        self.fit_levels(levels, observe, &mut |at, from, tell| {
            let from = from.map(|phases| Warm { phases, progress: 0.0 });
            let mut observe = flow_of(tell);
            let mut at_random = |_: f64, _: &mut dyn FnMut(&Progress) -> Flow| Ok(None);
            let (tile, settings, mut engine) =
                (self.tile(problem, at), self.settings(from.is_some()), CpuEngine::new());
            Ok(solve_begun_by(&tile, &settings, from, &mut at_random, &mut engine, &mut observe)?.phases)
        })
    }

    /// Fits the drive values that these colors share. A level is gray, with the same brightness in every color.
    pub(super) fn fit_shared(
        &self,
        colors: &[&Problem],
        lasers: &[Laser],
        levels: &mut Levels,
        observe: &mut dyn FnMut(f64) -> bool,
    ) -> Result<(), SolveError> {
        let slopes: Vec<f64> = lasers.iter().map(|laser| laser.slope).collect();
        let powers: Vec<Vec<f64>> = lasers.iter().map(|laser| laser.powers.clone()).collect();
        // All laser powers stay as they are, because none may exceed the mean.
        let joint = Some(Joint { brightness: colors.len() as f64 });
        let exposures = vec![1.0; colors.len()];
        self.fit_levels(levels, observe, &mut |at, from, tell| {
            let tiles: Vec<Problem> = colors.iter().map(|problem| self.tile(problem, at)).collect();
            let problem =
                JointProblem { colors: &tiles, slopes: &slopes, exposures: Some(&exposures), powers: Some(&powers) };
            let settings = Settings { joint, ..self.settings(from.is_some()) };
            let from = from.map(|phases| Warm { phases, progress: 0.0 });
            let mut observe = flow_of(tell);
            let solved = solve_joint(&problem, &settings, from, &mut CpuEngine::new(), &mut observe)?;
            Ok(drives_of(&slopes, |color| &solved.colors[color].phases))
        })
    }

    fn fit_levels(
        &self,
        levels: &mut Levels,
        observe: &mut dyn FnMut(f64) -> bool,
        fit_level: &mut FitLevel<'_>,
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
                let from = from.and_then(|from| levels.0[from].as_deref()).map(binary_angle::unpack);
                let phases = fit_level(at, from.as_deref(), &mut tell)?;
                if !goes_on {
                    return Ok(());
                }
                levels.0[at] = Some(binary_angle::pack(&phases));
            }
            taken += steps;
        }
        Ok(())
    }

    /// Returns an even picture of one level on a display of this kind.
    fn tile(&self, problem: &Problem, at: usize) -> Problem {
        let side = self.side;
        let optics = Optics { height: side, width: side, ..problem.optics };
        Problem {
            optics,
            padding: Padding::default(),
            views: ViewGrid { rows: 1, columns: 1, cell: problem.eyebox },
            center: [0.0; 2],
            pyramid: Arc::new(Pyramid::new(&[vec![level(at) as f32; side * side]], side, side)),
            // An efficiency of one makes the exposure 1 for every picture.
            mean: 1.0,
            share: 1.0,
            model: problem.model.as_ref().and_then(|model| model.tile(optics)),
            regions: Arc::new([]),
            choice: None,
            ..problem.clone()
        }
    }

    /// Returns the settings for the first level, or for a level that starts from its neighbor.
    fn settings(&self, follows: bool) -> Settings {
        let which = usize::from(follows);
        Settings {
            frames: self.frames,
            steps: self.steps[which],
            pupils: self.pupils,
            efficiency: Some(1.0),
            diameter: self.diameters,
            depth: self.depth,
            optimizer: Optimizer::Projection { gain: GAINS[which], momentum: 0.5, overlap_power: 0.5 },
            first_phases: FirstPhases::Random,
            ..Settings::default()
        }
    }
}

/// Returns an observer of a solve that passes on the number of steps taken.
fn flow_of(tell: &mut dyn FnMut(usize) -> bool) -> impl FnMut(&Progress) -> Flow {
    move |progress| if tell(progress.step) { Flow::Continue } else { Flow::Stop }
}
