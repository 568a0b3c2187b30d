//! `eyebox devices`.

use crate::Failure;
use crate::args::Devices;
use eyebox::engine::{Engine, cpu::CpuEngine};
use serde_json::json;

/// Lists engines and devices.
pub fn run(args: &Devices) -> Result<(), Failure> {
    let cpu = CpuEngine::new().describe();
    if args.json {
        println!("{}", json!({ "cpu": cpu, "auto": "cpu" }));
        return Ok(());
    }
    println!("cpu     {cpu}");
    Ok(())
}
