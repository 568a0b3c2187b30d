//! Starts the wavefront without a guess, from the shifts of pictures through small irises.
//!
//! A small iris sees the local slope of the wavefront as a shift of its picture.

use super::fit::COARSE;
use super::map::CameraMap;
use super::parameters::{Parameter, Parameters};
use super::views::Pictures;
use eyebox_optics::linear::solve;
use eyebox_optics::zernike;

/// Shifts that are tried in each round, as the reach in steps and the step in SLM pixels. A speckle of a small iris is
/// 5 pixels wide.
const ROUNDS: [(i32, f64); 2] = [(3, 2.5), (2, 1.0)];
/// A picture of which more than this share is left at its best shift shows no slope.
const LOST: f64 = 0.9;
/// Error of a shift, SLM pixels, and spread of the wavefront's terms, waves. With fewer slopes the wavefront becomes
/// smoother.
const SHIFT_ERROR: f64 = 0.5;
const SPREAD: f64 = 0.1;

/// Adds the terms that the shifts of these pictures show to the wavefront, and moves the camera by their common shift.
pub(super) fn from_shifts(pictures: &Pictures, start: &Parameters, which: &[usize], terms: &[u32]) -> Parameters {
    let mut at = start.clone();
    for (reach, step) in ROUNDS {
        let shifts = shifts(pictures, &at, which, reach, step);
        tracing::debug!("shifts of the small irises, pixels: {shifts:.1?}");
        let slopes: Vec<([f64; 2], [f64; 2])> = which
            .iter()
            .zip(shifts)
            .filter_map(|(v, shift)| {
                let look = &pictures.views[*v].looks[0].0;
                let iris = at.model.true_pupil(&look.pupil);
                Some(([iris.x / look.radius, iris.y / look.radius], shift?))
            })
            .collect();
        // Pixels per wave and per radius of the wavefront's disc.
        let radius = pictures.views[which[0]].looks[0].0.radius;
        let pixels = pictures.optics.eyebox() / radius;
        let Some((waves, common)) = wavefront(&slopes, pixels, terms) else { break };
        for (j, waves) in terms.iter().zip(waves) {
            *at.model.wavefront.entry(*j).or_insert(0.0) += waves;
        }
        at = shifted(&at, common);
    }
    at
}

/// The shift at which the model explains each picture best, SLM pixels, or none if no shift explains it.
pub(super) fn shifts(
    pictures: &Pictures,
    at: &Parameters,
    which: &[usize],
    reach: i32,
    step: f64,
) -> Vec<Option<[f64; 2]>> {
    let side = 2 * reach + 1;
    let camera = |i: i32| shifted(at, [i % side - reach, i / side - reach].map(|n| f64::from(n) * step)).map;
    let cameras: Vec<CameraMap> = (0..side * side).map(camera).collect();
    // The order is by view, then by camera.
    let left: Vec<Vec<f64>> = pictures
        .see_from(at, COARSE.subpixels, which, &cameras)
        .iter()
        .zip(which)
        .map(|(seen, v)| seen.iter().map(|seen| pictures.share_left(*v, seen)).collect())
        .collect();
    let best = |view: usize| {
        let value = |x: i32, y: i32| {
            let inside = x.abs() <= reach && y.abs() <= reach;
            inside.then(|| left[view][((y + reach) * side + x + reach) as usize])
        };
        let least = (0..side * side).min_by(|a, b| left[view][*a as usize].total_cmp(&left[view][*b as usize]))?;
        let [x, y] = [least % side - reach, least / side - reach];
        let middle = value(x, y)?;
        // The lowest point of the parabola through a place and its two neighbors.
        let between = |before: Option<f64>, after: Option<f64>| match (before, after) {
            (Some(a), Some(b)) if a + b > 2.0 * middle => ((a - b) / (2.0 * (a + b - 2.0 * middle))).clamp(-0.5, 0.5),
            _ => 0.0,
        };
        let dx = between(value(x - 1, y), value(x + 1, y));
        let dy = between(value(x, y - 1), value(x, y + 1));
        (middle < LOST).then_some([(f64::from(x) + dx) * step, (f64::from(y) + dy) * step])
    };
    (0..which.len()).map(best).collect()
}

/// Returns `at` with a camera whose pixels look at places of the SLM that are shifted by (x, y), pixels.
fn shifted(at: &Parameters, shift: [f64; 2]) -> Parameters {
    let middle = at.map.camera.map(|n| n as f64 / 2.0);
    let look = |at: &Parameters| at.map.to_slm([middle[1], middle[0]]);
    let here = look(at);
    let [[a, c], [b, d]] = [Parameter::Map(2), Parameter::Map(5)].map(|p| {
        let there = look(&at.moved(p, 1e-4));
        [0, 1].map(|i| (there[i] - here[i]) / 1e-4)
    });
    let (x, y, area) = (d * shift[0] - b * shift[1], a * shift[1] - c * shift[0], a * d - b * c);
    at.moved(Parameter::Map(2), x / area).moved(Parameter::Map(5), y / area)
}

/// Returns the waves of the terms, and the shift that all pictures share. The slopes of the terms explain the shifts of
/// the pictures. Places are shares of the disc's radius. `pixels` is the shift by a slope of one wave per radius.
fn wavefront(slopes: &[([f64; 2], [f64; 2])], pixels: f64, terms: &[u32]) -> Option<(Vec<f64>, [f64; 2])> {
    const STEP: f64 = 1e-4;
    let count = terms.len() + 2;
    let (mut normal, mut right) = (vec![vec![0.0; count]; count], vec![0.0; count]);
    for ([x, y], shift) in slopes {
        for (axis, shift) in shift.iter().enumerate() {
            let step = if axis == 0 { [STEP, 0.0] } else { [0.0, STEP] };
            let slope = |j: &u32| {
                let [after, before] = [1.0, -1.0].map(|s| zernike(*j, x + s * step[0], y + s * step[1]));
                pixels * (after - before) / (2.0 * STEP)
            };
            let mut row: Vec<f64> = terms.iter().map(slope).collect();
            row.extend([f64::from(axis == 0), f64::from(axis == 1)]);
            for i in 0..count {
                right[i] += row[i] * shift;
                (0..count).for_each(|j| normal[i][j] += row[i] * row[j]);
            }
        }
    }
    (0..terms.len()).for_each(|i| normal[i][i] += (SHIFT_ERROR / SPREAD).powi(2));
    (0..2).for_each(|i| normal[terms.len() + i][terms.len() + i] += 1e-6);
    let mut waves = solve(&normal, &right)?;
    let common = waves.split_off(terms.len());
    Some((waves, [common[0], common[1]]))
}

#[cfg(test)]
mod tests {
    use super::super::map::CameraMap;
    use super::*;
    use eyebox_optics::DisplayModel;

    #[test]
    fn a_shift_moves_the_places_that_pixels_look_at() {
        let numbers = [-0.9, 0.1, 0.02, 0.12, 0.95, -0.03, 0.01, 0.0, 0.01, 0.0];
        let map = CameraMap { numbers, slm: [40, 54], camera: [160, 200] };
        let at = Parameters { model: DisplayModel::default(), map, camera_pixel: 1.0, soft_edge: true };
        let moved = shifted(&at, [3.0, -2.0]);
        for pixel in [[100.0, 80.0], [60.0, 50.0]] {
            let (before, after) = (at.map.to_slm(pixel), moved.map.to_slm(pixel));
            assert!((after[0] - before[0] - 3.0).abs() < 0.2, "{before:?} {after:?}");
            assert!((after[1] - before[1] + 2.0).abs() < 0.2, "{before:?} {after:?}");
        }
    }

    #[test]
    fn slopes_give_the_wavefront_and_the_shift_that_they_share() {
        let terms: Vec<u32> = (3..=9).collect();
        let truth = [0.1, -0.2, 0.05, 0.0, 0.12, -0.06, 0.03];
        let places =
            [[0.0, 0.0], [0.4, 0.1], [-0.3, 0.3], [0.1, -0.5], [0.7, 0.7], [-0.7, 0.6], [0.6, -0.7], [-0.7, -0.7]];
        let slope = |[x, y]: [f64; 2]| {
            let path = |x: f64, y: f64| terms.iter().zip(truth).map(|(j, c)| c * zernike(*j, x, y)).sum::<f64>();
            let along = |dx: f64, dy: f64| 2.0 * (path(x + dx, y + dy) - path(x - dx, y - dy)) / 2e-3;
            ([x, y], [along(1e-3, 0.0) + 1.5, along(0.0, 1e-3) - 0.7])
        };
        let slopes: Vec<_> = places.into_iter().map(slope).collect();
        let (waves, common) = wavefront(&slopes, 2.0, &terms).expect("a solution");
        for (got, want) in waves.iter().zip(truth) {
            assert!((got - want).abs() < 0.03, "{waves:?} instead of {truth:?}");
        }
        assert!((common[0] - 1.5).abs() < 0.3 && (common[1] + 0.7).abs() < 0.3, "{common:?}");
    }
}
