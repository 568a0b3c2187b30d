//! `eyebox display check` checks that a display is possible, and prints its eyebox and field of view.

use super::link;
use super::test_picture::check_capture;
use crate::Failure;
use crate::common;
use crate::show::args::{OutputTo, output};
use crate::talk::print_report;
use clap::Args;
use eyebox::low_level::calibrate::ModelAge;
use eyebox::low_level::optics::Display;
use eyebox::low_level::present::Link;
use serde_json::{Map, json};
use std::path::PathBuf;

/// The arguments of `eyebox display check`.
#[derive(Args)]
pub struct Check {
    /// Display preset or TOML file
    #[arg(value_name = "PRESET|FILE")]
    pub display: String,
    /// Accept a display that looks like a mistake
    #[arg(help_heading = "Display", long)]
    pub force: bool,
    /// Output whose link is checked (window, window:MONITOR, direct or direct:DISPLAY). It shows test pictures if the
    /// display has a controller, and may then be offscreen [default: first monitor of the size]
    #[arg(help_heading = "Display", long, value_name = "OUTPUT", value_parser = output)]
    pub output: Option<OutputTo>,
    /// Capture of the test picture at the end of the cable, a PNG (eyebox display test-picture)
    #[arg(help_heading = "Display", long, value_name = "PICTURE.png", conflicts_with = "output")]
    pub captured: Option<PathBuf>,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// Checks a display and its link, and prints its reach.
pub fn run(args: &Check) -> Result<(), Failure> {
    let display = common::display_of_size(&args.display, None, args.force)?;
    if let Some(capture) = &args.captured {
        return check_capture(&display, capture, args.json);
    }
    match &args.output {
        Some(to) if display.device.is_some() => super::plm::check(&display, to, args.json),
        to => {
            let link = link::of(&display, to.as_ref())?;
            print(&display, Some(link.as_ref()), args.json);
            Ok(())
        }
    }
}

/// Reads a display, checks it, and prints its reach, such as eyebox and field of view.
pub fn check(name: &str, force: bool, as_json: bool) -> Result<(), Failure> {
    print(&common::display_of_size(name, None, force)?, None, as_json);
    Ok(())
}

/// Prints the reach of a display, and its link if that was checked.
fn print(display: &Display, link: Option<Option<&Link>>, as_json: bool) {
    let age = |color| ModelAge::of(display, color).map(|age| age.to_string());
    let models: Map<_, _> =
        display.wavelengths.iter().filter_map(|w| Some((w.color.to_string(), json!(age(w.color)?)))).collect();
    if as_json {
        let mut report = json!({
            "kind": "display", "name": display.name, "resolution": [display.height, display.width], "reach": display.reach(), "models": models,
        });
        if let Some(link) = link {
            report["link"] = json!(link);
        }
        print_report(report);
        return;
    }
    println!("{}, {}x{}: {}", display.name, display.height, display.width, display.reach());
    common::say_model_age(display);
    match link {
        Some(Some(link)) => link::print(link),
        Some(None) => eprintln!("the link was not checked, because no monitor has the size of the video frames"),
        None => {}
    }
}
