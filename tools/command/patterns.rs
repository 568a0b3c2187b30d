//! Options of commands that have patterns shown for a camera: on a display of this machine, or by the camera's command.

use crate::Failure;
use crate::play::OutputName;
use crate::values::{S, not_negative_in};
use clap::Args;
use eyebox::low_level::calibrate::ShowsPatterns;
use eyebox::low_level::optics::{Color, Display};
use eyebox::low_level::reason;
use eyebox::low_level::session::{PatternOutput, SinkFile};
use std::path::PathBuf;
use std::time::Duration;

/// What shows the patterns.
#[derive(Args)]
pub struct PatternArgs {
    /// A display of this machine shows the patterns, and the camera's command takes pictures alone
    #[arg(help_heading = "Display", long, value_enum, requires = "camera")]
    pub output: Option<OutputName>,
    /// The monitor of --output window or direct, as of play
    #[arg(help_heading = "Display", long, value_name = "MONITOR", requires = "output")]
    pub monitor: Option<String>,
    /// With --output offscreen, the newest video frame to a file that others map, as of play
    #[arg(help_heading = "Output", long, value_name = "OUT", requires = "output")]
    pub shared: Option<PathBuf>,
    /// Seconds from when a pattern lit up until it stands [default: 0.2]
    #[arg(help_heading = "Camera", long, value_name = "SECONDS", value_parser = not_negative_in(S), requires = "output")]
    pub settle: Option<f64>,
}

impl PatternArgs {
    /// It, for these colours, where the command does not show them.
    pub fn open(&self, display: &Display, colors: &[Color]) -> Result<Option<PatternOutput>, Failure> {
        let Some(name) = self.output else { return Ok(None) };
        if self.shared.is_some() && name != OutputName::Offscreen {
            return Err(Failure::Arguments(reason!(
                "share-without-offscreen",
                "--shared goes with --output offscreen"
            )));
        }
        let output = name.output(self.monitor.clone(), false, self.shared.clone().map(SinkFile::Shared));
        let settle = Duration::from_secs_f64(self.settle.unwrap_or(0.2).min(1e6));
        Ok(Some(PatternOutput::open(&output, display, colors, settle)?))
    }
}

/// As the library takes it.
pub fn shows(output: &mut Option<PatternOutput>) -> Option<&mut dyn ShowsPatterns> {
    output.as_mut().map(|output| output as &mut dyn ShowsPatterns)
}
