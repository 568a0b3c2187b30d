//! Fits the place of the camera's picture by comparing pictures with predictions.
//!
//! The dots alone leave an error of half a pixel, and a bench's picture creeps over its camera.

use super::sensor::{Fine, Sensor};
use crate::fit::dot;
use eyebox_optics::linear::solve;

/// Numbers of a [`CameraMap`](crate::map::CameraMap) that give the position of the picture.
pub(super) const PLACE: [usize; 2] = [2, 5];
/// Gauss-Newton rounds. A round that does not help is repeated with a quarter of its step, up to `TRIES` steps in all.
const ROUNDS: usize = 8;
const TRIES: usize = 3;
/// Change of a number for its slope, in units of half a picture's width.
const STEP: f64 = 2e-4;
/// Another round follows only if a round reduces the share that is left by more than this fraction.
const WORTH: f64 = 1e-3;
/// Number of pixels that are compared.
const PIXELS: usize = 20_000;

/// The light of a picture by camera pixels (NaN if a pixel was saturated), and its prediction by the model.
pub(super) struct Pair<'a> {
    pub(super) light: &'a [f32],
    pub(super) predicted: &'a Fine,
}

/// The rest of the pictures, and the normal equations of the moving numbers.
struct Left {
    /// Share of a picture's variance that is left, mean over the pictures.
    share: f64,
    normal: Vec<Vec<f64>>,
    right: Vec<f64>,
}

/// Returns the sensor with the numbers `free` of its map fitted to the pictures. Each picture has its own gain and
/// offset.
pub(super) fn registered(sensor: &Sensor, pairs: &[Pair], free: &[usize]) -> Sensor {
    let every = sensor.pixels.len().div_ceil(PIXELS).max(1);
    let mut now = sensor.thinned(every);
    let mut left = Left::of(&now, pairs, every, free);
    for _ in 0..ROUNDS {
        let Some(step) = solve(&left.normal, &left.right) else { break };
        let tried = (0..TRIES as i32).find_map(|tries| {
            let mut map = now.map;
            free.iter().zip(&step).for_each(|(p, s)| map.numbers[*p] += s * 0.25f64.powi(tries));
            let moved = now.moved(map);
            let after = Left::of(&moved, pairs, every, free);
            (after.share < left.share).then_some((moved, after))
        });
        let Some((moved, after)) = tried else { break };
        let worth = left.share - after.share > WORTH * left.share;
        (now, left) = (moved, after);
        if !worth {
            break;
        }
    }
    sensor.moved(now.map)
}

impl Left {
    fn of(sensor: &Sensor, pairs: &[Pair], every: usize, free: &[usize]) -> Self {
        let moved: Vec<Sensor> = free
            .iter()
            .map(|p| {
                let mut map = sensor.map;
                map.numbers[*p] += STEP;
                sensor.moved(map)
            })
            .collect();
        let mut all =
            Self { share: 0.0, normal: vec![vec![0.0; free.len()]; free.len()], right: vec![0.0; free.len()] };
        for pair in pairs {
            let light: Vec<f32> = pair.light.iter().copied().step_by(every).collect();
            let known = |values: &[f32]| -> Vec<f64> {
                values.iter().zip(&light).filter(|(_, l)| l.is_finite()).map(|(v, _)| f64::from(*v)).collect()
            };
            let seen = sensor.see(pair.predicted);
            let (mut light, mut model) = (known(&light), known(&seen));
            centre(&mut light);
            centre(&mut model);
            let variance = dot(&light, &light).max(f64::MIN_POSITIVE);
            let gain = take_out(&mut light, &model);
            let slopes: Vec<Vec<f64>> = moved
                .iter()
                .map(|moved| {
                    let there = moved.see(pair.predicted);
                    let mut slope = known(&there.iter().zip(&seen).map(|(a, b)| a - b).collect::<Vec<_>>());
                    centre(&mut slope);
                    take_out(&mut slope, &model);
                    slope.iter_mut().for_each(|v| *v *= gain / STEP);
                    slope
                })
                .collect();
            let count = pairs.len() as f64;
            all.share += dot(&light, &light) / variance / count;
            for (i, a) in slopes.iter().enumerate() {
                all.right[i] += dot(a, &light) / variance / count;
                slopes.iter().enumerate().for_each(|(j, b)| all.normal[i][j] += dot(a, b) / variance / count);
            }
        }
        all
    }
}

fn centre(values: &mut [f64]) {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    values.iter_mut().for_each(|v| *v -= mean);
}

/// Subtracts the multiple of `of` from values that it explains. Returns the factor.
fn take_out(values: &mut [f64], of: &[f64]) -> f64 {
    let gain = dot(values, of) / dot(of, of).max(f64::MIN_POSITIVE);
    values.iter_mut().zip(of).for_each(|(v, o)| *v -= gain * o);
    gain
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_steps::sensor::Grid;
    use crate::dots::ALL;
    use crate::map::CameraMap;
    use eyebox_kernels::modulate;
    use eyebox_solve::solve::SplitMix;
    use std::f64::consts::TAU;

    /// A prediction with waves in all directions.
    fn predicted() -> Fine {
        let place = modulate::Args { height: 40, width: 48, grid_height: 48, grid_width: 60, top: 4, left: 6 };
        let mut random = SplitMix(3);
        let waves: Vec<[f64; 3]> = (0..40).map(|_| std::array::from_fn(|_| random.unit())).collect();
        let sample = |i: usize| {
            let (x, y) = ((i % 60) as f64 / 60.0, (i / 60) as f64 / 48.0);
            let wave =
                |[a, b, c]: &[f64; 3]| (TAU * ((16.0 * a).round() * x + ((b - 0.5) * 24.0).round() * y + c)).cos();
            1.0 + waves.iter().map(wave).sum::<f64>() as f32 / 20.0
        };
        let image: Vec<f32> = (0..48 * 60).map(sample).collect();
        Fine::of_image(&image, Grid { rows: 48, columns: 60, place })
    }

    #[test]
    fn the_map_is_found_by_what_is_predicted() {
        let dots = CameraMap {
            numbers: [0.9, 0.03, 0.02, -0.03, 0.91, -0.05, 0.02, -0.01, 0.01, 0.0],
            slm: [40, 48],
            camera: [84, 90],
        };
        let (sensor, predicted) = (Sensor::new(dots), predicted());
        let mut truth = dots;
        let off = [0.012, -0.004, 0.015, 0.006, -0.01, -0.012, 0.004, 0.006, -0.004];
        ALL.iter().zip(off).for_each(|(p, off)| truth.numbers[*p] += off);
        // The picture has another gain, some veiling light, and saturated pixels.
        let mut light: Vec<f32> = sensor.moved(truth).see(&predicted).iter().map(|v| 0.3 * v + 0.2).collect();
        light.iter_mut().step_by(17).for_each(|v| *v = f32::NAN);
        let pairs = [Pair { light: &light, predicted: &predicted }];
        let corners = [[1.0, 1.0], [46.0, 2.0], [24.0, 20.0], [3.0, 37.0], [45.0, 38.0]];
        let far = |map: CameraMap| {
            let off = |at: [f64; 2]| {
                let ([x, y], [u, v]) = (map.to_camera(at), truth.to_camera(at));
                (x - u).hypot(y - v)
            };
            corners.map(off).into_iter().fold(0.0, f64::max)
        };
        let found = registered(&sensor, &pairs, &ALL);
        assert!(far(dots) > 1.0 && far(found.map) < 0.02, "{} pixels off, then {}", far(dots), far(found.map));
        assert_eq!((found.pixels.len(), found.map.slm), (sensor.pixels.len(), dots.slm));
        // If the position alone is free, the other numbers stay as they were.
        let placed = registered(&found, &pairs, &PLACE);
        assert!(far(placed.map) < 0.02 && placed.map.numbers[0] == found.map.numbers[0]);
    }
}
