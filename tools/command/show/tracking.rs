//! Opens the tracker that a session follows.

use crate::Failure;
use crate::tracker::EyeName;
use crate::tracker::source::SourceOptions;
use crate::values::depth;
use clap::Args;
use eyebox::low_level::gaze::{Calibration, Estimator, Eye, Eyepiece, Settings};
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
    /// simulated or simulated:SEED [default: none, or mouse with --view]
    #[arg(help_heading = "Eye", long, value_name = "SOURCE")]
    pub tracker: Option<String>,
    #[command(flatten)]
    pub source: SourceOptions,
    /// Calibration of a user
    #[arg(help_heading = "Eye", long, value_name = "FILE.toml")]
    pub calibration: Option<PathBuf>,
    /// Eye that is followed
    #[arg(help_heading = "Eye", long, value_enum, default_value = "mean")]
    pub eye: EyeName,
    /// Focus of the eye, mm, or dioptres as in 0.5D, if the tracker does not measure it
    #[arg(help_heading = "Eye", long, value_name = "MM|D", default_value = "0", value_parser = depth)]
    pub focus: Depth,
}

/// Opens the tracker. If the tracker is the mouse, returns a handle for its position, too. `view` is true if there is a
/// window for a mouse. `eyepiece` converts dioptres of focus to depths before the display. If `real` is true, a
/// simulated eye lives in real time, otherwise in its own time.
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
            "the mouse is a tracker in a window only. Add --view"
        ))
        .into()),
        Spec::Mouse => {
            let (mouse, tracking) = Tracking::mouse(estimator);
            Ok((Some(mouse), tracking))
        }
        spec => Ok((None, Tracking::open(&spec, &options, estimator)?)),
    }
}

/// The nearest point that a simulated pair of eyes looks at, dioptres.
const NEAREST: f64 = 3.0;

/// Opens one tracker for the left and the right eye, whose pupils are `ipd` apart (meters). The other arguments are
/// the same as for [`tracking`].
pub fn tracking_of_two(
    tracker: &str,
    args: &TrackerArgs,
    real: bool,
    eyepieces: [Eyepiece; 2],
    reach: f64,
    ipd: f64,
) -> Result<[Tracking; 2], Failure> {
    let spec: Spec = tracker.parse()?;
    let calibration = args.calibration.as_deref().map(Calibration::load).transpose()?;
    let estimator = |eye: Eye, eyepiece: Eyepiece| -> Result<Estimator, Failure> {
        let focus = [args.focus.metres(eyepiece.focal_length); 2];
        let settings = Settings { eye, focus, eyepiece: Some(eyepiece), ..Settings::default() };
        let settings = Settings { reach: settings.reach.max(reach), ..settings };
        Ok(Estimator::new(settings, calibration.clone())?)
    };
    let [left, right] = eyepieces;
    // Content behind the panels' own plane needs no vergence of its own, because eyes do not diverge.
    let [far, near] = left.depths.map(|depth| (depth / left.focal_length.powi(2)).clamp(0.0, NEAREST));
    let estimators = [estimator(Eye::Left, left)?, estimator(Eye::Right, right)?];
    let radius = Settings::default().radius;
    Ok(Tracking::open_two(&spec, &args.source.options(real), estimators, (ipd, radius), [far, near])?)
}
