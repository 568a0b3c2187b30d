//! Filters the samples of a tracker to an estimate of the pupil, on a thread of its own.

use crate::gaze::place::{Counts, Refusal};
use crate::gaze::{Estimator, EyeVelocity};
use crate::optics::PupilDistribution;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::threads::spawn;
use crate::session::frame_log::trace::Track;
use crate::trackers::{Dropped, Sample, Stream, now_ns};
use crossbeam_utils::atomic::AtomicCell;
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The estimate of an eye at a time. Times are on the clock of the trackers ([`now_ns`]).
#[derive(Debug, Clone, Copy)]
pub struct PupilEstimate {
    /// The distribution of the pupil.
    pub pupil: PupilDistribution,
    /// The velocity of the pupil and the rotation of the eye.
    pub velocity: EyeVelocity,
    /// The times at which the newest sample was taken, had arrived and was filtered, or `None` before the first sample.
    pub sample_ns: Option<[u64; 3]>,
}

impl PupilEstimate {
    /// Creates the estimate of an eye without a tracker.
    pub(crate) fn of(pupil: PupilDistribution) -> Self {
        Self { pupil, velocity: EyeVelocity::default(), sample_ns: None }
    }

    /// Predicts an eye at a time from the samples of the estimator. `sample_ns` are the times of the newest sample.
    pub(crate) fn by(estimator: &Estimator, light_ns: u64, sample_ns: Option<[u64; 3]>) -> Self {
        Self { pupil: estimator.predict(light_ns), velocity: estimator.velocity(), sample_ns }
    }
}

/// The counts of the samples of a tracker until now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct TrackerCounts {
    /// The samples by their result.
    pub samples: Counts,
    /// The data that was dropped before it became a sample, or from a sample.
    pub dropped: Dropped,
}

impl TrackerCounts {
    /// Returns the counts by reason for statistics.
    pub fn to_json(&self) -> Value {
        let refused: Value = Refusal::ALL.iter().zip(self.samples.refused).map(|(r, n)| (r.key(), json!(n))).collect();
        let (received, placed) = (self.samples.samples(), self.samples.placed);
        json!({ "received": received, "placed": placed, "refused": refused, "dropped": self.dropped })
    }
}

/// The refusals for one reason before a note is sent, because blinks and single artefacts are usual.
const SAY: u64 = 20;

struct State {
    estimator: Estimator,
    counts: Arc<AtomicCell<TrackerCounts>>,
    /// True for each reason that a note was sent for.
    said: [bool; Refusal::ALL.len()],
    newest: Option<[u64; 3]>,
    /// The measured positions of the pupil for later comparison, as (time, position).
    places: VecDeque<(u64, [f64; 2])>,
}

/// The number of positions that are kept, which is a second at 1 kHz.
const REMEMBERED: usize = 1024;
/// The longest wait for a sample before the thread checks for its end.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// A thread that tracks the pupil. It stops when it is dropped.
pub struct PupilTracker {
    state: Arc<Mutex<State>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Track>>,
}

fn locked(state: &Mutex<State>) -> MutexGuard<'_, State> {
    // An estimate is complete between two samples, even if the holder of the lock panicked.
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PupilTracker {
    /// Filters the samples of `stream` with `estimator` and counts them. `notes` receives its messages, and `track`
    /// traces it.
    pub(crate) fn start(
        stream: Stream,
        estimator: Estimator,
        counts: Arc<AtomicCell<TrackerCounts>>,
        notes: Notes,
        mut track: Track,
    ) -> Result<Self, SessionError> {
        let places = VecDeque::with_capacity(REMEMBERED);
        let state = Arc::new(Mutex::new(State { estimator, counts, said: Default::default(), newest: None, places }));
        let stop = Arc::new(AtomicBool::new(false));
        let (theirs, stopped) = (Arc::clone(&state), Arc::clone(&stop));
        let thread = spawn("follows", move || {
            let (mut ended, mut count) = (false, 0);
            let _note = notes.on_panic("tracking of the pupil has ended by a fault of its own, and the picture stays");
            while !stopped.load(Ordering::Acquire) {
                while let Some(note) = stream.note() {
                    notes.send(note);
                }
                // The status is read first, so that samples from before the end are still taken.
                let status = stream.status();
                if let Some(sample) = stream.next(POLL_INTERVAL) {
                    if count == 0 {
                        // A device gives its name with its first sample.
                        let note = stream.tracker().and_then(|name| locked(&theirs).estimator.note_on(&name));
                        note.into_iter().for_each(|note| notes.send(note));
                    }
                    let begun = Instant::now();
                    if let Some(note) = locked(&theirs).take(&sample, status.source) {
                        notes.send(note);
                    }
                    track.span("filter", count, begun);
                    count += 1;
                    continue;
                }
                if status.ended && !ended {
                    ended = true;
                    let why = status.failure.unwrap_or_else(|| "it has come to its end".into());
                    notes.send(format!("the tracker is over: {why}; the picture stays"));
                }
                if ended {
                    std::thread::sleep(POLL_INTERVAL);
                }
            }
            track
        })?;
        Ok(Self { state, stop, thread: Some(thread) })
    }

    /// Returns the estimate at a future time.
    pub fn expect(&self, light_ns: u64) -> PupilEstimate {
        let state = locked(&self.state);
        PupilEstimate::by(&state.estimator, light_ns, state.newest)
    }

    /// Returns the position of the pupil at a past time, interpolated between the two measurements around it. Returns
    /// `None` if these are more than 40 ms apart, or the later one has not arrived.
    pub fn measured(&self, time_ns: u64) -> Option<[f64; 2]> {
        let state = locked(&self.state);
        let after = state.places.iter().position(|p| p.0 >= time_ns)?;
        let (t1, p1) = state.places[after];
        let (t0, p0) = *state.places.get(after.checked_sub(1)?)?;
        let span = t1 - t0;
        (span <= 40_000_000).then(|| {
            let share = (time_ns - t0) as f64 / span.max(1) as f64;
            [0, 1].map(|i| p0[i] + (p1[i] - p0[i]) * share)
        })
    }

    /// Returns true if the measurements reach this time.
    pub fn reaches(&self, time_ns: u64) -> bool {
        locked(&self.state).places.back().is_some_and(|p| p.0 >= time_ns)
    }

    /// Ends the thread and returns its track.
    pub fn stop(&mut self) -> Option<Track> {
        self.stop.store(true, Ordering::Release);
        self.thread.take().and_then(|t| t.join().ok())
    }
}

impl Drop for PupilTracker {
    fn drop(&mut self) {
        let _ = self.stop();
    }
}

impl State {
    /// Takes a sample. Returns a note if one reason has refused many samples.
    fn take(&mut self, sample: &Sample, dropped: Dropped) -> Option<String> {
        let stages = self.estimator.update(sample);
        let samples = self.estimator.counts();
        self.counts.store(TrackerCounts { samples, dropped });
        if let Ok(placed) = &stages.placed {
            // A clock that was set back clears the positions.
            if self.places.back().is_some_and(|p| p.0 >= placed.time_ns) {
                self.places.clear();
            }
            if self.places.len() == REMEMBERED {
                self.places.pop_front();
            }
            self.places.push_back((placed.time_ns, placed.position));
        }
        self.newest = Some([sample.time_ns, sample.received_ns, now_ns()]);
        let refusal = stages.placed.err().filter(|r| !matches!(r, Refusal::NotSeen | Refusal::Confidence))?;
        let count = samples.refused[refusal as usize];
        if count < SAY || std::mem::replace(&mut self.said[refusal as usize], true) {
            return None;
        }
        let which =
            sample.readings().find(|r| r.1.valid).map_or(String::new(), |(eye, r)| format!(", such as {eye} {r}"));
        Some(format!("{count} of {} samples of the tracker are refused: {refusal}{which}", samples.samples()))
    }
}
