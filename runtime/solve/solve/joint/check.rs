//! What all colours at once do not have, and what their lasers must.

use crate::optics::reference_of;
use crate::solve::error::{SolveError, require};
use crate::solve::problem::Problem;

/// Names of refused settings whose values do not identify them.
pub(super) const PADDING: &str = "the padding of the colours";
pub(super) const SOURCE: &str = "the display's source";
pub(super) const DISPERSION: &str = "the dispersion of the colours";
pub(super) const POWERS: &str = "the powers to begin with";

/// Refuses colours that cannot share one SLM's drives, of these turns of their light for a turn of the drive.
pub(super) fn colors(colors: &[&Problem], slopes: &[f64]) -> Result<(), SolveError> {
    let Some(first) = colors.first() else {
        return require(false, "the number of colours", 0, "one at least");
    };
    let grid = |problem: &Problem| {
        let optics = problem.padding.grid(problem.optics);
        (optics.height, optics.width, problem.padding, problem.optics.geometry)
    };
    let are_alike = colors.iter().all(|problem| grid(problem) == grid(first));
    require(are_alike, PADDING, "of several sizes", "one for all colours at once (`padding` exact)")?;
    let model = |problem: &Problem| problem.model.as_ref().map(|model| model.parts()).unwrap_or_default();
    let keeps = |p: &&Problem| !model(p).drives && model(p).more_subpixels == 0 && model(p) == model(first);
    let right =
        "one without look-up table, lag, crosstalk, fill, sub-pixels and mask for all colours at once (`model_terms`)";
    require(colors.iter().all(keeps), "the display's model", "one that changes drives", right)?;
    let is_laser = colors.iter().all(|problem| problem.modes.is_empty());
    require(is_laser, SOURCE, "of several modes", "a laser on the axis for all colours at once")?;
    let are_positive = slopes.len() == colors.len() && slopes.iter().all(|s| *s > 0.0 && s.is_finite());
    let fits = are_positive && reference_of(slopes.iter().copied()).is_some();
    require(fits, DISPERSION, format_args!("{slopes:?}"), "positive, one a colour, one of them a whole number")
}

/// Refuses powers that so many lasers cannot have in so many sub-frames.
pub(super) fn powers<'a>(
    powers: impl Iterator<Item = &'a [f64]> + Clone,
    colors: usize,
    frames: usize,
) -> Result<(), SolveError> {
    let fits = powers.clone().count() == colors && powers.clone().all(|p| p.len() == frames);
    let sound = || powers.clone().flatten().all(|p| (0.0..=colors as f64 + 1e-6).contains(p));
    let right = "one a colour and sub-frame, from 0 to the number of colours";
    require(fits && sound(), POWERS, "others", right)
}
