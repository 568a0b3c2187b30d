//! Computes first phases in the far field from the picture's Fourier transform.
//!
//! The SLM is in the pupil plane there. No tile of it is like another, and no table knows a place of the picture. But
//! each pupil cuts a piece out of the SLM, and each piece of the transform of a picture with random phases shows the
//! whole picture. This is a kinoform (L. B. Lesem, P. M. Hirsch and J. A. Jordan, IBM Journal of Research and
//! Development 13, 1969). Its amplitude is left out because it is even in the mean.

use crate::engine::{EngineError, on_host};
use crate::optics::{Optics, Pupil};
use crate::solve::problem::Problem;
use crate::solve::sampling::random_phases;
use eyebox_kernels::fft::{Columns, Direction, Plans};
use eyebox_kernels::pupil_light::{self, pupil_light};
use eyebox_kernels::{Complex32, trig};
use rayon::prelude::*;
use std::sync::LazyLock;

/// Seed of the random phases of the first sub-frame, which are the same for all pictures. Further sub-frames count from
/// it.
const SEED: u64 = 1;

/// Plans of the transforms of pictures, which each new picture of a session reuses.
static PLANS: LazyLock<Plans> = LazyLock::new(Plans::default);

/// Returns true if the views of `problem` are as large as the picture of its SLM. A piece of a far field has the views
/// of the whole.
pub(super) fn exists(problem: &Problem) -> bool {
    let views = problem.pyramid.levels.first();
    views.is_some_and(|views| (views.height, views.width) == problem.optics.image_size())
}

/// Computes first phases (sub-frames, height, width) of the scene of `problem` through `pupil`, radians in -pi .. pi.
///
/// # Errors
/// [`EngineError`] for views that are not [as large as the picture](exists), or that are on a device that does not
/// answer.
pub(super) fn phases(problem: &Problem, pupil: &Pupil, frames: usize) -> Result<Vec<f32>, EngineError> {
    let optics @ Optics { height, width, .. } = problem.optics;
    let (rows, columns) = optics.image_size();
    if !exists(problem) {
        return Err(EngineError::Mismatch {
            reason: format!("a picture of {rows} x {columns} has views of another size"),
        });
    }
    let amplitude = amplitude(problem, pupil)?;
    let levels = problem.model.as_ref().map(|model| (model.model(), &model.pixels()[..height * width]));
    let (top, left) = optics.first_bin();
    let mut phases = vec![0.0; frames * height * width];
    phases.par_chunks_exact_mut(height * width).enumerate().for_each(|(frame, phases)| {
        let wave = |(phase, amplitude): (f32, &f32)| {
            let (cos, sin) = trig::cos_sin(phase);
            Complex32::new(amplitude * cos, amplitude * sin)
        };
        let random = random_phases(rows * columns, SEED + frame as u64);
        let mut field: Vec<Complex32> = random.into_iter().zip(&amplitude).map(wave).collect();
        PLANS.fft(&mut field, rows, columns, Direction::Forward, Columns::all(columns), |_| ());
        for (y, line) in (top..).zip(phases.chunks_exact_mut(width)) {
            let row = &field[y.rem_euclid(rows as i64) as usize * columns..][..columns];
            for (x, phase) in (left..).zip(line) {
                *phase = row[x.rem_euclid(columns as i64) as usize].arg();
            }
        }
        if let Some((model, levels)) = levels {
            for (phase, level) in phases.iter_mut().zip(levels) {
                *phase = trig::wrap(model.drive_of(f64::from(*phase), f64::from(*level)) as f32);
            }
        }
    });
    Ok(phases)
}

/// Computes the amplitude of the image through a pupil, with the axis first.
fn amplitude(problem: &Problem, pupil: &Pupil) -> Result<Vec<f32>, EngineError> {
    let (rows, columns) = problem.optics.image_size();
    let seen = problem.views.coverage(pupil);
    let [height, line] = [rows, columns].map(|n| n as u32);
    let end = seen.len() as u32;
    let stride = height * line;
    let place = pupil_light::Args { height, width: line, line, first: 0, stride, from: 0, begin: 0, end, adds: 0 };
    let mut light = vec![0; rows * columns];
    pupil_light(&place, &on_host(&problem.pyramid)?.levels[0].views, &pupil_light::shares(&seen), &mut light);
    let from = |i: usize| (i / columns + rows / 2) % rows * columns + (i % columns + columns / 2) % columns;
    Ok((0..rows * columns).map(|i| (light[from(i)] as f32).sqrt()).collect())
}

#[cfg(test)]
mod tests {
    use super::super::StartTable;
    use super::*;
    use crate::engine::cpu::CpuEngine;
    use crate::evaluate::Sums;
    use crate::optics::{Color, Display, DisplayModel, Padding};
    use crate::plan::ModelTables;
    use crate::scene::{self, Request};
    use crate::solve::{RefineSettings, Refiner, random_phases};

    const FRAMES: usize = 4;

    /// All light of an SLM in the pupil plane is in the picture, which is more than twice the light that it needs.
    fn exposure(problem: &Problem) -> f64 {
        problem.mean / 0.45
    }

    /// A far field that is wider than high, so that its picture is larger than its SLM.
    fn problem() -> Problem {
        let display = Display { height: 64, width: 96, pitch: 250e-6, ..Display::preset("far-field").unwrap() };
        let request = Request { views: 5, ..Request::new(&display, &[Color::Blue]) };
        let field = scene::load("builtin:still-life", &request).unwrap();
        Problem::new(&field, Color::Blue, &display, Padding::default()).unwrap()
    }

    fn refiner(problem: &Problem, phases: &[f32]) -> Refiner {
        Refiner::new(problem.clone(), phases, exposure(problem), RefineSettings::default(), Box::new(CpuEngine::new()))
            .unwrap()
    }

    #[test]
    fn a_far_field_is_seen_before_the_first_step() {
        let problem = problem();
        let table = StartTable::of(&problem, FRAMES, &mut |_| true).unwrap().expect("a far field");
        let pupils = [[0.0, 0.0, 6.0, 0.0], [4.0, -3.0, 5.0, 0.0], [-5.0, 4.0, 8.0, 0.0]].map(Pupil::from_mm);
        let db = |refiner: &mut Refiner| {
            let sums = refiner.look(&pupils).unwrap();
            let fitted = Sums::fit_exposure(&sums).unwrap();
            sums.iter().map(|s| s.psnr(fitted)).sum::<f64>() / sums.len() as f64
        };
        let random = random_phases(FRAMES * 64 * 96, 7);
        let mut by_steps = refiner(&problem, &random);
        let noise = db(&mut by_steps);
        assert!(by_steps.step().unwrap().is_finite());
        let stepped = db(&mut by_steps);
        let mut at_once = refiner(&problem, &random);
        at_once.look_up(&table).unwrap();
        let seen = db(&mut at_once);
        println!("{noise:.2} dB of random phases, {stepped:.2} after a step, {seen:.2} of the transform");
        assert!(seen > stepped + 2.0 && seen > noise + 3.0);
        // The engine continues with these phases, and no look-up of a table makes them.
        assert_eq!(at_once.phases().unwrap(), table.phases(&problem, 1.0).unwrap());
        assert!(table.look_up(&problem, 1.0).is_none());
    }

    #[test]
    fn drives_show_the_phases_on_a_display_with_faults() {
        let plain = problem();
        let model = DisplayModel {
            level: [[0.95, 1.0, 1.05], [1.0, 1.04, 0.98], [1.1, 1.0, 0.9]],
            bend: [0.12, -0.06],
            ..DisplayModel::default()
        };
        let levels = model.level_map([64, 96]);
        let tables = ModelTables::new(model.clone(), 10e-3, 256, plain.optics, plain.optics);
        let faulty = Problem { model: tables, ..plain.clone() };
        let pupil = Pupil::from_mm([0.0, 0.0, 12.0, 0.0]);
        let [wanted, drives] = [&plain, &faulty].map(|problem| phases(problem, &pupil, 1).unwrap());
        let mut reached = 0;
        for ((wanted, drive), level) in wanted.iter().zip(&drives).zip(levels) {
            let wanted = f64::from(*wanted).rem_euclid(std::f64::consts::TAU);
            let shown = model.look_up(f64::from(*drive).rem_euclid(std::f64::consts::TAU), level).0;
            // Full drive may be less than a turn.
            if wanted < 0.89 * std::f64::consts::TAU {
                assert!((shown - wanted).abs() < 1e-3, "{shown} instead of {wanted}");
                reached += 1;
            }
        }
        assert!(reached > 5000);
    }

    #[test]
    fn a_piece_of_a_far_field_has_none() {
        let whole = problem();
        let piece = Problem { optics: whole.optics.piece([8, 8], [32, 32]), ..whole };
        assert!(!exists(&piece) && !StartTable::fits(&piece));
        assert!(matches!(phases(&piece, &Pupil::from_mm([0.0, 0.0, 2.0, 0.0]), 1), Err(EngineError::Mismatch { .. })));
    }
}
