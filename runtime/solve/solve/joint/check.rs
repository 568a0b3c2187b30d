//! Checks the limits of simultaneous color and of its lasers.

use crate::optics::reference_of;
use crate::solve::error::{SolveError, require};
use crate::solve::problem::Problem;

/// Names of refused settings whose values do not identify them.
pub(super) const PADDING: &str = "the padding of the colors";
pub(super) const SOURCE: &str = "the display's source";
pub(super) const DISPERSION: &str = "the dispersion of the colors";
pub(super) const POWERS: &str = "the powers to begin with";

/// Returns an error for colors that cannot share the drive values of one SLM. `slopes` are turns of their light per
/// turn of the drive value.
pub(super) fn colors(colors: &[&Problem], slopes: &[f64]) -> Result<(), SolveError> {
    let Some(first) = colors.first() else {
        return require(false, "the number of colors", 0, "at least one");
    };
    let grid = |problem: &Problem| {
        let optics = problem.padding.grid(problem.optics);
        (optics.height, optics.width, problem.padding, problem.optics.geometry)
    };
    let are_alike = colors.iter().all(|problem| grid(problem) == grid(first));
    require(are_alike, PADDING, "of several sizes", "one for simultaneous color (`padding` exact)")?;
    let model = |problem: &Problem| problem.model.as_ref().map(|model| model.parts()).unwrap_or_default();
    let keeps = |p: &&Problem| !model(p).drives && model(p).more_subpixels == 0 && model(p) == model(first);
    let right =
        "one without look-up table, lag, crosstalk, fill, sub-pixels and mask for simultaneous color (`model_terms`)";
    require(colors.iter().all(keeps), "the display's model", "one that changes drives", right)?;
    let is_laser = colors.iter().all(|problem| problem.modes.is_empty());
    require(is_laser, SOURCE, "of several modes", "a laser on the axis for simultaneous color")?;
    let are_positive = slopes.len() == colors.len() && slopes.iter().all(|s| *s > 0.0 && s.is_finite());
    let fits = are_positive && reference_of(slopes.iter().copied()).is_some();
    require(fits, DISPERSION, format_args!("{slopes:?}"), "positive, one per color, one of them a whole number")
}

/// Returns an error for powers that this number of lasers and sub-frames cannot have.
pub(super) fn powers<'a>(
    powers: impl Iterator<Item = &'a [f64]> + Clone,
    colors: usize,
    frames: usize,
) -> Result<(), SolveError> {
    let fits = powers.clone().count() == colors && powers.clone().all(|p| p.len() == frames);
    let sound = || powers.clone().flatten().all(|p| (0.0..=colors as f64 + 1e-6).contains(p));
    let right = "one per color and sub-frame, from 0 to the number of colors";
    require(fits && sound(), POWERS, "others", right)
}
