//! Options of a source of tracker samples.

use crate::values::{HZ, MS, not_negative_in, positive_in};
use clap::Args;
use eyebox::low_level::trackers::Options;
use std::path::PathBuf;
use std::time::Duration;

/// A source, in the commands of trackers.
#[derive(Args)]
pub struct SourceArgs {
    /// Source of samples (hid, FILE.hid, FILE.jsonl, pupil://HOST, udp://HOST:PORT, udp://:PORT, simulated or
    /// simulated:SEED)
    #[arg(value_name = "SOURCE", default_value = "hid")]
    pub source: String,
    #[command(flatten)]
    pub how: SourceOptions,
}

/// The options that open a source, in every command that reads one.
#[derive(Args)]
pub struct SourceOptions {
    /// TOML file that describes a HID device with a layout of its own
    #[arg(help_heading = "Eye", long, value_name = "FILE.toml")]
    pub device_file: Option<PathBuf>,
    /// Time between the eye and the arrival of its sample, ms
    #[arg(help_heading = "Eye", long, value_name = "MS", default_value_t = 0.0, value_parser = not_negative_in(MS))]
    pub tracker_latency: f64,
    /// Samples per second of the simulated tracker
    #[arg(help_heading = "Eye", long, value_name = "HZ", default_value_t = 120.0, value_parser = positive_in(HZ))]
    pub tracker_rate: f64,
}

impl SourceOptions {
    /// Returns the options of the source, in real time or as fast as it is read.
    pub fn options(&self, real_time: bool) -> Options {
        Options {
            latency: Duration::from_secs_f64((self.tracker_latency * 1e-3).min(1e6)),
            device_file: self.device_file.clone(),
            real_time,
            rate_hz: self.tracker_rate,
        }
    }
}
