//! Content that follows the eye: a hologram, refined while it is shown.

use super::companion::{Asked, Companion, CompanionOpener, Now};
use super::output::OpenDisplay;
use super::present_thread::{Running, Setup};
use super::refine::{Refinement, RefinementOptions};
use super::scheduler::Start;
use super::{
    EngineOpener, Latency, LiveSource, LiveStatistics, Notes, Policy, PupilTracker, Schedule, SessionError, SetTiming,
    Speed, Stage, SteeredColor, Steerer, Trace, Track, as_ns,
};
use crate::encode::Encoder;
use crate::engine::{Backend, Engine, EngineError};
use crate::gaze::Estimator;
use crate::gpu::Gpu;
use crate::optics::Pupil;
use crate::present::{Clock, Rate, RealClock, SECOND_NS};
use crate::trackers::mouse::{self, MouseHandle};
use crate::trackers::simulated::{self, SimulatedSource};
use crate::trackers::{self, Options, Source, Spec, Stream, now_ns};
use crossbeam_utils::atomic::AtomicCell;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Whose eye is followed.
pub struct Tracking {
    source: Box<dyn Source>,
    estimator: Estimator,
    /// A simulated eye's twin, which knows where the pupil really is.
    truth: Option<simulated::Eye>,
}

impl Tracking {
    /// By a tracker of any kind.
    pub fn new(source: Box<dyn Source>, estimator: Estimator) -> Self {
        Self { source, estimator, truth: None }
    }

    /// By one that is named, in real time.
    ///
    /// # Errors
    /// [`SessionError::Tracker`].
    pub fn open(spec: &Spec, options: &Options, estimator: Estimator) -> Result<Self, SessionError> {
        let Spec::Simulated(seed) = *spec else { return Ok(Self::new(trackers::open(spec, options)?, estimator)) };
        let settings = simulated::Settings { seed, rate_hz: options.rate_hz, ..simulated::Settings::default() };
        let begins = now_ns();
        let source = SimulatedSource::starting(settings.clone(), true, begins)?;
        Ok(Self { source: Box::new(source), estimator, truth: Some(simulated::Eye::new(settings, begins)) })
    }

    /// By a mouse, whose place somebody pushes.
    pub fn mouse(estimator: Estimator) -> (MouseHandle, Self) {
        let (handle, source) = mouse::channel();
        (handle, Self::new(Box::new(source), estimator))
    }

    /// The tracker, for people.
    pub fn describe(&self) -> String {
        let about = self.source.about();
        about.notes.iter().fold(about.name, |all, note| format!("{all}, {note}"))
    }
}

/// Where engines come from.
pub enum EngineSource {
    /// All of them from one place: the CPU, or a device that they share.
    Backend(Backend),
    /// Each from wherever this opens it.
    Opener(EngineOpener),
}

impl From<Backend> for EngineSource {
    fn from(backend: Backend) -> Self {
        Self::Backend(backend)
    }
}

impl From<EngineOpener> for EngineSource {
    fn from(opener: EngineOpener) -> Self {
        Self::Opener(opener)
    }
}

impl EngineSource {
    fn open(&mut self) -> Result<Box<dyn Engine>, EngineError> {
        match self {
            Self::Backend(backend) => backend.engine(),
            Self::Opener(open) => open(),
        }
    }

    /// The device that they share.
    fn gpu(&self) -> Result<Option<Gpu>, EngineError> {
        match self {
            Self::Backend(backend) => backend.gpu(),
            Self::Opener(_) => Ok(None),
        }
    }
}

/// A hologram that follows the eye.
#[non_exhaustive]
pub struct Live {
    /// What is refined: every colour, begun with the hologram for the whole eyebox.
    pub colors: Vec<SteeredColor>,
    /// To what the display receives.
    pub encoder: Encoder,
    /// What computes: an engine for each colour, opened again when one is lost. Where they are on a device, sets are encoded
    /// there too, and phases never come to the host.
    pub engines: EngineSource,
    /// Whose eye.
    pub tracking: Tracking,
    /// How it follows.
    pub policy: Policy,
    /// Whether it does from the beginning.
    pub steered: bool,
    /// From a video frame's beginning to its light.
    pub display_latency: Duration,
    /// A window beside the display.
    pub companion: Option<CompanionOpener>,
}

impl Live {
    /// With everything else at its default.
    pub fn new(
        colors: Vec<SteeredColor>,
        encoder: Encoder,
        engines: impl Into<EngineSource>,
        tracking: Tracking,
    ) -> Self {
        let (policy, display_latency, engines) = (Policy::default(), Duration::ZERO, engines.into());
        Self { colors, encoder, engines, tracking, policy, steered: true, display_latency, companion: None }
    }

    /// Starts following and refining.
    pub(super) fn start(
        self,
        display: &mut OpenDisplay,
        steered: Arc<AtomicBool>,
        notes: &Notes,
        trace: Trace,
    ) -> Result<Setup, SessionError> {
        let Self { colors, encoder, mut engines, tracking, policy, .. } = self;
        let clock = display.real_clock.ok_or_else(|| {
            SessionError::Setting("a live hologram follows an eye in real time: its clock cannot be simulated".into())
        })?;
        let set_frames = encoder.packed().video_frames as u64;
        let period_ns = display.rate.time_of_ns(i64::try_from(set_frames).unwrap_or(i64::MAX));
        let schedule = Schedule {
            display_rate: display.rate,
            content_rate: Rate::new(1_000_000_000, u32::try_from(period_ns).unwrap_or(u32::MAX))?,
            speed: Speed::ONE,
            set_frames,
            start: Start::WhenReady { idle_sets: 4_u64.div_ceil(set_frames) },
            keep_phase: false,
        };
        let sub_frames = colors.iter().map(SteeredColor::frames).sum::<usize>() as u64;
        let name = tracking.describe();
        let stream = Stream::start(tracking.source)?;
        let tracker = PupilTracker::start(stream, tracking.estimator, notes.clone(), trace.track("gaze"))?;
        let tracker = Arc::new(tracker);
        let timing = Arc::new(AtomicCell::new(SetTiming::new(period_ns)));
        let light_after = Duration::from_nanos(period_ns.unsigned_abs() / 2) + self.display_latency;
        let with_phases = self.companion.is_some();
        let companion = match self.companion {
            Some(open) => Some(open(display.desktop()?).map_err(SessionError::Companion)?),
            None => None,
        };
        let again = move || Ok((Steerer::new(colors.clone(), policy, || engines.open())?, engines.gpu()?));
        let options = RefinementOptions {
            clock,
            timing: Arc::clone(&timing),
            light_after,
            steered: Arc::clone(&steered),
            with_phases,
            again: Box::new(again),
            notes: notes.clone(),
            track: trace.track("refine"),
        };
        let idle = encoder.frames();
        let (refinement, source) = Refinement::start(encoder, Arc::clone(&tracker), options)?;
        let following = Following {
            companion,
            source,
            refinement,
            tracker,
            name,
            policy,
            truth: tracking.truth,
            timing,
            steered,
            clock,
            light_after_ns: as_ns(light_after),
            sets_per_second: display.rate.hz() / set_frames as f64,
            notes: notes.clone(),
            latency: Latency::default(),
            pupil: None,
            open: VecDeque::with_capacity(OPEN),
            halves: [None; 2],
            halves_at_ns: i64::MIN,
        };
        Ok(Setup { running: Running::Live(Box::new(following)), schedule, idle, sub_frames })
    }
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
    /// From the sample to the light, ms: the median.
    pub sample_to_light_ms: Option<f64>,
    /// How far the pupil was from where it was expected, mm: the median.
    pub pupil_error_mm: Option<f64>,
}

/// Lights that wait for the tracker at most.
const OPEN: usize = 256;

/// A live hologram that is shown, as the present thread has it: what becomes of every set.
pub(super) struct Following {
    companion: Option<Box<dyn Companion>>,
    pub source: LiveSource,
    refinement: Refinement,
    tracker: Arc<PupilTracker>,
    name: String,
    policy: Policy,
    truth: Option<simulated::Eye>,
    timing: Arc<AtomicCell<SetTiming>>,
    steered: Arc<AtomicBool>,
    clock: RealClock,
    light_after_ns: i64,
    sets_per_second: f64,
    notes: Notes,
    latency: Latency,
    /// Where the pupil was expected for the set on the screen.
    pupil: Option<[f64; 2]>,
    /// Lights whose pupil is not known yet: time on the trackers' clock, where it was expected.
    open: VecDeque<(u64, [f64; 2])>,
    /// Medians for the status, and when they were taken.
    halves: [Option<f64>; 2],
    halves_at_ns: i64,
}

impl Following {
    /// After a video frame, which may have begun a set; false once a user closed the window beside the display.
    pub(super) fn after(&mut self, set_start_ns: Option<i64>, display: &mut OpenDisplay) -> bool {
        if let Some(start_ns) = set_start_ns {
            self.set_began(start_ns);
        }
        self.look_back();
        let now_ns = self.clock.now_ns();
        if now_ns > self.halves_at_ns.saturating_add(SECOND_NS / 4) {
            let of = |histogram: &super::Histogram| histogram.percentile(0.5);
            self.halves = [of(self.latency.of(Stage::SampleToLight)), of(self.latency.error_mm())];
            self.halves_at_ns = now_ns;
        }
        self.serve(display)
    }

    fn serve(&mut self, display: &mut OpenDisplay) -> bool {
        let Some(companion) = &mut self.companion else { return true };
        let seen = self.tracker.expect(self.clock.monotonic_ns(self.clock.now_ns())).pupil;
        let middle = |[low, high]: [f64; 2]| 0.5 * (low + high);
        let [x, y] = seen.centre;
        let pupil = Pupil { x, y, diameter: middle(seen.diameter), depth: middle(seen.focus) };
        let steered = self.steered.load(Ordering::Acquire);
        let now = Now { pupil, steered, sets_per_second: self.sets_per_second };
        match display.pump().map_err(|e| e.to_string()).and_then(|()| companion.serve(&now)) {
            Ok(Asked::Nothing) => true,
            Ok(Asked::Close) => false,
            Ok(Asked::Steer(steered)) => {
                self.steered.store(steered, Ordering::Release);
                true
            }
            // A view is not worth the display.
            Err(error) => {
                self.notes.tell(format!("{error}; the display goes on"));
                self.companion = None;
                true
            }
        }
    }

    /// A set begins to be lit at `start_ns`.
    fn set_began(&mut self, start_ns: i64) {
        let decided_ns = self.source.asked().map_or(start_ns, |at| self.clock.at_ns(at));
        self.timing.store(self.timing.load().after(start_ns, decided_ns));
        let light_ns = start_ns.saturating_add(self.light_after_ns);
        if let Some(set) = self.source.newly_shown() {
            self.latency.shown(&set.timestamps, self.clock.now_ns(), light_ns);
            self.pupil = set.timestamps.sample_ns.map(|_| set.pupil);
            if let Some(companion) = &mut self.companion {
                companion.shown(set);
            }
        }
        if let Some(pupil) = self.pupil {
            if self.open.len() == OPEN {
                self.open.pop_front();
            }
            self.open.push_back((self.clock.monotonic_ns(light_ns), pupil));
        }
    }

    /// Where the pupil was at lights that have passed: truly, for a simulated eye, else as it was measured.
    fn look_back(&mut self) {
        let now = self.clock.monotonic_ns(self.clock.now_ns());
        while let Some((light, expected)) = self.open.front().copied() {
            let position = match &mut self.truth {
                Some(eye) if light <= now => {
                    let truth = eye.at(light);
                    (truth.lid > 0.5).then_some(truth.position)
                }
                None if self.tracker.reaches(light) => self.tracker.measured(light),
                None if now.saturating_sub(light) > 2_000_000_000 => None,
                _ => return,
            };
            self.open.pop_front();
            if let Some([x, y]) = position {
                self.latency.missed_by((x - expected[0]).hypot(y - expected[1]));
            }
        }
    }

    pub(super) fn status(&self) -> LiveStatus {
        let ([sets_new, sets_repeated], [restarts, steps]) = (self.source.counts(), self.refinement.counts());
        let [sample_to_light_ms, pupil_error_mm] = self.halves;
        LiveStatus { sets_new, sets_repeated, steps, restarts, sample_to_light_ms, pupil_error_mm }
    }

    /// Ends the threads: what came of it, and what they did.
    pub(super) fn stop(mut self) -> (LiveStatistics, Vec<Track>) {
        let LiveStatus { sets_new, sets_repeated, steps, restarts, .. } = self.status();
        let mut tracks: Vec<Track> = self.refinement.stop().into_iter().collect();
        if let Some(mut tracker) = Arc::into_inner(self.tracker) {
            tracks.extend(tracker.stop());
        }
        let (latency, policy) = (self.latency, self.policy);
        let live = LiveStatistics { tracker: self.name, policy, sets_new, sets_repeated, steps, restarts, latency };
        (live, tracks)
    }
}
