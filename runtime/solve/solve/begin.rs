//! Solves one color, from its first phases to the end of its steps.

use super::error::SolveError;
use super::method::Method;
use super::outcome::{Flow, Progress, Solution, Warm};
use super::problem::Problem;
use super::settings::Settings;
use super::solver::solve_begun_by;
use super::start_table;
use crate::engine::Engine;
use std::time::Instant;

/// Solves one color and calls `observe` after every step.
///
/// The same seed gives the same phases on one engine, bit for bit.
///
/// # Errors
/// [`SolveError`]. If the engine fails, the best state is lost with this call.
pub fn solve(
    problem: &Problem,
    settings: &Settings,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&Progress) -> Flow,
) -> Result<Solution, SolveError> {
    solve_from(problem, settings, None, engine, observe)
}

/// Solves one color from given phases, as [`solve`] does otherwise. Methods in closed form do not use them.
///
/// # Errors
/// The errors of [`solve`], and [`SolveError::Setting`] for another number of phases.
pub fn solve_from(
    problem: &Problem,
    settings: &Settings,
    from: Option<Warm<'_>>,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&Progress) -> Flow,
) -> Result<Solution, SolveError> {
    settings.check()?;
    problem.check_eye(settings)?;
    let of_table = (settings.method == Method::Table).then(|| settings.as_of_table(problem)).transpose()?;
    let settings = of_table.as_ref().unwrap_or(settings);
    let from = from.filter(|_| of_table.is_none());
    let start = Instant::now();
    let mut begin = |exposure: f64, observe: &mut dyn FnMut(&Progress) -> Flow| {
        start_table::beginning(problem, &settings.as_computed(), exposure, start, observe)
    };
    solve_begun_by(problem, settings, from, &mut begin, engine, observe)
}
