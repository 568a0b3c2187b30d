//! Tests an application and a display that follow the rules.
#![cfg(target_os = "linux")]

use eyebox_live_input::{
    Application, Content, Dioptres, Display, FrameInfo, Kind, Latest, LiveError, Offer, Pupil, Request, Sample,
    Transfer, Wanted,
};
use std::path::{Path, PathBuf};
use std::time::Duration;

fn offer() -> Offer {
    Offer {
        size: [4, 5],
        colors: [true; 3],
        kinds: Kind::ALL.to_vec(),
        views: [3, 3],
        layers: 5,
        slots: 3,
        pixel_angle: 2e-5,
        eyebox_mm: [20.0, 18.0],
    }
}

/// A folder that ends with the test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        Self(std::env::temp_dir().join(format!("eyebox-ring-{}-{name}", std::process::id())))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Opens a display and connects an application to it.
fn pair(folder: &Path) -> (Display, Application) {
    let mut display = Display::open_in(folder, "x", offer()).unwrap();
    let mut frame = display.frame();
    let there = folder.to_path_buf();
    let application = std::thread::spawn(move || Application::connect_in(&there, "x"));
    while !display.is_connected() {
        display.wait(Duration::from_secs(1));
        display.latest(&mut frame);
    }
    (display, application.join().unwrap().unwrap())
}

fn request(x: f64) -> Request {
    let pupil = Pupil {
        center_mm: [x, -x],
        diameter_mm: 4.0,
        focus_dioptres: 1.25,
        velocity_mm_s: [30.0, -2.0],
        tracked: true,
    };
    let wanted = Wanted { kind: Kind::Layers, views: [3, 2], pitch_mm: 1.5, center_mm: [0.5, x] };
    Request { number: 0, lit_ns: 1_000_000_007, period_ns: 16_666_667, pupil, wanted }
}

#[test]
fn requests_go_one_way_and_frames_of_each_kind_the_other() {
    let folder = Folder::new("kinds");
    let (mut display, mut application) = pair(&folder.0);
    let mut frame = display.frame();
    assert_eq!((application.offer(), application.request()), (&offer(), None));
    assert_eq!((display.ask(&request(1.0)), display.ask(&request(2.0))), (1, 2));
    assert!(application.wait(Duration::from_secs(10)).unwrap() && !application.wait(Duration::ZERO).unwrap());
    assert_eq!(application.request(), Some(Request { number: 2, ..request(2.0) }));

    // For views, sample s of the whole frame has the value s, as an integer and as light.
    let views = Content::Views { grid: [3, 2], pitch_mm: 1.5 };
    let info = FrameInfo {
        request: 2,
        content_time_ns: -5,
        center_mm: [0.5, 2.0],
        ..FrameInfo::new(views, Sample::U16, Transfer::Linear)
    };
    let samples: Vec<u8> = (0..6 * 4 * 5 * 3u16).flat_map(u16::to_le_bytes).collect();
    assert_eq!(application.send(&info, &samples, &[]).unwrap(), 1);
    assert_eq!(display.latest(&mut frame), Latest::New);
    assert_eq!((frame.info(), frame.number(), frame.dioptres().len()), (&info, 1, 0));
    for color in 0..3 {
        let expected: Vec<f32> = (0..6 * 4 * 5).map(|i| (3 * i + color) as f32 / 65_535.0).collect();
        assert_eq!(frame.channel(color), expected);
    }
    assert!(frame.channel(3).is_empty());
    assert_eq!(display.latest(&mut frame), Latest::Late);

    // Color and depth have 60 bytes of color, and depth begins at byte 64.
    let info = FrameInfo::new(Content::ColorAndDepth, Sample::U8, Transfer::Srgb);
    let dioptres: Vec<f32> = (0..20).map(|i| i as f32 / 10.0 - 0.5).collect();
    assert_eq!(application.send(&info, &[188; 60], &dioptres).unwrap(), 2);
    assert_eq!(display.latest(&mut frame), Latest::New);
    assert!(frame.channel(2).iter().all(|v| (v - 0.502_886).abs() < 1e-5), "{:?}", frame.channel(2));
    assert_eq!(frame.dioptres(), dioptres);

    // For layers, opacity is linear and follows the colors.
    let content = Content::Layers(Dioptres::new(&[0.0, 2.0]));
    let info = FrameInfo::new(content, Sample::F16, Transfer::Linear);
    let pixel = [0x3c00u16, 0x3800, 0x4000, 0x3400].map(u16::to_le_bytes).concat();
    assert_eq!(application.send(&info, &pixel.repeat(2 * 4 * 5), &[]).unwrap(), 3);
    assert_eq!(display.latest(&mut frame), Latest::New);
    let seen = [0, 1, 2, 3].map(|c| (frame.channel(c).len(), frame.channel(c)[39]));
    assert_eq!((seen, frame.dioptres().len()), ([(40, 1.0), (40, 0.5), (40, 2.0), (40, 0.25)], 0));
    assert_eq!(frame.info().content, content);

    drop(application);
    assert_eq!((display.latest(&mut frame), frame.number()), (Latest::Gone, 3));
    let counts = display.counts();
    assert_eq!((counts.applications, counts.frames, counts.refused, counts.torn), (1, 3, 0, 0));
}

#[test]
fn the_newest_wins_and_what_was_given_before_the_end_is_taken() {
    let folder = Folder::new("newest");
    let (mut display, mut application) = pair(&folder.0);
    let mut frame = display.frame();
    let info = FrameInfo::new(Content::ColorAndDepth, Sample::U8, Transfer::Linear);
    for value in 0..100u8 {
        application.send(&info, &[value; 60], &[0.0; 20]).unwrap();
    }
    // A frame that was begun and never published does no harm.
    let mut slot = application.begin(&info).unwrap();
    slot.write(0, &[255; 60]);
    drop(application);
    // The next application connects at once, and is accepted after the last frame of this one is used.
    let there = folder.0.clone();
    let next = std::thread::spawn(move || Application::connect_in(&there, "x").unwrap());
    // It must have connected before the display looks, and only a delay can ensure this.
    std::thread::sleep(Duration::from_millis(50));
    assert_eq!((display.latest(&mut frame), frame.number(), frame.channel(0)[7]), (Latest::New, 100, 99.0 / 255.0));
    while !next.is_finished() {
        assert_eq!(display.latest(&mut frame), Latest::Gone);
        display.wait(Duration::from_secs(1));
        if display.is_connected() {
            break;
        }
    }
    let mut next = next.join().unwrap();
    assert_eq!((display.latest(&mut frame), frame.number()), (Latest::Late, 100));
    next.send(&info, &[1; 60], &[0.0; 20]).unwrap();
    assert_eq!((display.latest(&mut frame), frame.number()), (Latest::New, 1));
    drop(display);
    assert!(matches!(next.wait(Duration::from_secs(10)), Err(LiveError::Gone)));
}

#[test]
fn what_the_display_would_refuse_is_refused_where_it_is_made() {
    let folder = Folder::new("refused");
    let (_display, mut application) = pair(&folder.0);
    let mut refused = |content, sample, transfer, bytes: usize| {
        let info = FrameInfo::new(content, sample, transfer);
        application.send(&info, &vec![0; bytes], &[]).unwrap_err().to_string()
    };
    let views = Content::Views { grid: [4, 1], pitch_mm: 1.0 };
    let lines = [
        (refused(views, Sample::U8, Transfer::Linear, 240), "rows of views 4, but it must be 1 to 3"),
        (
            refused(Content::Views { grid: [1, 1], pitch_mm: 1.0 }, Sample::F32, Transfer::Srgb, 240),
            "transfer 2, but it must be 1, linear, for floats",
        ),
        (
            refused(Content::Layers(Dioptres::new(&[2.0, 1.0])), Sample::U8, Transfer::Linear, 160),
            "a layer's dioptres 1, but it must be -100 to 100, and more than the layer behind",
        ),
        (refused(Content::ColorAndDepth, Sample::U8, Transfer::Linear, 61), "bytes 61, but it must be 60"),
        (refused(Content::ColorAndDepth, Sample::U8, Transfer::Linear, 60), "depths 0, but it must be 20"),
    ];
    for (found, expected) in lines {
        assert_eq!(found, format!("the application's frame is refused: {expected}"));
    }
}

#[test]
fn nothing_is_allocated_once_an_application_is_there() {
    let folder = Folder::new("steady");
    let (mut display, mut application) = pair(&folder.0);
    let mut frame = display.frame();
    let kinds = [
        Content::ColorAndDepth,
        Content::Views { grid: [3, 3], pitch_mm: 1.0 },
        Content::Layers(Dioptres::new(&[0.0, 1.0, 2.0, 3.0, 4.0])),
    ];
    let mut samples = [60, 540, 400].map(|n| vec![9u8; 4 * n]);
    samples.iter_mut().for_each(|s| s.as_chunks_mut::<4>().0.fill(0.5f32.to_le_bytes()));
    let dioptres = [1.0; 20];
    let allocated = allocation_counter::measure(|| {
        for i in 0..30 {
            let info = FrameInfo::new(kinds[i % 3], Sample::F32, Transfer::Linear);
            let depth = if i % 3 == 0 { &dioptres[..] } else { &[] };
            application.send(&info, &samples[i % 3], depth).unwrap();
            display.ask(&request(i as f64));
            assert_eq!(display.latest(&mut frame), Latest::New);
            assert_eq!(display.latest(&mut frame), Latest::Late);
        }
    });
    assert_eq!(allocated.count_total, 0, "{allocated:?}");
}

/// An application and a display run at full speed, each on its thread. Each accepted frame is complete and newer than
/// the last.
#[test]
fn frames_are_whole_and_in_order_at_full_speed() {
    let folder = Folder::new("speed");
    let (mut display, mut application) = pair(&folder.0);
    let mut frame = display.frame();
    let info = FrameInfo::new(Content::Views { grid: [3, 3], pitch_mm: 1.0 }, Sample::U16, Transfer::Linear);
    let sender = std::thread::spawn(move || {
        for number in 1..=20_000u16 {
            let samples: Vec<u8> = number.to_le_bytes().repeat(540);
            application.send(&info, &samples, &[]).unwrap();
        }
    });
    let mut last = 0;
    loop {
        match display.latest(&mut frame) {
            Latest::New => {
                assert!(frame.number() > last);
                last = frame.number();
                let light = last as f32 / 65_535.0;
                assert!((0..3).all(|c| frame.channel(c).iter().all(|v| *v == light)), "frame {last} is torn");
            }
            Latest::Late => {}
            Latest::Gone => break,
            other => panic!("{other:?}"),
        }
    }
    sender.join().unwrap();
    assert_eq!((last, display.counts().refused), (20_000, 0));
}
