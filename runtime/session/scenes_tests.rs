//! Scenes that follow each other while they are refined, in simulated time: what is shown when, what it gains, and that it is the
//! same every time.

use super::player::SetSource;
use super::refine::{Refinement, RefinementOptions};
use super::tests::cpu;
use super::trace::Trace;
use super::watch::{Samples, Watch};
use super::*;
use crate::encode::Encoder;
use crate::engine::cpu::CpuEngine;
use crate::gaze::{Estimator, Settings as GazeSettings};
use crate::optics::{Color, Display, Padding, Pupil};
use crate::present::Rate;
use crate::scene::{self, Request};
use crate::solve::{Flow, Problem, Refiner, Settings, random_phases, solve};
use crate::trackers::simulated::{Eye, Settings as EyeSettings, SimulatedSource};
use crossbeam_utils::atomic::AtomicCell;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const PERIOD_NS: i64 = 16_666_667;
const COST: Cost = Cost::Fixed { step: Duration::from_millis(4), encode: Duration::from_millis(1) };
const EXPOSURE: f64 = 0.35;

fn display() -> Display {
    Display { height: 64, width: 64, ..Display::preset("planes8").unwrap() }
}

/// The still life, whose fruit has moved so far; no phases.
fn scene(shift: f64) -> SteeredColor {
    let request = Request { views: 5, ..Request::new(&DISPLAY, &[Color::Green]) };
    let field = scene::load(&format!("builtin:still-life?shift={shift}"), &request).unwrap();
    let problem = Problem::new(&field, Color::Green, &DISPLAY, Padding::default()).unwrap();
    SteeredColor { problem, phases: Vec::new(), exposure: EXPOSURE }
}

static DISPLAY: std::sync::LazyLock<Display> = std::sync::LazyLock::new(display);

/// An application that exists in simulated time: 30 frames a second from its beginning to its end, whose fruit goes to and fro.
struct Moving {
    frames: Vec<SteeredColor>,
    /// Alive between these times, ns.
    alive: [i64; 2],
    newest: Option<u64>,
    pupils: Arc<Mutex<Vec<bool>>>,
}

impl Moving {
    fn new(alive: [i64; 2]) -> Self {
        let frames = (0..4).map(|i| scene(f64::from(i) * 0.05)).collect();
        Self { frames, alive, newest: None, pupils: Arc::default() }
    }

    fn frame(&self, number: u64) -> &SteeredColor {
        let way = [0, 1, 2, 3, 2, 1];
        &self.frames[way[number as usize % way.len()]]
    }
}

impl Scenes for Moving {
    fn describe(&self) -> String {
        "moving".into()
    }

    fn next(&mut self, due: &Due) -> Result<Newest, SessionError> {
        self.pupils.lock().unwrap().push(due.tracked);
        if !(self.alive[0]..self.alive[1]).contains(&due.now_ns) {
            return Ok(Newest::Late(Supply::ApplicationGone));
        }
        let number = ((due.now_ns - self.alive[0]) * 30 / 1_000_000_000) as u64;
        if self.newest == Some(number) {
            return Ok(Newest::Same);
        }
        self.newest = Some(number);
        let arrived = self.alive[0] + number as i64 * 1_000_000_000 / 30;
        Ok(Newest::New(SceneFrame { number, colors: vec![self.frame(number).clone()], arrived_ns: Some(arrived) }))
    }

    fn begins_with_one(&self) -> bool {
        false
    }
}

fn first() -> Vec<SteeredColor> {
    vec![SteeredColor { phases: random_phases(8 * 64 * 64, 1), ..scene(0.0) }]
}

fn eye() -> EyeSettings {
    EyeSettings { fixation: [0.4, 0.6], pursuit: 0.0, blinks: 0.0, ..EyeSettings::default() }
}

fn samples() -> Samples {
    let source = SimulatedSource::starting(eye(), false, 0).unwrap();
    Samples::new(Box::new(source), Estimator::new(GazeSettings::default(), None).unwrap())
}

/// What an eye sees of phases, dB.
fn seen(phases: &[f32], exposure: f64, frame: &SteeredColor, pupil: Pupil) -> f64 {
    let engine = Box::new(CpuEngine::new());
    let steering = Policy::default().steering;
    let mut refiner = Refiner::new(frame.problem.clone(), phases, exposure, steering, engine).unwrap();
    refiner.look(&[pupil]).unwrap()[0].psnr(exposure)
}

/// Decibels at the true eye of every fifth set of a second, and steps; `tracked`, or over the whole eyebox.
fn shown(tracked: bool) -> Vec<(f64, u64, Pupil)> {
    let whole = whole_eyebox(DISPLAY.eyebox_min(), [0.0; 2]);
    let watch = if tracked { Watch::Samples(Box::new(samples())) } else { Watch::Nobody(whole) };
    let parts = first();
    let policy = Policy { restart: f64::INFINITY, ..Policy::default() };
    let again = move || Ok((Steerer::new(parts.clone(), policy, cpu)?, None));
    let moving = Moving::new([0, i64::MAX]);
    let options = RefinementOptions {
        clock: None,
        cost: COST,
        watch,
        scenes: Some(Box::new(Moving::new([0, i64::MAX]))),
        journal: None,
        timing: Arc::new(AtomicCell::new(SetTiming::new(PERIOD_NS))),
        light_after: Duration::from_nanos(PERIOD_NS as u64 / 2),
        steered: Arc::new(AtomicBool::new(true)),
        whole: Some(whole),
        direct: None,
        with_phases: true,
        again: Box::new(again),
        notes: notes::Notes::default(),
        track: Trace::none().track("refine"),
    };
    let encoder = Encoder::new(&DISPLAY, &[Color::Green], 8).unwrap();
    let (_refinement, mut source) = Refinement::start(encoder, options).unwrap();
    let mut eye = Eye::new(eye(), 0);
    let (mut all, mut newest) = (Vec::new(), None);
    for set in 1..=60i64 {
        let start_ns = set * PERIOD_NS;
        source.settle(0, start_ns).unwrap();
        source.show(0);
        let Some(made) = source.newly_shown() else { continue };
        let content = made.content.expect("a scene");
        if newest.replace(content) != Some(content) {
            assert!(start_ns - made.arrived_ns.unwrap() <= 2 * PERIOD_NS, "{set}: {:?}", made.arrived_ns);
        }
        if set % 5 == 0 && set > 10 {
            let truth = eye.at((start_ns + PERIOD_NS / 2) as u64);
            let [x, y] = truth.position;
            let pupil = Pupil { x, y, diameter: truth.diameter, depth: 0.0 };
            let phases = &made.phases.as_ref().unwrap()[0];
            all.push((seen(phases, EXPOSURE, moving.frame(content), pupil), content, pupil));
        }
    }
    assert!(all.len() >= 9, "{} sets", all.len());
    all
}

/// A live application with an eye tracker: at the eye 3 dB better than the same budget on the whole eyebox, and within 3 dB of
/// a hologram of the frame that was solved for the whole eyebox at leisure.
#[test]
fn live_content_is_refined_for_the_eye() {
    let (steered, whole) = (shown(true), shown(false));
    let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
    let db = |all: &[(f64, u64, Pupil)]| mean(&all.iter().map(|s| s.0).collect::<Vec<_>>());
    let moving = Moving::new([0, i64::MAX]);
    let settings = Settings { steps: 60, diameter: [2e-3, 8e-3], depth: [0.0; 2], ..Settings::default() };
    let leisure: Vec<(Vec<f32>, f64)> = moving
        .frames
        .iter()
        .map(|f| solve(&f.problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap())
        .map(|solution| (solution.phases, solution.exposure))
        .collect();
    let way = [0, 1, 2, 3, 2, 1];
    let at_leisure: Vec<f64> = steered
        .iter()
        .map(|(_, content, pupil)| {
            let (phases, exposure) = &leisure[way[*content as usize % 6]];
            seen(phases, *exposure, moving.frame(*content), *pupil)
        })
        .collect();
    let (steered, whole, leisure) = (db(&steered), db(&whole), mean(&at_leisure));
    assert!(
        steered > whole + 3.0 && steered > leisure - 3.0,
        "{steered:.1} steered, {whole:.1} whole, {leisure:.1} at leisure"
    );
}

/// A whole session on a simulated clock, of an application that comes late, goes and comes again: the idle picture until there is
/// something, then the last good picture; the account says so, and a second session shows the same bytes.
#[test]
fn a_session_of_live_content_is_accounted_for_and_is_the_same_again() {
    let once = || {
        let encoder = Encoder::new(&DISPLAY, &[Color::Green], 8).unwrap();
        let options = crate::trackers::Options { real_time: false, ..Default::default() };
        let estimator = Estimator::new(GazeSettings::default(), None).unwrap();
        let spec = "simulated:3".parse().unwrap();
        let tracking = Tracking::open(&spec, &options, estimator).unwrap();
        let engines: EngineOpener = Box::new(cpu);
        let mut live = Live::new(first(), encoder, engines, tracking);
        live.scenes = Some(Box::new(Moving::new([200_000_000, 600_000_000])));
        live.cost = COST;
        let bytes = Arc::new(Mutex::new(Vec::new()));
        let theirs = Arc::clone(&bytes);
        let seen = move |frame: &PresentedFrame<'_>| {
            theirs.lock().unwrap().push((frame.index, crc32c::crc32c(frame.picture)));
        };
        let options = SessionOptions {
            display_rate: Some(Rate::new(60, 1).unwrap()),
            duration: Some(Duration::from_millis(700)),
            observer: Some(Box::new(seen)),
            ..SessionOptions::default()
        };
        let session = Session::start(live, Output::Memory { simulated: true, sink: None }, options).unwrap();
        while session.is_running() {
            std::thread::sleep(Duration::from_millis(2));
        }
        let ended = session.stop();
        ended.result.unwrap();
        let bytes = bytes.lock().unwrap().clone();
        (ended.statistics, bytes)
    };
    let (statistics, bytes) = once();
    let live = statistics.live.as_ref().unwrap();
    let showing = live.showing.as_ref().unwrap();
    // 0.4 s at 30 a second: twelve frames, each of which is lit.
    assert!((11..=12).contains(&showing.shown), "{showing:?}");
    assert_eq!(
        (showing.scenes, showing.refused, showing.sets[Supply::New as usize]),
        (showing.shown, 0, showing.shown)
    );
    assert!(showing.sets[Supply::ApplicationGone as usize] >= 5, "{:?}", showing.sets);
    assert!(showing.arrival_to_light.percentile(1.0).unwrap() < 34.0);
    let account = statistics.report.account;
    assert_eq!(showing.sets.iter().sum::<u64>(), account.sets - account.idle_sets);
    assert!(account.idle_sets >= 10 && live.sets_new + live.sets_repeated == account.sets - account.idle_sets);
    let idle = bytes.iter().take_while(|b| b.0.is_none()).count();
    assert!(idle >= 10, "{idle} video frames of the idle picture");
    assert!(bytes[idle..].iter().all(|b| b.0.is_some()), "the picture stays");
    assert_eq!(once().1, bytes);
}
