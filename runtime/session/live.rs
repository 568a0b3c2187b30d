//! Content that follows the eye: a hologram, refined while it is shown.

use super::companion::CompanionOpener;
use super::error::SessionError;
use super::following::{Following, OPEN};
use super::latency::Latency;
use super::notes::Notes;
use super::output::OpenDisplay;
use super::pupil_tracker::PupilTracker;
use super::refine::{Refinement, RefinementOptions};
use super::running::{Running, Setup};
use super::scheduler::{Schedule, Start};
use super::set_timing::{SetTiming, as_ns};
use super::steerer::{Policy, SteeredColor, Steerer};
use super::timeline::Speed;
use super::trace::Trace;
use crate::encode::Encoder;
use crate::engine::{Backend, Engine, EngineError};
use crate::gaze::Estimator;
use crate::gpu::Gpu;
use crate::present::Rate;
use crate::trackers::mouse::{self, MouseHandle};
use crate::trackers::simulated::{self, SimulatedSource};
use crate::trackers::{self, Options, Source, Spec, Stream, now_ns};
use crossbeam_utils::atomic::AtomicCell;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
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

/// Opens an engine, as often as it is called.
pub type EngineOpener = Box<dyn FnMut() -> Result<Box<dyn Engine>, EngineError> + Send>;

/// Where engines come from.
#[non_exhaustive]
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

    /// Starts following and refining. `on_host`: somebody on the host wants the video frames too.
    pub(super) fn start(
        self,
        display: &mut OpenDisplay,
        on_host: bool,
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
        let (name, is_mouse) = (tracking.describe(), tracking.source.about().kind == "mouse");
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
        let shared = engines.gpu()?;
        let direct = match display.presenter().takes() {
            Some((gpu, order)) if !on_host && shared.is_some_and(|shared| shared.is(gpu)) => Some(order),
            _ => None,
        };
        let again = move || Ok((Steerer::new(colors.clone(), policy, || engines.open())?, engines.gpu()?));
        let options = RefinementOptions {
            clock,
            timing: Arc::clone(&timing),
            light_after,
            steered: Arc::clone(&steered),
            direct,
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
            is_mouse,
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
            focus: None,
            focused: None,
            open: VecDeque::with_capacity(OPEN),
            medians: [None; 2],
            medians_at_ns: i64::MIN,
        };
        Ok(Setup { running: Running::Live(Box::new(following)), schedule, idle, sub_frames })
    }
}
