//! Tracks each multiplex set of a live hologram on the present thread.

use crate::encode::Packed;
use crate::optics::{Pupil, PupilDistribution};
use crate::present::SECOND_NS;
use crate::session::feeds::journal::{Decision, JournalWriter};
use crate::session::feeds::refine::Refinement;
use crate::session::feeds::sets::{FinishedSet, LiveSource};
use crate::session::feeds::sidecar::{LitSources, Now, SidecarWindow, SourceSwitch, UserRequest};
use crate::session::feeds::statistics::LiveStatistics;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::latency::{Histogram, Stage};
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::trace::{Light, Lit, Track};
use crate::session::playback::output::OpenDisplay;
use crate::session::playback::player::SetSource;
use crate::session::refinement::pupil_tracker::{PupilTracker, TrackerCounts};
use crate::session::refinement::set_timing::SetTiming;
use crate::session::refinement::work_time::Times;
use crate::trackers::simulated;
use crossbeam_utils::atomic::AtomicCell;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The eye that a session follows, and its tracker.
pub(crate) struct FollowedEye {
    /// The tracker on its thread, or `None` without a tracker and in simulated time.
    pub tracker: Option<Arc<PupilTracker>>,
    pub truth: Option<simulated::Eye>,
    pub name: String,
    /// True if a silent tracker is no error. A mouse may never enter its window, and a program may never push a sample.
    pub may_be_silent: bool,
    /// The counts of its samples.
    pub counts: Arc<AtomicCell<TrackerCounts>>,
}

/// The state of a live hologram.
#[derive(Debug, Clone, Copy, Default)]
#[non_exhaustive]
pub struct LiveStatus {
    /// The sets that were new when they were decided on.
    pub sets_new: u64,
    /// The sets that were shown again.
    pub sets_repeated: u64,
    /// The steps over all colors.
    pub steps: u64,
    /// The number of restarts from the hologram for the whole eyebox.
    pub restarts: u64,
    /// The median time from a new sample to its first light (ms).
    pub sample_to_light_ms: Option<f64>,
    /// The age of the newest sample at the newest light (ms).
    pub sample_age_ms: Option<f64>,
    /// The median distance of the pupil from its predicted position (mm).
    pub pupil_error_mm: Option<f64>,
    /// The depth that the set on the screen was made for (m), or `None` if it is for the whole eyebox.
    pub focus: Option<f64>,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct HandedOver {
    /// The time at which the video frame begins to be lit (ns).
    pub start_ns: i64,
    /// The number of the video frame in its set.
    pub video_frame: u64,
    /// True if the content was decided on with this video frame.
    pub decided: bool,
}

/// The largest number of lights that wait for the tracker.
pub(crate) const OPEN: usize = 256;

/// A live hologram that is shown, as the present thread tracks it.
pub(crate) struct LiveState {
    pub(crate) sidecar_window: Option<Box<dyn SidecarWindow>>,
    pub(crate) switch: Option<SourceSwitch>,
    pub(crate) source: LiveSource,
    pub(crate) refinement: Refinement,
    pub(crate) eye: FollowedEye,
    pub(crate) keeping: Option<JournalWriter>,
    /// True if the session starts without a scene because an application supplies it.
    pub(crate) first_is_to_come: bool,
    pub(crate) track: Track,
    pub(crate) timing: Arc<AtomicCell<SetTiming>>,
    pub(crate) steered: Arc<AtomicBool>,
    pub(crate) times: Times,
    /// The pupils that are assumed without a tracker.
    pub(crate) whole: PupilDistribution,
    /// The time from the beginning of a set that is decided at once to the middle of its light, and the same time of
    /// one video frame (ns).
    pub(crate) light_after_ns: i64,
    pub(crate) frame_light_after_ns: i64,
    pub(crate) packed: Arc<Packed>,
    /// The set on the screen and the number of its video frames that were lit.
    pub(crate) lit_of_set: (u64, usize),
    pub(crate) sets_per_second: f64,
    pub(crate) notes: Notes,
    pub(crate) statistics: LiveStatistics,
    /// The predicted position of the pupil for the set on the screen.
    pub(crate) pupil: Option<[f64; 2]>,
    /// The depth that the set was made for (m).
    pub(crate) focus: Option<f64>,
    /// The lights whose pupil is not yet known, each with its time on the clock of the trackers and the predicted
    /// position.
    pub(crate) open: VecDeque<(u64, [f64; 2])>,
    /// The medians for the status, and the time at which they were taken.
    pub(crate) medians: [Option<f64>; 2],
    pub(crate) medians_at_ns: i64,
}

impl LiveState {
    /// Updates the state after a video frame. Returns false after a user closed the sidecar window.
    pub(crate) fn after(&mut self, frame: Option<HandedOver>, display: &mut OpenDisplay) -> bool {
        if let Some(frame) = frame {
            if frame.decided {
                self.set_began(frame, display.clock.now_ns());
            }
            self.lights(frame);
        }
        let now_ns = display.clock.now_ns();
        self.look_back(now_ns);
        if now_ns > self.medians_at_ns.saturating_add(SECOND_NS / 4) {
            let of = |histogram: &Histogram| histogram.percentile(0.5);
            let latency = &self.statistics.latency;
            self.medians = [of(latency.of(Stage::SampleToLight)), of(latency.error_mm())];
            self.medians_at_ns = now_ns;
        }
        self.serve(display)
    }

    fn serve(&mut self, display: &mut OpenDisplay) -> bool {
        let Some(sidecar_window) = &mut self.sidecar_window else { return true };
        let now_ns = self.times.monotonic_ns(display.clock.now_ns());
        let seen = self.eye.tracker.as_ref().map_or(self.whole, |tracker| tracker.expect(now_ns).pupil);
        let middle = |[low, high]: [f64; 2]| 0.5 * (low + high);
        let [x, y] = seen.centre;
        let pupil = Pupil { x, y, diameter: middle(seen.diameter), depth: middle(seen.focus) };
        let steered = self.steered.load(Ordering::Acquire);
        let now = Now { pupil, steered, sets_per_second: self.sets_per_second };
        match display.pump().map_err(|e| e.to_string()).and_then(|()| sidecar_window.serve(&now)) {
            Ok(UserRequest::Nothing) => true,
            Ok(UserRequest::Close) => false,
            Ok(UserRequest::Steer(steered)) => {
                self.steered.store(steered, Ordering::Release);
                true
            }
            // A failed preview must not end the display.
            Err(error) => {
                self.notes.send(format!("{error}: the preview is closed, and the display continues"));
                self.sidecar_window = None;
                true
            }
        }
    }

    /// Records that a set begins to be lit, or with rolling updates a video frame of the newest set.
    fn set_began(&mut self, HandedOver { start_ns, video_frame, .. }: HandedOver, now_ns: i64) {
        if let Some(clock) = self.times.0 {
            let decided_ns = self.source.asked.map_or(start_ns, |at| clock.at_ns(at));
            self.timing.store(self.timing.load().after(start_ns, decided_ns).at_turn(video_frame));
        }
        let light_ns = start_ns.saturating_add(self.light_after_ns);
        if let (Some(keeping), Some((_, number))) = (&self.keeping, self.source.on_screen()) {
            keeping.journal().keep(Decision::Lit { number });
        }
        if let Some(set) = self.source.newly_shown() {
            if let Some(switch) = &mut self.switch {
                // A failed switch must not end the display. The switch reports its own errors.
                switch(&LitSources { set: set.number, start_ns, colors: set.sources() });
            }
            if let Some(showing) = &mut self.statistics.showing {
                showing.lit(Some(set), start_ns);
            }
            self.track.lit(lit_by(set, light_ns));
            self.statistics.latency.shown(&set.timestamps, now_ns, light_ns);
            self.pupil = set.timestamps.sample_ns.map(|_| set.pupil);
            self.focus = set.focus;
            if let Some(z) = set.focus {
                let [low, high] = self.statistics.focus.unwrap_or([z; 2]);
                self.statistics.focus = Some([low.min(z), high.max(z)]);
            }
            if let Some(sidecar_window) = &mut self.sidecar_window {
                sidecar_window.shown(set);
            }
        } else if let Some(showing) = &mut self.statistics.showing {
            showing.lit(None, start_ns);
        }
        if let Some(pupil) = self.pupil {
            if self.open.len() == OPEN {
                self.open.pop_front();
            }
            self.open.push_back((self.times.monotonic_ns(light_ns), pupil));
        }
    }

    /// Records the light of a video frame and its sub-frames.
    fn lights(&mut self, HandedOver { start_ns, video_frame, .. }: HandedOver) {
        let Some(set) = &self.source.on_screen else { return };
        let (number, lit) = self.lit_of_set;
        let lit = if number == set.number { lit } else { 0 };
        self.lit_of_set = (set.number, lit + 1);
        let again = lit >= self.packed.video_frames;
        let held = self.packed.slots.iter().filter(|slot| slot.video_frame as u64 == video_frame).count();
        self.statistics.sub_frames[usize::from(again)] += held as u64;
        let why = self.source.repeated.unwrap_or_default();
        self.track.light(Light {
            lit: lit_by(set, start_ns.saturating_add(self.frame_light_after_ns)),
            video_frame,
            again: again.then(|| why.name()),
            packed: Arc::clone(&self.packed),
        });
    }

    /// Compares the pupil at past lights with the prediction. A simulated eye gives the true position, a tracker the
    /// measured one.
    fn look_back(&mut self, now_ns: i64) {
        let now = self.times.monotonic_ns(now_ns);
        while let Some((light, expected)) = self.open.front().copied() {
            let position = match &mut self.eye.truth {
                Some(eye) if light <= now => {
                    let truth = eye.at(light);
                    (truth.lid > 0.5).then_some(truth.position)
                }
                None if self.eye.tracker.as_ref().is_some_and(|tracker| tracker.reaches(light)) => {
                    self.eye.tracker.as_ref().and_then(|tracker| tracker.measured(light))
                }
                None if now.saturating_sub(light) > 2_000_000_000 => None,
                _ => return,
            };
            self.open.pop_front();
            if let Some([x, y]) = position {
                self.statistics.latency.missed_by((x - expected[0]).hypot(y - expected[1]));
            }
        }
    }

    pub(crate) fn status(&self) -> LiveStatus {
        let ([restarts, steps, ..], [sample_to_light_ms, pupil_error_mm]) = (self.refinement.counts(), self.medians);
        LiveStatus {
            sets_new: self.source.news,
            sets_repeated: self.source.repeats.iter().sum(),
            steps,
            restarts,
            sample_to_light_ms,
            sample_age_ms: self.statistics.latency.sample_age_ms(),
            pupil_error_mm,
            focus: self.focus,
        }
    }

    /// Returns an error if a tracker was expected to give a pupil position and never did.
    pub(crate) fn followed(&self) -> Result<(), SessionError> {
        let samples = self.eye.counts.load().samples;
        if self.eye.tracker.is_none() || samples.placed > 0 || self.eye.may_be_silent {
            return Ok(());
        }
        let reason = match samples.reasons().first() {
            None => "no sample came".to_string(),
            Some((why, _)) => format!("none of {} samples gave a pupil position ({why})", samples.samples()),
        };
        Err(SessionError::NotFollowed { tracker: self.eye.name.clone(), reason })
    }

    /// Ends the threads and returns the statistics, the tracks of the threads and the result of the journal.
    pub(crate) fn stop(mut self) -> (LiveStatistics, Vec<Track>, Result<(), SessionError>) {
        let [restarts, steps, sets_moving, phases_moved] = self.refinement.counts();
        let mut tracks: Vec<Track> = self.refinement.stop().into_iter().collect();
        // A refinement in simulated time holds no reference to the tracker.
        if let Some(mut tracker) = self.eye.tracker.and_then(Arc::into_inner) {
            tracks.extend(tracker.stop());
        }
        let live = LiveStatistics {
            sets_new: self.source.news,
            sets_repeated: self.source.repeats.iter().sum(),
            repeats: self.source.repeats,
            steps,
            restarts,
            sets_moving,
            phases_moved,
            showing: self.statistics.showing.map(|showing| showing.with(self.refinement.taken())),
            samples: self.eye.counts.load(),
            tracker: self.eye.name,
            ..self.statistics
        };
        (live, tracks, self.keeping.map_or(Ok(()), JournalWriter::finish))
    }
}

/// Returns the entry of the trace for a set that is lit at `light_ns`.
fn lit_by(set: &FinishedSet, light_ns: i64) -> Lit {
    Lit {
        set: set.number,
        content: set.content,
        supply: set.supply.name(),
        sample_ns: set.timestamps.sample_ns,
        light_ns,
        steps: set.steps,
        estimated_db: set.estimated_db,
    }
}
