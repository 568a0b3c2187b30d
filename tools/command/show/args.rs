//! Reads the arguments of `eyebox show` for output and time.

use crate::values::{MS, S, mark, not_negative_in, positive, positive_in, rate};
use clap::{Args, ValueEnum};
use eyebox::low_level::present::Rate;
use eyebox::low_level::session::{Output, SessionOptions, SinkFile};
use std::path::PathBuf;

/// The output of video frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum OutputTo {
    /// A window over a whole monitor, which an index, a name or a size may choose.
    Window(Option<String>),
    /// A display that no desktop drives, which an index, a connector or a name may choose.
    Direct(Option<String>),
    /// Memory, at the pace of a clock.
    Offscreen,
    /// Memory, and a file or a pipe that every video frame is appended to.
    Raw(PathBuf),
    /// Memory, and a file that other programs map, which holds the newest video frame.
    Shared(PathBuf),
}

/// Reads the name of an output.
pub fn output(text: &str) -> Result<OutputTo, String> {
    let (name, rest) = text.split_once(':').map_or((text, None), |(name, rest)| (name, Some(rest)));
    match (name, rest.filter(|rest| !rest.is_empty())) {
        ("window", monitor) => Ok(OutputTo::Window(monitor.map(str::to_owned))),
        ("direct", display) => Ok(OutputTo::Direct(display.map(str::to_owned))),
        ("offscreen", None) => Ok(OutputTo::Offscreen),
        ("raw", Some(file)) => Ok(OutputTo::Raw(file.into())),
        ("shared", Some(file)) => Ok(OutputTo::Shared(file.into())),
        _ => Err("expected window, window:MONITOR, direct, direct:DISPLAY, offscreen, raw:FILE or shared:FILE".into()),
    }
}

impl OutputTo {
    /// Returns whether a display shows the video frames.
    pub fn is_shown(&self) -> bool {
        matches!(self, Self::Window(_) | Self::Direct(_))
    }

    /// Returns the file that video frames go to.
    pub fn sink(&self) -> Option<SinkFile> {
        match self {
            Self::Raw(file) => Some(SinkFile::Raw(file.clone())),
            Self::Shared(file) => Some(SinkFile::Shared(file.clone())),
            _ => None,
        }
    }

    /// Returns the outputs of the left and the right eye. A name may hold both, as in `window:LEFT,RIGHT`.
    pub fn of_two(&self) -> [Self; 2] {
        let both = |name: &Option<String>| -> [Option<String>; 2] {
            let name = name.as_deref();
            match name.and_then(|name| name.split_once(',')) {
                Some((left, right)) => [left, right].map(|one| Some(one.trim().to_owned())),
                None => [name.map(str::to_owned), None],
            }
        };
        match self {
            Self::Window(name) => both(name).map(Self::Window),
            Self::Direct(name) => both(name).map(Self::Direct),
            other => [other.clone(), other.clone()],
        }
    }

    /// Returns it as a session takes it.
    pub fn output(&self, simulated: bool) -> Output {
        match self {
            Self::Window(monitor) => Output::Window { monitor: monitor.clone() },
            Self::Direct(display) => Output::Direct { display: display.clone() },
            _ => Output::Memory { simulated, sink: self.sink() },
        }
    }
}

/// The clock of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ClockName {
    /// Clock of the system
    Real,
    /// Clock that runs as fast as the machine is, and waits for content
    Simulated,
}

/// The options for the output of holograms.
#[derive(Args)]
pub struct OutputArgs {
    /// Output of video frames (window, window:MONITOR, direct, direct:DISPLAY, offscreen, raw:FILE or shared:FILE).
    /// With offscreen, memory receives the frames. With raw, a file or a pipe receives every frame, too (8 bits, (row,
    /// column, channel)). With shared, another program maps the newest frame (docs/playback.md) [default: offscreen]
    #[arg(help_heading = "Display", long, value_name = "OUTPUT", default_value = "offscreen", hide_default_value = true, value_parser = output)]
    pub output: OutputTo,
    /// Video frames per second, or with --output direct of the mode [default: of the monitor, otherwise 60]
    #[arg(help_heading = "Display", long, value_name = "HZ", value_parser = rate)]
    pub display_rate: Option<Rate>,
    /// Check the use of Vulkan, and print the faults
    #[arg(help_heading = "Display", long)]
    pub validation: bool,
}

impl OutputArgs {
    /// Returns the other options of a session.
    pub fn options(&self) -> SessionOptions {
        let mut options = SessionOptions::default();
        options.display_rate = self.display_rate;
        options
    }
}

/// The options for the times at which holograms are shown.
#[derive(Args)]
pub struct StreamArgs {
    /// Holograms per second [default: of the sequence]
    #[arg(help_heading = "Time", long, value_name = "HZ", value_parser = rate)]
    pub rate: Option<Rate>,
    /// Begin again at the end
    #[arg(help_heading = "Time", long = "loop")]
    pub looped: bool,
    /// Wait for a sequence that is still being written
    #[arg(help_heading = "Time", long)]
    pub follow: bool,
    /// Number of the hologram in a sequence that is shown first, from 0
    #[arg(help_heading = "Time", long, value_name = "N", default_value_t = 0)]
    pub at: u64,
    /// Begin at this time in seconds since 1970, ready or not, for displays that begin together
    #[arg(help_heading = "Time", long, value_name = "UNIX", value_parser = positive_in(S))]
    pub start_at: Option<f64>,
    /// Clock, which is real, or simulated (as fast as the machine is) [default: real, or simulated with --record]
    #[arg(help_heading = "Time", long, value_enum)]
    pub clock: Option<ClockName>,
}

/// The options of the camera in front of splats.
#[derive(Args)]
pub struct WalkArgs {
    /// Path of the camera in front of splats (around, or a file like cameras.json). Without it, the keys and the wheel
    /// in the window of --view move the camera
    #[arg(help_heading = "Scene", long, value_name = "PATH")]
    pub walk: Option<String>,
    /// Time of one round of the path, s
    #[arg(help_heading = "Scene", long, value_name = "S", default_value_t = 12.0, value_parser = positive_in(S))]
    pub walk_time: f64,
}

/// The table `show` of the settings.
#[derive(Args, Clone)]
pub struct ShowSettings {
    /// Time from the beginning of a video frame to its light, ms
    #[arg(help_heading = "Display", long, value_name = "MS", default_value_t = 0.0, value_parser = not_negative_in(MS))]
    pub display_latency: f64,
    /// Show complete sets on a display that takes several video frames for one, instead of a rolling update
    #[arg(help_heading = "Steps", long)]
    pub whole_sets: bool,
    /// Refine each sub-frame for its own time if the eye or the content moves, and move phases with the content (on).
    /// With off, sub-frames count as seen at once
    #[arg(help_heading = "Steps", long, value_enum, default_value = "on", value_name = "on|off")]
    pub moments: Moments,
    /// File, or pipe to the driver of the display's switchable sources. It receives a line of JSON with the sources
    /// that light a set, when the display receives the set
    #[arg(help_heading = "Display", long, value_name = "OUT")]
    pub sources_out: Option<PathBuf>,
    /// Speed of playback as a factor
    #[arg(help_heading = "Time", long, value_name = "FACTOR", value_parser = positive, default_value_t = 1.0)]
    pub speed: f64,
    /// Seconds of the sync picture before content. Its first sub-frame sends light aside along x, and the others along
    /// y
    #[arg(help_heading = "Time", long, value_name = "S", value_parser = not_negative_in(S), default_value_t = 0.0)]
    pub sync: f64,
    /// Side of a sync mark in the upper left corner of every hologram, pixels
    #[arg(help_heading = "Time", long, value_name = "PX", value_parser = mark, default_value = "0")]
    pub mark: usize,
    /// Wait after a missed present until sets are in phase with the first, for lasers that count video frames
    #[arg(help_heading = "Time", long)]
    pub keep_phase: bool,
    /// Sets that are encoded ahead
    #[arg(help_heading = "Time", long, value_name = "N", default_value_t = 4)]
    pub ahead: usize,
    /// Time of a step of one color on a simulated clock, ms
    #[arg(help_heading = "Eye", long, value_name = "MS", value_parser = positive_in(MS))]
    pub step_time: Option<f64>,
    /// Time of encoding a set on a simulated clock, ms
    #[arg(help_heading = "Eye", long, default_value_t = 1.0, value_name = "MS", value_parser = positive_in(MS))]
    pub encode_time: f64,
    /// Content that is requested from an application
    #[arg(help_heading = "Display", long, value_enum, default_value = "views")]
    pub ask: Ask,
}

/// The choice to refine sub-frames for their own times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Moments {
    /// Refine for own times if something moves
    On,
    /// Refine as if all were seen at once
    Off,
}

/// The content that is requested from an application.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Ask {
    /// Views around the pupil, with at most --views along an axis [default: 5]
    Views,
    /// A picture with the depth of every pixel
    Depth,
    /// Layers of content with opacity
    Layers,
}
