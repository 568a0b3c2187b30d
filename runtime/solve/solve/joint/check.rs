//! What all colours at once do not have, and what their lasers must.

use crate::optics::reference_of;
use crate::solve::error::SolveError;
use crate::solve::problem::Problem;

/// Names of refused settings whose values do not identify them.
pub(super) const PADDING: &str = "the padding of the colours";
pub(super) const SOURCE: &str = "the display's source";
pub(super) const DISPERSION: &str = "the dispersion of the colours";
pub(super) const POWERS: &str = "the powers to begin with";

/// Refuses colours that cannot share one SLM's drives, of these turns of their light for a turn of the drive.
pub(super) fn colors(colors: &[&Problem], slopes: &[f64]) -> Result<(), SolveError> {
    let wrong = |what, value: String, right| Err(SolveError::Setting { what, value, right });
    let Some(first) = colors.first() else {
        return wrong("the number of colours", "0".into(), "one at least");
    };
    let grid = |problem: &Problem| {
        let optics = problem.padding.grid(problem.optics);
        (optics.height, optics.width, problem.padding, problem.optics.geometry)
    };
    if colors.iter().any(|problem| grid(problem) != grid(first)) {
        return wrong(PADDING, "of several sizes".into(), "one for all colours at once (`padding` exact)");
    }
    let model = |problem: &Problem| problem.model.as_ref().map(|model| model.parts()).unwrap_or_default();
    if colors.iter().any(|p| model(p).drives || model(p).more_subpixels > 0 || model(p) != model(first)) {
        let right = "one without look-up table, lag, crosstalk, fill, sub-pixels and mask for all colours at once (`model_terms`)";
        return wrong("the display's model", "one that changes drives".into(), right);
    }
    if colors.iter().any(|problem| !problem.modes.is_empty()) {
        let right = "a laser on the axis for all colours at once";
        return wrong(SOURCE, "of several modes".into(), right);
    }
    let steep = |slope: &f64| !(*slope > 0.0 && slope.is_finite());
    if slopes.len() != colors.len() || slopes.iter().any(steep) || reference_of(slopes.iter().copied()).is_none() {
        let right = "positive, one a colour, one of them a whole number";
        return wrong(DISPERSION, format!("{slopes:?}"), right);
    }
    Ok(())
}

/// Refuses powers that so many lasers cannot have in so many sub-frames.
pub(super) fn powers<'a>(
    powers: impl Iterator<Item = &'a [f64]> + Clone,
    colors: usize,
    frames: usize,
) -> Result<(), SolveError> {
    let fits = powers.clone().count() == colors && powers.clone().all(|p| p.len() == frames);
    let sound = || powers.clone().flatten().all(|p| (0.0..=colors as f64 + 1e-6).contains(p));
    if fits && sound() {
        return Ok(());
    }
    let right = "one a colour and sub-frame, from 0 to the number of colours";
    Err(SolveError::Setting { what: POWERS, value: "others".into(), right })
}
