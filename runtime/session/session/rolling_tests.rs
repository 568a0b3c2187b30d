//! Tests that rolling updates replace the oldest sub-frames in turn, and are as good as whole sets.

use crate::optics::Pupil;
use crate::present::{Clock, Offscreen, Rate, SECOND_NS, SimulatedClock};
use crate::session::feeds::sets::set_channel;
use crate::session::frame_log::trace::Trace;
use crate::session::playback::player::{Player, SetSource};
use crate::session::playback::scheduler::{Schedule, Scheduler, Start};
use crate::session::scenes_tests::seen;
use crate::session::scripted::{Application, content_of, samples, shown};
use crate::session::stage::*;
use crate::session::tests::made;
use crate::session::*;
use crate::solve::SplitMix;
use crate::trackers::simulated::{Eye, Settings as EyeSettings};
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

const SUB_FRAMES: i64 = 480;
/// The cost of steps and encoding at 128 x 128 pixels.
const COST: Cost = Cost::Fixed { step: Duration::from_micros(2000), encode: Duration::from_micros(300) };

fn arrival_to_light(statistics: &Statistics) -> f64 {
    let live = statistics.live.as_ref().unwrap();
    live.latency.of(Stage::ArrivalToLight).percentile(0.5).unwrap()
}

/// The time from the arrival of a sample to the middle of the first light that uses it is 6 ms on a display of 480
/// sub-frames per second. Whole sets take more than twice that time. Content is also lit a period of a set sooner.
#[test]
fn what_a_sample_says_is_lit_with_the_next_sub_frame() {
    let stage = Scripted::new("grey8", 32, 2);
    let once = |whole_sets| {
        let mut live = stage.live(Application::new(&stage, 30, [51_300_000, i64::MAX]), COST, 5);
        live.whole_sets = whole_sets;
        shown(live, 480, 2.0)
    };
    let ((rolling, frames), (whole, _)) = (once(false), once(true));
    let (rolled, held) = (arrival_to_light(&rolling), arrival_to_light(&whole));
    println!("{rolled:.2} ms rolling, {held:.2} ms in whole sets");
    assert!(rolled <= 6.0 && held > 2.0 * rolled, "{rolled} ms rolling, {held} ms in whole sets");
    let content =
        |s: &Statistics| s.live.as_ref().unwrap().showing.as_ref().unwrap().arrival_to_light.percentile(1.0).unwrap();
    println!("content after {:.2} ms at most, {:.2} ms in whole sets", content(&rolling), content(&whole));
    // The sum is a video frame until the scene is read, another one while a step of 2 ms runs, that step, encoding and
    // the decision.
    assert!(content(&rolling) <= 2.0 * 2.09 + 2.0 + 0.3 + 0.3, "{} ms", content(&rolling));
    assert!(content(&whole) <= 16.7 + 2.0 + 0.3 + 0.3, "{} ms", content(&whole));
    let live = rolling.live.as_ref().unwrap();
    assert!(live.rolls && !whole.live.as_ref().unwrap().rolls);
    let lit: Vec<u64> = frames.iter().filter(|f| f.set.is_some()).map(|f| f.video_frame).collect();
    assert!(lit.iter().enumerate().all(|(i, turn)| *turn == i as u64 % 8), "each in its turn");
    assert!(frames.windows(2).all(|two| two[0].set <= two[1].set), "the newest, never an older one again");
}

/// On a display of 1,440 sub-frames per second, with a device that takes a step within one of them, a sample is lit
/// within 3 ms of its arrival. Each sub-frame is counted once.
#[test]
fn a_sample_is_lit_within_three_milliseconds_at_1440_sub_frames_per_second() {
    const RATE: u32 = 1440;
    let stage = Scripted::new("grey8", 32, 2);
    let cost = Cost::Fixed { step: Duration::from_micros(600), encode: Duration::from_micros(50) };
    let live = stage.live(Application::new(&stage, 30, [51_300_000, i64::MAX]), cost, 5);
    let (statistics, frames) = shown(live, RATE, 2.0);
    let live = statistics.live.as_ref().unwrap();
    let of = |stage: Stage| [0.5, 0.99].map(|share| live.latency.of(stage).percentile(share).unwrap());
    let (light, age) = (of(Stage::ArrivalToLight), of(Stage::SampleAge));
    println!("arrival to light {light:?} ms, age of the sample at any light {age:?} ms");
    assert!(live.rolls && light[1] <= 3.0, "{light:?}");
    let lit: Vec<u64> = frames.iter().filter(|f| f.set.is_some()).map(|f| f.video_frame).collect();
    assert!(lit.iter().enumerate().all(|(i, turn)| *turn == i as u64 % 8), "each in its turn");
    assert_eq!(live.sub_frames.iter().sum::<u64>(), lit.len() as u64, "each is lit for the first time or again");
    assert_eq!(statistics.report.account.missed_presents, 0);
}

/// The picture of each video frame comes whole from the newest set, with the sub-frames whose turn it is, regardless of
/// when sets arrive.
#[test]
fn every_video_frame_is_the_newest_sets_in_its_turn() {
    let clock = Rc::new(SimulatedClock::default());
    let rate = Rate::new(480, 1).unwrap();
    let frames = encoder_of("grey8").frames();
    assert_eq!(frames.count(), 8);
    let (sender, mut source) = set_channel(&frames, 1, || Ok::<_, SessionError>(None)).unwrap();
    let schedule = Schedule {
        display_rate: rate,
        content_rate: rate,
        speed: Speed::ONE,
        set_frames: 8,
        rolls: true,
        start: Start::WhenReady { idle_sets: 3 },
        waits: false,
        keep_phase: false,
    };
    let mut presenter = Offscreen::new(Rc::clone(&clock) as Rc<dyn Clock>, rate, frames.frame_bytes());
    let dyn_clock = Rc::clone(&clock) as Rc<dyn Clock>;
    let mut player = Player::new(dyn_clock, Scheduler::new(schedule), frames.clone(), Trace::none().track("present"));
    let (mut noise, mut number, mut turn) = (SplitMix(3), 0, 0);
    for tick in 0..20_000 {
        // Between two video frames, no set, one or several arrive.
        while tick > 20 && noise.unit() < 0.4 {
            let mut set = made(&sender, number);
            let each = frames.frame_bytes();
            for (i, picture) in set.buffer.frames.bytes_mut().chunks_exact_mut(each).enumerate() {
                picture.fill(((number * 8 + i as u64) % 251) as u8);
            }
            sender.send(set);
            number += 1;
        }
        let content = number > 0;
        player
            .tick(&mut presenter, &mut source, &mut |frame| {
                assert_eq!(frame.index, number.checked_sub(1), "the newest");
                if content {
                    assert_eq!(frame.video_frame, turn % 8);
                    let byte = ((number - 1) * 8 + turn % 8) % 251;
                    assert!(frame.picture.iter().all(|b| u64::from(*b) == byte), "torn at {tick}");
                    turn += 1;
                }
                Ok(())
            })
            .unwrap();
    }
    let account = player.scheduler.account();
    assert_eq!((account.sets, account.video_frames, account.drops()), (20_000, 20_000, 0));
    let (news, repeats) = (source.news, source.repeats);
    assert_eq!(news + repeats.iter().sum::<u64>() + account.idle_sets, 20_000);
}

/// Returns the PSNR (dB) at the true eye of eight successive video frames, for rolling and for whole sets.
fn windows(stage: &Scripted, rolls: bool) -> Vec<f64> {
    let frame_ns = SECOND_NS / SUB_FRAMES;
    let decided_ns = if rolls { frame_ns } else { 8 * frame_ns };
    let eye = EyeSettings { fixation: [0.4, 0.6], pursuit: 0.0, blinks: 0.0, ..EyeSettings::default() };
    let app = Application::new(stage, 10, [0, i64::MAX]);
    let cost = Cost::Fixed { step: Duration::from_micros(1500), encode: Duration::from_micros(300) };
    let (_refinement, mut source) = stage.sets(app, samples(eye.clone()), cost, decided_ns);
    let mut eye = Eye::new(eye, 0);
    let pixels = stage.display.height * stage.display.width;
    let mut window: VecDeque<(usize, Arc<Vec<f32>>, u64)> = VecDeque::new();
    let mut newest: Option<(Arc<Vec<f32>>, u64)> = None;
    let mut all = Vec::new();
    for frame in 0..2 * SUB_FRAMES {
        let start_ns = (frame + 8) * frame_ns;
        if rolls || frame % 8 == 0 {
            source
                .settle(0, Target { start_ns, hand_over_ns: start_ns - frame_ns / 8, turn: frame as u64 % 8 })
                .unwrap();
            source.show(0);
            if let Some(set) = source.newly_shown() {
                newest = Some((Arc::clone(&set.phases.as_ref().unwrap()[0]), set.content.unwrap()));
            }
        }
        let Some((phases, content)) = &newest else { continue };
        window.push_back((frame as usize % 8, Arc::clone(phases), *content));
        if window.len() > 8 {
            window.pop_front();
        }
        // Between two scenes there is no target to compare with.
        let still = window.iter().all(|one| one.2 == *content);
        if frame > SUB_FRAMES / 2 && frame % 12 == 11 && still {
            let mut added = vec![0.0; 8 * pixels];
            for (at, phases, _) in &window {
                added[at * pixels..(at + 1) * pixels].copy_from_slice(&phases[at * pixels..(at + 1) * pixels]);
            }
            let truth = eye.at((start_ns - 3 * frame_ns) as u64);
            let [x, y] = truth.position;
            let pupil = Pupil { x, y, diameter: truth.diameter, depth: 0.0 };
            all.push(seen(&added, EXPOSURE, stage.scene(*content), pupil));
        }
    }
    assert!(all.len() > 20, "{} windows", all.len());
    all
}

/// Windows of rolling sets, whose sub-frames come from eight successive steps, are as good as whole sets with as much
/// work. The reason is that each sub-frame comes from phases that were refined together.
#[test]
fn rolling_windows_are_as_good_as_whole_sets() {
    let stage = Scripted::new("grey8", 64, 2);
    let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
    let (rolling, whole) = (mean(&windows(&stage, true)), mean(&windows(&stage, false)));
    println!("{rolling:.2} dB rolling, {whole:.2} dB in whole sets");
    assert!(rolling > whole - 0.3, "{rolling:.2} dB rolling, {whole:.2} dB in whole sets");
}

/// The recording of a session with rolling updates replays byte for byte.
#[test]
fn a_session_whose_sets_roll_is_the_same_again() {
    let stage = Scripted::new("grey8", 32, 2);
    let here = tempfile::tempdir().unwrap();
    let kept = here.path().join("kept");
    let mut app = Application::new(&stage, 24, [50_000_000, 300_000_000]);
    app.alive.push([350_000_000, i64::MAX]);
    let mut live = stage.live(app, COST, 9);
    live.journal = Some(kept.clone());
    let (_, first) = shown(live, 480, 0.6);
    let engines: EngineOpener = Box::new(cpu);
    let mut again = Live::new(stage.begun(), stage.encoder(), engines, None);
    // All sessions whose first scene arrives later have these settings.
    (again.replay, again.policy.restart) = (Some(kept), f64::INFINITY);
    let (_, second) = shown(again, 480, 10.0);
    let (first, second) = (content_of(&first), content_of(&second));
    assert!(first.len() > 200, "{}", first.len());
    assert_eq!(first.len(), second.len());
    assert!(first == second);
}
