//! Compares frames of an application that stay on the device with the same frames from shared memory.
//!
//! The test uses two devices of one process, watched by the validation layer.

use crate::gpu::test_options::watched;
use crate::gpu::{DeviceIds, DeviceKind, Gpu, Options, SharedLayout, SlotWriter};
use crate::optics::{Color, Display, PupilDistribution};
use crate::session::{Due, LiveInput, LiveKind, Newest, SceneFrame, Scenes};
use eyebox_live_input::{Application, Content, Dioptres, FrameFault, FrameInfo, LiveError, Sample, Transfer};
use std::sync::PoisonError;
use std::time::Duration;

const SIDE: usize = 48;
const VIEWS: usize = 9;

/// Returns a picture that no other seed gives.
fn samples(seed: usize) -> Vec<u8> {
    (0..VIEWS * SIDE * SIDE).map(|i| (i * 31 + seed * 77 + i / 7 * seed) as u8).collect()
}

fn silent(gpus: [Gpu; 2]) {
    let messages = gpus.each_ref().map(Gpu::messages);
    drop(gpus);
    for messages in messages {
        let heard = messages.lock().unwrap_or_else(PoisonError::into_inner);
        assert!(heard.is_empty(), "messages of the validation layer:\n{}", heard.join("\n"));
    }
}

fn due(light_ms: i64) -> Due {
    let aim =
        PupilDistribution { centre: [0.0; 2], spread: 1e-3, diameter: [3e-3, 5e-3], focus: [0.0; 2], elsewhere: 0.0 };
    let light_ns = light_ms * 1_000_000;
    Due {
        now_ns: light_ns,
        light_ns,
        light_monotonic_ns: light_ns as u64,
        period_ns: 1_000_000,
        pupil: aim,
        velocity: [0.0; 2],
        tracked: true,
        patient: false,
    }
}

fn taken(newest: Newest) -> SceneFrame {
    match newest {
        Newest::New(scene) => scene,
        Newest::Refused(reason) => panic!("{reason}"),
        _ => panic!("nothing came"),
    }
}

/// Counts the sets of a session.
#[derive(Default)]
struct Clock(i64);

impl Clock {
    fn next(&mut self, input: &mut LiveInput) -> Newest {
        self.0 += 1;
        input.next(&due(self.0)).expect("asked")
    }
}

fn display() -> Display {
    Display { height: SIDE, width: SIDE, ..Display::preset("planes8").expect("a preset") }
}

/// A display that decodes on a device, and an application that writes into memory of the same device.
struct Pair {
    ours: Gpu,
    theirs: Gpu,
    input: LiveInput,
    application: Application,
    writer: SlotWriter,
}

impl Pair {
    /// The device makes the views of pictures with depths if it `draws`.
    fn open(name: &str, draws: bool) -> Self {
        let plan_as = Some(if draws { DeviceKind::Discrete } else { DeviceKind::Cpu });
        let ours = Gpu::open(&Options { plan_as, ..watched() }).expect("a device");
        let name = format!("{name}-{}", std::process::id());
        let theirs = Gpu::open_same(ours.ids(), &watched()).expect("the same device");
        let mut input = LiveInput::open(&name, &display(), &[Color::Green], 3, LiveKind::Views).expect("a ring");
        input.decode_on(&ours).expect("a decoder");
        let (mut input, mut application) = connected(&name, input);
        let its = application.device().expect("it shares");
        assert_eq!(DeviceIds { device: its.device, driver: its.driver }, ours.ids());
        let (memory, fd) = std::thread::scope(|scope| {
            let asking =
                scope.spawn(|| application.share(Duration::from_secs(20)).expect("an answer").expect("memory"));
            while !asking.is_finished() {
                drop(Clock::default().next(&mut input));
                std::thread::sleep(Duration::from_millis(1));
            }
            asking.join().expect("shared")
        });
        let layout = SharedLayout {
            memory_bytes: memory.memory_bytes,
            buffer_bytes: memory.buffer_bytes,
            memory_type: memory.memory_type,
            usage: memory.usage,
        };
        let writer = SlotWriter::new(&theirs, fd, &layout, memory.slot_stride).expect("imported");
        Self { ours, theirs, input, application, writer }
    }
}

/// Connects an application to a display.
fn connected(name: &str, mut input: LiveInput) -> (LiveInput, Application) {
    let to = name.to_owned();
    let application = std::thread::spawn(move || Application::connect(&to).expect("taken"));
    while !application.is_finished() {
        drop(Clock::default().next(&mut input));
        std::thread::sleep(Duration::from_millis(1));
    }
    (input, application.join().expect("connected"))
}

/// A frame on the device of the application gives the same picture as the same frame from shared memory.
#[test]
fn frames_of_an_application_stay_on_the_device() {
    let Pair { ours, theirs, mut input, mut application, mut writer } = Pair::open("shared", true);
    let mut clock = Clock::default();
    let mut next = |input: &mut LiveInput| clock.next(input);
    let host = FrameInfo::new(Content::Views { grid: [3, 3], pitch_mm: 1.0 }, Sample::U8, Transfer::Srgb);
    let there = FrameInfo { on_device: true, ..host };
    for seed in 1..6 {
        let frame = writer.keep(None, &samples(seed)).expect("kept");
        let before = [&ours, &theirs].map(Gpu::counts);
        let slot = application.begin(&there).expect("a slot");
        writer.write(slot.index(), frame).expect("written");
        slot.publish();
        let scene = taken(next(&mut input));
        let moved = [ours.counts().since(before[0]), theirs.counts().since(before[1])];
        // No byte of the frame is uploaded or read back, except sums and one small view of nine.
        assert!(moved.iter().all(|m| m.uploaded == 0), "{moved:?}");
        assert!(moved[0].read_back < (3 * SIDE * SIDE) as u64 && moved[1].read_back == 0, "{moved:?}");
        application.send(&host, &samples(seed), &[]).expect("sent");
        let wanted = taken(next(&mut input));
        let [a, b] = [&scene, &wanted].map(|s| s.colors[0].problem.pyramid.on_host().expect("read"));
        assert!(*a == *b && scene.colors[0].problem.mean == wanted.colors[0].problem.mean, "frame {seed}");
        assert_eq!(scene.colors[0].exposure, wanted.colors[0].exposure);
    }
    // Layers are never there, and are refused where they are made.
    let layers = Content::Layers(Dioptres::new(&[0.0, 1.0]));
    let error = application.begin(&FrameInfo { on_device: true, content: layers, ..host }).map(drop);
    assert!(
        matches!(error, Err(LiveError::Frame(FrameFault::Number { found: 1, least: 0, most: 0, .. }))),
        "{error:?}"
    );
    drop(application);
    assert!(matches!(next(&mut input), Newest::Late(_)));
    drop((writer, input));
    silent([ours, theirs]);
}

/// Returns a slanted ground and a near square, with the colors before the dioptres.
fn relief_frame(seed: usize) -> (Vec<u8>, Vec<f32>) {
    let near = |i: usize| (i / SIDE).abs_diff(20 + seed) < 9 && (i % SIDE).abs_diff(24) < 9;
    let color = |i: usize| if near(i) { 200 - (i % 7) as u8 } else { 40 + (i * 5 % 61) as u8 };
    let colors = (0..SIDE * SIDE).map(color).collect();
    let dioptres = (0..SIDE * SIDE).map(|i| if near(i) { 0.05 } else { 2e-4 * (i % SIDE) as f32 }).collect();
    (colors, dioptres)
}

/// A software device leaves color and depth to the host, also if the frame is in memory of the device.
#[test]
fn a_software_device_leaves_color_and_depth_to_the_host() {
    let Pair { ours, theirs, mut input, mut application, mut writer } = Pair::open("software", false);
    let mut clock = Clock(5);
    let info = FrameInfo::new(Content::ColorAndDepth, Sample::U8, Transfer::Srgb);
    let (colors, dioptres) = relief_frame(1);
    application.send(&info, &colors, &dioptres).expect("sent");
    let wanted = taken(clock.next(&mut input));
    assert!(wanted.colors[0].problem.pyramid.on_device().is_none());
    let frame = writer.keep(None, &stored(&colors, &dioptres)).expect("kept");
    let slot = application.begin(&FrameInfo { on_device: true, ..info }).expect("a slot");
    writer.write(slot.index(), frame).expect("written");
    slot.publish();
    let found = taken(clock.next(&mut input));
    let [found, wanted] = [&found, &wanted].map(|scene| &scene.colors[0].problem);
    assert!(*found.pyramid == *wanted.pyramid && found.mean == wanted.mean);
    drop((application, writer, input));
    silent([ours, theirs]);
}

/// Returns a frame as it is in a slot.
fn stored(colors: &[u8], dioptres: &[f32]) -> Vec<u8> {
    let mut samples = colors.to_vec();
    samples.resize(samples.len().next_multiple_of(64), 0);
    samples.extend(dioptres.iter().flat_map(|d| d.to_le_bytes()));
    samples
}

/// Views of color and depth are the same from the device and from the host, whether the frame comes through shared
/// memory or is on the device already.
#[test]
fn views_of_color_and_depth_are_made_on_the_device() {
    let Pair { ours, theirs, mut input, mut application, mut writer } = Pair::open("depths", true);
    let name = format!("depths-host-{}", std::process::id());
    let host = LiveInput::open(&name, &display(), &[Color::Green], 3, LiveKind::Views).expect("a ring");
    let (mut host, mut to_host) = connected(&name, host);
    let mut clock = Clock(5);
    let info = FrameInfo::new(Content::ColorAndDepth, Sample::U8, Transfer::Srgb);
    for seed in 1..4 {
        let (colors, dioptres) = relief_frame(seed);
        to_host.send(&info, &colors, &dioptres).expect("sent");
        let wanted = taken(clock.next(&mut host));
        application.send(&info, &colors, &dioptres).expect("sent");
        let through_region = taken(clock.next(&mut input));
        let frame = writer.keep(None, &stored(&colors, &dioptres)).expect("kept");
        let before = [&ours, &theirs].map(Gpu::counts);
        let slot = application.begin(&FrameInfo { on_device: true, ..info }).expect("a slot");
        writer.write(slot.index(), frame).expect("written");
        slot.publish();
        let on_device = taken(clock.next(&mut input));
        let moved = [ours.counts().since(before[0]), theirs.counts().since(before[1])];
        // The upload is the initial state of a frame, and sums and one small view are read.
        assert!(moved[0].uploaded < 64 && moved[1].uploaded == 0, "{moved:?}");
        assert!(moved[0].read_back < (3 * SIDE * SIDE) as u64 && moved[1].read_back == 0, "{moved:?}");
        let views = |scene: &SceneFrame| scene.colors[0].problem.pyramid.on_host().expect("read");
        let (a, b, c) = (views(&through_region), views(&on_device), views(&wanted));
        assert!(*a == *b, "frame {seed}");
        let light = |pyramid: &crate::scene::Pyramid| -> Vec<f64> {
            pyramid.levels[0].views.iter().map(|v| f64::from(*v) / 65_535.0 * f64::from(pyramid.scale)).collect()
        };
        let (found, wanted_light) = (light(&a), light(&c));
        let error: f64 = found.iter().zip(&wanted_light).map(|(a, b)| (a - b).powi(2)).sum();
        let decibels = 10.0 * (found.len() as f64 / error.max(1e-30)).log10();
        assert!(found.len() == 9 * SIDE * SIDE && decibels > 70.0, "frame {seed}: {decibels} dB");
        let [one, other] = [&on_device, &wanted].map(|scene| &scene.colors[0]);
        assert!((one.problem.mean / other.problem.mean - 1.0).abs() < 1e-4);
        assert_eq!((one.problem.center, one.problem.views), (other.problem.center, other.problem.views));
        assert!((one.exposure / other.exposure - 1.0).abs() < 1e-3);
    }
    // Values that are no depth or no light, and depths that move content too far, are refused like on the host.
    let (colors, dioptres) = relief_frame(1);
    let mut wrong = dioptres.clone();
    wrong[77] = f32::NAN;
    let deep = vec![99.0; SIDE * SIDE];
    for dioptres in [&wrong, &deep] {
        application.send(&info, &colors, dioptres).expect("sent");
        to_host.send(&info, &colors, dioptres).expect("sent");
        let [found, wanted] = [&mut input, &mut host].map(|input| match clock.next(input) {
            Newest::Refused(reason) => reason,
            _ => panic!("the frame was not refused"),
        });
        assert_eq!(found, wanted);
    }
    let (half, nan) = (FrameInfo { sample: Sample::F32, transfer: Transfer::Linear, ..info }, f32::NAN.to_le_bytes());
    application.send(&half, &nan.repeat(SIDE * SIDE), &dioptres).expect("sent");
    assert!(matches!(clock.next(&mut input), Newest::Refused(_)));
    drop((application, to_host, writer, input, host));
    silent([ours, theirs]);
}
