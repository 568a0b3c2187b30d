//! `eyebox display check` checks that a display is possible, and prints its eyebox and field of view.

use crate::Failure;
use crate::common;
use crate::show::args::{OutputTo, output};
use crate::talk::print_report;
use clap::Args;
use eyebox::low_level::calibrate::ModelAge;
use serde_json::{Map, json};

/// The arguments of `eyebox display check`.
#[derive(Args)]
pub struct Check {
    /// Display preset or TOML file
    #[arg(value_name = "PRESET|FILE")]
    pub display: String,
    /// Accept a display that looks like a mistake
    #[arg(help_heading = "Display", long)]
    pub force: bool,
    /// Output of test pictures for the display's controller (window, window:MONITOR, direct, direct:DISPLAY or
    /// offscreen)
    #[arg(help_heading = "Display", long, value_name = "OUTPUT", value_parser = output)]
    pub output: Option<OutputTo>,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// Checks a display and prints its reach.
pub fn run(args: &Check) -> Result<(), Failure> {
    match &args.output {
        Some(to) => super::plm::check(&common::display_of_size(&args.display, None, args.force)?, to, args.json),
        None => check(&args.display, args.force, args.json),
    }
}

/// Reads a display, checks it, and prints its reach, such as eyebox and field of view.
pub fn check(name: &str, force: bool, as_json: bool) -> Result<(), Failure> {
    let display = common::display_of_size(name, None, force)?;
    let age = |color| ModelAge::of(&display, color).map(|age| age.to_string());
    let models: Map<_, _> =
        display.wavelengths.iter().filter_map(|w| Some((w.color.to_string(), json!(age(w.color)?)))).collect();
    if as_json {
        print_report(json!({
            "kind": "display", "name": display.name, "resolution": [display.height, display.width], "reach": display.reach(), "models": models,
        }));
        return Ok(());
    }
    println!("{}, {}x{}: {}", display.name, display.height, display.width, display.reach());
    common::say_model_age(&display);
    Ok(())
}
