//! Which tracker is followed.

use crate::Failure;
use crate::tracker::EyeName;
use crate::values::{HZ, MS, depth, not_negative_in, positive_in};
use clap::Args;
use eyebox::low_level::gaze::{Calibration, Estimator, Eyepiece, Settings};
use eyebox::low_level::optics::Depth;
use eyebox::low_level::reason;
use eyebox::low_level::session::Tracking;
use eyebox::low_level::trackers::pushed::MouseHandle;
use eyebox::low_level::trackers::{Options, Spec, TrackerError};
use std::path::PathBuf;
use std::time::Duration;

/// The tracker, in every command that follows one.
#[derive(Args)]
pub struct TrackerArgs {
    /// Eye tracker (`eyebox tracker list`). hid, FILE.hid, FILE.jsonl, pupil://HOST, udp://:PORT, mouse (with --view), simulated or simulated:SEED [default: none; with
    /// --view mouse]
    #[arg(help_heading = "Eye", long, value_name = "SOURCE")]
    pub tracker: Option<String>,
    /// A HID device with a layout of its own, described in a TOML file
    #[arg(help_heading = "Eye", long, value_name = "FILE.toml")]
    pub device_file: Option<PathBuf>,
    /// Time between the eye and the arrival of its sample, ms
    #[arg(help_heading = "Eye", long, value_name = "MS", default_value_t = 0.0, value_parser = not_negative_in(MS))]
    pub tracker_latency: f64,
    /// Samples a second of the simulated tracker
    #[arg(help_heading = "Eye", long, value_name = "HZ", default_value_t = 120.0, value_parser = positive_in(HZ))]
    pub tracker_rate: f64,
    /// Calibration of a user
    #[arg(help_heading = "Eye", long, value_name = "FILE.toml")]
    pub calibration: Option<PathBuf>,
    /// Eye that is followed
    #[arg(help_heading = "Eye", long, value_enum, default_value = "mean")]
    pub eye: EyeName,
    /// Where the eye focuses, where the tracker does not measure it, mm, or dioptres as in 0.5D
    #[arg(help_heading = "Eye", long, value_name = "MM|D", default_value = "0", value_parser = depth)]
    pub focus: Depth,
}

/// Opens it, and says where a mouse is told, if that is the tracker; `view` says whether there is a window for one, `eyepiece`
/// what dioptres of focus are before the display. Whose time is `real` has a simulated eye live in it; else that has its own.
pub fn tracking(
    tracker: &str,
    args: &TrackerArgs,
    view: bool,
    real: bool,
    eyepiece: Eyepiece,
    reach: f64,
) -> Result<(Option<MouseHandle>, Tracking), Failure> {
    let spec: Spec = tracker.parse()?;
    let calibration = args.calibration.as_deref().map(Calibration::load).transpose()?;
    let focus = [args.focus.metres(eyepiece.focal_length); 2];
    let settings = Settings { eye: args.eye.into(), focus, eyepiece: Some(eyepiece), ..Settings::default() };
    // Switchable sources reach farther than one.
    let settings = Settings { reach: settings.reach.max(reach), ..settings };
    let estimator = Estimator::new(settings, calibration)?;
    let options = Options {
        latency: Duration::from_secs_f64((args.tracker_latency * 1e-3).min(1e6)),
        device_file: args.device_file.clone(),
        real_time: real,
        rate_hz: args.tracker_rate,
    };
    match spec {
        Spec::Mouse if !view => Err(TrackerError::Setting(reason!(
            "mouse-without-view",
            "the mouse is a tracker in a window only: add --view"
        ))
        .into()),
        Spec::Mouse => {
            let (mouse, tracking) = Tracking::mouse(estimator);
            Ok((Some(mouse), tracking))
        }
        spec => Ok((None, Tracking::open(&spec, &options, estimator)?)),
    }
}
