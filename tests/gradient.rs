//! Compares the gradients of an engine with central differences of a loss in float64.

use crate::noise;
use eyebox::low_level::engine::{Buffer, Engine, cpu::CpuEngine};
use std::f64::consts::TAU;

/// Returns random phases (rad) in both precisions, which float32 stores exactly. They are not near the wrap of a drive,
/// because the loss jumps there.
pub fn unwrapped_phases(count: usize, seed: u64) -> (Vec<f64>, Vec<f32>) {
    let rounded: Vec<f32> = noise(count, seed).iter().map(|x| (0.02 + (x + 1.0) * 0.498 * TAU) as f32).collect();
    (rounded.iter().map(|p| f64::from(*p)).collect(), rounded)
}

/// Returns `count` random target images with values from 0 to 1.
pub fn random_targets(count: u64, samples: usize) -> Vec<Vec<f32>> {
    let one = |i| noise(samples, 10 + i).iter().map(|x| (0.5 + 0.5 * x) as f32).collect();
    (0..count).map(one).collect()
}

/// Returns the mean over pupils of the mean square of exposed view minus target (OPTICS 6, on intensities). `view`
/// returns the view through a pupil.
pub fn intensity_loss(targets: &[Vec<f32>], exposure: f64, view: impl Fn(usize) -> Vec<f64>) -> f64 {
    let one = |(i, target): (usize, &Vec<f32>)| {
        let view = view(i);
        assert_eq!(view.len(), target.len());
        let squares = view.iter().zip(target).map(|(v, t)| (exposure * v - f64::from(*t)).powi(2));
        squares.sum::<f64>() / target.len() as f64
    };
    targets.iter().enumerate().map(one).sum::<f64>() / targets.len() as f64
}

/// Returns the gradient after one step of Adam, in which the first moment is a tenth of the gradient.
pub fn gradient_of(engine: &mut CpuEngine) -> Vec<f64> {
    let momentum = engine.read(Buffer::Momentum).expect("the first moment of a step of Adam");
    momentum.iter().map(|m| f64::from(*m) * 10.0).collect()
}

/// Asserts that the gradient at these phases is the derivative of the loss in random directions. `directions` is their
/// number, and `bound` is the allowed relative error.
pub fn assert_derivative(
    gradient: &[f64],
    phases: &[f64],
    directions: u64,
    bound: f64,
    what: &str,
    loss: impl Fn(&[f64]) -> f64,
) {
    assert_eq!(gradient.len(), phases.len());
    let h = 1e-5;
    for seed in 0..directions {
        let direction = noise(phases.len(), 100 + seed);
        let at = |s: f64| loss(&phases.iter().zip(&direction).map(|(p, d)| p + s * h * d).collect::<Vec<_>>());
        let numeric = (at(1.0) - at(-1.0)) / (2.0 * h);
        let closed: f64 = gradient.iter().zip(&direction).map(|(g, d)| g * d).sum();
        assert!((numeric - closed).abs() < bound * numeric.abs(), "{what}: {closed}, not {numeric}");
    }
}
