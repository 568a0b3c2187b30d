//! How far a forecast is off: the same arguments, solved by a process of its own.

use super::args::Plan;
use crate::Failure;
use crate::progress::JobBar;
use eyebox::optics::Color;
use eyebox::solve::Forecast;
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;

/// What `solve --json` says of the arguments that this process was given, but for the options that are `plan`'s own.
fn solve(out: &Path) -> Result<Value, Failure> {
    let asked = |what: String| Failure::Asked(what);
    let mut given = std::env::args().skip_while(|a| a != "plan").skip(1);
    let mut kept = vec!["solve".to_owned(), "--json".into(), "--out".into(), out.display().to_string()];
    while let Some(argument) = given.next() {
        match argument.as_str() {
            "--check" | "--time-again" | "--json" => {}
            "-o" | "--out" => drop(given.next()),
            other if other.starts_with("-o") || other.starts_with("--out=") => {}
            _ => kept.push(argument),
        }
    }
    let program = std::env::current_exe().map_err(|e| asked(format!("this program cannot be found again: {e}")))?;
    let bar = JobBar::new(true);
    bar.show("solving what is planned", 0.0);
    let answer =
        Command::new(program).args(&kept).output().map_err(|e| asked(format!("solve cannot be started: {e}")))?;
    if !answer.status.success() {
        let said = String::from_utf8_lossy(&answer.stderr);
        // Before it there may be lines of its progress.
        let last = said.trim().lines().last().unwrap_or_default();
        return Err(asked(last.trim_start_matches("eyebox: ").to_owned()));
    }
    serde_json::from_slice(&answer.stdout).map_err(|e| asked(format!("solve answered no JSON: {e}")))
}

/// Solves, and compares with the forecasts.
pub fn run(args: &Plan, forecasts: &[(Color, Forecast)]) -> Result<Value, Failure> {
    let temp = tempfile::tempdir().map_err(|e| Failure::Asked(format!("no folder for a while: {e}")))?;
    let said = solve(&temp.path().join("hologram.zarr"))?;
    let off = |predicted: f64, measured: f64| 100.0 * (predicted / measured - 1.0);
    let mut colors = Vec::new();
    for ((color, f), solved) in forecasts.iter().zip(said["colors"].as_array().into_iter().flatten()) {
        let (predicted, measured) = (f.step_seconds * 1e3, solved["step_ms"].as_f64().unwrap_or(f64::NAN));
        colors.push(json!({ "color": color, "predicted_ms": predicted, "measured_ms": measured }));
        if !args.solve.json {
            let off = off(predicted, measured);
            println!("  measured       {color}: {measured:.1} ms a step; the forecast is {off:+.0} %");
        }
    }
    let predicted = forecasts.iter().map(|f| f.1.peak_bytes()).max().unwrap_or(0) as f64 / f64::from(1 << 20);
    let measured = said["peak_memory_mib"].as_f64();
    if let (Some(measured), false) = (measured, args.solve.json) {
        println!("  measured       {measured:.0} MiB at the peak; the forecast is {:+.0} %", off(predicted, measured));
    }
    Ok(json!({ "steps": colors, "predicted_mib": predicted, "measured_mib": measured }))
}
