//! Shifts content for studies and tests.

use crate::scene::Pyramid;
use crate::solve::Problem;
use std::sync::Arc;

/// Moves all views to the right by `shift` pixels, with wraparound at the edges. If `mirrored` is true, the whole light
/// field is mirrored first.
pub fn shifted_problem(problem: &Problem, shift: usize, mirrored: bool) -> Problem {
    let Some(level) = problem.pyramid.levels.first() else { return problem.clone() };
    let (width, pixels) = (level.width, level.height * level.width);
    let columns = problem.views.columns;
    let view = |index: usize| {
        let from = if mirrored { index / columns * columns + columns - 1 - index % columns } else { index };
        let from = &level.views[from * pixels..(from + 1) * pixels];
        let value = |at: usize| {
            let column = (at % width + width - shift % width) % width;
            let column = if mirrored { width - 1 - column } else { column };
            f32::from(from[at / width * width + column]) / 65535.0 * problem.pyramid.scale
        };
        (0..pixels).map(value).collect::<Vec<f32>>()
    };
    let views: Vec<Vec<f32>> = (0..problem.pyramid.count).map(view).collect();
    Problem { pyramid: Arc::new(Pyramid::new(&views, level.height, width)), ..problem.clone() }
}
