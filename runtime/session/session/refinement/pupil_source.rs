//! Who is asked where the pupil will be.

use crate::gaze::Estimator;
use crate::optics::PupilDistribution;
use crate::session::frame_log::error::SessionError;
use crate::session::refinement::pupil_tracker::{PupilEstimate, PupilTracker, TrackerCounts};
use crate::trackers::{Event, Sample, Source};
use crossbeam_utils::atomic::AtomicCell;
use std::sync::Arc;
use std::time::Duration;

/// Who is asked where the pupil will be.
pub enum PupilSource {
    /// A tracker, on its thread.
    Tracker(Arc<PupilTracker>),
    /// A tracker that is asked for what has arrived, in simulated time.
    Samples(Box<Samples>),
    /// Nobody: pupils are drawn over the whole eyebox.
    Nobody(PupilDistribution),
}

impl PupilSource {
    /// What is expected at `light_ns`, by what has arrived by `now_ns`: times on the trackers' clock.
    ///
    /// # Errors
    /// Those of a tracker in simulated time.
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

/// A tracker's samples, taken as they arrive in simulated time.
pub struct Samples {
    source: Box<dyn Source>,
    /// The filter that the samples go through.
    pub estimator: Estimator,
    waiting: Option<Sample>,
    /// When the newest was taken, had arrived and had gone through the filter.
    newest: Option<[u64; 3]>,
    counts: Arc<AtomicCell<TrackerCounts>>,
}

impl Samples {
    /// From a source that does not wait for real time.
    pub fn new(source: Box<dyn Source>, estimator: Estimator, counts: Arc<AtomicCell<TrackerCounts>>) -> Self {
        Self { source, estimator, waiting: None, newest: None, counts }
    }

    /// Takes what has arrived by now.
    ///
    /// # Errors
    /// [`SessionError::Tracker`].
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
