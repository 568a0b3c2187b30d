//! Tests that both eyes are lit in the same video frame, and that one failing eye leaves the other one's picture.

use crate::encode::Encoder;
use crate::gaze::{Estimator, Eye, Eyepiece, Settings as GazeSettings};
use crate::hologram::{ColorHologram, Hologram, SequenceWriter};
use crate::optics::{Color, Display, Panels, Stereo};
use crate::present::Rate;
use crate::session::stage::*;
use crate::session::*;
use crate::solve::random_phases;
use crate::trackers::{Options, Spec};
use eyebox_base::error::ErrorData;
use eyebox_base::reason;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A video frame of both eyes, with a checksum of each half.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Lit {
    index: Option<u64>,
    halves: [u32; 2],
}

/// Runs a session of two eyes whose panels are one below the other. Returns its end and its video frames.
fn run(both: TwoEyed, simulated: bool, seconds: f64) -> (Ended, Vec<Lit>) {
    let frames = Arc::new(Mutex::new(Vec::new()));
    let theirs = Arc::clone(&frames);
    let observer = move |frame: &PresentedFrame<'_>| {
        let (left, right) = frame.picture.split_at(frame.picture.len() / 2);
        theirs.lock().unwrap().push(Lit { index: frame.index, halves: [left, right].map(crc32c::crc32c) });
    };
    let options = SessionOptions {
        display_rate: Some(Rate::new(60, 1).unwrap()),
        duration: Some(Duration::from_secs_f64(seconds)),
        observer: Some(Box::new(observer)),
        ..SessionOptions::default()
    };
    let session = Session::start(both, Output::Memory { simulated, sink: None }, options).unwrap();
    while session.is_running() {
        std::thread::sleep(Duration::from_millis(2));
    }
    let ended = session.stop();
    let frames = frames.lock().unwrap().clone();
    (ended, frames)
}

fn tracking(real_time: bool) -> [Tracking; 2] {
    let estimator = |eye| Estimator::new(GazeSettings { eye, ..GazeSettings::default() }, None).unwrap();
    let options = Options { real_time, ..Options::default() };
    let estimators = [estimator(Eye::Left), estimator(Eye::Right)];
    Tracking::open_two(&Spec::Simulated(4), &options, estimators, (63e-3, 11e-3), [0.0, 2.0]).unwrap()
}

/// Returns content of one eye, whose steps take `step_ms`, or the time that they take.
fn eye(stage: &Scripted, tracking: Tracking, step_ms: Option<f64>) -> Live {
    let engines: EngineOpener = Box::new(cpu);
    let mut live = Live::new(stage.begun(), stage.encoder(), engines, tracking);
    live.cost = step_ms.map_or(Cost::Measured, |ms| Cost::Fixed {
        step: Duration::from_secs_f64(ms * 1e-3),
        encode: Duration::from_micros(500),
    });
    live
}

fn two_live(stereo: Stereo, steps_ms: [Option<f64>; 2], places: Panels) -> TwoEyed {
    let stage = Scripted::new("planes8", 64, 1);
    let [left, right] = tracking(steps_ms[0].is_none());
    TwoEyed::live(eye(&stage, left, steps_ms[0]), eye(&stage, right, steps_ms[1]), stereo, places)
}

fn report(ended: &Ended) -> &TwoEyesReport {
    ended.statistics.two_eyes.as_ref().unwrap()
}

/// Returns the video frames at which the left and the right half changed.
fn changes(frames: &[Lit]) -> [Vec<usize>; 2] {
    [0, 1].map(|eye| (1..frames.len()).filter(|i| frames[*i].halves[eye] != frames[i - 1].halves[eye]).collect())
}

/// If one eye needs three times the time of the other one, both wait for each other. Independent eyes do not.
#[test]
fn eyes_that_show_together_change_in_the_same_video_frame() {
    let steps = [Some(4.0), Some(21.0)];
    let (ended, frames) = run(two_live(Stereo::Together, steps, Panels::TopBottom), true, 4.0);
    let both = report(&ended);
    assert!(both.video_frames > 200 && both.differing == 0, "{} of {}", both.differing, both.video_frames);
    let [left, right] = changes(&frames);
    // The first set of the whole eyebox may be the idle picture of the other eye.
    assert_eq!(left[1..], right[1..]);
    assert!(left.len() > 80, "{} new sets", left.len());
    let (left, right) = (ended.statistics.live.as_ref().unwrap(), both.right_live.as_ref().unwrap());
    assert_eq!(left.sets_new, right.sets_new);
    assert!(left.repeats[RepeatReason::OtherEye as usize] > 80, "{:?}", left.repeats);
    assert_eq!(right.repeats[RepeatReason::OtherEye as usize], 0, "{:?}", right.repeats);

    // Sets that take two and three video frames are shown every three video frames, and not every six.
    let (ended, _) = run(two_live(Stereo::Together, [Some(25.0), Some(42.0)], Panels::TopBottom), true, 4.0);
    let new = report(&ended).right_live.as_ref().unwrap().sets_new;
    assert!((70..=82).contains(&new), "{new} new sets in 240 video frames");

    let (ended, frames) = run(two_live(Stereo::Independent, steps, Panels::TopBottom), true, 4.0);
    let alone = report(&ended);
    assert!(alone.differing * 3 > alone.video_frames, "{} of {}", alone.differing, alone.video_frames);
    let [left, right] = changes(&frames);
    assert!(left.len() > 2 * right.len() - 10 && right.len() > 80, "{} and {}", left.len(), right.len());
}

/// Each eye of a pair shows the bytes of a session of its own.
#[test]
fn each_eye_is_refined_as_if_it_were_alone() {
    let stage = Scripted::new("planes8", 64, 1);
    let steps = Some(5.0);
    let [left, right] = tracking(false);
    let pair = TwoEyed::live(eye(&stage, left, steps), eye(&stage, right, steps), Stereo::Together, Panels::TopBottom);
    let (_, both) = run(pair, true, 1.0);
    for at in [0, 1] {
        let mut own = tracking(false).into_iter();
        let tracking = own.nth(at).unwrap();
        let (_, frames) = scripted::shown(eye(&stage, tracking, steps), 60, 1.0);
        let own: Vec<u32> = frames.iter().map(|frame| frame.checksum).collect();
        let of_pair: Vec<u32> = both.iter().map(|frame| frame.halves[at]).collect();
        assert_eq!(own, of_pair, "{at}");
        assert!(own.windows(2).filter(|two| two[0] != two[1]).count() > 50);
    }
    assert!(both.iter().skip(10).any(|frame| frame.halves[0] != frame.halves[1]), "the eyes see different pictures");
}

/// In real time on a machine of any speed, both eyes have sets for the same time.
#[test]
fn eyes_in_real_time_agree() {
    let (ended, frames) = run(two_live(Stereo::Together, [None, None], Panels::SideBySide), false, 2.0);
    ended.result.as_ref().unwrap();
    let both = report(&ended);
    assert!(both.video_frames > 20 && both.differing == 0, "{} of {}", both.differing, both.video_frames);
    let right = both.right_live.as_ref().unwrap();
    assert!(right.sets_new > 3, "{} new sets", right.sets_new);
    assert_eq!(ended.statistics.live.as_ref().unwrap().sets_new, right.sets_new);
    assert!(!frames.is_empty());
}

/// Content that ends with an error after some scenes.
struct Fails(u32);

impl Scenes for Fails {
    fn describe(&self) -> String {
        "fails".into()
    }

    fn next(&mut self, _: &Due) -> Result<Newest, SessionError> {
        self.0 = self.0.saturating_sub(1);
        if self.0 == 0 { Err(reason!("gone", "the content is gone").into()) } else { Ok(Newest::Same) }
    }
}

#[test]
fn a_failing_eye_leaves_the_other_ones_picture() {
    for fails in [0, 1] {
        let stage = Scripted::new("planes8", 64, 1);
        let mut eyes = tracking(false).map(|tracking| eye(&stage, tracking, Some(4.0)));
        eyes[fails].scenes = Some(Box::new(Fails(30)));
        // Scenes are numbered, so the scenes of the other eye are numbered, too.
        eyes[1 - fails].scenes = Some(Box::new(Fails(u32::MAX)));
        let [left, right] = eyes;
        let (ended, frames) = run(TwoEyed::live(left, right, Stereo::Together, Panels::TopBottom), true, 3.0);
        ended.result.as_ref().unwrap();
        assert_eq!(ended.statistics.ended_by, Ending::Duration);
        let changes = changes(&frames);
        let last = |eye: usize| *changes[eye].last().unwrap();
        // The last picture of a session is the idle picture.
        assert!(changes[fails].len() < 40, "{:?}", changes[fails]);
        assert!(changes[1 - fails].len() > 120 && last(1 - fails) > 160, "{:?}", changes[1 - fails]);
    }
}

/// Writes a sequence whose holograms are random, and returns it with the encoder of its display.
fn sequence(folder: &std::path::Path, name: &str, seed: u64, count: u64) -> (Play, Vec<u32>) {
    let display = Display { height: 12, width: 16, ..Display::preset("grey8").unwrap() };
    let green = display.wavelengths.iter().find(|w| w.color == Color::Green).unwrap().wavelength;
    let hologram = |index: u64| {
        let phases = random_phases(192, seed + index);
        let color = Some(Color::Green);
        let green = ColorHologram { color, wavelength: green, exposure: 0.4, efficiency: 0.4, phases };
        Hologram { height: 12, width: 16, ..Hologram::on(&display, 1, vec![green]) }
    };
    let path = folder.join(name);
    let mut writer = SequenceWriter::create(&path, &hologram(0), [20, 1], None).unwrap();
    (0..count).for_each(|index| writer.append(&hologram(index)).unwrap());
    drop(writer);
    let encoder = Encoder::new(&display, &[Color::Green], 1).unwrap();
    let checksum = |index: u64| {
        let phases = hologram(index).colors.remove(0).phases;
        crc32c::crc32c(encoder.encode(&crate::encode::PhaseSet::trusted(&[&phases])).unwrap().frame(0))
    };
    let checksums = (0..count).map(checksum).collect();
    (Play::open(&path, &display).unwrap(), checksums)
}

/// The holograms of both eyes with the same number are lit in the same video frames.
#[test]
fn sequences_of_both_eyes_are_played_in_step() {
    let here = tempfile::tempdir().unwrap();
    for stereo in [Stereo::Together, Stereo::Independent] {
        let (left, of_left) = sequence(here.path(), &format!("l-{stereo:?}.zarr"), 1, 30);
        let (right, of_right) = sequence(here.path(), &format!("r-{stereo:?}.zarr"), 1000, 30);
        let (ended, frames) = run(TwoEyed::play(left, right, stereo, Panels::Monitors), true, 60.0);
        ended.result.as_ref().unwrap();
        assert_eq!(ended.statistics.ended_by, Ending::End);
        let lit: Vec<&Lit> = frames.iter().filter(|frame| frame.index.is_some()).collect();
        assert_eq!(lit.len(), 90, "each for three video frames");
        for frame in lit {
            let number = frame.index.unwrap() as usize;
            assert_eq!(frame.halves, [of_left[number], of_right[number]], "{number}");
        }
        assert_eq!((report(&ended).video_frames, report(&ended).differing), (90, 0));
    }
}

/// Damages one hologram of a sequence.
fn damage(path: &std::path::Path, index: u64) {
    let file = path.join(format!("phases/c/{index}/0/0/0/0"));
    let mut bytes = std::fs::read(&file).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&file, bytes).unwrap();
}

/// If one eye has no set for a position, both eyes wait together, and independent eyes do not.
#[test]
fn a_hologram_that_one_eye_lacks_is_left_out_on_both_or_on_one() {
    let here = tempfile::tempdir().unwrap();
    for (stereo, lacks) in
        [(Stereo::Together, 0), (Stereo::Together, 1), (Stereo::Independent, 0), (Stereo::Independent, 1)]
    {
        let names = ["l", "r"].map(|eye| format!("{eye}-{stereo:?}-{lacks}.zarr"));
        let (left, of_left) = sequence(here.path(), &names[0], 1, 10);
        let (right, of_right) = sequence(here.path(), &names[1], 1000, 10);
        damage(&here.path().join(&names[lacks]), 5);
        let (ended, frames) = run(TwoEyed::play(left, right, stereo, Panels::TopBottom), true, 60.0);
        ended.result.as_ref().unwrap();
        let mut shown: Vec<[u32; 2]> = frames.iter().filter(|f| f.index.is_some()).map(|f| f.halves).collect();
        shown.dedup();
        let mut expected: Vec<[u32; 2]> = (0..10).map(|i| [of_left[i], of_right[i]]).collect();
        if stereo == Stereo::Together {
            expected.remove(5);
        } else {
            expected[5][lacks] = expected[4][lacks];
        }
        assert_eq!(shown, expected, "{stereo:?} {lacks}");
        let differing = if stereo == Stereo::Together { 0 } else { 3 };
        assert_eq!(report(&ended).differing, differing, "{stereo:?} {lacks}");
    }
}

/// A jump in a sequence is one of both eyes.
#[test]
fn both_eyes_seek_together() {
    let here = tempfile::tempdir().unwrap();
    for stereo in [Stereo::Together, Stereo::Independent] {
        let (left, of_left) = sequence(here.path(), &format!("l-{stereo:?}.zarr"), 1, 30);
        let (right, of_right) = sequence(here.path(), &format!("r-{stereo:?}.zarr"), 1000, 30);
        let frames = Arc::new(Mutex::new(Vec::new()));
        let (theirs, (jumps, jump)) = (Arc::clone(&frames), std::sync::mpsc::channel());
        let (sent, wait_until_sent) = std::sync::mpsc::channel();
        let observer = move |frame: &PresentedFrame<'_>| {
            let (left, right) = frame.picture.split_at(frame.picture.len() / 2);
            let mut seen = theirs.lock().unwrap();
            seen.push((frame.index, [left, right].map(crc32c::crc32c)));
            if seen.len() == 40 {
                jumps.send(()).unwrap();
                wait_until_sent.recv_timeout(Duration::from_secs(60)).unwrap();
            }
        };
        let options = SessionOptions {
            display_rate: Some(Rate::new(60, 1).unwrap()),
            duration: Some(Duration::from_secs(60)),
            observer: Some(Box::new(observer)),
            ..SessionOptions::default()
        };
        let both = TwoEyed::play(left, right, stereo, Panels::TopBottom);
        let session = Session::start(both, Output::Memory { simulated: true, sink: None }, options).unwrap();
        jump.recv_timeout(Duration::from_secs(60)).unwrap();
        session.command(Command::Seek(-8));
        sent.send(()).unwrap();
        while session.is_running() {
            std::thread::sleep(Duration::from_millis(2));
        }
        let ended = session.stop();
        ended.result.unwrap();
        assert_eq!(ended.statistics.ended_by, Ending::End, "{stereo:?}");
        let lit: Vec<(u64, [u32; 2])> = frames.lock().unwrap().iter().filter_map(|(i, h)| i.map(|i| (i, *h))).collect();
        for (number, halves) in &lit {
            assert_eq!(*halves, [of_left[*number as usize], of_right[*number as usize]], "{stereo:?} {number}");
        }
        let back: Vec<_> = lit.windows(2).filter(|two| two[1].0 < two[0].0).map(|two| two[0].0 - two[1].0).collect();
        assert_eq!(back, [8], "{stereo:?}");
        assert_eq!(lit.last().unwrap().0, 29);
    }
}

/// A tracker of both eyes that measures no focus still gives the focus of the sets, by the directions of the eyes.
#[test]
fn both_eyes_are_refined_for_the_focus_of_their_vergence() {
    let stage = Scripted::new("planes8", 64, 1);
    let focal_length = stage.display.focal_length;
    let per_dioptre = focal_length * focal_length;
    let eyepiece = Some(Eyepiece { focal_length, depths: [-3.0 * per_dioptre, 3.0 * per_dioptre] });
    let estimator = |eye| Estimator::new(GazeSettings { eye, eyepiece, ..GazeSettings::default() }, None).unwrap();
    let options = Options { real_time: false, ..Options::default() };
    let estimators = [estimator(Eye::Left), estimator(Eye::Right)];
    let trackings = Tracking::open_two(&Spec::Simulated(4), &options, estimators, (63e-3, 11e-3), [0.0, 2.0]).unwrap();
    let [left, right] = trackings.map(|tracking| eye(&stage, tracking, Some(4.0)));
    let both = TwoEyed::live(left, right, Stereo::Together, Panels::TopBottom);
    let (ended, _) = run(both, true, 8.0);
    let range = |live: &LiveStatistics| live.focus.expect("a focus").map(|z| z / per_dioptre);
    let left = range(ended.statistics.live.as_ref().unwrap());
    let right = range(report(&ended).right_live.as_ref().unwrap());
    for [low, high] in [left, right] {
        assert!(low > -0.4 && high < 2.4 && high - low > 0.8, "{low} to {high} D for eyes that look at 0 to 2 D");
    }
    assert!((left[0] - right[0]).abs() < 0.2 && (left[1] - right[1]).abs() < 0.2, "{left:?} {right:?} D");
}

#[test]
fn eyes_that_do_not_belong_together_are_refused() {
    let here = tempfile::tempdir().unwrap();
    let code = |both: TwoEyed, output: Output| {
        let error = Session::start(both, output, SessionOptions::default()).err().expect("an error");
        ErrorData::of(&error).code
    };
    let memory = || Output::Memory { simulated: true, sink: None };
    let stage = Scripted::new("planes8", 64, 1);
    let [left, right] = tracking(false);
    let mut wide = Scripted::new("planes8", 64, 1);
    wide.display.width = 32;
    let small = Scripted::before(Display { height: 32, width: 32, ..wide.display.clone() }, 1);
    let other =
        TwoEyed::live(eye(&stage, left, Some(1.0)), eye(&small, right, Some(1.0)), Stereo::Together, Panels::Monitors);
    assert_eq!(code(other, memory()), "setting/eyes-differ");
    let mut journal = two_live(Stereo::Together, [Some(1.0), Some(1.0)], Panels::Monitors);
    if let super::feeds::two_eyed::Eyes::Live(eyes) = &mut journal.eyes {
        eyes[1].journal = Some(here.path().join("j"));
    }
    assert_eq!(code(journal, memory()), "setting/eyes-journal");
    let pair = Output::Pair { left: Box::new(memory()), right: Box::new(memory()) };
    let both = two_live(Stereo::Together, [Some(1.0), Some(1.0)], Panels::Monitors);
    assert_eq!(code(both, pair), "setting/pair-of-outputs");
}
