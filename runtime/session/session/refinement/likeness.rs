//! Detects if new content is a completely different picture.

use crate::solve::Problem;

/// Two pictures are alike if their correlation coefficient is at least this.
const ALIKE: f64 = 0.5;
/// A picture is even if its variance is at most this share of the square of its mean brightness.
const EVEN: f64 = 1e-4;

/// Returns true if two scenes are different pictures. It compares the smallest copies of their middle views, which
/// takes a negligible time. A picture that fades or becomes brighter is the same picture.
pub(crate) fn differ(before: &Problem, after: &Problem) -> bool {
    let (Some((before, width)), Some((after, new_width))) = (picture(before), picture(after)) else { return true };
    if (before.len(), width) != (after.len(), new_width) {
        return true;
    }
    let mean = |light: &[f64]| light.iter().sum::<f64>() / light.len().max(1) as f64;
    let (mean_before, mean_after) = (mean(&before), mean(&after));
    let product = |a: &[f64], ma: f64, b: &[f64], mb: f64| {
        a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>() / a.len().max(1) as f64
    };
    let contrast =
        [product(&before, mean_before, &before, mean_before), product(&after, mean_after, &after, mean_after)];
    let even = |contrast: f64, mean: f64| contrast <= EVEN * mean * mean;
    match (even(contrast[0], mean_before), even(contrast[1], mean_after)) {
        (true, true) => mean_before == 0.0 && mean_after > 0.0,
        (false, false) => {
            let correlation = product(&before, mean_before, &after, mean_after);
            correlation < ALIKE * (contrast[0] * contrast[1]).sqrt()
        }
        _ => true,
    }
}

/// Returns the smallest copy of the middle view in linear light, and its width.
fn picture(problem: &Problem) -> Option<(Vec<f64>, usize)> {
    let (pyramid, views) = (&problem.pyramid, &problem.views);
    let level = pyramid.levels.last()?;
    let pixels = level.height * level.width;
    let middle = (views.rows / 2 * views.columns + views.columns / 2) * pixels;
    let view = level.views.get(middle..middle + pixels)?;
    let light = view.iter().map(|v| f64::from(*v) / 65535.0 * f64::from(pyramid.scale)).collect();
    Some((light, level.width))
}
