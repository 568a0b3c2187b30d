//! A tracker's samples on their way to the estimate of the pupil, on a thread of their own.

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

/// What is expected of the eye at a time. Times on the trackers' clock ([`now_ns`]).
#[derive(Debug, Clone, Copy)]
pub struct PupilEstimate {
    /// The pupil.
    pub pupil: PupilDistribution,
    /// How fast it moves, and the eye turns.
    pub velocity: EyeVelocity,
    /// When the newest sample was taken, had arrived, and had gone through the filter; none before the first.
    pub sample_ns: Option<[u64; 3]>,
}

impl PupilEstimate {
    /// Of an eye that nobody tracks.
    pub(crate) fn of(pupil: PupilDistribution) -> Self {
        Self { pupil, velocity: EyeVelocity::default(), sample_ns: None }
    }

    /// Predicts an eye at a time from the estimator's samples. `sample_ns` are the newest sample's times.
    pub(crate) fn by(estimator: &Estimator, light_ns: u64, sample_ns: Option<[u64; 3]>) -> Self {
        Self { pupil: estimator.predict(light_ns), velocity: estimator.velocity(), sample_ns }
    }
}

/// The samples of a tracker so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct TrackerCounts {
    /// Samples by what became of them.
    pub samples: Counts,
    /// What was dropped before it was a sample, or of one.
    pub dropped: Dropped,
}

impl TrackerCounts {
    /// The counts for statistics, by reason.
    pub fn to_json(&self) -> Value {
        let refused: Value = Refusal::ALL.iter().zip(self.samples.refused).map(|(r, n)| (r.key(), json!(n))).collect();
        let (received, placed) = (self.samples.samples(), self.samples.placed);
        json!({ "received": received, "placed": placed, "refused": refused, "dropped": self.dropped })
    }
}

/// Refusals of one reason before it is said: blinks and single artefacts are usual.
const SAY: u64 = 20;

struct State {
    estimator: Estimator,
    counts: Arc<AtomicCell<TrackerCounts>>,
    /// Reasons that were said.
    said: [bool; Refusal::ALL.len()],
    newest: Option<[u64; 3]>,
    /// Where the pupil was measured, for looking back: (time, position).
    places: VecDeque<(u64, [f64; 2])>,
}

/// Places that are remembered: a second at 1 kHz.
const REMEMBERED: usize = 1024;
/// How long it waits for a sample before it looks whether it should stop.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Follows the pupil; dropped, it stops.
pub struct PupilTracker {
    state: Arc<Mutex<State>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Track>>,
}

fn locked(state: &Mutex<State>) -> MutexGuard<'_, State> {
    // An estimate is whole between two samples, whatever became of who held it.
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PupilTracker {
    /// Takes the samples of `stream` through `estimator` and counts them. `notes` receive its messages, `track` traces it.
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
            let _note = notes.on_panic("following the eye has ended by a fault of its own; the picture stays");
            while !stopped.load(Ordering::Acquire) {
                while let Some(note) = stream.note() {
                    notes.send(note);
                }
                // Asked before: what came before the end is still taken.
                let status = stream.status();
                if let Some(sample) = stream.next(POLL_INTERVAL) {
                    if count == 0 {
                        // A device is known once it has sent something.
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

    /// What is expected at a time to come.
    pub fn expect(&self, light_ns: u64) -> PupilEstimate {
        let state = locked(&self.state);
        PupilEstimate::by(&state.estimator, light_ns, state.newest)
    }

    /// Where the pupil was at a time that has passed, between the two measurements around it; none where it was not
    /// seen within 20 ms before and after, or is not known yet.
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

    /// Whether what was measured reaches this time.
    pub fn reaches(&self, time_ns: u64) -> bool {
        locked(&self.state).places.back().is_some_and(|p| p.0 >= time_ns)
    }

    /// Ends the thread: what it did.
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
    /// Takes a sample; a note, if one reason has refused many.
    fn take(&mut self, sample: &Sample, dropped: Dropped) -> Option<String> {
        let stages = self.estimator.update(sample);
        let samples = self.estimator.counts();
        self.counts.store(TrackerCounts { samples, dropped });
        if let Ok(placed) = &stages.placed {
            // A clock that went back begins a new memory.
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
