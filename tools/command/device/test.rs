//! `eyebox device test` compares the same solve on a device and on the CPU.

use crate::Failure;
use crate::common;
use crate::groups::{DeviceArgs, EngineArgs, EngineName};
use crate::talk::print_report;
use clap::Args;
use eyebox::low_level::engine::{Engine, cpu::CpuEngine};
use eyebox::low_level::optics::{Color, Display};
use eyebox::low_level::produce::solve_colors;
use eyebox::low_level::quality::ColorJob;
use eyebox::low_level::reason;
use eyebox::low_level::scene::{self, Request};
use eyebox::low_level::solve::{Flow, Levels, Settings, Solution};
use serde_json::json;
use std::f32::consts::PI;

/// The arguments of `eyebox device test`.
#[derive(Args)]
pub struct Test {
    #[command(flatten)]
    pub device: DeviceArgs,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// The scene of the test.
const SCENE: &str = "builtin:still-life";
/// Pixels of the display along each axis.
const SIZE: usize = 128;
/// Steps of the solve. After many steps rounding alone makes phases differ.
const STEPS: usize = 3;
/// The largest root mean square difference of phases that rounding explains, radians. Both engines compute in float32,
/// and lavapipe is 5e-7 off.
const LARGEST_RMS: f64 = 1e-3;

/// Solves on the device and on the CPU, and compares the phases.
pub fn run(args: &Test) -> Result<(), Failure> {
    let device = DeviceArgs { device: args.device.device.clone() };
    let mut engine = common::engine(&EngineArgs { engine: EngineName::Vulkan, device })?;
    let on_device = solve(engine.as_mut())?;
    let on_cpu = solve(&mut CpuEngine::new())?;
    let rms = rms_difference(&on_device.phases, &on_cpu.phases);
    let quality = |solution: &Solution| solution.validation.quality().map(|[mean, _]| mean);
    let is_right = rms <= LARGEST_RMS;
    let [device_ms, cpu_ms] = [&on_device, &on_cpu].map(|solution| solution.step_seconds * 1e3);
    if args.json {
        print_report(json!({
            "engine": engine.describe(), "right": is_right, "phase_rms_rad": rms, "phase_rms_limit_rad": LARGEST_RMS,
            "step_ms": device_ms, "cpu_step_ms": cpu_ms, "psnr_mean_db": quality(&on_device), "cpu_psnr_mean_db": quality(&on_cpu),
        }));
    } else {
        println!("{}", engine.describe());
        println!(
            "  phases      {rms:.1e} rad off those of the CPU (root mean square after {STEPS} steps, at most {LARGEST_RMS:.0e})"
        );
        println!("  step        {device_ms:.2} ms, on the CPU {cpu_ms:.2} ms ({SIZE}x{SIZE}, 8 sub-frames)");
    }
    if is_right {
        return Ok(());
    }
    Err(Failure::Arguments(reason!(
        "device-differs",
        "{}: its phases are {rms:.1e} rad off those of the CPU. Update its driver, or use --engine cpu",
        engine.describe()
    )))
}

/// Solves the scene of the test.
fn solve(engine: &mut dyn Engine) -> Result<Solution, Failure> {
    let mut display = Display::load("paper")?;
    (display.height, display.width) = (SIZE, SIZE);
    let field = scene::load(SCENE, &Request::new(&display, &[Color::Green]))?;
    let depth = field.depths(&display, None)?;
    let diameter = common::diameters(None, &display, false)?;
    let settings = Settings { steps: STEPS, depth, diameter, ..Settings::default() };
    let levels = Levels::of(&display);
    let job = ColorJob { field: &field, color: Color::Green, display: &display, base: settings.clone(), levels };
    let solved = solve_colors(&job, &[Color::Green], &settings, engine, &mut |_| Flow::Continue)?;
    let solution = solved.into_iter().next().map(|(_, solution)| solution);
    solution.ok_or_else(|| Failure::Arguments(reason!("nothing-solved", "no color was solved")))
}

/// Returns the root mean square of the differences of phases, radians. A full turn is no difference.
fn rms_difference(a: &[f32], b: &[f32]) -> f64 {
    let wrapped = |(a, b): (&f32, &f32)| f64::from((a - b + PI).rem_euclid(2.0 * PI) - PI);
    let sum: f64 = a.iter().zip(b).map(|pair| wrapped(pair).powi(2)).sum();
    (sum / a.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_is_no_difference() {
        assert!(rms_difference(&[-3.1, 3.1, 0.0], &[3.1, -3.1, 0.0]) < 0.1);
        assert!((rms_difference(&[0.5, -0.5], &[0.0, 0.0]) - 0.5).abs() < 1e-6);
    }
}
