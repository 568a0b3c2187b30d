//! `eyebox device list` lists engines and devices, and the one that `--engine auto` takes.

use crate::Failure;
use crate::talk::print_report;
use clap::Args;
use eyebox::low_level::engine::{self, Engine, cpu::CpuEngine};
use eyebox::low_level::gpu::{self, DeviceReport};
use serde_json::json;
use std::time::{Duration, UNIX_EPOCH};

/// Returns when a device was tested, and its error, in words.
fn tested(device: &DeviceReport) -> String {
    let Some(t) = device.tested else { return "not tested yet, the first run on it does that".into() };
    let ago = (UNIX_EPOCH + Duration::from_secs(t.at_unix_s)).elapsed().unwrap_or_default().as_secs();
    let when = match (ago / 3600, ago / 86_400) {
        (0, _) => format!("{} min", ago / 60),
        (hours, 0) => format!("{hours} h"),
        (_, days) => format!("{days} days"),
    };
    format!("tested {when} ago against float64, error power {:.0e}", t.transfer.max(t.transform))
}

/// The arguments of `eyebox device list`.
#[derive(Args)]
pub struct List {
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// Lists engines and devices, and the choice of `auto` with its reason.
pub fn run(args: &List) -> Result<(), Failure> {
    let cpu = CpuEngine::new().describe();
    let found = gpu::devices();
    let (_, auto) = engine::reason(&found);
    let devices = found.as_deref().unwrap_or_default();
    if args.json {
        let device = |d: &DeviceReport| {
            let l = &d.limits;
            json!({
                "index": d.index, "name": d.name, "kind": d.kind.to_string(), "driver": d.driver, "api": d.api,
                "usable": d.usable.is_ok(), "reason": d.usable.as_ref().err(), "memory_mib": l.memory >> 20,
                "storage_range_mib": l.storage_range >> 20, "shared_memory": l.shared_memory, "subgroup": l.subgroup,
                "tested": d.tested,
            })
        };
        let vulkan: Vec<_> = devices.iter().map(device).collect();
        let all = json!({
            "cpu": cpu, "vulkan": vulkan, "no_vulkan": found.as_ref().err().map(ToString::to_string), "auto": auto,
        });
        print_report(all);
        return Ok(());
    }
    println!("cpu      {cpu}");
    for d in devices {
        let l = &d.limits;
        println!(
            "vulkan   {}: {} ({}, Vulkan {}), {} MiB, {} MiB a buffer, {} KiB shared, subgroups of {}",
            d.index,
            d.name,
            d.kind,
            d.api,
            l.memory >> 20,
            l.storage_range >> 20,
            l.shared_memory >> 10,
            l.subgroup
        );
        match &d.usable {
            Ok(()) => println!("         {}; runs every kernel; {}", d.driver, tested(d)),
            Err(reason) => println!("         {}; cannot be used: {reason}", d.driver),
        }
    }
    if let Err(error) = &found {
        println!("vulkan   {error}");
    }
    println!("auto     takes {auto}");
    Ok(())
}
