//! Solves every color of a hologram, one after the other or all at once.

use super::{ProduceError, SceneEvent};
use crate::engine::{Engine, Memory};
use crate::hologram::{ColorHologram, Hologram, Metadata};
use crate::memory;
use crate::optics::{Color, Display, JointColor, Laser, OpticsError, Padding, reference_of};
use crate::quality::{ColorJob, Reference};
use crate::scene::{LightField, SceneError};
use crate::solve::{Flow, JointProblem, JointSolution, Progress, Settings, Solution, solve_joint};

/// Returns an error for a color that needs more memory than available, by the count of a plan.
fn check_memory(job: &ColorJob, settings: &Settings, memory: Memory) -> Result<(), ProduceError> {
    let bytes = job.cost(settings, memory)?.bytes();
    let what = || format!("{} sub-frames of {} x {}", settings.frames, job.display.height, job.display.width);
    let remedy = "take fewer `frames`, `views` or `pupils`, or a smaller `size`";
    Ok(memory::check_available(what, bytes, remedy).map_err(SceneError::from)?)
}

/// Solves every color in turn with settings of this quality.
///
/// After `observe` returns [`Flow::Stop`], each remaining color gets one step, so that the hologram is complete. If the
/// settings [reduce](Settings::reduces) the problem, each solution is scored against the whole problem.
///
/// # Errors
/// [`ProduceError`] if the memory is too small, or if a solve fails.
pub fn solve_colors(
    job: &ColorJob,
    colors: &[Color],
    settings: &Settings,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
) -> Result<Vec<(Color, Solution)>, ProduceError> {
    let mut solved = Vec::with_capacity(colors.len());
    for &color in colors {
        let job = ColorJob { color, ..job.clone() };
        check_memory(&job, settings, engine.memory())?;
        let mut stepped = |progress: &Progress| observe(&SceneEvent::Step { hologram: 0, color, progress });
        let mut solution = job.solve(settings, engine, &mut stepped)?.solution;
        if settings.reduces() {
            // The validation of the solve belongs to the reduced problem.
            let reference = Reference::new(&job, job.base.seed, engine)?;
            solution.validation = reference.score(&solution.phases, engine)?;
            if settings.pixel > 1 {
                solution.exposure = solution.validation.exposure;
            }
        }
        observe(&SceneEvent::Solved { hologram: 0, color, solution: &solution });
        solved.push((color, solution));
    }
    Ok(solved)
}

/// Solves all colors at once (OPTICS 13) with `settings.joint`, with every pixel, view and sub-frame of the job, and
/// with exposures from each color's scene.
///
/// It returns the colors with their phases of the shared drive values, and the description of their display.
///
/// # Errors
/// [`ProduceError`] if the memory is too small, or if the solve fails.
pub fn solve_joint_colors(
    job: &ColorJob,
    colors: &[Color],
    settings: &Settings,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
) -> Result<(Vec<(Color, Solution)>, JointColor), ProduceError> {
    let settings = &settings.for_joint_colors();
    let mut problems = Vec::with_capacity(colors.len());
    for &color in colors {
        let job = ColorJob { color, ..job.clone() };
        check_memory(&job, settings, engine.memory())?;
        problems.push(job.prepare(settings)?.problem);
    }
    let slopes = job.display.slopes(colors);
    let problem = JointProblem { colors: &problems, slopes: &slopes, exposures: None, powers: None };
    let reference = reference_of(slopes.iter().copied()).unwrap_or(0);
    let mut stepped =
        |progress: &Progress| observe(&SceneEvent::Step { hologram: 0, color: colors[reference], progress });
    let JointSolution { colors: solutions, powers } = solve_joint(&problem, settings, None, engine, &mut stepped)?;
    let lasers = colors.iter().zip(&slopes).zip(powers);
    let lasers = lasers.map(|((color, slope), powers)| (*color, Laser { slope: *slope, powers })).collect();
    let solutions: Vec<_> = colors.iter().copied().zip(solutions).collect();
    for (color, solution) in &solutions {
        observe(&SceneEvent::Solved { hologram: 0, color: *color, solution });
    }
    Ok((solutions, JointColor { lasers }))
}

impl Hologram {
    /// Creates the hologram of solved colors of a scene on a display, with a record of its making.
    ///
    /// # Errors
    /// [`OpticsError`] for a color that the display does not have.
    pub fn from_solutions(
        field: &LightField,
        display: &Display,
        settings: &Settings,
        padding: Padding,
        solutions: &[(Color, Solution)],
    ) -> Result<Self, OpticsError> {
        let color = |(color, s): &(Color, Solution)| {
            let wavelength = display.optics(*color)?.wavelength;
            let Solution { exposure, efficiency, .. } = *s;
            Ok(ColorHologram { color: Some(*color), wavelength, exposure, efficiency, phases: s.phases.clone() })
        };
        let (views, cell) = field.own_views(display);
        let colors = solutions.iter().map(color).collect::<Result<_, _>>()?;
        let on_display = Self::on(display, settings.frames, colors);
        Ok(Self {
            seed: settings.seed,
            version: env!("CARGO_PKG_VERSION").into(),
            scene: field.name.clone(),
            metadata: Metadata {
                solve: Some(settings.clone()),
                padded: Some([padding.rows, padding.columns]),
                views: Some(views),
                view_pitch_mm: Some(cell * 1e3),
                eyebox_mm: Some(display.eyebox_min() * 1e3),
                ..on_display.metadata
            },
            ..on_display
        })
    }
}
