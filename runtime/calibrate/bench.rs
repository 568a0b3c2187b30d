//! Describes the source of the pictures, the display of the patterns and the reported events.

use eyebox_optics::Color;
use std::path::Path;
use std::time::Duration;

/// The least number of pictures. They are dots, two of a pattern that is taken twice, and patterns to fit.
pub const FEWEST: usize = 12;

/// A camera's command with its limits.
#[derive(Debug, Clone, Copy)]
pub struct CameraCommand<'a> {
    /// The command, which is split into words as in a POSIX shell. No shell runs it.
    pub command: &'a str,
    /// The folder in which its pictures are kept. Pictures of an interrupted calibration are not requested again.
    pub keep: Option<&'a Path>,
    /// Limit for each request, instead of the protocol's own limits.
    pub limit: Option<Duration>,
    /// Place of an iris that does not move, x, y, diameter, mm, if the command does not report it.
    pub iris_mm: Option<[f64; 3]>,
}

/// The source of the pictures.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Bench<'a> {
    /// A command that shows patterns and takes pictures.
    Command {
        /// The command and its limits.
        camera: CameraCommand<'a>,
        /// Largest number of pictures.
        most: usize,
        /// True for a few pictures that fit drift only.
        quick: bool,
    },
    /// A folder that such a calibration kept, or one made by hand.
    Folder {
        /// The path of the folder.
        folder: &'a Path,
        /// Place of an iris that does not move, as for a command.
        iris_mm: Option<[f64; 3]>,
    },
}

/// A display of this machine that shows the patterns, while the camera's command only takes pictures.
pub trait ShowsPatterns {
    /// Number of sub-frames that the display repeats. Patterns have as many, or a divisor of that number.
    fn sub_frames(&self) -> usize;

    /// Shows phases (sub-frame, row, column), radians, in the light of a color. Returns once they are shown.
    ///
    /// # Errors
    /// The display is lost or does not show this color. The error has one line.
    fn show(&mut self, color: Color, phases: &[f32]) -> Result<(), Box<dyn std::error::Error + Send + Sync>>;
}

/// An event during a calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Event<'a> {
    /// A line from the bench or about it.
    Said(&'a str),
    /// The current task, and the share of the whole that is done.
    At(&'a str, f64),
}
