//! Refines a hologram for the tracked pupil while it is shown.

use crate::encode::Encoder;
use crate::engine::{Backend, Engine, EngineError};
use crate::gpu::Gpu;
use crate::hologram::Hologram;
use crate::optics::{Display, PupilDistribution};
use crate::scene::LightField;
use crate::session::content::scenes::Scenes;
use crate::session::feeds::ContentSetup;
use crate::session::feeds::eye_content::EyeContent;
use crate::session::feeds::following::{FollowedEye, LiveState, OPEN};
use crate::session::feeds::journal::{Journal, JournalWriter, RecordedSession};
use crate::session::feeds::play::encoder_of;
use crate::session::feeds::refine::{Begin, Refinement, RefinementOptions};
use crate::session::feeds::replay::Replay;
use crate::session::feeds::showing::ContentReport;
use crate::session::feeds::sidecar::{SidecarOpener, SourceSwitch};
use crate::session::feeds::statistics::LiveStatistics;
use crate::session::feeds::tracking::Tracking;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::trace::Trace;
use crate::session::playback::output::OpenDisplay;
use crate::session::playback::scheduler::{Schedule, Start};
use crate::session::playback::timeline::Speed;
use crate::session::refinement::agreement::Member;
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
use crate::trackers::Stream;
use crossbeam_utils::atomic::AtomicCell;
use eyebox_base::reason;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Returns the pupils that are assumed without a tracker. They are anywhere in an eyebox of this side (m), have the
/// usual diameters of eyes, and focus between these depths (m).
pub fn whole_eyebox(eyebox: f64, focus: [f64; 2]) -> PupilDistribution {
    let [low, high] = PupilRange::usual_diameter(eyebox);
    let diameter = [low, high.min(WIDEST_PUPIL).max(low)];
    PupilDistribution { centre: [0.0; 2], spread: eyebox / 2.0, diameter, focus, elsewhere: 1.0 }
}

/// The widest pupil of an eye (m).
const WIDEST_PUPIL: f64 = 8e-3;

/// The source of the engines of a session.
#[non_exhaustive]
pub enum EngineSource {
    /// One backend supplies all engines, on the CPU or on a device that they share.
    Backend(Backend),
    /// This function opens each engine.
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

    /// Returns the device that the engines share, if there is one.
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

/// A hologram that is refined for the tracked pupil.
#[non_exhaustive]
pub struct Live {
    /// The colors that are refined. Each starts from the hologram for the whole eyebox.
    pub colors: Vec<LiveColor>,
    /// The encoder for the video frames of the display.
    pub encoder: Encoder,
    /// The source of an engine for each color. A lost engine is opened again. If the engines are on a device, sets are
    /// encoded there too, and the phases never come to the host.
    pub engines: EngineSource,
    /// The scenes, if the content changes while it is shown, or `None` for one hologram.
    pub scenes: Option<Box<dyn Scenes>>,
    /// The whole far field in tiles. The refined part is a piece of it, and `scenes` is its
    /// [`FarField`](crate::session::FarField).
    pub field: Option<Field>,
    /// The tables of first phases for content that jumps, as [`start_tables`](crate::session::start_tables) returns
    /// them. They are empty if no table is used.
    pub start_tables: Vec<Option<Arc<StartTable>>>,
    /// The tracked eye. If it is `None`, pupils are drawn from the whole eyebox.
    pub tracking: Option<Tracking>,
    /// The pupils that are assumed without a tracker.
    pub whole: PupilDistribution,
    /// True if sets are shown only whole, although the display takes several video frames for one. Otherwise updates
    /// roll. Each video frame then comes from the newest set, with the sub-frames whose turn it is.
    pub whole_sets: bool,
    /// True if each sub-frame is refined for its own time while the eye or the content moves (OPTICS 15).
    pub moments: bool,
    /// The time that work takes on a simulated clock.
    pub cost: Cost,
    /// A new folder for the journal of decisions and scenes, so that the session can be replayed.
    pub journal: Option<PathBuf>,
    /// The folder of a journal to replay on a simulated clock. The same sets are lit in the same order. All other
    /// settings have to be the same as in that session.
    pub replay: Option<PathBuf>,
    /// The policy of the refinement.
    pub policy: Policy,
    /// True if the hologram follows the pupil from the start.
    pub steered: bool,
    /// The time from the beginning of a video frame to its light.
    pub display_latency: Duration,
    /// The sidecar window next to the display.
    pub sidecar_window: Option<SidecarOpener>,
    /// The function that switches the sources of the display, if it has any.
    pub switch: Option<SourceSwitch>,
}

impl Live {
    /// Creates live content with all other settings at their defaults.
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

    /// Refines a hologram for the whole eyebox on a display for the scene `field` that it shows. All other settings
    /// have their defaults.
    ///
    /// # Errors
    /// Returns [`SessionError::Hologram`] if the hologram does not state its optics, and [`SessionError::Encode`].
    /// Returns [`SessionError::Setting`] if its size differs from the display, or the scene lacks one of its colors.
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

    /// Starts content that jumps, and the first frame of an application, with the phases of a table ([`StartTable`]).
    /// The table comes from the cache of the user, or is fitted now in seconds. `observe` receives the share that is
    /// fitted, and stops the fit if it returns false.
    ///
    /// # Errors
    /// Returns the errors of the fit.
    pub fn with_start_tables(mut self, observe: &mut dyn FnMut(f64) -> bool) -> Result<Self, SessionError> {
        self.start_tables = start_tables(&self.colors, observe)?;
        if self.scenes.as_ref().is_none_or(|scenes| !scenes.begins_with_one()) {
            begin_with_tables(&mut self.colors, &self.start_tables)?;
        }
        Ok(self)
    }

    /// Checks the settings before anything is opened.
    pub(crate) fn check(&self) -> Result<(), SessionError> {
        Ok(self.policy.steering.check()?)
    }

    /// Checks that the settings fit the clock of the display.
    fn check_clock(&self, is_real: bool) -> Result<(), SessionError> {
        let wrong = |why| Err(SessionError::Setting(why));
        if self.replay.is_some() {
            let alone = self.scenes.is_none() && self.tracking.is_none() && self.journal.is_none();
            return match !is_real && alone {
                true => Ok(()),
                false => wrong(reason!(
                    "replay-in-real-time",
                    "`replay`: it needs a simulated clock, without `tracker`, scenes and `journal`"
                )),
            };
        }
        match self.cost {
            Cost::Measured if !is_real => wrong(reason!(
                "no-step-time",
                "a simulated clock needs the time of a step: set `step_time`, or leave out `clock` simulated"
            )),
            Cost::Fixed { .. } if is_real => {
                wrong(reason!("step-time", "`step_time`: it applies only to a simulated clock"))
            }
            _ if self.tracking.as_ref().is_some_and(|tracking| tracking.real_time != is_real) => wrong(reason!(
                "no-eye",
                "`tracker`: a live hologram needs a tracker in real time, or on a simulated clock the simulated eye"
            )),
            _ => Ok(()),
        }
    }

    /// Starts tracking and refinement. `on_host` is true if the host needs the video frames too. `pair` is the place of
    /// this eye in an agreement with the other eye.
    pub(crate) fn start(
        self,
        display: &mut OpenDisplay,
        on_host: bool,
        steered: Arc<AtomicBool>,
        notes: &Notes,
        trace: Trace,
        pair: Option<Member>,
    ) -> Result<ContentSetup<EyeContent>, SessionError> {
        let clock = display.real_clock;
        self.check_clock(clock.is_some())?;
        let Self { colors, encoder, engines, field, tracking, mut policy, scenes, whole, whole_sets, cost, .. } = self;
        // If scenes bring no hologram for the whole eyebox, refinement cannot restart from one.
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
            waits: false,
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
        let beside =
            |open: SidecarOpener| open(&mut *display.desktop()?).map_err(|e| SessionError::SidecarWindow(e.into()));
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
                pair,
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
        Ok(ContentSetup { running: EyeContent::Live(Box::new(following)), schedule, idle, sub_frames })
    }
}

/// Returns a function that opens the engines with all of their data, each time it is called.
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
