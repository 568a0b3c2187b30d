//! Where pictures come from, what shows the patterns, and what is told meanwhile.

use eyebox_optics::Color;
use std::path::Path;
use std::time::Duration;

/// Pictures at least: dots, two of a pattern twice, and patterns to fit.
pub const FEWEST: usize = 12;

/// A camera's command.
#[derive(Debug, Clone, Copy)]
pub struct CameraCommand<'a> {
    /// Its words, as a POSIX shell splits them; no shell runs it.
    pub command: &'a str,
    /// Where its pictures are kept; those of a calibration that was broken off are not asked for again.
    pub keep: Option<&'a Path>,
    /// Limit for every question, in the place of the protocol's own.
    pub limit: Option<Duration>,
    /// Where an iris stands that does not move: x, y, diameter, mm; where the command does not say so itself.
    pub iris_mm: Option<[f64; 3]>,
}

/// Where pictures come from.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Bench<'a> {
    /// A command that shows patterns and takes pictures.
    Command {
        /// The command.
        camera: CameraCommand<'a>,
        /// Pictures at most.
        most: usize,
        /// A few pictures, for what drifts.
        quick: bool,
    },
    /// A folder that such a calibration kept, or one made by hand.
    Folder {
        /// It.
        folder: &'a Path,
        /// As of a command.
        iris_mm: Option<[f64; 3]>,
    },
}

/// A display of this machine's own, which shows the patterns while the camera's command takes pictures alone.
pub trait ShowsPatterns {
    /// Sub-frames that it shows in turn, over and over: patterns have as many, or a whole part of them.
    fn sub_frames(&self) -> usize;

    /// Shows phases (sub-frame, row, column), radians, in the light of a colour, and returns once they stand.
    ///
    /// # Errors
    /// It is lost, or shows no such colour, in one line.
    fn show(&mut self, color: Color, phases: &[f32]) -> Result<(), Box<dyn std::error::Error + Send + Sync>>;
}

/// What happens while a display is calibrated.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Event<'a> {
    /// A line of the bench, or about it.
    Said(&'a str),
    /// What is being done, and the share of everything that is done.
    At(&'a str, f64),
}
