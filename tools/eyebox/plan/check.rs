//! How far a forecast is off: the same arguments, solved by a process of its own.

use super::Plan;
use crate::Failure;
use eyebox::optics::Color;
use eyebox::solve::Forecast;
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;

/// Options that `plan` has and `solve` has not, and whether a value follows.
const OWN: [(&str, bool); 4] = [("--check", false), ("--measure", false), ("--seeds", true), ("--time-again", false)];
/// Options of `solve` that are given anew, and whether a value follows.
const GIVEN: [(&str, bool); 4] = [("--json", false), ("-o", true), ("--out", true), ("--seed", true)];

/// What `solve --json` says of the arguments that this process was given, changed by `more`.
pub fn solve(out: &Path, seed: u64, more: &[&str]) -> Result<Value, Failure> {
    let asked = |what: String| Failure::Asked(what);
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let at = arguments.iter().position(|a| a == "plan").unwrap_or(0);
    arguments.drain(..=at);
    let mut kept = vec!["solve".to_owned()];
    let mut rest = arguments.into_iter();
    while let Some(argument) = rest.next() {
        let is = |(name, _): &&(&str, bool)| argument == *name || argument.starts_with(&format!("{name}="));
        let replaced = more.iter().any(|m| argument.split('=').next() == m.split('=').next());
        match OWN.iter().chain(&GIVEN).find(is) {
            Some((name, true)) if argument == *name => drop(rest.next()),
            Some(_) => {}
            None if replaced => {}
            None => kept.push(argument),
        }
    }
    kept.extend(["--json".into(), "--seed".into(), seed.to_string(), "-o".into(), out.display().to_string()]);
    kept.extend(more.iter().map(|m| (*m).to_owned()));
    let program = std::env::current_exe().map_err(|e| asked(format!("this program cannot be found again: {e}")))?;
    let answer =
        Command::new(program).args(&kept).output().map_err(|e| asked(format!("solve cannot be started: {e}")))?;
    if !answer.status.success() {
        let said = String::from_utf8_lossy(&answer.stderr);
        return Err(asked(said.trim().trim_start_matches("eyebox: ").to_owned()));
    }
    serde_json::from_slice(&answer.stdout).map_err(|e| asked(format!("solve answered no JSON: {e}")))
}

/// Solves, and compares with the forecasts.
pub fn run(args: &Plan, forecasts: &[(Color, Forecast)]) -> Result<Value, Failure> {
    let temp = tempfile::tempdir().map_err(|e| Failure::Asked(format!("no folder for a while: {e}")))?;
    let said = solve(&temp.path().join("hologram.zarr"), args.solve.seed, &[])?;
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
