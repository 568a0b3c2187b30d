//! Measures the energy of the spectrum over the pupil plane, and its evenness over the eyebox.

use crate::engine::{Buffer, Engine, EngineError};
use crate::optics::{Geometry, Optics, Pupil, Window, WindowFactor};
use crate::plan::{Comparison, Planner};

/// Returns the energy per bin of the spectrum of the phases in `engine`, summed over sub-frames. It is (grid height,
/// grid width) with the middle of the eyebox in the middle, +y down, and a mean of 1.
///
/// The engine must have been loaded with the planner's shape.
///
/// # Errors
/// Returns the errors of the engine.
pub fn energy(engine: &mut dyn Engine, planner: &Planner) -> Result<Vec<f64>, EngineError> {
    let planner = Planner { factor: WindowFactor::Full, views: None, ..planner.clone() };
    let (height, width) = (planner.grid.height, planner.grid.width);
    // This pupil passes everything, because engines skip columns that no pupil passes.
    let everything = Pupil { x: 0.0, y: 0.0, diameter: 2.0 * planner.grid.eyebox(), depth: 0.0 };
    let step = planner.view_step(vec![planner.pupil_pass(&everything, &Comparison::default())]);
    engine.run_part(&step, 0..step.shared())?;
    let field = engine.read(Buffer::Field)?;
    let mut energy = vec![0.0; height * width];
    for frame in field.chunks_exact(2 * height * width) {
        for (i, value) in frame.chunks_exact(2).enumerate() {
            // The far field's pixels already have that order.
            let at = match planner.grid.geometry {
                Geometry::Relay => (i / width + height / 2) % height * width + (i % width + width / 2) % width,
                Geometry::FarField => i,
            };
            energy[at] += f64::from(value[0]).powi(2) + f64::from(value[1]).powi(2);
        }
    }
    let mean = energy.iter().sum::<f64>() / energy.len() as f64;
    if mean > 0.0 {
        energy.iter_mut().for_each(|e| *e /= mean);
    }
    Ok(energy)
}

/// Returns the mean energy of the bins inside each pupil's disc, which is 1 for an even eyebox. `energy` is the result
/// of [`energy`] over `grid`. The value is 0 for a pupil that contains no bin.
///
/// # Panics
/// Panics if `energy` does not have the grid's size, which is a mistake of the caller.
pub fn passed(energy: &[f64], grid: &Optics, pupils: &[Pupil]) -> Vec<f64> {
    let width = grid.width;
    assert_eq!(energy.len(), grid.height * width, "one value per bin");
    let through = |pupil: &Pupil| {
        let window = Window::new(grid, pupil, WindowFactor::One);
        let (mut sum, mut count) = (0.0, 0usize);
        for (j, &[first, end]) in window.spans(grid, pupil).iter().enumerate() {
            // Spans hold existing bins only.
            let row = window.y0 + j as i64 - grid.first_bin().0;
            for k in first..end {
                let column = window.x0 + i64::from(k) - grid.first_bin().1;
                sum += energy[row as usize * width + column as usize];
                count += 1;
            }
        }
        if count > 0 { sum / count as f64 } else { 0.0 }
    };
    pupils.iter().map(through).collect()
}

/// Returns the coefficient of variation, which is the standard deviation over the mean. It is 0 for no values.
pub fn variation(values: &[f64]) -> f64 {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    if mean > 0.0 { variance.sqrt() / mean } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::super::places;
    use super::*;
    use crate::engine::cpu::CpuEngine as Cpu;
    use crate::plan::Purpose;

    fn spectrum_of(phases: &[f32], optics: Optics, frames: usize) -> Vec<f64> {
        let planner = Planner::new(optics, frames, WindowFactor::Full);
        let mut engine = Cpu::new();
        engine.load(&planner.shape(Purpose::View), None).unwrap();
        engine.write(Buffer::Phases, phases).unwrap();
        energy(&mut engine, &planner).unwrap()
    }

    #[test]
    fn a_grating_sends_its_light_where_it_should() {
        // Three turns down over 12 rows, and minus two across 10 columns, give bin (3, -2), below and left of the
        // middle.
        let optics = Optics::new(12, 10, 8e-6, 520e-9, 0.4).unwrap();
        let turn = std::f32::consts::TAU;
        let phase = |i: usize| turn * (3.0 * (i / 10) as f32 / 12.0 - 2.0 * (i % 10) as f32 / 10.0);
        let map = spectrum_of(&(0..120).map(phase).collect::<Vec<_>>(), optics, 1);
        assert!((map[(6 + 3) * 10 + (5 - 2)] - 120.0).abs() < 1e-3, "{map:?}");
        assert!(map.iter().sum::<f64>() - 120.0 < 1e-6);
        // The pupil over that bin gets all of it, the opposite one nothing.
        let (bin_y, bin_x) = optics.bin_size();
        let there = Pupil { x: -2.0 * bin_x, y: 3.0 * bin_y, diameter: 0.5 * bin_x, depth: 0.0 };
        let opposite = Pupil { x: -there.x, y: -there.y, ..there };
        let seen = passed(&map, &optics, &[there, opposite]);
        assert!((seen[0] - 120.0).abs() < 1e-3 && seen[1] < 1e-6, "{seen:?}");
    }

    #[test]
    fn constant_phase_is_uneven_and_random_phase_is_even() {
        let optics = Optics::new(64, 64, 8e-6, 520e-9, 0.4).unwrap();
        let eyebox = 22e-3;
        let pupils = places(eyebox, eyebox / 8.0, 9, 0.0);
        let flat = passed(&spectrum_of(&[0.5; 4096], optics, 1), &optics, &pupils);
        // All light is in one of 81 pupils, which gives sqrt(80).
        assert!((variation(&flat) - 80f64.sqrt()).abs() < 1e-3);
        let mut state = 1u64;
        let random: Vec<f32> = (0..8 * 4096)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 40) as f32 / 16_777_216.0 * std::f32::consts::TAU
            })
            .collect();
        let even = passed(&spectrum_of(&random, optics, 8), &optics, &pupils);
        assert!(variation(&even) < 0.1, "{}", variation(&even));
        assert_eq!((variation(&[]), variation(&[0.0; 4])), (0.0, 0.0));
    }
}
