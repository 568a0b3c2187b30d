//! Which tracker is watched, and what is true of a simulated eye.

use crate::Failure;
use crate::trackers::EyeName;
use crate::values::{not_negative, positive};
use clap::Args;
use eyebox::gaze::{Calibration, Estimator, Settings};
use eyebox::live::Watch;
use eyebox::playback::Lane;
use eyebox::trackers::mouse::{self, MouseHandle};
use eyebox::trackers::simulated::{self, SimulatedSource};
use eyebox::trackers::{Options, Source, Spec, Stream, TrackerError, now_ns, open};
use std::path::PathBuf;
use std::time::Duration;

/// The tracker, in every command that follows one.
#[derive(Args)]
pub struct TrackerArgs {
    /// hid, FILE.hid, FILE.jsonl, pupil://HOST, udp://:PORT, mouse (with --view), simulated or simulated:SEED
    #[arg(long, value_name = "SOURCE", default_value = "simulated")]
    pub tracker: String,
    /// A HID device with a layout of its own, described in a TOML file
    #[arg(long, value_name = "FILE.toml")]
    pub device_file: Option<PathBuf>,
    /// Time between the eye and the arrival of its sample, ms
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = not_negative)]
    pub tracker_latency: f64,
    /// Samples a second of the simulated tracker
    #[arg(long, value_name = "HZ", default_value_t = 120.0, value_parser = positive)]
    pub tracker_rate: f64,
    /// A user's calibration
    #[arg(long, value_name = "FILE.toml")]
    pub calibration: Option<PathBuf>,
    /// Whose pupil
    #[arg(long, value_enum, default_value = "mean")]
    pub eye: EyeName,
    /// Where the eye focuses, mm
    #[arg(long, value_name = "MM", default_value_t = 0.0, allow_hyphen_values = true)]
    pub focus: f64,
}

/// A tracker that is watched.
pub struct Watching {
    /// It.
    pub watch: Watch,
    /// A simulated eye's twin, which knows where the pupil really is.
    pub truth: Option<simulated::Eye>,
    /// Where the mouse is told, if that is the tracker.
    pub mouse: Option<MouseHandle>,
    /// For people.
    pub about: String,
}

/// Opens and watches it; `view` says whether there is a window for a mouse.
pub fn start(args: &TrackerArgs, view: bool, lane: Lane) -> Result<Watching, Failure> {
    let spec: Spec = args.tracker.parse()?;
    let calibration = args.calibration.as_deref().map(Calibration::load).transpose()?;
    let settings = Settings { eye: args.eye.into(), focus: [args.focus * 1e-3; 2], ..Settings::default() };
    let estimator = Estimator::new(settings, calibration)?;
    let options = Options {
        latency: Duration::from_secs_f64((args.tracker_latency * 1e-3).min(1e6)),
        device_file: args.device_file.clone(),
        real_time: true,
        rate_hz: args.tracker_rate,
    };
    let mut handle = None;
    let (source, truth): (Box<dyn Source>, _) = match spec {
        Spec::Simulated(seed) => {
            let settings = simulated::Settings { seed, rate_hz: args.tracker_rate, ..simulated::Settings::default() };
            let begins = now_ns();
            let source = SimulatedSource::starting(settings.clone(), true, begins)?;
            (Box::new(source), Some(simulated::Eye::new(settings, begins)))
        }
        Spec::Mouse if !view => {
            return Err(TrackerError::Setting("the mouse is a tracker in a window only: add --view".into()).into());
        }
        Spec::Mouse => {
            let (pushed, source) = mouse::channel();
            handle = Some(pushed);
            (Box::new(source), None)
        }
        spec => (open(&spec, &options)?, None),
    };
    let about = source.about();
    let about = about.notes.iter().fold(about.name, |all, note| format!("{all}, {note}"));
    Ok(Watching { watch: Watch::start(Stream::start(source)?, estimator, lane)?, truth, mouse: handle, about })
}
