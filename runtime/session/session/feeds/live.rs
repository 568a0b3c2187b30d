//! Content that follows the eye: a hologram, refined while it is shown.

use crate::encode::Encoder;
use crate::engine::{Backend, Engine, EngineError};
use crate::gaze::Estimator;
use crate::gpu::Gpu;
use crate::hologram::Hologram;
use crate::optics::{Display, PupilDistribution};
use crate::scene::LightField;
use crate::session::content::scenes::Scenes;
use crate::session::feeds::following::{FollowedEye, LiveState, OPEN};
use crate::session::feeds::journal::{Journal, JournalWriter, RecordedSession};
use crate::session::feeds::play::encoder_of;
use crate::session::feeds::refine::{Begin, Refinement, RefinementOptions};
use crate::session::feeds::replay::Replay;
use crate::session::feeds::showing::ContentReport;
use crate::session::feeds::sidecar::{SidecarOpener, SourceSwitch};
use crate::session::feeds::statistics::LiveStatistics;
use crate::session::feeds::{ActiveContent, ContentSetup};
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::trace::Trace;
use crate::session::playback::output::OpenDisplay;
use crate::session::playback::scheduler::{Schedule, Start};
use crate::session::playback::timeline::Speed;
use crate::session::refinement::field::{Field, LiveColor};
use crate::session::refinement::live_refiner::look_up::{begin_with_tables, start_tables};
use crate::session::refinement::live_refiner::together::{lighting_of, sub_frames_of};
use crate::session::refinement::live_refiner::{EngineOpener, LiveRefiner, Policy};
use crate::session::refinement::moments::MotionCompensation;
use crate::session::refinement::pupil_source::{PupilSource, Samples};
use crate::session::refinement::pupil_tracker::{PupilTracker, TrackerCounts};
use crate::session::refinement::set_timing::{SetTiming, as_ns};
use crate::session::refinement::work_time::{Cost, Times};
use crate::solve::{PupilRange, StartTable};
use crate::trackers::pushed::{self, MouseHandle, SampleSender};
use crate::trackers::simulated::{self, SimulatedSource};
use crate::trackers::{self, Options, Source, Spec, Stream, now_ns};
use crossbeam_utils::atomic::AtomicCell;
use eyebox_base::reason;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Whose eye is followed.
pub struct Tracking {
    source: Box<dyn Source>,
    estimator: Estimator,
    /// A simulated eye's twin, which knows where the pupil really is.
    truth: Option<simulated::Eye>,
    /// Whether its samples come when they would.
    real_time: bool,
}

impl Tracking {
    /// By a tracker of any kind.
    pub fn new(source: Box<dyn Source>, estimator: Estimator) -> Self {
        Self { source, estimator, truth: None, real_time: true }
    }

    /// By one that is named: in real time, or, of simulated eyes, in a time of their own that begins at 0.
    ///
    /// # Errors
    /// [`SessionError::Tracker`]; [`SessionError::Setting`] for what lives in real time alone.
    pub fn open(spec: &Spec, options: &Options, estimator: Estimator) -> Result<Self, SessionError> {
        let Spec::Simulated(seed) = *spec else {
            if !options.real_time {
                return Err(reason!(
                    "simulated-clock",
                    "a simulated clock takes a simulated eye alone (`tracker` simulated), and {spec:?} lives in real time"
                ).into());
            }
            return Ok(Self::new(trackers::open(spec, options)?, estimator));
        };
        let settings = simulated::Settings { seed, rate_hz: options.rate_hz, ..simulated::Settings::default() };
        Self::of_eye(settings, options.real_time, estimator)
    }

    /// By a simulated eye, in real time or in a time of its own that begins at 0.
    pub(crate) fn of_eye(
        settings: simulated::Settings,
        real_time: bool,
        estimator: Estimator,
    ) -> Result<Self, SessionError> {
        let begins = if real_time { now_ns() } else { 0 };
        let source = SimulatedSource::starting(settings.clone(), real_time, begins)?;
        let truth = Some(simulated::Eye::new(settings, begins));
        Ok(Self { source: Box::new(source), estimator, truth, real_time })
    }

    /// By a mouse, whose place somebody pushes.
    pub fn mouse(estimator: Estimator) -> (MouseHandle, Self) {
        let (handle, source) = pushed::mouse();
        (handle, Self::new(Box::new(source), estimator))
    }

    /// By the program's own tracker, whose samples it pushes, in real time.
    pub fn pushed(estimator: Estimator) -> (SampleSender, Self) {
        let (sender, source) = pushed::channel();
        (sender, Self::new(Box::new(source), estimator))
    }

    /// The tracker, for people.
    pub fn describe(&self) -> String {
        let about = self.source.about();
        about.notes.iter().fold(about.name, |all, note| format!("{all}, {note}"))
    }
}

/// Where the pupil may be where nobody tells: anywhere in an eyebox of this side, metres, as wide as eyes' pupils are, focused
/// between these depths, metres.
pub fn whole_eyebox(eyebox: f64, focus: [f64; 2]) -> PupilDistribution {
    let [low, high] = PupilRange::usual_diameter(eyebox);
    let diameter = [low, high.min(WIDEST_PUPIL).max(low)];
    PupilDistribution { centre: [0.0; 2], spread: eyebox / 2.0, diameter, focus, elsewhere: 1.0 }
}

/// As wide as an eye's pupil becomes, metres.
const WIDEST_PUPIL: f64 = 8e-3;

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

impl FollowedEye {
    fn start(
        tracking: Option<Tracking>,
        whole: PupilDistribution,
        notes: &Notes,
        trace: &Trace,
    ) -> Result<(Self, PupilSource), SessionError> {
        let Some(tracking) = tracking else {
            let name = "no eye tracker: pupils over the whole eyebox".into();
            let eye = Self { tracker: None, truth: None, name, may_be_silent: false, counts: Arc::default() };
            return Ok((eye, PupilSource::Nobody(whole)));
        };
        let counts = Arc::<AtomicCell<TrackerCounts>>::default();
        let kind = tracking.source.about().kind;
        let (name, may_be_silent) = (tracking.describe(), matches!(kind, "mouse" | "program"));
        let Tracking { source, estimator, truth, real_time } = tracking;
        if !real_time {
            let note = source.tracker().and_then(|name| estimator.note_on(&name));
            note.into_iter().for_each(|note| notes.send(note));
            let watch = PupilSource::Samples(Box::new(Samples::new(source, estimator, Arc::clone(&counts))));
            return Ok((Self { tracker: None, truth, name, may_be_silent, counts }, watch));
        }
        let (stream, track) = (Stream::start(source)?, trace.track("gaze"));
        let tracker = PupilTracker::start(stream, estimator, Arc::clone(&counts), notes.clone(), track)?;
        let tracker = Arc::new(tracker);
        let watch = PupilSource::Tracker(Arc::clone(&tracker));
        Ok((Self { tracker: Some(tracker), truth, name, may_be_silent, counts }, watch))
    }
}

/// A hologram that follows the eye.
#[non_exhaustive]
pub struct Live {
    /// What is refined: every colour, begun with the hologram for the whole eyebox.
    pub colors: Vec<LiveColor>,
    /// To what the display receives.
    pub encoder: Encoder,
    /// What computes: an engine for each colour, opened again when one is lost. Where they are on a device, sets are encoded
    /// there too, and phases never come to the host.
    pub engines: EngineSource,
    /// What there is to be seen, where that changes while it is shown; none for the one hologram.
    pub scenes: Option<Box<dyn Scenes>>,
    /// Of a far field in tiles, all of it: what is refined is a piece, and `scenes` its [`FarField`](crate::session::FarField).
    pub field: Option<Field>,
    /// For content that jumps: the tables from which a picture's first phases are looked up, as [`start_tables`](crate::session::start_tables) gives
    /// them; empty where none is to be used.
    pub start_tables: Vec<Option<Arc<StartTable>>>,
    /// Whose eye; none where nobody is tracked: pupils are then drawn over the whole eyebox.
    pub tracking: Option<Tracking>,
    /// Where nobody is tracked: where the pupil may be.
    pub whole: PupilDistribution,
    /// Sets are handed over and shown whole, though the display takes several video frames for one; else they roll there: every
    /// video frame is the newest set's whose turn it is.
    pub whole_sets: bool,
    /// Whether each sub-frame is refined for its own moment, where the eye or the content moves (OPTICS 15).
    pub moments: bool,
    /// What work takes on a simulated clock.
    pub cost: Cost,
    /// A new folder that keeps what was decided, with all scenes that followed each other, so that it can be done again.
    pub journal: Option<PathBuf>,
    /// Such a folder, for a simulated clock: the same sets are lit again in the same order. Everything else is as it was then.
    pub replay: Option<PathBuf>,
    /// How it follows.
    pub policy: Policy,
    /// Whether it does from the beginning.
    pub steered: bool,
    /// From a video frame's beginning to its light.
    pub display_latency: Duration,
    /// A window beside the display.
    pub sidecar_window: Option<SidecarOpener>,
    /// What switches the display's sources, where it has any.
    pub switch: Option<SourceSwitch>,
}

impl Live {
    /// With everything else at its default.
    pub fn new(
        colors: Vec<LiveColor>,
        encoder: Encoder,
        engines: impl Into<EngineSource>,
        tracking: impl Into<Option<Tracking>>,
    ) -> Self {
        let (policy, display_latency, engines) = (Policy::default(), Duration::ZERO, engines.into());
        let whole = whole_eyebox(colors.first().map_or(0.0, |c| c.problem.eyebox), [0.0; 2]);
        Self {
            colors,
            encoder,
            engines,
            scenes: None,
            field: None,
            start_tables: Vec::new(),
            tracking: tracking.into(),
            whole,
            whole_sets: false,
            moments: true,
            cost: Cost::Measured,
            journal: None,
            replay: None,
            policy,
            steered: true,
            display_latency,
            sidecar_window: None,
            switch: None,
        }
    }

    /// A hologram for the whole eyebox, refined for the scene `field` that it shows, on a display; everything else at its default.
    ///
    /// # Errors
    /// [`SessionError::Hologram`] where it does not say which optics it was made for; [`SessionError::Encode`];
    /// [`SessionError::Setting`] for one that does not have the display's size, or has a colour that the scene lacks.
    pub fn of_hologram(
        hologram: &Hologram,
        field: &LightField,
        display: &Display,
        engines: impl Into<EngineSource>,
        tracking: impl Into<Option<Tracking>>,
    ) -> Result<Self, SessionError> {
        let encoder = encoder_of("the hologram", hologram, display)?;
        let colors = LiveColor::all_of(hologram, field, &hologram.made_for()?)?;
        let mut live = Self::new(colors, encoder, engines, tracking);
        live.whole.focus = hologram.metadata.solve.as_ref().map_or(live.whole.focus, |solve| solve.depth);
        Ok(live)
    }

    /// Content that jumps, and the first frame of an application, begin with phases of a table ([`StartTable`]): that of the user's cache,
    /// or one that is fitted now, in seconds. `observe` is told the share that is fitted, and ends it by answering false.
    ///
    /// # Errors
    /// Those of the fit.
    pub fn with_start_tables(mut self, observe: &mut dyn FnMut(f64) -> bool) -> Result<Self, SessionError> {
        self.start_tables = start_tables(&self.colors, observe)?;
        if self.scenes.as_ref().is_none_or(|scenes| !scenes.begins_with_one()) {
            begin_with_tables(&mut self.colors, &self.start_tables)?;
        }
        Ok(self)
    }

    /// Refuses what does not go together, before anything is opened for it.
    pub(crate) fn check(&self) -> Result<(), SessionError> {
        Ok(self.policy.steering.check()?)
    }

    /// Refuses what does not go with the display's clock.
    fn check_clock(&self, is_real: bool) -> Result<(), SessionError> {
        let wrong = |why| Err(SessionError::Setting(why));
        if self.replay.is_some() {
            let alone = self.scenes.is_none() && self.tracking.is_none() && self.journal.is_none();
            return match !is_real && alone {
                true => Ok(()),
                false => wrong(reason!(
                    "replay-in-real-time",
                    "what was kept is shown again on a simulated clock, without a tracker and without content"
                )),
            };
        }
        match self.cost {
            Cost::Measured if !is_real => wrong(reason!(
                "no-step-time",
                "a simulated clock has to be told what work takes: `step_time`, or leave out `clock` simulated"
            )),
            Cost::Fixed { .. } if is_real => {
                wrong(reason!("step-time", "what work takes is said to a simulated clock alone"))
            }
            _ if self.tracking.as_ref().is_some_and(|tracking| tracking.real_time != is_real) => wrong(reason!(
                "no-eye",
                "a live hologram follows an eye in real time: on a simulated clock, the simulated eye"
            )),
            _ => Ok(()),
        }
    }

    /// Starts following and refining. `on_host`: somebody on the host wants the video frames too.
    pub(crate) fn start(
        self,
        display: &mut OpenDisplay,
        on_host: bool,
        steered: Arc<AtomicBool>,
        notes: &Notes,
        trace: Trace,
    ) -> Result<ContentSetup, SessionError> {
        let clock = display.real_clock;
        self.check_clock(clock.is_some())?;
        let Self { colors, encoder, engines, field, tracking, mut policy, scenes, whole, whole_sets, cost, .. } = self;
        // What no scene brings cannot be begun again with.
        let whole_of_none = scenes.as_ref().filter(|scenes| !scenes.begins_with_one()).map(|_| whole);
        if whole_of_none.is_some() {
            policy.restart = f64::INFINITY;
        }
        let set_frames = encoder.packed().video_frames as u64;
        let rolls = set_frames > 1 && !whole_sets;
        let every = if rolls { 1 } else { set_frames };
        let period_ns = display.rate.time_of_ns(i64::try_from(every).unwrap_or(i64::MAX));
        let schedule = Schedule {
            display_rate: display.rate,
            content_rate: display.rate.over(u32::try_from(every).unwrap_or(u32::MAX))?,
            speed: Speed::ONE,
            set_frames,
            rolls,
            start: Start::WhenReady { idle_sets: 4_u64.div_ceil(every) },
            keep_phase: false,
        };
        let set_ns = display.rate.time_of_ns(i64::try_from(set_frames).unwrap_or(i64::MAX));
        let sub_frames = sub_frames_of(&colors) as u64;
        let (eye, watch) = FollowedEye::start(tracking, whole, notes, &trace)?;
        let showing = scenes.as_ref().map(|scenes| ContentReport::new(scenes.describe()));
        let timing = Arc::new(AtomicCell::new(SetTiming::new(period_ns).rolling(if rolls { set_frames } else { 1 })));
        let light_after = Duration::from_nanos(period_ns.unsigned_abs() / 2) + self.display_latency;
        let frame_light_after =
            Duration::from_nanos(display.rate.period_ns().unsigned_abs() / 2) + self.display_latency;
        let (packed, lighting) = (Arc::new(encoder.packed().clone()), lighting_of(encoder.lighting(rolls), &colors));
        let with_phases = self.sidecar_window.is_some();
        let beside = |open: SidecarOpener| open(display.desktop()?).map_err(|e| SessionError::SidecarWindow(e.into()));
        let sidecar_window = self.sidecar_window.map(beside).transpose()?;
        let shared = engines.gpu()?;
        let direct = match display.presenter().takes() {
            Some((gpu, order)) if !on_host && shared.is_some_and(|shared| shared.is(gpu)) => Some(order),
            _ => None,
        };
        let keeping = self.journal.as_deref().map(Journal::start).transpose()?;
        let mut again = begin(colors.clone(), policy, engines, field, self.start_tables);
        let idle = encoder.frames();
        let (refinement, source) = if let Some(folder) = &self.replay {
            let (refiner, _) = again()?;
            (Refinement::none(), Replay::start(RecordedSession::open(folder)?, colors, refiner, encoder, lighting)?)
        } else {
            let options = RefinementOptions {
                clock,
                cost,
                watch,
                scenes,
                journal: keeping.as_ref().map(JournalWriter::journal),
                timing: Arc::clone(&timing),
                light_after,
                moments: MotionCompensation::when(self.moments, lighting, set_ns, &colors),
                steered: Arc::clone(&steered),
                whole: whole_of_none,
                direct,
                with_phases,
                again,
                notes: notes.clone(),
                track: trace.track("refine"),
            };
            Refinement::start(encoder, options)?
        };
        let following = LiveState {
            sidecar_window,
            switch: self.switch,
            source,
            refinement,
            eye,
            keeping,
            first_is_to_come: whole_of_none.is_some(),
            track: trace.track("sets"),
            timing,
            steered,
            times: Times(clock),
            whole,
            light_after_ns: as_ns(light_after),
            frame_light_after_ns: as_ns(frame_light_after),
            packed,
            lit_of_set: (u64::MAX, 0),
            sets_per_second: display.rate.hz() / set_frames as f64,
            notes: notes.clone(),
            statistics: LiveStatistics { policy, rolls, showing, ..LiveStatistics::default() },
            pupil: None,
            focus: None,
            open: VecDeque::with_capacity(OPEN),
            medians: [None; 2],
            medians_at_ns: i64::MIN,
        };
        Ok(ContentSetup { running: ActiveContent::Live(Box::new(following)), schedule, idle, sub_frames })
    }
}

/// What makes engines with all that is on them, as often as it is called.
fn begin(
    colors: Vec<LiveColor>,
    policy: Policy,
    engines: EngineSource,
    field: Option<Field>,
    tables: Vec<Option<Arc<StartTable>>>,
) -> Begin {
    fn lock(engines: &Mutex<EngineSource>) -> MutexGuard<'_, EngineSource> {
        engines.lock().unwrap_or_else(PoisonError::into_inner)
    }
    let engines = Arc::new(Mutex::new(engines));
    Box::new(move || {
        let refiner =
            LiveRefiner::new(colors.clone(), policy, || lock(&engines).open())?.with_start_tables(tables.clone());
        let gpu = lock(&engines).gpu()?;
        let Some(field) = field.clone() else { return Ok((refiner, gpu)) };
        let more = Arc::clone(&engines);
        Ok((refiner.in_field(&colors, field, Box::new(move || lock(&more).open())), gpu))
    })
}
