//! The arguments of `eyebox play`.

use crate::args::{Colors, DeviceArgs, EngineName};
use crate::phases::{PhaseUnitArgs, UnfinishedArgs};
use crate::values::{S, mark, not_negative_in, positive, positive_in, rate, size};
use clap::{Args, ValueEnum};
use eyebox::low_level::present::Rate;
use eyebox::low_level::session::{Output, SessionOptions, SinkFile};
use std::path::PathBuf;

/// Where video frames go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum OutputName {
    /// A window over a whole monitor
    Window,
    /// A display that no desktop drives
    Direct,
    /// Memory, at the pace of a clock
    Offscreen,
}

impl OutputName {
    /// It, on this monitor, or memory with this clock and sink.
    pub fn output(self, monitor: Option<String>, simulated: bool, sink: Option<SinkFile>) -> Output {
        match self {
            Self::Window => Output::Window { monitor },
            Self::Direct => Output::Direct { display: monitor },
            Self::Offscreen => Output::Memory { simulated, sink },
        }
    }
}

/// Whose time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ClockName {
    /// The system's
    Real,
    /// One that passes as fast as the machine is, and waits for content
    Simulated,
}

/// Where holograms are shown.
#[derive(Args)]
pub struct OutputArgs {
    /// Where video frames go
    #[arg(help_heading = "Display", long, value_enum, default_value = "offscreen")]
    pub output: OutputName,
    /// The monitor, by index, name or rows x columns; with --output direct, the display, by index, connector or monitor
    /// [default: the first of the video frame's size]
    #[arg(help_heading = "Display", long, value_name = "MONITOR")]
    pub monitor: Option<String>,
    /// Video frames a second; with --output direct, of the mode [default: what the monitor says, else 60]
    #[arg(help_heading = "Display", long, value_name = "HZ", value_parser = rate)]
    pub display_rate: Option<Rate>,
    /// Have Vulkan's use checked, and say what was wrong
    #[arg(help_heading = "Display", long)]
    pub validation: bool,
}

impl OutputArgs {
    /// Where a session shows; memory with this clock and sink.
    pub fn output(&self, simulated: bool, sink: Option<SinkFile>) -> Output {
        self.output.output(self.monitor.clone(), simulated, sink)
    }

    /// What a session takes of it besides.
    pub fn options(&self) -> SessionOptions {
        let mut options = SessionOptions::default();
        options.display_rate = self.display_rate;
        options
    }
}

/// `eyebox play`
#[derive(Args)]
pub struct Play {
    /// NAME.zarr: a sequence, or a single hologram; or phases: NAME.npy or a folder of PNGs
    pub file: PathBuf,
    /// Display: a preset (eyebox displays lists them), or a TOML file [default: the one that it was solved for; of bare
    /// phases paper]
    #[arg(help_heading = "Display", long, value_name = "PRESET|FILE")]
    pub display: Option<String>,
    /// Resolution instead of the display's own, rows x columns, N for a square, or a name such as 1080p
    #[arg(help_heading = "Display", long, value_name = "HxW", value_parser = size)]
    pub size: Option<[usize; 2]>,
    /// Take sizes and wavelengths that look like a mistake as they are
    #[arg(help_heading = "Display", long)]
    pub force: bool,
    /// Colours; bare phases of one colour are for this one
    #[arg(help_heading = "Display", long, value_enum, default_value = "all")]
    pub color: Colors,
    /// Bare phases
    #[command(flatten)]
    pub unit: PhaseUnitArgs,
    /// Where
    #[command(flatten)]
    pub shown: OutputArgs,
    /// When, and to which file
    #[command(flatten)]
    pub stream: StreamArgs,
    /// What is not finished
    #[command(flatten)]
    pub unfinished: UnfinishedArgs,
    /// Seconds of content to play
    #[arg(help_heading = "Time", long, value_name = "S", value_parser = positive_in(S))]
    pub duration: Option<f64>,
    /// Which engine encodes
    #[arg(help_heading = "Engine", long, value_enum, default_value = "auto")]
    pub engine: EngineName,
    /// Device
    #[command(flatten)]
    pub device: DeviceArgs,
    /// What was shown, as JSON
    #[arg(help_heading = "Output", long, value_name = "OUT.json")]
    pub stats: Option<PathBuf>,
    /// Keep every picture as PNG, and when it was shown, in a new folder
    #[arg(help_heading = "Output", long, value_name = "OUT_DIR")]
    pub record: Option<PathBuf>,
    /// What each thread did when, for chrome://tracing
    #[arg(help_heading = "Output", long, value_name = "OUT.json")]
    pub trace: Option<PathBuf>,
}

/// When holograms are shown, and to which file video frames go besides.
#[derive(Args)]
pub struct StreamArgs {
    /// Holograms a second [default: what the sequence says]
    #[arg(help_heading = "Time", long, value_name = "HZ", value_parser = rate)]
    pub rate: Option<Rate>,
    /// Speed as a factor
    #[arg(help_heading = "Time", long, value_name = "FACTOR", value_parser = positive, default_value_t = 1.0)]
    pub speed: f64,
    /// Begin again at the end
    #[arg(help_heading = "Time", long = "loop")]
    pub looped: bool,
    /// Wait for a sequence that is still being written
    #[arg(help_heading = "Time", long)]
    pub follow: bool,
    /// Number of the hologram to begin with, from 0
    #[arg(help_heading = "Time", long, value_name = "N", default_value_t = 0)]
    pub first: u64,
    /// Begin at this time, ready or not: seconds since 1970, for displays that begin together
    #[arg(help_heading = "Time", long, value_name = "UNIX", value_parser = positive_in(S))]
    pub start_at: Option<f64>,
    /// Seconds of the sync picture before content: its first sub-frame's light goes aside along x, the others' along y
    #[arg(help_heading = "Time", long, value_name = "S", value_parser = not_negative_in(S), default_value_t = 0.0)]
    pub sync: f64,
    /// Side of such a mark in the upper left corner of every hologram, pixels
    #[arg(help_heading = "Time", long, value_name = "PX", value_parser = mark, default_value = "0")]
    pub mark: usize,
    /// After a missed present, wait until sets are in phase with the first: for lasers that count video frames
    #[arg(help_heading = "Time", long)]
    pub keep_phase: bool,
    /// Sets that are encoded ahead
    #[arg(help_heading = "Time", long, value_name = "N", default_value_t = 4)]
    pub ahead: usize,
    /// Whose time [default: real; simulated with --record]
    #[arg(help_heading = "Time", long, value_enum)]
    pub clock: Option<ClockName>,
    /// Append every video frame to a file or a pipe: 8 bits, (row, column, channel)
    #[arg(help_heading = "Output", long, value_name = "OUT", conflicts_with = "shared")]
    pub raw: Option<PathBuf>,
    /// Keep the newest video frame where another program maps it, as /dev/shm/NAME (docs/playback.md)
    #[arg(help_heading = "Output", long, value_name = "OUT")]
    pub shared: Option<PathBuf>,
}

impl StreamArgs {
    /// The file that video frames go to.
    pub fn sink(&self) -> Option<SinkFile> {
        let raw = self.raw.clone().map(SinkFile::Raw);
        raw.or_else(|| self.shared.clone().map(SinkFile::Shared))
    }
}

/// `eyebox monitors`
#[derive(Args)]
pub struct Monitors {
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}
