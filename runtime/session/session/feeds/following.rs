//! A live hologram that is shown, as the present thread has it: what becomes of every set.

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
    /// A tracker on its thread. It is `None` without a tracker and in simulated time.
    pub tracker: Option<Arc<PupilTracker>>,
    pub truth: Option<simulated::Eye>,
    pub name: String,
    /// Whether nothing need ever come of it: a mouse need not come over its window, nor a program push anything.
    pub may_be_silent: bool,
    /// What became of its samples.
    pub counts: Arc<AtomicCell<TrackerCounts>>,
}

/// How a live hologram is doing.
#[derive(Debug, Clone, Copy, Default)]
#[non_exhaustive]
pub struct LiveStatus {
    /// Sets that were new when they were decided on.
    pub sets_new: u64,
    /// Sets that were shown again.
    pub sets_repeated: u64,
    /// Steps over all colours.
    pub steps: u64,
    /// How often it began again with the hologram for the whole eyebox.
    pub restarts: u64,
    /// From a new sample to its first light, ms: the median.
    pub sample_to_light_ms: Option<f64>,
    /// How old the newest sample was at the newest light, ms.
    pub sample_age_ms: Option<f64>,
    /// How far the pupil was from where it was expected, mm: the median.
    pub pupil_error_mm: Option<f64>,
    /// Depth that the set on the screen was made for, metres; none where that is for the whole eyebox.
    pub focus: Option<f64>,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct HandedOver {
    /// When it begins to be lit.
    pub start_ns: i64,
    /// Which of its set.
    pub video_frame: u64,
    /// Whether it was decided with it what is shown.
    pub decided: bool,
}

/// Lights that wait for the tracker at most.
pub(crate) const OPEN: usize = 256;

/// A live hologram that is shown, as the present thread has it: what becomes of every set.
pub(crate) struct LiveState {
    pub(crate) sidecar_window: Option<Box<dyn SidecarWindow>>,
    pub(crate) switch: Option<SourceSwitch>,
    pub(crate) source: LiveSource,
    pub(crate) refinement: Refinement,
    pub(crate) eye: FollowedEye,
    pub(crate) keeping: Option<JournalWriter>,
    /// Whether that begins with nothing: an application gives it.
    pub(crate) first_is_to_come: bool,
    pub(crate) track: Track,
    pub(crate) timing: Arc<AtomicCell<SetTiming>>,
    pub(crate) steered: Arc<AtomicBool>,
    pub(crate) times: Times,
    /// Where pupils are where nobody is tracked.
    pub(crate) whole: PupilDistribution,
    /// From the beginning to the middle of the light of what is decided at once, and of one video frame.
    pub(crate) light_after_ns: i64,
    pub(crate) frame_light_after_ns: i64,
    pub(crate) packed: Arc<Packed>,
    /// Of the set on the screen, how many video frames were lit.
    pub(crate) lit_of_set: (u64, usize),
    pub(crate) sets_per_second: f64,
    pub(crate) notes: Notes,
    pub(crate) statistics: LiveStatistics,
    /// Where the pupil was expected for the set on the screen.
    pub(crate) pupil: Option<[f64; 2]>,
    /// Depth that it was made for, metres.
    pub(crate) focus: Option<f64>,
    /// Lights whose pupil is not known yet: time on the trackers' clock, where it was expected.
    pub(crate) open: VecDeque<(u64, [f64; 2])>,
    /// Medians for the status, and when they were taken.
    pub(crate) medians: [Option<f64>; 2],
    pub(crate) medians_at_ns: i64,
}

impl LiveState {
    /// After a video frame; false once a user closed the window beside the display.
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
            // A view is not worth the display.
            Err(error) => {
                self.notes.send(format!("{error}; the display goes on"));
                self.sidecar_window = None;
                true
            }
        }
    }

    /// A set begins to be lit, or, where sets roll, a video frame of the newest.
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
                // A switch is not worth the picture: it says itself what is wrong with it.
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

    /// A video frame is lit, with what it holds.
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

    /// Where the pupil was at lights that have passed: truly, for a simulated eye, else as it was measured.
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

    /// Why there was nothing to follow, where there was not, and should have been.
    pub(crate) fn followed(&self) -> Result<(), SessionError> {
        let samples = self.eye.counts.load().samples;
        if self.eye.tracker.is_none() || samples.placed > 0 || self.eye.may_be_silent {
            return Ok(());
        }
        let reason = match samples.reasons().first() {
            None => "no sample came".to_string(),
            Some((why, _)) => format!("none of {} samples told where the pupil is ({why})", samples.samples()),
        };
        Err(SessionError::NotFollowed { tracker: self.eye.name.clone(), reason })
    }

    /// Ends the threads: what came of it, and what they did.
    pub(crate) fn stop(mut self) -> (LiveStatistics, Vec<Track>, Result<(), SessionError>) {
        let [restarts, steps, sets_moving, phases_moved] = self.refinement.counts();
        let mut tracks: Vec<Track> = self.refinement.stop().into_iter().collect();
        // A refinement in simulated time holds nothing of it.
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

/// What a trace says of a set that is lit then.
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
