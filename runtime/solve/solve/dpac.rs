//! Encodes a complex field as two phases per value on a checkerboard, by the double-phase method.
//!
//! The method is from Maimone, Georgiou and Kollin, SIGGRAPH 2017. The field has the amplitude of the central view and
//! smooth phase, and each pixel is at its depth.

use super::error::SolveError;
use super::problem::Problem;
use super::settings::Settings;
use crate::engine::{Buffer, Engine};
use crate::optics::{Geometry, Pupil, WindowFactor};
use crate::plan::{Comparison, Purpose};
use crate::scene;
use eyebox_kernels::trig::wrap;
use std::sync::Arc;

/// Number of depth layers of a scene.
const LAYERS: usize = 48;

/// Computes phases (frames, height, width). Sub-frames differ in the half of the checkerboard to which a pixel belongs.
///
/// The engine is loaded for one sub-frame and must be loaded again for later work.
///
/// # Errors
/// [`SolveError::Engine`] if the engine fails.
pub(super) fn phases(problem: &Problem, settings: &Settings, engine: &mut dyn Engine) -> Result<Vec<f32>, SolveError> {
    let planner = problem.planner(1, WindowFactor::Full);
    engine.load(&planner.shape(Purpose::Project), Some(Arc::clone(&problem.pyramid)))?;
    let per_pixel = problem.optics.depth_of_disparity(1.0, problem.views.cell);
    let range = settings.depth.map(|z| z / per_pixel);
    let (light, disparity) = scene::central_view(&problem.pyramid, &problem.views, range);

    // Each layer holds the pixels nearest to its depth. Its light passes the disc that a centered eye can see.
    let layers = if range[1] > range[0] { LAYERS } else { 1 };
    let step = (range[1] - range[0]) / layers as f64;
    let layer_of = |d: f32| (((f64::from(d) - range[0]) / step) as usize).min(layers - 1);
    let layer: Vec<usize> = disparity.iter().map(|d| if layers == 1 { 0 } else { layer_of(*d) }).collect();
    let pupil_pass = |i: usize| {
        let depth = (range[0] + (i as f64 + 0.5) * step) * per_pixel;
        let pupil = Pupil { x: 0.0, y: 0.0, diameter: problem.eyebox, depth };
        planner.pupil_pass(&pupil, &Comparison::default())
    };
    let full = planner.layers_step((0..layers).map(pupil_pass).collect());
    // Index 0 of a window is bin (y0, x0), so its image is modulated by that frequency (mostly the signs of a
    // checkerboard).
    let ((height, width), window) = (planner.grid.image_size(), full.pupil_passes[0].window);
    let turn = |i: usize| {
        let across = (window.y0 * (i / width) as i64).rem_euclid(height as i64) as f64 / height as f64;
        let along = (window.x0 * (i % width) as i64).rem_euclid(width as i64) as f64 / width as f64;
        let (sin, cos) = (-std::f64::consts::TAU * (across + along)).sin_cos();
        [cos as f32, sin as f32]
    };
    engine.write(Buffer::Change, &vec![0.0; 2 * planner.grid.height * planner.grid.width])?;
    for i in 0..layers {
        if !layer.contains(&i) {
            continue;
        }
        let value = |at: usize| if layer[at] == i { light[at].sqrt() } else { 0.0 };
        // In the far field the axis comes first, as in the planner's target images.
        let (ay, ax) = if planner.grid.geometry == Geometry::FarField { (height / 2, width / 2) } else { (0, 0) };
        let rolled = |n: usize| (n / width + ay) % height * width + (n % width + ax) % width;
        let window: Vec<f32> = (0..height * width)
            .flat_map(|n| {
                let amplitude = value(rolled(n));
                turn(n).map(|t| t * amplitude)
            })
            .collect();
        engine.write(Buffer::Window(0), &window)?;
        engine.run_part(&full, 3 * i..3 * i + 3)?;
    }
    engine.run_part(&full, 3 * layers..full.list.len())?;
    let mut field = engine.read(Buffer::Change)?;
    let place = planner.place();
    let Some(model) = problem.model.as_ref().map(|tables| tables.model()) else {
        return Ok(encode(&place, &field, settings.frames));
    };
    let (height, width) = (place.height as usize, place.width as usize);
    // A weaker source needs a larger amplitude.
    for (i, amplitude) in model.source_amplitude([height, width]).into_iter().enumerate() {
        let at = (i / width + place.top as usize) * place.grid_width as usize + i % width + place.left as usize;
        field[2 * at..2 * at + 2].iter_mut().for_each(|v| *v /= amplitude as f32);
    }
    let levels = model.level_map([height, width]);
    let mut phases = encode(&place, &field, settings.frames);
    for frame in phases.chunks_exact_mut(height * width) {
        let each = frame.iter_mut().zip(&levels);
        each.for_each(|(phase, level)| *phase = model.drive_of(f64::from(*phase), *level) as f32);
    }
    Ok(phases)
}

/// Encodes `field`, pairs (re, im) on the grid, as phases.
fn encode(place: &eyebox_kernels::modulate::Args, field: &[f32], frames: usize) -> Vec<f32> {
    let (height, width) = (place.height as usize, place.width as usize);
    let at = |y: usize, x: usize| {
        let i = 2 * ((y + place.top as usize) * place.grid_width as usize + x + place.left as usize);
        [field[i], field[i + 1]]
    };
    let pixels = || (0..height).flat_map(move |y| (0..width).map(move |x| (y, x)));
    let largest = pixels().map(|(y, x)| at(y, x)).map(|[re, im]| re.hypot(im)).fold(0.0, f32::max);
    let mut phases = Vec::with_capacity(frames * height * width);
    for f in 0..frames {
        phases.extend(pixels().map(|(y, x)| {
            let [re, im] = at(y, x);
            let share = if largest > 0.0 { (re.hypot(im) / largest).min(1.0) } else { 0.0 };
            let apart = share.acos();
            wrap(im.atan2(re) + if (x + y + f).is_multiple_of(2) { apart } else { -apart })
        }));
    }
    phases
}
