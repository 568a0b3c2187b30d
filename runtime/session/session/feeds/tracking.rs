//! Opens the tracker of a session, for one eye or for both.

use crate::gaze::Estimator;
use crate::session::frame_log::error::SessionError;
use crate::trackers::pushed::{self, MouseHandle, SampleSender};
use crate::trackers::simulated::{self, Side, SimulatedSource};
use crate::trackers::two_eyes::{Vergence, share};
use crate::trackers::{self, Options, Source, Spec, now_ns};
use eyebox_base::reason;

/// The eye that a session follows.
pub struct Tracking {
    pub(super) source: Box<dyn Source>,
    pub(super) estimator: Estimator,
    /// A copy of the simulated eye, which gives the true position of the pupil.
    pub(super) truth: Option<simulated::Eye>,
    /// True if its samples arrive in real time.
    pub(super) real_time: bool,
}

impl Tracking {
    /// Follows a tracker of any kind.
    pub fn new(source: Box<dyn Source>, estimator: Estimator) -> Self {
        Self { source, estimator, truth: None, real_time: true }
    }

    /// Opens a tracker by its specification. It runs in real time, except that simulated eyes can run in a time of
    /// their own that begins at 0.
    ///
    /// # Errors
    /// Returns [`SessionError::Tracker`], or [`SessionError::Setting`] for a real-time tracker with a simulated clock.
    pub fn open(spec: &Spec, options: &Options, estimator: Estimator) -> Result<Self, SessionError> {
        let Spec::Simulated(seed) = *spec else {
            if !options.real_time {
                return Err(reason!(
                    "simulated-clock",
                    "`tracker` {spec:?}: it runs in real time, but a simulated clock needs `tracker` simulated"
                )
                .into());
            }
            return Ok(Self::new(trackers::open(spec, options)?, estimator));
        };
        let settings = simulated::Settings { seed, rate_hz: options.rate_hz, ..simulated::Settings::default() };
        Self::of_eye(settings, options.real_time, estimator)
    }

    /// Follows a simulated eye, in real time or in a time of its own that begins at 0.
    pub(crate) fn of_eye(
        settings: simulated::Settings,
        real_time: bool,
        estimator: Estimator,
    ) -> Result<Self, SessionError> {
        let begins = if real_time { now_ns() } else { 0 };
        let source = SimulatedSource::starting(settings.clone(), real_time, begins)?;
        let truth = Some(simulated::Eye::new(settings, begins));
        Ok(Self { source: Box::new(source), estimator, truth, real_time })
    }

    /// Follows both eyes with one tracker, as [`open`](Self::open) follows one. The left and the right eye have
    /// `estimators`. Their pupils are `ipd` apart, and turn at `radius` from the center of rotation (m). A simulated pair
    /// of eyes looks at points between the dioptres of `focus`.
    ///
    /// # Errors
    /// Returns the errors of [`open`](Self::open).
    pub fn open_two(
        spec: &Spec,
        options: &Options,
        estimators: [Estimator; 2],
        (ipd, radius): (f64, f64),
        focus: [f64; 2],
    ) -> Result<[Self; 2], SessionError> {
        let [left, right] = estimators;
        let (one, eyes) = match *spec {
            Spec::Simulated(seed) => {
                let rate_hz = options.rate_hz;
                let settings = simulated::Settings { seed, rate_hz, ipd, focus, ..simulated::Settings::default() };
                let one = Self::of_eye(settings, options.real_time, left.clone())?;
                let eyes = one.truth.clone().map(|eye| [Side::Left, Side::Right].map(|side| eye.clone().of(side)));
                (one, eyes)
            }
            _ => (Self::open(spec, options, left.clone())?, None),
        };
        let real_time = one.real_time;
        let [left_source, right_source] = share(one.source, Vergence::new(ipd, radius));
        let [left_truth, right_truth] = eyes.map_or([None, None], |eyes| eyes.map(Some));
        Ok([
            Self { source: Box::new(left_source), estimator: left, truth: left_truth, real_time },
            Self { source: Box::new(right_source), estimator: right, truth: right_truth, real_time },
        ])
    }

    /// Follows a mouse, whose position the caller pushes.
    pub fn mouse(estimator: Estimator) -> (MouseHandle, Self) {
        let (handle, source) = pushed::mouse();
        (handle, Self::new(Box::new(source), estimator))
    }

    /// Follows the tracker of the calling program, which pushes its samples in real time.
    pub fn pushed(estimator: Estimator) -> (SampleSender, Self) {
        let (sender, source) = pushed::channel();
        (sender, Self::new(Box::new(source), estimator))
    }

    /// Describes the tracker for people.
    pub fn describe(&self) -> String {
        let about = self.source.about();
        about.notes.iter().fold(about.name, |all, note| format!("{all}, {note}"))
    }
}
