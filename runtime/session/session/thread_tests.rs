//! Tests that a flood, a failure or an end of the tracking and refinement threads keeps the picture.

use crate::encode::Encoder;
use crate::engine::cpu::CpuEngine;
use crate::engine::{Backend, Choice, Engine, EngineError};
use crate::gaze::{Estimator, Settings as GazeSettings};
use crate::gpu::test_options::watched;
use crate::gpu::{Gpu, PixelOrder};
use crate::optics::{Color, Display};
use crate::present::{Clock, RealClock};
use crate::session::feeds::refine::{Refinement, RefinementOptions};
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::trace::Trace;
use crate::session::playback::player::SetSource;
use crate::session::playback::scheduler::{Content, Readiness};
use crate::session::refinement::pupil_source::PupilSource;
use crate::session::refinement::pupil_tracker::PupilTracker;
use crate::session::stage::{cpu, encoder, part};
use crate::session::*;
use crate::trackers::{
    About as TrackerAbout, Event, Quantity, Reading, Sample, Source, Stream, TrackerError, Unit, now_ns,
};
use crossbeam_utils::atomic::AtomicCell;
use eyebox_base::error::Reason;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// A tracker whose samples a test supplies.
struct Scripted(Box<dyn FnMut(u64) -> Option<Event> + Send>, u64);

impl Source for Scripted {
    fn about(&self) -> TrackerAbout {
        TrackerAbout { name: "scripted".into(), kind: "test", rate_hz: None, notes: Vec::new() }
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

/// Returns a sample with the latest possible time that arrives now.
fn late(received_ns: u64) -> Event {
    let mut sample = Sample::empty(received_ns);
    sample.time_ns = u64::MAX;
    sample.combined = Some(Reading::new(Quantity::Pupil, Unit::Metres, [0.0; 2]));
    Event::Sample(sample, None)
}

fn follow(notes: &Notes, script: impl FnMut(u64) -> Option<Event> + Send + 'static) -> PupilTracker {
    let stream = Stream::start(Box::new(Scripted(Box::new(script), 0))).unwrap();
    let estimator = Estimator::new(GazeSettings::default(), None).unwrap();
    PupilTracker::start(stream, estimator, Arc::default(), notes.clone(), Trace::none().track("gaze")).unwrap()
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
    let (start, notes) = (now_ns(), Notes::default());
    // The tracker sends good samples, then a flood of bad ones (NaN, jumps, time that goes backward), good ones again,
    // and ends.
    let tracker = follow(&notes, move |i| match i {
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
    let mut told = Vec::new();
    wait_for("the end of the tracker", || {
        told.extend(notes.take());
        told.iter().any(|n| n.contains("the picture stays"))
    });
    assert_eq!(told.iter().filter(|n| n.contains("over")).count(), 1, "one line: {told:?}");
    assert!((tracker.expect(start + 20_300_000_000).pupil.centre[0] - 2e-3).abs() < 1e-4, "it is believed again");
    for ahead in [0, 20_000_000, 3_600_000_000_000, u64::MAX - start] {
        let expected = tracker.expect(start + ahead);
        let pupil = expected.pupil;
        let all =
            [pupil.centre[0], pupil.centre[1], pupil.spread, pupil.elsewhere, pupil.diameter[0], pupil.diameter[1]];
        assert!(all.iter().all(|v| v.is_finite()), "{pupil:?}");
    }
}

#[test]
fn what_was_measured_is_looked_up_between_samples() {
    let (start, notes) = (now_ns(), Notes::default());
    let tracker = follow(&notes, move |i| match i {
        0..100 => Some(at(start + i * 4_000_000, [i as f64 * 1e-5, 0.0])),
        // This is a gap without measurements.
        100..110 => Some(at(start + 1_000_000_000 + i * 4_000_000, [0.0, 0.0])),
        _ => None,
    });
    wait_for("all samples", || tracker.reaches(start + 1_000_000_000 + 109 * 4_000_000));
    let place = tracker.measured(start + 10 * 4_000_000 + 1_000_000).unwrap();
    assert!((place[0] - 10.25e-5).abs() < 1e-12, "{place:?}");
    assert_eq!(tracker.measured(start + 700_000_000), None);
    assert_eq!(tracker.measured(start - 1), None);
    assert_eq!(tracker.measured(start + 100_000_000_000), None);
}

#[test]
fn the_thread_hands_over_refined_sets_and_ends_without_taking_the_picture() {
    let whole = part();
    let start = now_ns();
    let tracker =
        Arc::new(follow(&Notes::default(), move |i| (i < 100).then(|| at(start + i * 1_000_000, [1e-3, 0.0]))));
    let clock = RealClock::start();
    let timing = Arc::new(AtomicCell::new(SetTiming::new(16_666_667)));
    let options = options(tracker, clock, &timing, move || {
        Ok((LiveRefiner::new(vec![whole.clone()], Policy::default(), cpu)?, None))
    });
    let started_ns = clock.now_ns();
    let (mut refinement, mut source) = Refinement::start(encoder(), options).unwrap();
    source.poll(0).unwrap();
    assert_eq!(source.readiness(0), Readiness::Ready, "the first set is there at once");
    // The first set is not refined. Its encoding begins after the start, not at the zero of the clock.
    source.show(0);
    let first = source.newly_shown().unwrap();
    assert_eq!(first.steps, 0);
    let Timestamps { refine_start_ns, refine_end_ns, handed_over_ns, .. } = first.timestamps;
    assert!(started_ns <= refine_start_ns && refine_start_ns == refine_end_ns && refine_end_ns <= handed_over_ns);
    let mut steps = 0;
    wait_for("refined sets", || {
        timing.store(timing.load().after(clock.now_ns() + 2_000_000, clock.now_ns()));
        source.poll(0).unwrap();
        source.show(0);
        if let Some(made) = source.newly_shown() {
            steps += made.steps;
            assert!(made.phases.as_ref().is_some_and(|p| p.len() == 1 && p[0].iter().all(|v| v.is_finite())));
            assert!(made.timestamps.handed_over_ns >= made.timestamps.refine_end_ns);
            assert!(made.timestamps.refine_end_ns >= made.timestamps.aimed_ns);
        }
        steps > 3
    });
    assert!(refinement.is_running() && refinement.counts()[1] > 0);
    refinement.stop();
    source.poll(0).unwrap();
    assert!(source.on_screen().is_some());
}

/// Returns options for refinement at 60 Hz. `again` opens the engines again.
fn options(
    tracker: Arc<PupilTracker>,
    clock: RealClock,
    timing: &Arc<AtomicCell<SetTiming>>,
    again: impl FnMut() -> Result<(LiveRefiner, Option<Gpu>), SessionError> + Send + 'static,
) -> RefinementOptions {
    RefinementOptions {
        clock: Some(clock),
        cost: Cost::Measured,
        watch: PupilSource::Tracker(tracker),
        scenes: None,
        journal: None,
        whole: None,
        timing: Arc::clone(timing),
        light_after: Duration::from_millis(8),
        moments: refinement::moments::MotionCompensation::default(),
        steered: Arc::new(AtomicBool::new(true)),
        direct: None,
        with_phases: true,
        again: Box::new(again),
        pair: None,
        notes: Notes::default(),
        track: Trace::none().track("refine"),
    }
}

/// Creates an engine that is lost after `calls` calls.
fn failing(calls: usize) -> Box<dyn Engine> {
    let mut left = calls;
    let lost = move || {
        let lost = || EngineError::DeviceLost { device: "a test".into(), during: "compare".into() };
        left = left.checked_sub(1).ok_or_else(lost)?;
        Ok(())
    };
    Box::new(CpuEngine::watched(lost))
}

#[test]
fn an_engine_that_is_lost_is_made_anew_and_then_given_up() {
    let (whole, opened) = (part(), Arc::new(AtomicU64::new(0)));
    let count = Arc::clone(&opened);
    let short = move || {
        count.fetch_add(1, Ordering::Relaxed);
        let refiner = LiveRefiner::new(vec![whole.clone()], Policy::default(), || Ok(failing(4)))?;
        Ok((refiner, None))
    };
    let tracker = Arc::new(follow(&Notes::default(), |_| None));
    let clock = RealClock::start();
    let timing = Arc::new(AtomicCell::new(SetTiming::new(16_666_667)));
    let options = options(tracker, clock, &timing, short);
    let notes = options.notes.clone();
    let (refinement, mut source) = Refinement::start(encoder(), options).unwrap();
    wait_for("the end of the refinement", || {
        timing.store(timing.load().after(clock.now_ns() + 2_000_000, clock.now_ns()));
        source.poll(0).unwrap();
        source.show(0);
        !refinement.is_running()
    });
    let messages: Vec<String> = std::iter::from_fn(|| notes.take()).collect();
    // It starts again three times and then ends. Each note names the lost device.
    let lost = messages.iter().filter(|m| m.contains("a test")).count();
    assert_eq!((lost, opened.load(Ordering::Relaxed)), (4, 4), "three times anew: {messages:?}");
    assert!(source.on_screen().is_some());
}

/// Refines with engines of `again` until `done`, which receives the number of new sets since the start. Returns the
/// notes, and true if refinement still runs.
fn refines_until(
    again: impl FnMut() -> Result<(LiveRefiner, Option<Gpu>), SessionError> + Send + 'static,
    mut done: impl FnMut(u64, &[String]) -> bool,
) -> (Vec<String>, bool) {
    let tracker = Arc::new(follow(&Notes::default(), |_| None));
    let clock = RealClock::start();
    let timing = Arc::new(AtomicCell::new(SetTiming::new(16_666_667)));
    let options = options(tracker, clock, &timing, again);
    let notes = options.notes.clone();
    let (refinement, mut source) = Refinement::start(encoder(), options).unwrap();
    let (mut messages, mut sets) = (Vec::new(), 0);
    wait_for("what refinement does with lost engines", || {
        timing.store(timing.load().after(clock.now_ns() + 2_000_000, clock.now_ns()));
        source.poll(0).unwrap();
        source.show(0);
        sets += u64::from(source.newly_shown().is_some());
        messages.extend(std::iter::from_fn(|| notes.take()));
        done(sets, &messages) || !refinement.is_running()
    });
    (messages, refinement.is_running())
}

/// An engine that has worked may be lost again. The limit of three attempts is for one loss, not for the whole session.
#[test]
fn an_engine_that_has_worked_is_made_anew_any_number_of_times() {
    let (whole, lose) = (part(), Arc::new(AtomicBool::new(false)));
    let lost = Arc::clone(&lose);
    let again = move || {
        let lost = Arc::clone(&lost);
        let fails = move || match lost.swap(false, Ordering::Relaxed) {
            true => Err(EngineError::DeviceLost { device: "a test".into(), during: "compare".into() }),
            false => Ok(()),
        };
        let engine = move || Ok(Box::new(CpuEngine::watched(fails.clone())) as Box<dyn Engine>);
        Ok((LiveRefiner::new(vec![whole.clone()], Policy::default(), engine)?, None))
    };
    let (mut losses, mut since) = (0, 0);
    let (messages, runs) = refines_until(again, |sets, messages| {
        // Only sets of a working engine count, because the first set after a loss may be from before it.
        if messages.len() == losses && sets > since + 24 {
            if losses == 6 {
                return true;
            }
            (losses, since) = (losses + 1, sets);
            lose.store(true, Ordering::Relaxed);
        }
        since = if messages.len() < losses { sets } else { since };
        false
    });
    assert!(runs && messages.len() == 6, "{messages:?}");
}

/// Opening an engine again may fail for a while. It is tried three times, and the notes give the reason of the failure.
#[test]
fn a_failed_opening_is_tried_again_and_its_reason_is_said() {
    for fail in [1, 2, 3] {
        let (whole, opened) = (part(), Arc::new(AtomicU64::new(0)));
        let count = Arc::clone(&opened);
        let again = move || {
            let nth = count.fetch_add(1, Ordering::Relaxed);
            if (1..=fail).contains(&nth) {
                return Err(SessionError::Setting(Reason::new("no-device", format!("no device at attempt {nth}"))));
            }
            let engine = || Ok(if nth == 0 { failing(4) } else { Box::new(CpuEngine::new()) as Box<dyn Engine> });
            Ok((LiveRefiner::new(vec![whole.clone()], Policy::default(), engine)?, None))
        };
        // The message of an end comes just before the end.
        let ends = fail == 3;
        let (messages, runs) = refines_until(again, |_, messages| !messages.is_empty() && !ends);
        assert_eq!((runs, opened.load(Ordering::Relaxed)), (fail < 3, 4.min(fail + 2)), "{messages:?}");
        assert!((1..=fail).all(|n| messages[0].contains(&format!("attempt {n}"))), "{messages:?}");
    }
}

/// Engines of three colors and the encoder share a device. Sets come from phases that are never read back, and a
/// display that shows from there reads nothing back.
#[test]
fn on_one_device_phases_never_come_to_the_host() {
    [None, Some(PixelOrder::Bgra)].into_iter().for_each(refines_on_one_device);
}

fn refines_on_one_device(direct: Option<PixelOrder>) {
    let (colors, gpu_options) = (vec![part(); 3], watched());
    let backend = Backend::open(Choice::Vulkan, &gpu_options).unwrap();
    let gpu = backend.gpu().unwrap().expect("a device");
    let display = Display { height: 96, width: 112, ..Display::preset("planes24").unwrap() };
    let encoder = Encoder::new(&display, &[Color::Red, Color::Green, Color::Blue], 8).unwrap();
    let start = now_ns();
    let tracker = follow(&Notes::default(), move |i| (i < 100).then(|| at(start + i * 1_000_000, [1e-3, 0.0])));
    let clock = RealClock::start();
    let timing = Arc::new(AtomicCell::new(SetTiming::new(16_666_667)));
    let again = move || {
        let refiner = LiveRefiner::new(colors.clone(), Policy::default(), || backend.engine())?;
        Ok((refiner, backend.gpu()?))
    };
    let options = RefinementOptions { direct, with_phases: false, ..options(Arc::new(tracker), clock, &timing, again) };
    let (mut refinement, mut source) = Refinement::start(encoder, options).unwrap();
    let mut sets = 0;
    wait_for("refined sets", || {
        timing.store(timing.load().after(clock.now_ns() + 2_000_000, clock.now_ns()));
        source.poll(0).unwrap();
        source.show(0);
        sets += u32::from(source.newly_shown().is_some_and(|set| set.steps > 0));
        sets > 2
    });
    assert!(refinement.is_running());
    refinement.stop();
    let counts = gpu.counts();
    assert_eq!((counts.read_back == 0, source.pictures().is_some()), (direct.is_some(), direct.is_some()));
    assert_eq!(counts.phases_read_back, 0);
    let messages = gpu.messages();
    drop((refinement, source, gpu));
    assert_eq!(*messages.lock().unwrap(), Vec::<String>::new());
}
