//! Which tracker is followed.

use crate::Failure;
use crate::tracker::EyeName;
use crate::tracker::source::SourceOptions;
use crate::values::depth;
use clap::Args;
use eyebox::low_level::gaze::{Calibration, Estimator, Eyepiece, Settings};
use eyebox::low_level::optics::Depth;
use eyebox::low_level::reason;
use eyebox::low_level::session::Tracking;
use eyebox::low_level::trackers::pushed::MouseHandle;
use eyebox::low_level::trackers::{Spec, TrackerError};
use std::path::PathBuf;

/// The tracker, in every command that follows one.
#[derive(Args)]
pub struct TrackerArgs {
    /// Eye tracker (`eyebox tracker list`). hid, FILE.hid, FILE.jsonl, pupil://HOST, udp://:PORT, mouse (with --view),
    /// simulated or simulated:SEED [default: none; with --view mouse]
    #[arg(help_heading = "Eye", long, value_name = "SOURCE")]
    pub tracker: Option<String>,
    /// How it is opened
    #[command(flatten)]
    pub source: SourceOptions,
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
    let options = args.source.options(real);
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
