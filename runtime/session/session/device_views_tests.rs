//! Compares frames of an application that stay on the device with the same frames from shared memory.
//!
//! The test uses two devices of one process, watched by the validation layer.

use crate::gpu::test_options::watched;
use crate::gpu::{DeviceIds, Gpu, SharedLayout, SlotWriter};
use crate::optics::{Color, Display, PupilDistribution};
use crate::session::{Due, LiveInput, LiveKind, Newest, SceneFrame, Scenes};
use eyebox_live_input::{Application, Content, FrameFault, FrameInfo, LiveError, Sample, Transfer};
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

/// A frame on the device of the application gives the same picture as the same frame from shared memory.
#[test]
fn frames_of_an_application_stay_on_the_device() {
    let ours = Gpu::open(&watched()).expect("a device");
    let name = format!("shared-{}", std::process::id());
    let theirs = Gpu::open_same(ours.ids(), &watched()).expect("the same device");
    let display = Display { height: SIDE, width: SIDE, ..Display::preset("planes8").expect("a preset") };
    let mut input = LiveInput::open(&name, &display, &[Color::Green], 3, LiveKind::Views).expect("a ring");
    input.decode_on(&ours).expect("a decoder");
    let connected = name.clone();
    let application = std::thread::spawn(move || Application::connect(&connected).expect("taken"));
    let mut clock = 0;
    let mut next = |input: &mut LiveInput| {
        clock += 1;
        input.next(&due(clock)).expect("asked")
    };
    while !application.is_finished() {
        drop(next(&mut input));
        std::thread::sleep(Duration::from_millis(1));
    }
    let mut application = application.join().expect("connected");
    let its = application.device().expect("it shares");
    assert_eq!(DeviceIds { device: its.device, driver: its.driver }, ours.ids());
    let (memory, fd) = std::thread::scope(|scope| {
        let asking = scope.spawn(|| application.share(Duration::from_secs(20)).expect("an answer").expect("memory"));
        while !asking.is_finished() {
            drop(next(&mut input));
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
    let mut writer = SlotWriter::new(&theirs, fd, &layout, memory.slot_stride).expect("imported");
    let host = FrameInfo::new(Content::Views { grid: [3, 3], pitch_mm: 1.0 }, Sample::U8, Transfer::Srgb);
    let there = FrameInfo { on_device: true, ..host };
    let taken = |newest: Newest| -> SceneFrame {
        match newest {
            Newest::New(scene) => scene,
            Newest::Refused(reason) => panic!("{reason}"),
            _ => panic!("nothing came"),
        }
    };
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
    // Numbers of places that do not exist, and other kinds, are refused where they are made.
    let error = application.begin(&FrameInfo { on_device: true, content: Content::ColorAndDepth, ..host }).map(drop);
    assert!(
        matches!(error, Err(LiveError::Frame(FrameFault::Number { found: 1, least: 0, most: 0, .. }))),
        "{error:?}"
    );
    drop(application);
    assert!(matches!(next(&mut input), Newest::Late(_)));
    drop((writer, input));
    silent([ours, theirs]);
}
