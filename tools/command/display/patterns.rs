//! Options of commands that have patterns shown for a camera: on a display of this machine, or by the camera's command.

use crate::Failure;
use crate::show::args::{OutputTo, output};
use crate::values::{S, not_negative_in};
use clap::Args;
use eyebox::low_level::calibrate::ShowsPatterns;
use eyebox::low_level::optics::{Color, Display};
use eyebox::low_level::session::PatternOutput;
use std::time::Duration;

/// What shows the patterns.
#[derive(Args)]
pub struct PatternArgs {
    /// Output of the patterns if this machine shows them and the camera's command only takes pictures: window or window:MONITOR,
    /// direct or direct:DISPLAY, offscreen, raw:FILE or shared:FILE
    #[arg(help_heading = "Display", long, value_name = "OUTPUT", value_parser = output, requires = "camera")]
    pub output: Option<OutputTo>,
    /// Seconds from when a pattern lit up until it stands [default: 0.2]
    #[arg(help_heading = "Camera", long, value_name = "SECONDS", value_parser = not_negative_in(S), requires = "output")]
    pub settle: Option<f64>,
}

impl PatternArgs {
    /// It, for these colours, where the command does not show them.
    pub fn open(&self, display: &Display, colors: &[Color]) -> Result<Option<PatternOutput>, Failure> {
        let Some(to) = &self.output else { return Ok(None) };
        let settle = Duration::from_secs_f64(self.settle.unwrap_or(0.2).min(1e6));
        Ok(Some(PatternOutput::open(&to.output(false), display, colors, settle)?))
    }
}

/// As the library takes it.
pub fn shows(output: &mut Option<PatternOutput>) -> Option<&mut dyn ShowsPatterns> {
    output.as_mut().map(|output| output as &mut dyn ShowsPatterns)
}
