//! Simulates the eye, its tracker and the time of a study.

use super::results::StudySettings;
use eyebox::low_level::error::Reason;
use eyebox::low_level::gaze::{Estimator, GazeError};
use eyebox::low_level::optics::PupilDistribution;
use eyebox::low_level::session::Samples;
use eyebox::low_level::session::SessionError;
use eyebox::low_level::session::SetTiming;
use eyebox::low_level::trackers::simulated::{Doing, Eye, SimulatedSource, Truth};

pub(super) struct Stage {
    settings: StudySettings,
    eye: Eye,
    /// A second copy of the eye, for a look at its future.
    ahead: Eye,
    samples: Samples,
    /// The simulated time that has passed, in nanoseconds.
    pub(super) now_ns: i64,
    /// The time until which jumps have been searched, in nanoseconds.
    watched_ns: u64,
    pub(super) landed_ns: Option<u64>,
    pub(super) jumps: u32,
}

impl Stage {
    pub(super) fn new(settings: &StudySettings) -> Result<Self, SessionError> {
        let wrong = |e: GazeError| SessionError::Setting(Reason::of(&e));
        Ok(Self {
            eye: Eye::new(settings.eye.clone(), 0),
            ahead: Eye::new(settings.eye.clone(), 0),
            samples: Samples::new(
                Box::new(SimulatedSource::starting(settings.eye.clone(), false, 0)?),
                Estimator::new(settings.gaze.clone(), None).map_err(wrong)?,
                std::sync::Arc::default(),
            ),
            now_ns: 0,
            watched_ns: 0,
            landed_ns: None,
            jumps: 0,
            settings: settings.clone(),
        })
    }

    /// Reads the samples that have arrived by now.
    pub(super) fn arrive(&mut self) -> Result<(), SessionError> {
        self.samples.arrive(u64::try_from(self.now_ns).unwrap_or(0))
    }

    /// Predicts the pupil at this time.
    pub(super) fn predict(&self, light_ns: u64) -> PupilDistribution {
        self.samples.estimator.predict(light_ns)
    }

    /// Returns the eye at a time, and counts its jumps until then.
    pub(super) fn truth(&mut self, time_ns: u64) -> Truth {
        // Jumps last at least 20 ms.
        while self.watched_ns < time_ns {
            self.watched_ns = (self.watched_ns + 5_000_000).min(time_ns);
            if let Doing::Saccade { lands_ns, .. } = self.eye.at(self.watched_ns).doing
                && self.landed_ns != Some(lands_ns)
            {
                self.landed_ns = Some(lands_ns);
                self.jumps += 1;
            }
        }
        self.eye.at(time_ns)
    }

    /// Returns true if the eye, which rests now, jumps by this time.
    pub(super) fn jumps_by(&mut self, time_ns: i64) -> bool {
        let truth = self.ahead.at(u64::try_from(time_ns).unwrap_or(0));
        matches!(truth.doing, Doing::Saccade { .. })
    }

    /// Returns the timing of the last set that is decided by now.
    pub(super) fn timing(&self) -> SetTiming {
        let StudySettings { period_ns, lead_ns, .. } = self.settings;
        let start_ns = (self.now_ns + lead_ns).div_euclid(period_ns) * period_ns;
        SetTiming { start_ns, lead_ns, ..SetTiming::new(period_ns) }
    }
}
