//! `eyebox display monitors` lists the monitors of the desktop and the displays without a desktop.

use crate::Failure;
use crate::talk::print_report;
use clap::Args;
use eyebox::low_level::present::{Desktop, DirectDisplay, Monitor, Rate, direct_displays};
use serde_json::{Value, json};

/// The arguments of `eyebox display monitors`.
#[derive(Args)]
pub struct Monitors {
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// Lists the monitors of the desktop, and the displays that can be shown on directly.
pub fn monitors(args: &Monitors) -> Result<(), Failure> {
    let desktop = Desktop::open().map(|desktop| desktop.monitors());
    let direct = direct_displays().unwrap_or_default();
    // Without a desktop there may still be displays. Only if there is neither, the missing desktop is an error.
    let monitors = match desktop {
        Ok(monitors) => monitors,
        Err(error) if direct.is_empty() => return Err(error.into()),
        Err(_) => Vec::new(),
    };
    if args.json {
        let monitors: Vec<Value> = monitors.iter().map(of_desktop).collect();
        let direct: Vec<Value> = direct.iter().map(of_direct).collect();
        print_report(json!({ "monitors": monitors, "direct": direct }));
        return Ok(());
    }
    for m in &monitors {
        println!("{m} at {}", hertz(m.rate));
        for (size, rate, bits) in &m.modes {
            println!("    {}x{} at {}, {bits} bits", size[0], size[1], hertz(*rate));
        }
    }
    for c in &direct {
        println!("direct {c} of {}", c.device);
        for mode in &c.modes {
            println!("    {}x{} at {}", mode.size[0], mode.size[1], hertz(rate(mode.millihertz)));
        }
    }
    if monitors.is_empty() && direct.is_empty() {
        println!("the desktop has no monitors");
    }
    Ok(())
}

fn rate(millihertz: u32) -> Option<Rate> {
    Rate::from_hz(f64::from(millihertz) / 1000.0).ok()
}

fn hertz(rate: Option<Rate>) -> String {
    rate.map_or_else(|| "unknown rate".into(), |r| format!("{r} Hz"))
}

fn of_desktop(m: &Monitor) -> Value {
    let mode = |(size, rate, bits): &([usize; 2], Option<Rate>, u16)| json!({ "rows": size[0], "columns": size[1], "hz": rate.map(Rate::hz), "bits": bits });
    json!({
        "index": m.index, "name": m.name, "rows": m.size[0], "columns": m.size[1], "position": m.position,
        "hz": m.rate.map(Rate::hz), "modes": m.modes.iter().map(mode).collect::<Vec<_>>(),
    })
}

fn of_direct(d: &DirectDisplay) -> Value {
    let modes = d
        .modes
        .iter()
        .map(|m| json!({ "rows": m.size[0], "columns": m.size[1], "hz": rate(m.millihertz).map(Rate::hz) }));
    json!({
        "index": d.index, "name": d.name, "monitor": d.monitor, "device": d.device, "rows": d.size[0],
        "columns": d.size[1], "modes": modes.collect::<Vec<_>>(),
    })
}
