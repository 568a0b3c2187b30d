//! Tests the order and the bytes of the frames of a stream, with damage, ends, loops and growth.

use crate::encode::{Encoder, PhaseSet};
use crate::engine::vulkan::{LesserDevice, VulkanEncoder};
use crate::gpu::Gpu;
use crate::gpu::test_options::watched;
use crate::hologram::{ColorHologram, Hologram, NewestHologram, Sequence, SequenceWriter};
use crate::optics::{Color, Display, JointColor, Laser, Optics};
use crate::present::{Clock, Offscreen, Rate, SimulatedClock};
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::trace::Trace;
use crate::session::playback::player::{Command, Flow, Player, PresentedFrame, SetSource};
use crate::session::playback::scheduler::{Content, Readiness, Schedule, Scheduler, Start};
use crate::session::playback::stream::{Stream, StreamOptions};
use crate::session::*;
use crate::solve::SplitMix;
use eyebox_base::error::ErrorData;
use std::path::{Path, PathBuf};
use std::rc::Rc;

const COLORS: [Color; 3] = [Color::Red, Color::Green, Color::Blue];

fn display(preset: &str) -> Display {
    Display { height: 12, width: 16, ..Display::preset(preset).expect("a preset") }
}

fn hologram(index: u64, display: &Display) -> Hologram {
    let mut random = SplitMix(index);
    let mut color = |c: &crate::optics::Wavelength| ColorHologram {
        color: Some(c.color),
        wavelength: c.wavelength,
        exposure: 0.4,
        efficiency: 0.4,
        phases: (0..8 * 192).map(|_| crate::optics::wrap_phase((7.0 * random.unit()) as f32)).collect(),
    };
    let colors = display.wavelengths.iter().map(&mut color).collect();
    Hologram { height: 12, width: 16, ..Hologram::on(display, 8, colors) }
}

struct Fixture {
    _here: tempfile::TempDir,
    path: PathBuf,
    display: Display,
    writer: SequenceWriter,
}

fn fixture(preset: &str, count: u64) -> Fixture {
    let here = tempfile::tempdir().unwrap();
    let (path, display) = (here.path().join("x.zarr"), display(preset));
    assert!(Optics::new(12, 16, display.pitch, 520e-9, 0.4).is_ok());
    let mut writer = SequenceWriter::create(&path, &hologram(0, &display), [60, 1], None).unwrap();
    (0..count).for_each(|i| writer.append(&hologram(i, &display)).unwrap());
    Fixture { _here: here, path, display, writer }
}

fn options() -> StreamOptions {
    StreamOptions {
        ahead: 3,
        looped: false,
        follow: false,
        first: 0,
        threads: 2,
        mark: 0,
        notes: Notes::default(),
        trace: Trace::none(),
    }
}

fn start(path: &Path, display: &Display, options: StreamOptions) -> Stream {
    let encoder = Encoder::new(display, &COLORS, 8).unwrap();
    Stream::start(Sequence::open(path).unwrap(), encoder, None, options).unwrap()
}

fn encoded(index: u64, display: &Display) -> Vec<Vec<u8>> {
    let hologram = hologram(index, display);
    let colors: Vec<&[f32]> = hologram.colors.iter().map(|c| &c.phases[..]).collect();
    let frames = Encoder::new(display, &COLORS, 8).unwrap().encode(&PhaseSet::trusted(&colors)).unwrap();
    (0..frames.count()).map(|i| frames.frame(i).to_vec()).collect()
}

/// The video frames that were handed over, as frame of the file, video frame and bytes.
type Log = Vec<(Option<u64>, u64, Vec<u8>)>;

struct Played {
    log: Log,
    messages: Vec<String>,
    account: Account,
    flow: Flow,
}

/// Plays with a simulated clock until the end, or for `most` video frames.
fn play(
    fixture: &Fixture,
    options: StreamOptions,
    content: &str,
    most: usize,
    act: impl FnMut(usize, &mut Player, &mut Stream),
) -> Played {
    let notes = options.notes.clone();
    play_stream(fixture, (start(&fixture.path, &fixture.display, options), notes), content, most, act)
}

/// Plays the same with a stream of the test.
fn play_stream(
    fixture: &Fixture,
    (mut stream, notes): (Stream, Notes),
    content: &str,
    most: usize,
    mut act: impl FnMut(usize, &mut Player, &mut Stream),
) -> Played {
    let encoder = Encoder::new(&fixture.display, &COLORS, 8).unwrap();
    let clock: Rc<dyn Clock> = Rc::new(SimulatedClock::default());
    let display_rate = Rate::parse("60").unwrap();
    let schedule = Schedule {
        rolls: false,
        display_rate,
        content_rate: Rate::parse(content).unwrap(),
        speed: Speed::ONE,
        set_frames: encoder.packed().video_frames as u64,
        start: Start::WhenReady { idle_sets: 2 },
        waits: false,
        keep_phase: false,
    };
    let idle = encoder.frames();
    let mut offscreen = Offscreen::new(Rc::clone(&clock), display_rate, idle.frame_bytes());
    let mut player = Player::new(clock, Scheduler::new(schedule), idle, Trace::none().track(""));
    let (mut log, mut messages, mut flow) = (Log::new(), Vec::new(), Flow::Continue);
    while flow == Flow::Continue && log.len() < most {
        act(log.len(), &mut player, &mut stream);
        let mut keep = |m: &PresentedFrame<'_>| {
            log.push((m.index, m.video_frame, m.picture.to_vec()));
            Ok(())
        };
        flow = player.tick(&mut offscreen, &mut stream, &mut keep).unwrap();
    }
    while let Some(message) = notes.take() {
        messages.push(message);
    }
    let account = *player.scheduler.account();
    Played { log, messages, account, flow }
}

fn shown(log: &Log) -> Vec<u64> {
    let mut shown: Vec<u64> = log.iter().filter_map(|l| l.0).collect();
    shown.dedup();
    shown
}

#[test]
fn every_packing_is_played_as_it_is_encoded() {
    for preset in ["grey8", "fields", "planes8", "planes24", "plm"] {
        let fixture = fixture(preset, 5);
        let rate = if preset == "grey8" { "2.5" } else { "7.5" };
        let played = play(&fixture, options(), rate, 100_000, |_, _, _| {});
        assert_eq!((shown(&played.log), played.flow), (vec![0, 1, 2, 3, 4], Flow::Ended), "{preset}");
        assert_eq!(played.account.drops(), 0, "{preset}: {:?}", played.account);
        for (index, video_frame, picture) in &played.log {
            if let Some(index) = index {
                assert!(
                    *picture == encoded(*index, &fixture.display)[*video_frame as usize],
                    "{preset} {index} {video_frame}"
                );
            }
        }
    }
}

/// If the drives that all colors share are not the phases of any color, they are computed from the phases of all
/// colors.
#[test]
fn an_slm_of_two_turns_is_sent_its_drives() {
    let (here, mut display) = (tempfile::tempdir().unwrap(), display("grey8"));
    display.dispersion.insert(Color::Red, 2.0);
    let mut random = SplitMix(4);
    // Each drive is in the middle of a level, so that none is rounded to the next level.
    let level = |_| crate::optics::wrap_phase((std::f64::consts::TAU * (256.0 * random.unit()).floor() / 256.0) as f32);
    let drives: Vec<f32> = (0..8 * 192).map(level).collect();
    let mut hologram = hologram(0, &display);
    let mut joint = JointColor::default();
    for (color, slope) in hologram.colors.iter_mut().zip(display.slopes(&COLORS)) {
        let laser = Laser { slope, powers: vec![1.0; 8] };
        color.phases = laser.phases(&drives);
        joint.lasers.insert(color.color.unwrap(), laser);
    }
    hologram.metadata.joint_color = Some(joint);
    let path = here.path().join("x.zarr");
    hologram.save(&path).unwrap();
    let encoder = || Encoder::new(&display, &COLORS[..1], 8).unwrap();
    let wanted = encoder().encode(&PhaseSet::trusted(&[&drives])).unwrap();
    assert!(hologram.encode(&display).unwrap().bytes() == wanted.bytes());
    let sequence = Sequence::open(&path).unwrap();
    let mut stream = Stream::start(sequence, encoder(), None, options()).unwrap();
    stream.settle(0, Target::default()).unwrap();
    stream.show(0);
    assert!(stream.on_screen().unwrap().0.bytes() == wanted.bytes());
}

/// A software device is sufficient. It is watched by the validation layer and has a cache of the tests.
fn gpu() -> Gpu {
    Gpu::open(&watched()).unwrap()
}

fn is_as_encoded(played: &Played, fixture: &Fixture) {
    for (index, video_frame, picture) in &played.log {
        if let Some(index) = index {
            let wanted = &encoded(*index, &fixture.display)[*video_frame as usize];
            assert!(picture == wanted, "{} {index} {video_frame}", fixture.display.name);
        }
    }
}

#[test]
fn a_vulkan_device_streams_the_bytes_of_the_cpu() {
    for preset in ["grey8", "fields", "planes8", "planes24", "plm"] {
        let fixture = fixture(preset, 5);
        let encoder = Encoder::new(&fixture.display, &COLORS, 8).unwrap();
        let sequence = Sequence::open(&fixture.path).unwrap();
        let options = options();
        let notes = options.notes.clone();
        let gpu = gpu();
        let heard = gpu.messages();
        let device = crate::engine::vulkan::VulkanEncoder::new(&gpu, encoder.plan()).unwrap();
        let stream = Stream::start(sequence, encoder, Some(device), options).unwrap();
        let rate = if preset == "grey8" { "2.5" } else { "7.5" };
        let played = play_stream(&fixture, (stream, notes), rate, 100_000, |_, _, _| {});
        assert_eq!((shown(&played.log), played.flow), (vec![0, 1, 2, 3, 4], Flow::Ended), "{preset}");
        is_as_encoded(&played, &fixture);
        assert!(played.messages.iter().all(|m| tells_of(m, &fixture).is_some()), "{:?}", played.messages);
        assert_eq!(*heard.lock().unwrap(), Vec::<String>::new());
    }
}

/// Creates an encoder on a device that stages its transfers.
fn staged(encoder: &Encoder) -> VulkanEncoder {
    let lesser = LesserDevice { staged: true, ..LesserDevice::default() };
    VulkanEncoder::on_lesser(&gpu(), encoder.plan(), &lesser).unwrap()
}

/// Returns the text behind the path of the sequence in a note.
fn tells_of<'a>(note: &'a str, fixture: &Fixture) -> Option<&'a str> {
    note.strip_prefix(&fixture.path.display().to_string())
}

/// The device is lost at the first submission, in an upload, in the kernel or in a download. The CPU continues with the
/// same hologram, nothing is dropped, and one note reports it.
#[test]
fn a_device_lost_while_streaming_is_followed_by_the_cpu() {
    for after in [0, 1, 3, 4, 12, 17] {
        let fixture = fixture("planes24", 8);
        let encoder = Encoder::new(&fixture.display, &COLORS, 8).unwrap();
        let sequence = Sequence::open(&fixture.path).unwrap();
        let mut lost = staged(&encoder);
        lost.pretend_lost_after(after);
        let heard = lost.gpu().messages();
        let options = options();
        let notes = options.notes.clone();
        let stream = Stream::start(sequence, encoder, Some(lost), options).unwrap();
        let played = play_stream(&fixture, (stream, notes), "20", 100_000, |_, _, _| {});
        assert_eq!((shown(&played.log), played.flow), ((0..8).collect(), Flow::Ended), "after {after}");
        assert_eq!(played.account.drops(), 0);
        is_as_encoded(&played, &fixture);
        let lost = played.messages.iter().filter(|m| tells_of(m, &fixture).is_none()).count();
        assert_eq!(lost, 1, "{:?}", played.messages);
        assert_eq!(*heard.lock().unwrap(), Vec::<String>::new());
    }
}

/// While content is on the display, the reader or the encoder panics, or a device gives an error. Playback ends with
/// the name of the failure and its reason, and the display shows the idle picture.
#[test]
fn a_thread_that_fails_leaves_the_idle_picture_and_one_line() {
    enum Fault {
        Panic(usize),
        Full,
    }
    let cases =
        [(Fault::Panic(0), "reads holograms"), (Fault::Panic(1), "encodes"), (Fault::Full, "engine/out-of-memory")];
    for (fault, line) in cases {
        let fixture = fixture("planes24", 4);
        let encoder = Encoder::new(&fixture.display, &COLORS, 8).unwrap();
        let mut idle = encoder.frames();
        idle.bytes_mut().fill(0x5a);
        let device = matches!(fault, Fault::Full).then(|| {
            let mut device = staged(&encoder);
            device.pretend_full_after(40);
            device
        });
        let sequence = Sequence::open(&fixture.path).unwrap();
        let looped = StreamOptions { looped: true, ..options() };
        let mut stream = Stream::start(sequence, encoder, device, looped).unwrap();
        if let Fault::Panic(thread) = fault {
            stream.pretend_panic_from(thread, 20);
        }
        let clock: Rc<dyn Clock> = Rc::new(SimulatedClock::default());
        let rate = Rate::parse("60").unwrap();
        let start = Start::WhenReady { idle_sets: 2 };
        let (speed, keep_phase) = (Speed::ONE, false);
        let schedule = Schedule {
            display_rate: rate,
            content_rate: rate,
            speed,
            set_frames: 1,
            rolls: false,
            start,
            waits: false,
            keep_phase,
        };
        let mut offscreen = Offscreen::new(Rc::clone(&clock), rate, idle.frame_bytes());
        let mut player = Player::new(clock, Scheduler::new(schedule), idle.clone(), Trace::none().track(""));
        let ended = loop {
            let shown = offscreen.picture().to_vec();
            if let Err(error) = player.tick(&mut offscreen, &mut stream, &mut |_| Ok(())) {
                assert!(shown != idle.frame(0) && offscreen.picture() == shown, "{line}: nothing was shown");
                break Err::<(), _>(error);
            }
        };
        assert!(player.scheduler.account().shown > 4, "{line}");
        let error = player.end(&mut offscreen, ended).expect_err("a failure");
        assert!(!error.to_string().contains('\n'), "{error}");
        let panicked = match &error {
            SessionError::Thread { what, reason } => {
                assert!(*what == line && reason.contains("a test's fault at 20"), "{error}");
                true
            }
            _ => {
                assert_eq!(ErrorData::of(&error).code, line, "{error}");
                false
            }
        };
        assert_eq!(offscreen.picture(), idle.frame(0), "{line}");
        // The other thread has ended too, and nothing waits for it.
        assert_eq!(stream.stop().len(), if panicked { 1 } else { 2 }, "{line}");
    }
}

#[test]
fn damaged_holograms_are_left_out_with_a_message() {
    let fixture = fixture("planes24", 6);
    let file = fixture.path.join("phases/c/2/0/0/0/0");
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[100] ^= 1;
    std::fs::write(&file, bytes).unwrap();
    let played = play(&fixture, options(), "20", 100_000, |_, _, _| {});
    assert_eq!(shown(&played.log), [0, 1, 3, 4, 5]);
    assert_eq!((played.account.dropped_for(Cause::Damaged), played.account.drops()), (1, 1));
    assert!(played.messages[0].contains(" 2 ") && played.messages[0].contains("phases/c/2"), "{:?}", played.messages);
    let ends = tells_of(&played.messages[1], &fixture);
    assert!(ends.is_some_and(|rest| rest.contains(" 6")), "{:?}", played.messages);
}

#[test]
fn a_loop_a_first_frame_and_seeking() {
    let fixture = fixture("planes24", 4);
    let looped = StreamOptions { looped: true, first: 2, ..options() };
    let played = play(&fixture, looped.clone(), "60", 30, |_, _, _| {});
    assert_eq!(shown(&played.log)[..9], [2, 3, 0, 1, 2, 3, 0, 1, 2]);
    let played = play(&fixture, looped, "60", 30, |tick, player, stream| {
        if tick == 12 {
            player.command(Command::Seek(-1), stream);
        }
    });
    let numbers = shown(&played.log);
    let back = numbers.windows(2).position(|w| w[1] != (w[0] + 1) % 4).expect("a seek");
    assert_eq!(numbers[back + 1], (numbers[back] + 3) % 4, "{numbers:?}");
    assert_eq!(played.account.drops(), 0);
}

#[test]
fn a_growing_sequence_is_followed_to_its_end() {
    let mut fixture = fixture("planes24", 2);
    let follow = StreamOptions { follow: true, ..options() };
    let encoder = Encoder::new(&fixture.display, &COLORS, 8).unwrap();
    let mut stream = start(&fixture.path, &fixture.display, follow);
    let mut seen = 0;
    for position in 0..5 {
        if position >= 2 {
            fixture.writer.append(&hologram(position, &fixture.display)).unwrap();
        }
        stream.settle(position, Target::default()).unwrap();
        assert_eq!(stream.readiness(position), Readiness::Ready);
        stream.show(position);
        let (frames, index) = stream.on_screen().unwrap();
        assert_eq!((index, frames.frame(0)), (position, &encoded(position, &fixture.display)[0][..]));
        assert_eq!(frames.count(), encoder.packed().video_frames);
        seen += 1;
    }
    assert_eq!((seen, stream.end()), (5, None));
    fixture.writer.finish().unwrap();
    stream.settle(5, Target::default()).unwrap();
    assert_eq!(stream.end(), Some(5));
}

#[test]
fn a_hologram_of_another_shape_is_refused_at_once() {
    let fixture = fixture("planes24", 1);
    let encoder = Encoder::new(&Display { width: 20, ..fixture.display.clone() }, &COLORS, 8).unwrap();
    let sequence = Sequence::open(&fixture.path).unwrap();
    assert!(matches!(Stream::start(sequence, encoder, None, options()), Err(SessionError::Encode(_))));
}

/// A version is on the screen from the light of its second set until the first video frame of another version, or of
/// the idle picture, is handed over.
#[test]
fn a_version_is_on_the_screen_while_its_light_stands() {
    for preset in ["planes24", "fields"] {
        let fixture = fixture(preset, 1);
        let newest = NewestHologram::new(hologram(0, &fixture.display));
        let sequence = Sequence::newest_of(Path::new("newest"), &newest);
        let encoder = Encoder::new(&fixture.display, &COLORS, 8).unwrap();
        let set_frames = encoder.packed().video_frames;
        let options = StreamOptions { looped: true, ..options() };
        let notes = options.notes.clone();
        let stream = Stream::start(sequence, encoder, None, options).unwrap();
        let mut seen = Vec::new();
        let played = play_stream(&fixture, (stream, notes), "7.5", 400, |tick, player, stream| {
            match tick {
                0 => player.follows(newest.clone()),
                100 => assert_eq!(newest.replace(hologram(1, &fixture.display)).unwrap(), 1),
                // Positions start at 0 again, and the version stays.
                300 => player.command(Command::Seek(0), stream),
                _ => {}
            }
            seen.push(newest.on_screen());
        });
        let sets = [0, 1].map(|version| encoded(version, &fixture.display));
        for (tick, shown) in seen.iter().enumerate() {
            let Some(shown) = shown else { continue };
            let lit = &played.log[shown.since as usize..tick];
            assert!(lit.len() > set_frames, "{preset} {tick}");
            let of_version = |(index, video_frame, picture): &(Option<u64>, u64, Vec<u8>)| {
                index.is_some() && *picture == sets[shown.version as usize][*video_frame as usize]
            };
            assert!(lit.iter().all(of_version), "{preset} {tick}: {shown:?}");
        }
        let mut seen: Vec<_> = seen.iter().map(|shown| shown.map(|shown| shown.version)).collect();
        seen.dedup();
        assert_eq!(seen, [None, Some(0), None, Some(1)], "{preset}");
        assert_eq!(newest.on_screen(), None, "{preset}: the player is gone");
    }
}

#[test]
fn a_mark_changes_its_corner_alone() {
    let fixture = fixture("planes24", 2);
    let marked = StreamOptions { mark: 4, ..options() };
    let played = play(&fixture, marked, "60", 100, |_, _, _| {});
    let (_, _, picture) = played.log.iter().find(|l| l.0 == Some(0)).unwrap();
    let plain = &encoded(0, &fixture.display)[0];
    let differs = |y: usize, x: usize| picture[3 * (16 * y + x)..][..3] != plain[3 * (16 * y + x)..][..3];
    assert!((0..12).all(|y| (0..16).all(|x| !differs(y, x) || (y < 4 && x < 4))));
    assert!((0..4).any(|y| (0..4).any(|x| differs(y, x))));
}
