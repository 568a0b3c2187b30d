//! A tracker's samples on their way to the estimate of the pupil, on a thread of their own.

use crate::gaze::{Estimator, Phase};
use crate::optics::PupilDistribution;
use crate::playback::Lane;
use crate::trackers::{Sample, Status, Stream, TrackerError, now_ns};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What is expected of the eye at a time. Times on the trackers' clock ([`now_ns`]).
#[derive(Debug, Clone, Copy)]
pub struct Expected {
    /// The pupil.
    pub pupil: PupilDistribution,
    /// What the eye does.
    pub phase: Phase,
    /// When the newest sample was taken, had arrived, and had gone through the filter; none before the first.
    pub sample_ns: Option<[u64; 3]>,
}

struct State {
    estimator: Estimator,
    newest: Option<[u64; 3]>,
    /// Where the pupil was measured, for looking back: (time, position).
    places: VecDeque<(u64, [f64; 2])>,
    notes: VecDeque<String>,
}

/// Places that are remembered: a second at 1 kHz.
const REMEMBERED: usize = 1024;
const NOTES: usize = 32;
/// How long it waits for a sample before it looks whether it should stop.
const PATIENCE: Duration = Duration::from_millis(50);

/// A tracker that is watched; dropped, it is left alone.
pub struct Watch {
    state: Arc<Mutex<State>>,
    stream: Arc<Stream>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Lane>>,
}

/// Said when the thread panics.
struct LastWords(Arc<Mutex<State>>);

impl Drop for LastWords {
    fn drop(&mut self) {
        if std::thread::panicking() {
            locked(&self.0).note("following the eye has ended by a fault of its own; the picture stays".into());
        }
    }
}

fn locked(state: &Mutex<State>) -> MutexGuard<'_, State> {
    // An estimate is whole between two samples, whatever became of who held it.
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Watch {
    /// Takes the samples of `stream` through `estimator`; `lane` traces it.
    ///
    /// # Errors
    /// [`TrackerError::Setting`] where the system gives no thread.
    pub fn start(stream: Stream, estimator: Estimator, mut lane: Lane) -> Result<Self, TrackerError> {
        let (places, notes) = (VecDeque::with_capacity(REMEMBERED), VecDeque::with_capacity(NOTES));
        let state = Arc::new(Mutex::new(State { estimator, newest: None, places, notes }));
        let (stream, stop) = (Arc::new(stream), Arc::new(AtomicBool::new(false)));
        let (theirs, samples, stopped) = (Arc::clone(&state), Arc::clone(&stream), Arc::clone(&stop));
        let thread = std::thread::Builder::new()
            .name("eyebox gaze".into())
            .spawn(move || {
                let (mut ended, mut count) = (false, 0);
                let _words = LastWords(Arc::clone(&theirs));
                while !stopped.load(Ordering::Acquire) {
                    while let Some(note) = samples.note() {
                        locked(&theirs).note(note);
                    }
                    // Asked before: what came before the end is still taken.
                    let status = samples.status();
                    if let Some(sample) = samples.next(PATIENCE) {
                        let begun = Instant::now();
                        locked(&theirs).take(&sample);
                        lane.span("filter", count, begun);
                        count += 1;
                        continue;
                    }
                    if status.ended && !ended {
                        ended = true;
                        let why = status.failure.unwrap_or_else(|| "it has come to its end".into());
                        locked(&theirs).note(format!("the tracker is over: {why}; the picture stays"));
                    }
                    if ended {
                        std::thread::sleep(PATIENCE);
                    }
                }
                lane
            })
            .map_err(|e| TrackerError::Setting(format!("no thread for the gaze: {e}")))?;
        Ok(Self { state, stream, stop, thread: Some(thread) })
    }

    /// What is expected at a time to come.
    pub fn expect(&self, light_ns: u64) -> Expected {
        let state = locked(&self.state);
        Expected { pupil: state.estimator.predict(light_ns), phase: state.estimator.phase(), sample_ns: state.newest }
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

    /// Something that the tracker said.
    pub fn note(&self) -> Option<String> {
        locked(&self.state).notes.pop_front()
    }

    /// Ends the thread: what it did.
    pub fn stop(&mut self) -> Option<Lane> {
        self.stop.store(true, Ordering::Release);
        self.thread.take().and_then(|t| t.join().ok())
    }

    /// How the tracker is doing.
    pub fn status(&self) -> Status {
        self.stream.status()
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.stop();
    }
}

impl State {
    fn take(&mut self, sample: &Sample) {
        let stages = self.estimator.update(sample);
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
    }

    fn note(&mut self, note: String) {
        if self.notes.len() < NOTES {
            self.notes.push_back(note);
        }
    }
}
