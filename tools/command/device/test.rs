//! `eyebox device test` compares the same solve on a device and on the CPU, and measures steps with `--measure`.

use super::measure::{self, Row};
use super::small_solve::{Solve, solve};
use crate::common::Engines;
use crate::groups::{DeviceArgs, EngineArgs, EngineName};
use crate::talk::print_report;
use crate::{Failure, progress};
use clap::Args;
use eyebox::low_level::engine::{Storage, cpu::CpuEngine};
use eyebox::low_level::gpu::Options;
use eyebox::low_level::reason;
use eyebox::low_level::solve::Solution;
use serde_json::json;
use std::f32::consts::PI;

/// The arguments of `eyebox device test`.
#[derive(Args)]
pub struct Test {
    #[command(flatten)]
    pub device: DeviceArgs,
    /// Measure steps of several sizes in fp32 and fp16, for a report (docs/measure.md)
    #[arg(help_heading = "Output", long)]
    pub measure: bool,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// Steps of the comparison. After many steps rounding alone makes phases differ.
const STEPS: usize = 3;
/// The solve of the comparison.
const TEST: Solve = Solve { size: [128, 128], pupils: 16, steps: STEPS };
/// The largest difference of quality that halves explain, dB.
const LARGEST_DB: f64 = 0.1;
/// The largest root mean square difference of phases that rounding explains, radians. Both engines compute in float32,
/// and lavapipe is 5e-7 off.
const LARGEST_RMS: f64 = 1e-3;

/// Solves on the device and on the CPU, and compares the phases.
pub fn run(args: &Test) -> Result<(), Failure> {
    let device = DeviceArgs { device: args.device.device.clone() };
    let args_of_engine = EngineArgs { engine: EngineName::Vulkan, device };
    let engines = Engines::new(&args_of_engine, &Options::default())?;
    let mut engine = engines.open()?;
    let [on_device, halves] = [Storage::F32, Storage::F16].map(|storage| solve(engine.as_mut(), TEST, storage));
    let (on_device, halves) = (on_device?, halves?);
    let on_cpu = solve(&mut CpuEngine::new(), TEST, Storage::F32)?;
    let rms = rms_difference(&on_device.phases, &on_cpu.phases);
    let quality = |solution: &Solution| solution.validation.quality().map(|[mean, _]| mean);
    let halves_db = quality(&halves).zip(quality(&on_cpu)).map(|(halves, exact)| halves - exact);
    let is_right = rms <= LARGEST_RMS && halves_db.is_none_or(|db| db.abs() <= LARGEST_DB);
    if args.measure {
        progress::catch_interrupt();
    }
    let rows = if args.measure { measure::rows(&engines, !args.json)? } else { Vec::new() };
    let [device_ms, cpu_ms] = [&on_device, &on_cpu].map(|solution| solution.step_seconds * 1e3);
    if args.json {
        print_report(json!({
            "engine": engine.describe(), "right": is_right, "phase_rms_rad": rms, "phase_rms_limit_rad": LARGEST_RMS,
            "step_ms": device_ms, "cpu_step_ms": cpu_ms, "psnr_mean_db": quality(&on_device), "cpu_psnr_mean_db": quality(&on_cpu),
            "fp16_psnr_difference_db": halves_db, "driver": measure::driver(&engine.describe()),
            "steps": rows.iter().map(Row::as_json).collect::<Vec<_>>(),
        }));
    } else {
        println!("{}", engine.describe());
        println!(
            "  phases      {rms:.1e} rad off those of the CPU (root mean square after {STEPS} steps, at most {LARGEST_RMS:.0e})"
        );
        if let Some(db) = halves_db {
            println!("  fp16        {:.3} dB off the quality in fp32 (at most {LARGEST_DB} dB)", db.abs());
        }
        println!(
            "  step        {device_ms:.2} ms, on the CPU {cpu_ms:.2} ms ({}x{}, 8 sub-frames)",
            TEST.size[0], TEST.size[1]
        );
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
