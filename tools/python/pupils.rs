//! Pupils for scores, which are random or the groups of the paper.

use crate::display::{Display, colors};
use crate::failure::Failure;
use crate::internals::{PupilRange, Sampler, members};
use crate::pupil::Numbers;
use eyebox::solve::{Diameters, Sequence};
use pyo3::prelude::*;

/// Draws random pupils in the eyebox of a display, as `eyebox eval score` does. Diameters and depths are in meters.
#[pyfunction]
pub(crate) fn random_pupils(
    display: &Display,
    color_names: Vec<String>,
    count: usize,
    seed: u64,
    diameter: Option<[f64; 2]>,
    depth: [f64; 2],
) -> PyResult<Vec<Numbers>> {
    let display = &display.0;
    let diameter = diameter.unwrap_or_else(|| PupilRange::usual_diameter(display.eyebox_min()));
    if diameter.iter().chain(&depth).any(|end| !end.is_finite()) || diameter[0] <= 0.0 || diameter[1] < diameter[0] {
        let right = "a smaller and a larger one above 0, and depths that are finite";
        return Err(Failure::Argument(format!("diameter is {diameter:?} m: it must be {right}")).into());
    }
    let range = PupilRange { eyebox: display.eyebox_min(), diameter, depth, diameters: Diameters::Uniform };
    let first = colors(display, &color_names)?.first().copied();
    let regions = first.map_or_else(Vec::new, |color| display.regions(color));
    let mut sampler = Sampler::new(range, Sequence::Random, seed).over(regions);
    let numbers = |pupil: eyebox::optics::Pupil| (pupil.x, pupil.y, pupil.diameter, pupil.depth);
    Ok((0..count).map(|_| numbers(sampler.draw())).collect())
}

/// Returns the pupils of the paper's groups with the name of their group. `random` are the pupils of the last group.
#[pyfunction]
pub(crate) fn paper_pupils(display: &Display, depth: [f64; 2], random: Vec<Numbers>) -> Vec<(&'static str, Numbers)> {
    let random: Vec<_> = random.into_iter().map(crate::pupil::pupil).collect();
    let all = members(display.0.eyebox_min(), depth, &random);
    let one = |pupil: eyebox::optics::Pupil| (pupil.x, pupil.y, pupil.diameter, pupil.depth);
    all.into_iter().map(|member| (member.group.name(), one(member.pupil))).collect()
}
