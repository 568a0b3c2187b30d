//! A study's simulated world: the eye, its tracker, and time.

use super::results::{Cost, StudySettings};
use crate::gaze::{Estimator, GazeError};
use crate::session::error::SessionError;
use crate::session::set_timing::{SetTiming, as_ns};
use crate::trackers::simulated::{Doing, Eye, SimulatedSource, Truth};
use crate::trackers::{Event, Sample, Source};
use std::time::{Duration, Instant};

/// Time that passes by what work costs, nanoseconds.
pub(super) struct WorkTime {
    cost: Cost,
    began_ns: i64,
    begun: Instant,
    spent: Duration,
}

impl WorkTime {
    pub(super) fn begin(cost: Cost, now_ns: i64) -> Self {
        Self { cost, began_ns: now_ns, begun: Instant::now(), spent: Duration::ZERO }
    }

    pub(super) fn now_ns(&self) -> i64 {
        let spent = if self.cost == Cost::Measured { self.begun.elapsed() } else { self.spent };
        self.began_ns.saturating_add(as_ns(spent))
    }

    /// Whether a step, which is `expected` to take so long where it is measured, ends in time; if so, it is taken.
    pub(super) fn step_before(&mut self, deadline_ns: i64, expected: Duration) -> bool {
        let cost = match self.cost {
            Cost::Measured => expected,
            Cost::Fixed { step, .. } => step,
        };
        let in_time = self.now_ns().saturating_add(as_ns(cost)) <= deadline_ns;
        if in_time {
            self.spent += cost;
        }
        in_time
    }

    /// A set was encoded.
    pub(super) fn encoded(&mut self) {
        if let Cost::Fixed { encode, .. } = self.cost {
            self.spent += encode;
        }
    }
}

pub(super) struct Stage {
    settings: StudySettings,
    eye: Eye,
    source: SimulatedSource,
    waiting: Option<Sample>,
    pub(super) estimator: Estimator,
    /// Time that has passed.
    pub(super) now_ns: i64,
    /// Looked at until here for jumps.
    watched_ns: u64,
    pub(super) landed_ns: Option<u64>,
    pub(super) jumps: u32,
}

impl Stage {
    pub(super) fn new(settings: &StudySettings) -> Result<Self, SessionError> {
        let wrong = |e: GazeError| SessionError::Setting(e.to_string());
        Ok(Self {
            eye: Eye::new(settings.eye.clone(), 0),
            source: SimulatedSource::starting(settings.eye.clone(), false, 0)?,
            waiting: None,
            estimator: Estimator::new(settings.gaze.clone(), None).map_err(wrong)?,
            now_ns: 0,
            watched_ns: 0,
            landed_ns: None,
            jumps: 0,
            settings: settings.clone(),
        })
    }

    /// Samples that have arrived by now.
    pub(super) fn arrive(&mut self) -> Result<(), SessionError> {
        let now = u64::try_from(self.now_ns).unwrap_or(0);
        loop {
            let sample = match self.waiting.take() {
                Some(sample) => sample,
                None => match self.source.next(Duration::ZERO)? {
                    Event::Sample(sample, _) => sample,
                    _ => return Ok(()),
                },
            };
            if sample.received_ns > now {
                self.waiting = Some(sample);
                return Ok(());
            }
            self.estimator.update(&sample);
        }
    }

    /// The eye at a time, and what it did until then.
    pub(super) fn truth(&mut self, time_ns: u64) -> Truth {
        // Jumps last 20 ms at least.
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

    /// The last set that is decided on by now.
    pub(super) fn timing(&self) -> SetTiming {
        let StudySettings { period_ns, lead_ns, .. } = self.settings;
        let start_ns = (self.now_ns + lead_ns).div_euclid(period_ns) * period_ns;
        SetTiming { start_ns, period_ns, lead_ns }
    }
}
