//! Supplies the predicted pupil of a session.

use crate::gaze::Estimator;
use crate::optics::PupilDistribution;
use crate::session::frame_log::error::SessionError;
use crate::session::refinement::pupil_tracker::{PupilEstimate, PupilTracker, TrackerCounts};
use crate::trackers::{Event, Sample, Source};
use crossbeam_utils::atomic::AtomicCell;
use std::sync::Arc;
use std::time::Duration;

/// The source of the predicted pupil.
pub enum PupilSource {
    /// A tracker on its thread.
    Tracker(Arc<PupilTracker>),
    /// A tracker whose arrived samples are read in simulated time.
    Samples(Box<Samples>),
    /// No tracker. Pupils are drawn from the whole eyebox.
    Nobody(PupilDistribution),
}

impl PupilSource {
    /// Predicts the pupil at `light_ns` from the samples that arrived by `now_ns`. Both are times on the clock of the
    /// trackers.
    ///
    /// # Errors
    /// Returns the errors of a tracker in simulated time.
    pub fn expect(&mut self, now_ns: u64, light_ns: u64) -> Result<PupilEstimate, SessionError> {
        match self {
            Self::Tracker(tracker) => Ok(tracker.expect(light_ns)),
            Self::Samples(samples) => {
                samples.arrive(now_ns)?;
                Ok(PupilEstimate::by(&samples.estimator, light_ns, samples.newest))
            }
            Self::Nobody(pupil) => Ok(PupilEstimate::of(*pupil)),
        }
    }

    pub(crate) fn is_tracked(&self) -> bool {
        !matches!(self, Self::Nobody(_))
    }
}

/// The samples of a tracker, taken as they arrive in simulated time.
pub struct Samples {
    source: Box<dyn Source>,
    /// The filter of the samples.
    pub estimator: Estimator,
    waiting: Option<Sample>,
    /// The times at which the newest sample was taken, had arrived and was filtered (ns).
    newest: Option<[u64; 3]>,
    counts: Arc<AtomicCell<TrackerCounts>>,
}

impl Samples {
    /// Creates samples from a source that does not wait for real time.
    pub fn new(source: Box<dyn Source>, estimator: Estimator, counts: Arc<AtomicCell<TrackerCounts>>) -> Self {
        Self { source, estimator, waiting: None, newest: None, counts }
    }

    /// Takes the samples that have arrived by `now_ns`.
    ///
    /// # Errors
    /// Returns [`SessionError::Tracker`] if the source fails.
    pub fn arrive(&mut self, now_ns: u64) -> Result<(), SessionError> {
        loop {
            let sample = match self.waiting.take() {
                Some(sample) => sample,
                None => match self.source.next(Duration::ZERO)? {
                    Event::Sample(sample, _) => sample,
                    _ => return Ok(()),
                },
            };
            if sample.received_ns > now_ns {
                self.waiting = Some(sample);
                return Ok(());
            }
            self.estimator.update(&sample);
            self.counts.store(TrackerCounts { samples: self.estimator.counts(), dropped: self.source.dropped() });
            self.newest = Some([sample.time_ns, sample.received_ns, sample.received_ns]);
        }
    }
}
