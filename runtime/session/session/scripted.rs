//! Scripts an application, an eye and whole sessions in simulated time for tests.

use crate::gaze::{Estimator, Settings as GazeSettings};
use crate::present::{Rate, SECOND_NS};
use crate::session::feeds::refine::{Refinement, RefinementOptions};
use crate::session::feeds::sets::LiveSource;
use crate::session::frame_log::trace::Trace;
use crate::session::refinement::pupil_source::{PupilSource, Samples};
use crate::session::stage::*;
use crate::session::*;
use crate::trackers::simulated::{Settings as EyeSettings, SimulatedSource};
use crossbeam_utils::atomic::AtomicCell;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};
use std::time::Duration;

impl Scripted {
    /// Creates sets of this application, which are made on request, with a beginning every `period_ns`.
    pub(super) fn sets(
        &self,
        app: Application,
        watch: PupilSource,
        cost: Cost,
        period_ns: i64,
    ) -> (Refinement, LiveSource) {
        let policy = Policy { restart: f64::INFINITY, ..Policy::default() };
        let parts = self.begun();
        let options = RefinementOptions {
            clock: None,
            cost,
            watch,
            scenes: Some(Box::new(app)),
            journal: None,
            timing: Arc::new(AtomicCell::new(SetTiming::new(period_ns))),
            light_after: Duration::from_nanos(period_ns as u64 / 2),
            moments: refinement::moments::MotionCompensation::default(),
            steered: Arc::new(AtomicBool::new(true)),
            whole: Some(whole_eyebox(self.display.eyebox_min(), [0.0; 2])),
            direct: None,
            with_phases: true,
            again: Box::new(move || Ok((LiveRefiner::new(parts.clone(), policy, cpu)?, None))),
            pair: None,
            notes: frame_log::notes::Notes::default(),
            track: Trace::none().track("refine"),
        };
        Refinement::start(self.encoder(), options).unwrap()
    }

    /// Creates live content from this application for an eye that is `simulated:SEED`. Work takes the time of `cost`.
    pub(super) fn live(&self, app: Application, cost: Cost, seed: u64) -> Live {
        self.live_before(app, cost, EyeSettings { seed, ..EyeSettings::default() })
    }

    /// Creates the same live content for this eye.
    pub(super) fn live_before(&self, app: Application, cost: Cost, eye: EyeSettings) -> Live {
        let estimator = Estimator::new(GazeSettings::default(), None).unwrap();
        let tracking = Tracking::of_eye(eye, cost == Cost::Measured, estimator).unwrap();
        let engines: EngineOpener = Box::new(cpu);
        let mut live = Live::new(self.begun(), self.encoder(), engines, tracking);
        live.scenes = Some(Box::new(app));
        live.cost = cost;
        live
    }
}

/// Returns the samples of an eye as they arrive.
pub(super) fn samples(eye: EyeSettings) -> PupilSource {
    let source = SimulatedSource::starting(eye, false, 0).unwrap();
    let estimator = Estimator::new(GazeSettings::default(), None).unwrap();
    PupilSource::Samples(Box::new(Samples::new(Box::new(source), estimator, Arc::default())))
}

/// An application that supplies `per_second` frames per second while it is alive, except during stalls. Times are in
/// ns.
pub(super) struct Application {
    pub scenes: Vec<LiveColor>,
    pub per_second: i64,
    pub alive: Vec<[i64; 2]>,
    pub stalls: Vec<[i64; 2]>,
    /// The number of the last frame that was supplied.
    pub given: Option<u64>,
}

/// The frames of one life are numbered from a multiple of this.
const LIFE: u64 = 1 << 32;

impl Application {
    pub(super) fn new(stage: &Scripted, per_second: i64, alive: [i64; 2]) -> Self {
        // The scenes are shown in order and then in reverse.
        let scenes = (0..2 * stage.scenes.len().max(2) as u64 - 2).map(|i| stage.scene(i).clone()).collect();
        Self { scenes, per_second, alive: vec![alive], stalls: Vec::new(), given: None }
    }

    /// Returns the number of the newest frame that has arrived and its time of arrival. Returns `None` before the first
    /// frame, and an error without an application.
    pub(super) fn newest(&self, now_ns: i64) -> Result<Option<(u64, i64)>, ()> {
        let within = |span: &&[i64; 2], at: i64| (span[0]..span[1]).contains(&at);
        let life = self.alive.iter().position(|life| within(&life, now_ns)).ok_or(())?;
        let begun_ns = self.alive[life][0];
        let comes = |frame: i64| begun_ns + frame * SECOND_NS / self.per_second;
        let newest = (now_ns - begun_ns) * self.per_second / SECOND_NS;
        let came = (0..=newest).rev().find(|i| !self.stalls.iter().any(|stall| within(&stall, comes(*i))));
        Ok(came.map(|frame| (life as u64 * LIFE + frame as u64, comes(frame))))
    }
}

impl Scenes for Application {
    fn describe(&self) -> String {
        format!("{} frames a second", self.per_second)
    }

    fn next(&mut self, due: &Due) -> Result<Newest, SessionError> {
        let (number, arrived_ns) = match self.newest(due.now_ns) {
            Err(()) => return Ok(Newest::Late(FrameFreshness::ApplicationGone)),
            Ok(None) => return Ok(Newest::Same),
            Ok(Some(newest)) => newest,
        };
        if self.given.is_some_and(|given| given >= number) {
            let late = due.now_ns - arrived_ns > 3 * SECOND_NS / (2 * self.per_second);
            return Ok(if late { Newest::Late(FrameFreshness::ApplicationLate) } else { Newest::Same });
        }
        self.given = Some(number);
        let color = self.scenes[(number % LIFE) as usize % self.scenes.len()].clone();
        let (arrived_ns, shows_ns) = (Some(arrived_ns), Some(arrived_ns));
        Ok(Newest::New(SceneFrame {
            number,
            colors: Arc::new(vec![color]),
            arrived_ns,
            shows_ns,
            moment: None,
            piece: None,
        }))
    }

    fn begins_with_one(&self) -> bool {
        false
    }
}

/// A video frame that was shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ShownFrame {
    pub set: Option<u64>,
    pub video_frame: u64,
    pub checksum: u32,
    /// The time at which it lit up (ns).
    pub begins_ns: i64,
}

/// Returns the content that was shown, as the set, the video frame and its checksum, without the times of their light.
pub(super) fn content_of(frames: &[ShownFrame]) -> Vec<(Option<u64>, u64, u32)> {
    frames.iter().filter(|f| f.set.is_some()).map(|f| (f.set, f.video_frame, f.checksum)).collect()
}

/// Runs a whole session on a display of this rate, in simulated time if work has fixed costs. Returns its statistics
/// and every video frame.
pub(super) fn shown(live: Live, rate: u32, seconds: f64) -> (Statistics, Vec<ShownFrame>) {
    let simulated = live.cost != Cost::Measured || live.replay.is_some();
    let frames = Arc::new(Mutex::new(Vec::new()));
    let theirs = Arc::clone(&frames);
    let seen = move |frame: &PresentedFrame<'_>| {
        let checksum = crc32c::crc32c(frame.picture);
        let one = ShownFrame {
            set: frame.index,
            video_frame: frame.video_frame,
            checksum,
            begins_ns: frame.predicted_display_time_ns,
        };
        theirs.lock().unwrap().push(one);
    };
    let options = SessionOptions {
        display_rate: Some(Rate::new(rate, 1).unwrap()),
        duration: Some(Duration::from_secs_f64(seconds)),
        observer: Some(Box::new(seen)),
        ..SessionOptions::default()
    };
    let session = Session::start(live, Output::Memory { simulated, sink: None }, options).unwrap();
    while session.is_running() {
        std::thread::sleep(Duration::from_millis(2));
    }
    let ended = session.stop();
    ended.result.unwrap();
    let frames = frames.lock().unwrap().clone();
    (ended.statistics, frames)
}
