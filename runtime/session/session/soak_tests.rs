//! Tests content at many rates on many displays, with stalls, saccades, blinks and applications that restart.
//!
//! No set is torn, and all statistics add up. `EYEBOX_SOAK=full` makes it ten minutes of simulated time for each, and a
//! minute on the real clock of a machine with full load on all cores.

use crate::present::SECOND_NS;
use crate::session::scripted::{Application, ShownFrame, shown};
use crate::session::stage::*;
use crate::session::*;
use crate::solve::SplitMix;
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// A packing, the rate of the display (Hz) and the video frames of a set.
const DISPLAYS: [(&str, u32, u64); 3] = [("planes8", 60, 1), ("planes8", 120, 1), ("grey8", 480, 8)];
const CONTENT: [i64; 6] = [10, 24, 30, 50, 60, 90];

/// Creates random lives and stalls of an application.
fn application(stage: &Scripted, per_second: i64, seconds: f64, noise: &mut SplitMix) -> Application {
    let mut span = |from_ns: i64, least: f64, most: f64| {
        let until = from_ns + ((least + (most - least) * noise.unit()) * 1e9) as i64;
        [from_ns, until]
    };
    let (mut alive, mut stalls) = (Vec::new(), Vec::new());
    let mut now_ns = 30_000_000;
    while (now_ns as f64) < seconds * 1e9 {
        let life = span(now_ns, 0.2, 0.8);
        // The first frame always arrives, and some later ones do not.
        let stall = span(life[0] + SECOND_NS / 8, 0.0, 0.3);
        now_ns = span(life[1], 0.0, 0.15)[1];
        alive.push(life);
        stalls.push(stall);
    }
    Application { alive, stalls, ..Application::new(stage, per_second, [0, 0]) }
}

/// Checks the sums that every session has to meet on any clock.
fn adds_up(statistics: &Statistics, frames: &[ShownFrame], set_frames: u64, what: &str) {
    let live = statistics.live.as_ref().unwrap();
    let (a, showing) = (&statistics.report.account, live.showing.as_ref().unwrap());
    let every = if live.rolls { 1 } else { set_frames };
    assert_eq!(a.due, a.shown + a.drops() + statistics.report.pending, "{what}");
    assert!((a.sets * every + a.missed_presents).abs_diff(a.video_frames) < every, "{what}: {a:?}");
    assert_eq!(a.video_frames - a.missed_presents, frames.len() as u64, "{what}");
    let content_sets = a.sets - a.idle_sets;
    assert_eq!(live.sets_new + live.sets_repeated, content_sets, "{what}");
    assert_eq!(live.repeats.iter().sum::<u64>(), live.sets_repeated, "{what}");
    assert_eq!(showing.sets.iter().sum::<u64>(), content_sets, "{what}: {showing:?}");
    assert_eq!((showing.sets[FrameFreshness::New as usize], showing.refused), (showing.shown, 0), "{what}");
    assert!(showing.scenes >= showing.shown, "{what}: {showing:?}");
    let lit = frames.iter().filter(|frame| frame.set.is_some()).count() as u64;
    assert_eq!(live.sub_frames.iter().sum::<u64>(), lit * 8 / set_frames, "{what}");
    assert!(live.sets_repeated > 0 || live.sub_frames[1] == 0, "{what}: {:?}", live.sub_frames);
    assert_eq!(live.latency.of(Stage::AllRefinement).count(), live.sets_new, "{what}");
}

/// Checks that long steps are the only cause of repeats in simulated time.
fn only_steps_are_too_long(statistics: &Statistics, what: &str) {
    let (live, a) = (statistics.live.as_ref().unwrap(), &statistics.report.account);
    assert_eq!(live.repeats[RepeatReason::StepTooLong as usize], live.sets_repeated, "{what}: {:?}", live.repeats);
    assert_eq!((a.drops(), a.missed_presents, a.late_sets), (0, 0, [0; 5]), "{what}");
}

/// Checks that the picture stays the same within a set, and that no older picture returns.
pub(super) fn nothing_is_torn(frames: &[ShownFrame], what: &str) {
    let mut seen = HashMap::new();
    for (i, frame) in frames.iter().enumerate() {
        let first = seen.entry((frame.set, frame.video_frame)).or_insert(frame.checksum);
        assert_eq!(*first, frame.checksum, "{what}: video frame {i}, {frame:?}");
    }
    assert!(frames.windows(2).all(|two| two[0].set <= two[1].set), "{what}");
}

/// Checks that the video frames of a set are lit equally often and in their order.
fn in_turn(frames: &[ShownFrame], set_frames: u64, what: &str) {
    let lit = frames.iter().filter(|frame| frame.set.is_some());
    for (i, frame) in lit.enumerate() {
        assert_eq!(frame.video_frame, i as u64 % set_frames, "{what}: video frame {i}");
    }
}

fn soak(seconds: f64, displays: &[(&str, u32, u64)], content: &[i64], seed: u64) {
    let mut noise = SplitMix(seed);
    for &(preset, rate, set_frames) in displays {
        let stage = Scripted::new(preset, 16, 3);
        for &per_second in content {
            let app = application(&stage, per_second, seconds, &mut noise);
            // Steps take between well within a set and several sets.
            let step = Duration::from_secs_f64((0.2 + 2.0 * noise.unit()) / f64::from(rate));
            let cost = Cost::Fixed { step, encode: step / 8 };
            let mut live = stage.live(app, cost, noise.0 % 1000);
            live.whole_sets = noise.unit() < 0.3;
            let what = format!("{per_second} a second on {preset} at {rate}, steps of {step:?}, {}", live.whole_sets);
            let (statistics, frames) = shown(live, rate, seconds);
            adds_up(&statistics, &frames, set_frames, &what);
            only_steps_are_too_long(&statistics, &what);
            nothing_is_torn(&frames, &what);
            in_turn(&frames, set_frames, &what);
            let showing = statistics.live.unwrap().showing.unwrap();
            assert!(showing.shown > 2, "{what}: {showing:?}");
        }
    }
}

pub(super) fn is_full() -> bool {
    std::env::var("EYEBOX_SOAK").is_ok_and(|soak| soak == "full")
}

/// A load on every core that ends when it is dropped.
struct Busy {
    over: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Busy {
    fn cores() -> Self {
        let over = Arc::new(AtomicBool::new(false));
        let work = |_| {
            let over = Arc::clone(&over);
            std::thread::spawn(move || {
                while !over.load(Ordering::Relaxed) {
                    std::hint::black_box((0..10_000u64).fold(0, |sum, i| sum ^ i));
                }
            })
        };
        let cores = std::thread::available_parallelism().map_or(2, usize::from);
        Self { threads: (0..cores).map(work).collect(), over }
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        self.threads.drain(..).for_each(|thread| drop(thread.join()));
    }
}

/// Runs the same on the real clock, with a load of as many threads as cores. Sets are late, presents are missed, and
/// the statistics count all of it.
#[test]
fn on_a_busy_machine_the_accounts_add_up() {
    let (mut noise, seconds) = (SplitMix(11), if is_full() { 20.0 } else { 0.8 });
    let _busy = Busy::cores();
    for (preset, rate, set_frames) in DISPLAYS {
        let stage = Scripted::new(preset, 16, 3);
        let per_second = CONTENT[(noise.unit() * CONTENT.len() as f64) as usize];
        let live = stage.live(application(&stage, per_second, seconds, &mut noise), Cost::Measured, noise.0 % 1000);
        let what = format!("{per_second} a second on {preset} at {rate}");
        let (statistics, frames) = shown(live, rate, seconds);
        adds_up(&statistics, &frames, set_frames, &what);
        nothing_is_torn(&frames, &what);
        in_turn(&frames, set_frames, &what);
        let (a, live) = (&statistics.report.account, statistics.live.as_ref().unwrap());
        println!(
            "{what}: {} video frames, {} presents missed, {} new sets, {} repeated, {} scenes shown",
            a.video_frames,
            a.missed_presents,
            live.sets_new,
            live.sets_repeated,
            live.showing.as_ref().unwrap().shown
        );
        assert!(live.sets_new > 0, "{what}: {a:?}");
    }
}

#[test]
fn whatever_an_application_does_the_accounts_add_up() {
    let full = is_full();
    let rounds = if full { 10 } else { 1 };
    for round in 0..rounds {
        soak(if full { 60.0 } else { 1.2 }, &DISPLAYS, &CONTENT, 7 + round);
    }
}
