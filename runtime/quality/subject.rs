//! What recipes are tried on, and how a recipe is solved.

use super::{QualityError, Recipe};
use crate::engine::Engine;
use crate::optics::{Color, Display, Padding};
use crate::scene::LightField;
use crate::solve::{self, Flow, Problem, Progress, Settings, Solution};
use std::borrow::Cow;
use std::time::Instant;

/// One colour of a scene on a display, and everything about its solve that no recipe decides.
#[derive(Debug, Clone)]
pub struct Subject<'a> {
    /// The scene, which has the display's size.
    pub field: &'a LightField,
    /// Which of its colours.
    pub color: Color,
    /// The display.
    pub display: &'a Display,
    /// Depths, diameters, seed; `frames` are the sub-frames shown.
    pub base: Settings,
    /// Phases that the SLM can show, radians, 256 at most; none where they are so many that they do not matter.
    pub levels: Option<Vec<f64>>,
}

/// What came of a recipe.
#[derive(Debug, Clone)]
pub struct Solved {
    /// Phases of all pixels and all sub-frames shown. Its verdict is about the problem that was solved: where the recipe
    /// [reduces](Recipe::reduces) that, only a [`Reference`](super::Reference) knows the truth.
    pub solution: Solution,
    /// Of those sub-frames, the first so many are solved; they repeat.
    pub frames: usize,
    /// Milliseconds from the light field to the phases: thinning, pyramid, choice of exposure, steps.
    pub milliseconds: f64,
}

/// A recipe's problem and settings, ready to be solved.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The problem, thinned or coarse if the recipe says so.
    pub problem: Problem,
    /// The settings.
    pub settings: Settings,
    /// Side of its pixels, in pixels of the SLM.
    pub pixel: usize,
}

impl Subject<'_> {
    /// Zeros around the SLM that depth and eyebox require (OPTICS 2).
    ///
    /// # Errors
    /// A colour that the display does not have.
    pub fn required_padding(&self) -> Result<Padding, QualityError> {
        let optics = self.display.optics(self.color)?;
        let deepest = self.base.depth[0].abs().max(self.base.depth[1].abs());
        Ok(Padding::required(&optics, deepest, self.display.eyebox_min() / 2.0))
    }

    /// The settings that a recipe means here.
    pub fn settings(&self, recipe: &Recipe) -> Settings {
        let mut settings = self.base.clone();
        recipe.apply(&mut settings);
        if recipe.levels {
            settings.levels = self.levels.clone().or(settings.levels);
        }
        settings
    }

    /// Makes what a recipe solves.
    ///
    /// # Errors
    /// A colour that display or scene do not have.
    pub fn prepare(&self, recipe: &Recipe) -> Result<Prepared, QualityError> {
        let settings = self.settings(recipe);
        let reduced = recipe.scene(self.field, self.display);
        let (field, display) = match &reduced {
            Some((field, display)) => (Cow::Borrowed(field), Cow::Borrowed(display)),
            None => (Cow::Borrowed(self.field), Cow::Borrowed(self.display)),
        };
        let pixel = self.display.width / display.width.max(1);
        let padding = match recipe.padding {
            true => Subject { field: &field, display: &display, ..self.clone() }.required_padding()?,
            false => Padding::default(),
        };
        let mut problem = Problem::new(&field, self.color, &display, padding)?;
        // Coarser pixels have a smaller eyebox: pupils outside of it are not worth a draw.
        problem.eyebox = problem.eyebox.min(self.display.eyebox_min());
        Ok(Prepared { problem, settings, pixel: pixel.max(1) })
    }

    /// Solves a recipe. The settings' `seconds` and `psnr` hold as in any solve.
    ///
    /// # Errors
    /// [`QualityError`].
    pub fn solve(
        &self,
        recipe: &Recipe,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(&Progress) -> Flow,
    ) -> Result<Solved, QualityError> {
        let start = Instant::now();
        let Prepared { problem, settings, pixel } = self.prepare(recipe)?;
        let mut solution = solve::solve(&problem, &settings, engine, observe)?;
        if pixel > 1 {
            solution.phases = enlarged(&solution.phases, problem.optics.height, problem.optics.width, pixel);
            // A pupil's share of the SLM's own eyebox is so many times smaller, and what it sees is divided by that share.
            solution.exposure /= (pixel * pixel) as f64;
        }
        let shown = self.base.frames.max(1);
        solution.phases = solution.phases.repeat((shown / settings.frames.max(1)).max(1));
        solution.seconds = start.elapsed().as_secs_f64();
        Ok(Solved { milliseconds: solution.seconds * 1e3, frames: settings.frames, solution })
    }
}

/// Every pixel of every frame (height, width) on `pixel` x `pixel` of its own.
fn enlarged(phases: &[f32], height: usize, width: usize, pixel: usize) -> Vec<f32> {
    let mut out = Vec::with_capacity(phases.len() * pixel * pixel);
    for row in phases.chunks_exact(width.max(1)) {
        let wide: Vec<f32> = row.iter().flat_map(|p| std::iter::repeat_n(*p, pixel)).collect();
        (0..pixel).for_each(|_| out.extend_from_slice(&wide));
    }
    debug_assert_eq!(out.len() % (height * width * pixel * pixel).max(1), 0);
    out
}
