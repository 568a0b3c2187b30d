//! Tests of the room: what is handed over, when it begins again, and ten minutes of a refinement that is often late.

use super::*;
use crate::encode::Encoder;
use crate::engine::cpu::CpuEngine;
use crate::engine::{Engine, EngineError};
use crate::gaze::{Estimator, Settings as GazeSettings};
use crate::optics::{Color, Display, Padding};
use crate::playback::{Content, Player, Readiness, Schedule, Scheduler, Source as _, Speed, Start, Trace};
use crate::present::{Clock, Offscreen, Rate, RealClock, SimulatedClock};
use crate::scene::{self, Pyramid, Request};
use crate::solve::{Flow, Problem, Settings, SplitMix, solve};
use crate::trackers::{About, Event, Quantity, Reading, Sample, Source, Stream, TrackerError, Unit, now_ns};
use std::cell::RefCell;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// A hologram of the still life for the whole eyebox.
fn part() -> Part {
    let display = Display { height: 96, width: 112, ..Display::preset("small").unwrap() };
    let field = scene::load("builtin:still-life", &Request::new(&display, &[Color::Green])).unwrap();
    let problem = Problem::new(&field, Color::Green, &display, Padding::default()).unwrap();
    let settings = Settings { steps: 24, diameter: [2e-3, 18e-3], depth: [-5e-4, 5e-4], ..Settings::default() };
    let solution = solve(&problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap();
    Part { problem, phases: solution.phases, exposure: solution.exposure }
}

fn cpu() -> Result<Box<dyn Engine>, EngineError> {
    Ok(Box::new(CpuEngine::new()))
}

fn encoder() -> Encoder {
    let display = Display { height: 96, width: 112, ..Display::preset("planes8").unwrap() };
    Encoder::new(&display, &[Color::Green], 8).unwrap()
}

fn aim(x: f64) -> PupilDistribution {
    let diameter = [3.8e-3, 4.2e-3];
    PupilDistribution { centre: [x, 0.0], spread: 1e-4, diameter, focus: [0.0, 0.0], elsewhere: 0.0 }
}

fn soon() -> Instant {
    Instant::now() + Duration::from_secs(600)
}

#[test]
fn a_jump_begins_again_and_a_drift_does_not() {
    let whole = part();
    let steerer = |restart| {
        let policy = Policy { restart, ..Policy::default() };
        let mut steerer = Steerer::new(vec![whole.clone(), whole.clone()], policy, cpu).unwrap();
        assert!(!steerer.aim(aim(0.0)).unwrap(), "the first aim is no jump");
        assert_eq!(steerer.round_until(soon()).unwrap(), 2, "one step of each colour");
        steerer
    };
    let mut restarts = steerer(0.5);
    assert!(restarts.phases().unwrap().iter().all(|p| **p != whole.phases));
    assert!(!restarts.aim(aim(1.9e-3)).unwrap(), "less than half a diameter");
    assert!(!restarts.aim(aim(3.8e-3)).unwrap(), "a pursuit is no jump, however far it goes");
    assert!(restarts.phases().unwrap().iter().all(|p| **p != whole.phases));
    assert!(restarts.aim(aim(-1e-3)).unwrap());
    assert!(restarts.phases().unwrap().iter().all(|p| **p == whole.phases));
    assert_eq!(restarts.counts(), [1, 2]);
    let mut never = steerer(f64::INFINITY);
    assert!(!never.aim(aim(9e-3)).unwrap());
    assert!(never.phases().unwrap().iter().all(|p| **p != whole.phases));
}

#[test]
fn no_step_is_begun_that_would_end_too_late() {
    let mut steerer = Steerer::new(vec![part()], Policy::default(), cpu).unwrap();
    steerer.aim(aim(0.0)).unwrap();
    steerer.round_until(soon()).unwrap();
    assert!(steerer.round() > Duration::ZERO);
    assert_eq!(steerer.round_until(Instant::now()).unwrap(), 0);
    assert!(Steerer::new(Vec::new(), Policy::default(), cpu).is_err());
    let policy = Policy { restart: f64::NAN, ..Policy::default() };
    assert!(Steerer::new(vec![part()], policy, cpu).is_err());
}

/// With no clock in it but the work's: on any machine the eye sees better after a while, and every set is judged.
#[test]
fn a_simulated_eye_sees_better_when_steered() {
    let settings = StudySettings { seconds: 1.2, ..StudySettings::default() };
    let mut shares = Vec::new();
    let mut seen = Vec::new();
    let whole = part();
    let parts = [whole.clone()];
    let result = study(&parts, &Policy::default(), &encoder(), &settings, &mut cpu, &mut |moment, phases, share| {
        assert_eq!(phases.len(), 1);
        seen.push((moment.new, phases[0] == whole.phases));
        shares.push(share);
        true
    })
    .unwrap();
    let sets = (settings.seconds * 1e9 / settings.period_ns as f64) as usize;
    assert!(result.moments.len().abs_diff(sets) <= 1, "{} of {sets}", result.moments.len());
    assert!(shares.windows(2).all(|w| w[0] < w[1]) && shares.iter().all(|s| (0.0..=1.1).contains(s)));
    let refined = seen.iter().position(|s| s.0).expect("a new set");
    assert!(seen[..refined].iter().all(|s| s.1), "until then it is the hologram for the whole eyebox");
    assert!(seen[refined..].iter().all(|s| !s.1), "and from then on it is not");
    assert!(seen.iter().any(|s| s.0) && result.steps > 0);
    let landed: Vec<&Moment> =
        result.moments.iter().filter(|m| m.since_landing_ms.is_some_and(|t| t > 150.0)).collect();
    assert!(!landed.is_empty());
    let gain = landed.iter().map(|m| m.gain_db()).sum::<f64>() / landed.len() as f64;
    let error = landed.iter().filter_map(|m| m.error).fold(0.0, f64::max);
    assert!(gain > 0.5 && error < 0.5e-3, "{gain} dB, {error} m");
    // What ends it early leaves what there is.
    let few = study(&parts, &Policy::default(), &encoder(), &settings, &mut cpu, &mut |_, _, share| share < 0.3);
    assert!((1..sets / 2).contains(&few.unwrap().moments.len()));
    let wrong = StudySettings { period_ns: 0, ..settings };
    assert!(study(&parts, &Policy::default(), &encoder(), &wrong, &mut cpu, &mut |_, _, _| true).is_err());
}

fn made(giver: &Giver, number: u64) -> Made {
    let mut frames = giver.buffer().expect("there is always a buffer");
    // Every byte says which set it is of.
    frames.bytes_mut().fill((number % 251) as u8);
    Made { number, frames, stamps: Stamps::default(), pupil: [0.0; 2], steps: 1, phases: None }
}

#[test]
fn the_newest_set_wins_and_buffers_go_round() {
    let (giver, mut source) = handover(&encoder().frames());
    assert_eq!(source.readiness(0), Readiness::Unread);
    for number in 0..100 {
        giver.give(made(&giver, number));
        if number % 7 == 0 {
            source.poll(0).unwrap();
        }
        if number % 10 == 9 {
            source.poll(0).unwrap();
            source.show(number);
            assert_eq!(source.on_screen().map(|s| s.1), Some(number));
            assert_eq!(source.newly_shown().map(|m| m.number), Some(number));
            assert!(source.newly_shown().is_none(), "told once");
        }
    }
    // Nothing new: the last one stays, and is counted.
    source.show(1000);
    assert_eq!((source.on_screen().map(|s| s.1), source.counts()), (Some(99), [10, 1]));
    // Who made it is gone: the picture stays.
    drop(giver);
    source.poll(0).unwrap();
    assert_eq!(source.readiness(7), Readiness::Ready);
}

/// A refinement in simulated time: it aims for the next set that it expects to reach, and takes as long as it likes.
struct Simulated {
    clock: Rc<SimulatedClock>,
    giver: Giver,
    beat: Rc<BeatCell>,
    ready_ns: i64,
    number: u64,
    noise: SplitMix,
}

impl Simulated {
    /// What would have been handed over by now.
    fn pass(&mut self) {
        while self.ready_ns <= self.clock.now_ns() {
            self.giver.give(made(&self.giver, self.number));
            self.number += 1;
            let now = self.ready_ns;
            let estimate = 4_000_000;
            let target = self.beat.get().reachable(now, estimate);
            // One in twenty takes ten times its estimate, after all the time there was had been used.
            let late = self.noise.unit() < 0.05;
            let took = target.hand_over_ns.max(now) - now + if late { 10 * estimate } else { 0 };
            self.ready_ns = now + took.max(estimate);
        }
    }
}

/// A source whose sets come from a refinement in the same simulated time.
struct Follows<'a>(&'a mut LiveSource, &'a RefCell<Simulated>);

impl Content for Follows<'_> {
    fn readiness(&self, position: u64) -> Readiness {
        self.0.readiness(position)
    }

    fn end(&self) -> Option<u64> {
        self.0.end()
    }
}

impl crate::playback::Source for Follows<'_> {
    fn poll(&mut self, useful_from: u64) -> Result<(), crate::playback::PlaybackError> {
        self.1.borrow_mut().pass();
        self.0.poll(useful_from)
    }

    fn settle(&mut self, position: u64) -> Result<(), crate::playback::PlaybackError> {
        self.0.settle(position)
    }

    fn show(&mut self, position: u64) {
        self.0.show(position);
    }

    fn on_screen(&self) -> Option<(&crate::encode::VideoFrames, u64)> {
        self.0.on_screen()
    }

    fn seek(&mut self, index: u64) {
        self.0.seek(index);
    }

    fn message(&mut self) -> Option<String> {
        self.0.message()
    }
}

#[test]
fn in_ten_minutes_no_set_is_late_because_of_refinement() {
    let clock = Rc::new(SimulatedClock::default());
    let rate = Rate::new(60, 1).unwrap();
    let frames = encoder().frames();
    let (giver, mut source) = handover(&frames);
    let beat = Rc::new(BeatCell::new(rate.period_ns(), 3_000_000));
    let simulated = RefCell::new(Simulated {
        clock: Rc::clone(&clock),
        giver,
        beat: Rc::clone(&beat),
        ready_ns: 0,
        number: 0,
        noise: SplitMix(9),
    });
    let schedule = Schedule {
        display_rate: rate,
        content_rate: rate,
        speed: Speed::new(1.0).unwrap(),
        set_frames: 1,
        start: Start::WhenReady { idle_sets: 4 },
        keep_phase: false,
    };
    let mut presenter = Offscreen::new(Rc::clone(&clock) as Rc<dyn Clock>, rate, frames.frame_bytes());
    let idle = frames.clone();
    let dyn_clock = Rc::clone(&clock) as Rc<dyn Clock>;
    let mut player = Player::new(dyn_clock, Scheduler::new(schedule), idle, Trace::new(0).lane("present"));
    let (mut last, mut news) = (0, 0u64);
    let ten_minutes = 600 * 1_000_000_000;
    while clock.now_ns() < ten_minutes {
        let asked = clock.now_ns();
        let mut began = None;
        player
            .tick(&mut presenter, &mut Follows(&mut source, &simulated), &mut |moment| {
                began = Some(moment.predicted_display_time_ns);
                if let Some(number) = moment.index {
                    assert!(moment.picture.iter().all(|b| u64::from(*b) == number % 251), "torn at {asked}");
                    assert!(number >= last, "{number} after {last}");
                    news += u64::from(number > last);
                    last = number;
                }
                Ok(())
            })
            .unwrap();
        let decided = clock.now_ns().min(began.unwrap_or(0) - 2_000_000);
        beat.decided(began.unwrap_or(0), decided);
    }
    let account = player.scheduler().account();
    assert_eq!(account.late_sets, [0; 5]);
    assert_eq!((account.drops(), account.missed_presents), (0, 0));
    assert!(account.sets.abs_diff(36_000) <= 2, "{} sets", account.sets);
    // Of twenty, one takes three periods: the others are all new.
    let share = news as f64 / account.sets as f64;
    assert!((0.8..0.95).contains(&share), "{share} of the sets were new");
}

/// A tracker that says what a test wants.
struct Scripted(Box<dyn FnMut(u64) -> Option<Event> + Send>, u64);

impl Source for Scripted {
    fn about(&self) -> About {
        About { name: "scripted".into(), kind: "test", rate_hz: None, notes: Vec::new() }
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        self.1 += 1;
        match (self.0)(self.1 - 1) {
            Some(event) => Ok(event),
            None => {
                std::thread::sleep(timeout.min(Duration::from_millis(2)));
                Ok(Event::Nothing)
            }
        }
    }
}

fn at(time_ns: u64, position: [f64; 2]) -> Event {
    let mut sample = Sample::empty(time_ns.saturating_add(1_000_000));
    sample.time_ns = time_ns;
    sample.combined = Some(Reading::new(Quantity::Pupil, Unit::Metres, position));
    Event::Sample(sample, None)
}

/// A sample from the end of all time, which arrives now.
fn late(received_ns: u64) -> Event {
    let mut sample = Sample::empty(received_ns);
    sample.time_ns = u64::MAX;
    sample.combined = Some(Reading::new(Quantity::Pupil, Unit::Metres, [0.0; 2]));
    Event::Sample(sample, None)
}

fn watch(script: impl FnMut(u64) -> Option<Event> + Send + 'static) -> Watch {
    let stream = Stream::start(Box::new(Scripted(Box::new(script), 0))).unwrap();
    let estimator = Estimator::new(GazeSettings::default(), None).unwrap();
    Watch::start(stream, estimator, Trace::new(0).lane("gaze")).unwrap()
}

fn wait_for(what: &str, mut done: impl FnMut() -> bool) {
    let until = Instant::now() + Duration::from_secs(60);
    while !done() {
        assert!(Instant::now() < until, "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn a_tracker_that_floods_lies_and_ends_takes_nothing_away() {
    let start = now_ns();
    // Some sense, a flood of nonsense (NaN, jumps, time going backwards), some sense, the end.
    let watch = watch(move |i| match i {
        0..200 => Some(at(start + i * 1_000_000, [1e-3, -1e-3])),
        200..20_000 => Some(match i % 4 {
            0 => at(start + 200_000_000, [f64::NAN, f64::INFINITY]),
            1 => at(start.saturating_sub(i * 1_000_000), [5e-3, 5e-3]),
            2 => at(start + 200_000_000 + i, [1e9, -1e9]),
            _ => late(start + 200_000_000 + i),
        }),
        20_000..20_300 => Some(at(start + i * 1_000_000, [2e-3, 1e-3])),
        20_300 => Some(Event::End),
        _ => None,
    });
    wait_for("the end of the tracker", || watch.status().ended);
    let mut notes = Vec::new();
    wait_for("its last words", || {
        notes.extend(watch.note());
        notes.iter().any(|n| n.contains("the picture stays"))
    });
    assert_eq!(notes.iter().filter(|n| n.contains("over")).count(), 1, "one line: {notes:?}");
    assert!((watch.expect(start + 20_300_000_000).pupil.centre[0] - 2e-3).abs() < 1e-4, "it is believed again");
    for ahead in [0, 20_000_000, 3_600_000_000_000, u64::MAX - start] {
        let expected = watch.expect(start + ahead);
        let aim = aim_of(&expected.pupil);
        let all = [aim.centre[0], aim.centre[1], aim.spread, aim.elsewhere, aim.diameter[0], aim.diameter[1]];
        assert!(all.iter().all(|v| v.is_finite()) && aim.spread > 0.0, "{aim:?}");
    }
}

#[test]
fn what_was_measured_is_looked_up_between_samples() {
    let start = now_ns();
    let watch = watch(move |i| match i {
        0..100 => Some(at(start + i * 4_000_000, [i as f64 * 1e-5, 0.0])),
        // A gap, in which nothing is known.
        100..110 => Some(at(start + 1_000_000_000 + i * 4_000_000, [0.0, 0.0])),
        _ => None,
    });
    wait_for("all samples", || watch.reaches(start + 1_000_000_000 + 109 * 4_000_000));
    let place = watch.measured(start + 10 * 4_000_000 + 1_000_000).unwrap();
    assert!((place[0] - 10.25e-5).abs() < 1e-12, "{place:?}");
    assert_eq!(watch.measured(start + 700_000_000), None);
    assert_eq!(watch.measured(start - 1), None);
    assert_eq!(watch.measured(start + 100_000_000_000), None);
}

#[test]
fn the_thread_hands_over_refined_sets_and_ends_without_taking_the_picture() {
    let whole = part();
    let steerer = Steerer::new(vec![whole.clone()], Policy::default(), cpu).unwrap();
    let start = now_ns();
    let watch = std::sync::Arc::new(watch(move |i| (i < 100).then(|| at(start + i * 1_000_000, [1e-3, 0.0]))));
    let clock = RealClock::start();
    let beat = std::sync::Arc::new(BeatCell::new(16_666_667, 2_000_000));
    let options = options(clock, &beat, move || Steerer::new(vec![whole.clone()], Policy::default(), cpu));
    let (live, mut source) = start_live(steerer, std::sync::Arc::clone(&watch), options);
    source.poll(0).unwrap();
    assert_eq!(source.readiness(0), Readiness::Ready, "the first set is there at once");
    let mut steps = 0;
    wait_for("refined sets", || {
        beat.decided(clock.now_ns() + 2_000_000, clock.now_ns());
        source.poll(0).unwrap();
        source.show(0);
        if let Some(made) = source.newly_shown() {
            steps += made.steps;
            assert!(made.phases.as_ref().is_some_and(|p| p.len() == 1 && p[0].iter().all(|v| v.is_finite())));
            assert!(made.stamps.handed_over_ns >= made.stamps.refine_end_ns);
            assert!(made.stamps.refine_end_ns >= made.stamps.aimed_ns);
        }
        steps > 3
    });
    assert!(live.is_running() && live.is_steered() && live.counts()[1] > 0);
    live.stop();
    source.poll(0).unwrap();
    assert!(source.on_screen().is_some());
}

/// Steered, at 60 Hz; `again` makes the engines anew.
fn options(
    clock: RealClock,
    beat: &std::sync::Arc<BeatCell>,
    again: impl FnMut() -> Result<Steerer, LiveError> + Send + 'static,
) -> LiveOptions {
    LiveOptions {
        clock,
        beat: std::sync::Arc::clone(beat),
        light_after: Duration::from_millis(8),
        steered: true,
        with_phases: true,
        again: Box::new(again),
        lane: Trace::new(0).lane("refine"),
    }
}

fn start_live(steerer: Steerer, watch: std::sync::Arc<Watch>, options: LiveOptions) -> (Live, LiveSource) {
    super::start(steerer, encoder(), watch, options).unwrap()
}

/// An engine that is lost after so many calls.
struct Fails(Box<dyn Engine>, usize);

impl Engine for Fails {
    fn describe(&self) -> String {
        self.0.describe()
    }

    fn load(&mut self, shape: &crate::plan::Shape, views: Option<std::sync::Arc<Pyramid>>) -> Result<(), EngineError> {
        self.0.load(shape, views)
    }

    fn write(&mut self, buffer: crate::engine::Buffer, data: &[f32]) -> Result<(), EngineError> {
        self.0.write(buffer, data)
    }

    fn read(&mut self, buffer: crate::engine::Buffer) -> Result<Vec<f32>, EngineError> {
        self.0.read(buffer)
    }

    fn run_part(&mut self, step: &crate::plan::Step, part: std::ops::Range<usize>) -> Result<Vec<f64>, EngineError> {
        if self.1 == 0 {
            return Err(EngineError::DeviceLost { device: "a test".into(), during: "compare".into() });
        }
        self.1 -= 1;
        self.0.run_part(step, part)
    }

    fn timings(&self) -> Vec<crate::engine::Timing> {
        self.0.timings()
    }

    fn reset_timings(&mut self) {
        self.0.reset_timings();
    }
}

#[test]
fn an_engine_that_is_lost_is_made_anew_and_then_given_up() {
    let whole = part();
    let short = move || Steerer::new(vec![whole.clone()], Policy::default(), || Ok(Box::new(Fails(cpu()?, 4)) as _));
    let steerer = short().unwrap();
    let watch = std::sync::Arc::new(watch(|_| None));
    let clock = RealClock::start();
    let beat = std::sync::Arc::new(BeatCell::new(16_666_667, 2_000_000));
    let options = options(clock, &beat, short);
    let (live, mut source) = start_live(steerer, watch, options);
    let mut messages = Vec::new();
    wait_for("the end of the refinement", || {
        beat.decided(clock.now_ns() + 2_000_000, clock.now_ns());
        source.poll(0).unwrap();
        source.show(0);
        messages.extend(source.message());
        !live.is_running()
    });
    messages.extend(std::iter::from_fn(|| source.message()));
    let anew = messages.iter().filter(|m| m.contains("anew") && m.contains("a test was lost")).count();
    assert!(anew >= 2 && messages.last().is_some_and(|m| m.contains("the picture stays")), "{messages:?}");
    assert!(source.on_screen().is_some());
}
