//! `eyebox display connect` runs the controller of a display for pictures of other programs.

use super::plm::print_identity;
use crate::Failure;
use crate::common;
use crate::progress;
use crate::show::controller_line;
use crate::talk::print_report;
use crate::values::{S, positive_in, rate};
use clap::Args;
use eyebox::low_level::present::Rate;
use eyebox::low_level::reason;
use eyebox::low_level::session::ControllerConnection;
use std::time::{Duration, Instant};

/// The time between two checks for ctrl-C.
const LOOK: Duration = Duration::from_millis(50);

/// The arguments of `eyebox display connect`.
#[derive(Args)]
pub struct Connect {
    /// Display preset or TOML file
    #[arg(value_name = "PRESET|FILE")]
    pub display: String,
    /// Video frames per second. Without it, the rate of the monitor counts, then the display's, then 60, or 30 on HDMI
    #[arg(help_heading = "Display", long, value_name = "HZ", value_parser = rate)]
    pub display_rate: Option<Rate>,
    /// Stop after this time, s. Without it, ctrl-C ends the command
    #[arg(help_heading = "Time", long, value_name = "S", value_parser = positive_in(S))]
    pub duration: Option<f64>,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// Starts the controller, prints its notes until the end, and prints its statistics.
pub fn run(args: &Connect) -> Result<(), Failure> {
    let display = common::display_of_size(&args.display, None, false)?;
    progress::catch_interrupt();
    let begun = Instant::now();
    let connection = ControllerConnection::start(&display, args.display_rate)?;
    print_identity(connection.identity());
    let longest = args.duration.map(|seconds| Duration::from_secs_f64(seconds.min(1e9)));
    while !progress::interrupted() && longest.is_none_or(|longest| begun.elapsed() < longest) {
        if let Some(note) = connection.note(LOOK) {
            eprintln!("note: {note}");
        }
    }
    let is_lost = connection.is_lost();
    let report = connection.stop()?;
    eprintln!("{}", controller_line(&report));
    let last = report.events.last().map(|event| event.text.clone()).unwrap_or_default();
    if args.json {
        print_report(report.to_json());
    }
    if is_lost {
        return Err(Failure::Lost(reason!("controller", "the controller was lost ({last})")));
    }
    Ok(())
}
