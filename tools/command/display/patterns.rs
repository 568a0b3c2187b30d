//! Options of commands that show patterns for a camera, on a display or by the camera's command.

use crate::Failure;
use crate::show::args::{OutputTo, output};
use clap::Args;
use eyebox::low_level::calibrate::ShowsPatterns;
use eyebox::low_level::optics::{Color, Display};
use eyebox::low_level::session::PatternOutput;
use std::time::Duration;

/// The option for the output of the patterns.
#[derive(Args)]
pub struct PatternArgs {
    /// Output of the patterns (window, window:MONITOR, direct, direct:DISPLAY, offscreen, raw:FILE or shared:FILE).
    /// The camera's command then only takes pictures
    #[arg(help_heading = "Display", long, value_name = "OUTPUT", value_parser = output, requires = "camera")]
    pub output: Option<OutputTo>,
}

impl PatternArgs {
    /// Opens the output for these colors, unless the camera's command shows the patterns.
    pub fn open(&self, settle: f64, display: &Display, colors: &[Color]) -> Result<Option<PatternOutput>, Failure> {
        let Some(to) = &self.output else { return Ok(None) };
        let settle = Duration::from_secs_f64(settle.min(1e6));
        Ok(Some(PatternOutput::open(&to.output(false), display, colors, settle)?))
    }
}

/// Returns the output as the library takes it.
pub fn shows(output: &mut Option<PatternOutput>) -> Option<&mut dyn ShowsPatterns> {
    output.as_mut().map(|output| output as &mut dyn ShowsPatterns)
}
