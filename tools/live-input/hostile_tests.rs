//! Tests applications that send invalid data, write anywhere, stop or die. The last good frame always stays.

use crate::device::Nobody;
use crate::layout::{self, HEADER_WORDS, Header, SLOT_HEADER};
use crate::region::Region;
use crate::{
    Application, Content, Dioptres, Display, Frame, FrameFault, FrameInfo, Kind, Latest, LiveError, Offer, Sample,
    Transfer, socket,
};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

fn offer() -> Offer {
    Offer {
        size: [6, 7],
        colors: [true, false, true],
        kinds: Kind::ALL.to_vec(),
        views: [3, 2],
        layers: 4,
        slots: 3,
        pixel_angle: 2e-5,
        eyebox_mm: [20.0, 18.0],
    }
}

fn folder() -> PathBuf {
    static COUNT: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
    let name = format!("eyebox-hostile-{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
    std::env::temp_dir().join(name)
}

/// A display, and the region of an application that ignores all rules.
struct Bench {
    folder: PathBuf,
    display: Display,
    frame: Frame,
    stream: UnixStream,
    region: Region,
}

impl Bench {
    fn new() -> Self {
        let folder = folder();
        let mut display = Display::open_in(&folder, "x", offer()).unwrap();
        let mut frame = display.frame();
        let stream = UnixStream::connect(folder.join("x.sock")).unwrap();
        assert_eq!(display.latest(&mut frame), Latest::Gone);
        let (fd, bytes) = socket::greeted(&stream, Duration::from_secs(10)).unwrap();
        let region = Region::received(fd, bytes).unwrap();
        Self { folder, display, frame, stream, region }
    }

    fn latest(&mut self) -> Latest {
        self.display.latest(&mut self.frame)
    }

    /// Writes this header and samples of this value into a slot.
    fn put(&self, slot: usize, sequence: u64, header: &Header, fill: u8) {
        let start = layout::slot_word(&offer(), slot);
        self.region.store(start + 1, &header[1..]);
        self.region.store_bytes(start + SLOT_HEADER, &vec![fill; offer().slot_bytes()]);
        self.region.word(start).store(sequence, Ordering::Release);
    }

    /// Sends a good frame whose samples all have this value.
    fn good(&mut self, number: u64, fill: u8) {
        self.put(0, 2 * number, &header(number), fill);
        assert_eq!(self.latest(), Latest::New);
        self.is(fill);
    }

    fn is(&self, fill: u8) {
        let light = f32::from(fill) / 255.0;
        assert!(self.frame.channel(0).len() == 42 && self.frame.channel(0).iter().all(|v| *v == light), "not {fill}");
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

fn layers() -> FrameInfo {
    let dioptres = Content::Layers(Dioptres::new(&[0.0, 1.5, 2.5]));
    FrameInfo { center_mm: [3.0, -2.0], ..FrameInfo::new(dioptres, Sample::U8, Transfer::Linear) }
}

fn header(number: u64) -> Header {
    let views = Content::Views { grid: [1, 1], pitch_mm: 2.0 };
    layout::header_words(&offer(), &FrameInfo::new(views, Sample::U8, Transfer::Linear), number)
}

/// Values that are read from a header are within bounds, and they describe the header completely.
#[test]
fn a_million_fuzzed_headers() {
    let (offer, mut random) = (offer(), fastrand::Rng::with_seed(1));
    let kinds = [
        Content::Views { grid: [3, 2], pitch_mm: 2.0 },
        Content::ColorAndDepth,
        Content::Layers(Dioptres::new(&[-0.5, 0.0, 1.0, 4.0])),
    ];
    let good = kinds.map(|content| layout::header_words(&offer, &FrameInfo { content, ..layers() }, 5));
    let odd = [0, 1, 1 << 31, u64::from(u32::MAX), 1 << 63, u64::MAX, f64::NAN.to_bits(), 0x7f80_0000_7f80_0000];
    let (mut taken, mut messages) = (0u32, std::collections::BTreeSet::new());
    for i in 0..1_000_000u32 {
        let mut words: Header = good[i as usize % 3];
        for _ in 0..random.u32(0..4) {
            let word = &mut words[random.usize(1..HEADER_WORDS)];
            match random.u32(0..4) {
                0 => *word = random.u64(..),
                1 => *word ^= 1 << random.u32(0..64),
                2 => *word = odd[random.usize(0..odd.len())],
                _ => *word = word.wrapping_add(1),
            }
        }
        if i % 10 == 0 {
            words[1..].fill_with(|| random.u64(..));
        }
        match layout::read_header(&words, &offer, i % 2 == 1) {
            Ok(info) => {
                taken += 1;
                assert!(!info.on_device || (i % 2 == 1 && !matches!(info.content, Content::Layers(_))));
                assert!(offer.bytes(&info.content, info.sample)[0] <= offer.slot_bytes());
                let again = layout::read_header(&layout::header_words(&offer, &info, words[1]), &offer, true);
                assert_eq!(again, Ok(info));
            }
            Err(fault) if i < 10_000 => {
                let line = fault.to_string();
                assert!(line.contains("it must be") && !line.contains('\n'), "{line}");
                messages.insert(line.split_whitespace().nth(5).unwrap_or_default().to_string());
            }
            Err(_) => {}
        }
    }
    assert!(taken > 100_000 && taken < 900_000 && messages.len() >= 8, "{taken} taken, {messages:?}");
}

#[test]
fn each_lie_is_one_line_and_the_last_good_frame_stays() {
    let mut bench = Bench::new();
    bench.good(1, 100);
    let huge = 1 << 31 | 1 << 63;
    let lies: [(usize, u64, &str); 12] = [
        (4, 1 << 32 | 8, "kind 8, but it must be one that the display takes"),
        (4, 9 << 32 | 1, "sample 9, but it must be 1 to 4"),
        (5, 5 << 32 | 7, "transfer 7, but it must be 1, linear, or 2, sRGB"),
        (5, 7 << 32 | 1, "colors 7, but it must be 5"),
        (6, huge, "rows 2147483648, but it must be 6"),
        (6, 1 << 63 | 6, "columns 2147483648, but it must be 7"),
        (7, huge, "rows of views 2147483648, but it must be 1 to 3"),
        (7, 0, "rows of views 0, but it must be 1 to 3"),
        (8, f64::NAN.to_bits(), "the view pitch, mm, NaN, but it must be a finite number, at most a meter"),
        (9, 1e9f64.to_bits(), "the camera's x, mm, 1000000000, but it must be"),
        (11, 1 << 31, "layers 2147483648, but it must be 0"),
        (12, u64::MAX, "bytes 18446744073709551615, but it must be 84"),
    ];
    for (i, (word, value, line)) in lies.into_iter().enumerate() {
        let mut words = header(2);
        words[word] = value;
        bench.put(1, 2 + 2 * i as u64, &words, 7);
        let Latest::Refused(fault) = bench.latest() else { panic!("{line}: taken") };
        assert!(fault.to_string().contains(line), "{fault}");
        // The frame is refused once, and no other frame is lost by it.
        assert_eq!(bench.latest(), Latest::Late);
        bench.is(100);
    }
    // This frame number would leave no room for later ones.
    bench.put(1, 90, &header(u64::MAX), 7);
    let Latest::Refused(fault) = bench.latest() else { panic!("taken") };
    assert!(fault.to_string().contains("frame number 18446744073709551615, but it must be 2 to"), "{fault}");
    // These floats are no light.
    let views = Content::Views { grid: [1, 1], pitch_mm: 2.0 };
    let float = FrameInfo::new(views, Sample::F32, Transfer::Linear);
    bench.put(1, 92, &layout::header_words(&offer(), &float, 3), 0xff);
    assert!(matches!(bench.latest(), Latest::Refused(FrameFault::Value { channel: 0, index: 0, .. })));
    bench.is(100);
    bench.good(4, 50);
    assert_eq!(bench.display.counts().refused, 14);
}

#[test]
fn a_frame_that_never_ends_is_not_looked_at_and_one_that_changes_is_torn() {
    let mut bench = Bench::new();
    bench.good(1, 100);
    bench.put(1, 3, &header(2), 7);
    assert_eq!(bench.latest(), Latest::Late);
    // The application dies in the middle of writing. The last frame stays, and another application may connect.
    bench.stream = UnixStream::connect(bench.folder.join("x.sock")).unwrap();
    assert_eq!((bench.latest(), bench.latest()), (Latest::Gone, Latest::Late));
    bench.is(100);
    let (fd, bytes) = socket::greeted(&bench.stream, Duration::from_secs(10)).unwrap();
    bench.region = Region::received(fd, bytes).unwrap();
    bench.good(1, 30);
    assert_eq!(bench.display.counts().applications, 2);
}

/// The change happens at an exact point. A slot that changes in the middle of a copy is copied again, at most four
/// times.
#[test]
fn a_slot_that_changes_in_the_middle_of_its_copy_is_thrown_away() {
    let mut bench = Bench::new();
    bench.good(1, 100);
    bench.put(1, 2, &header(2), 7);
    let start = layout::slot_word(&offer(), 1);
    let Bench { display, frame, region, .. } = &mut bench;
    let mut changes = 0;
    let mut again = |most: u64| {
        let mut change = || {
            assert_eq!(region.word(layout::HELD).load(Ordering::Relaxed), 2, "the region has the slot that is copied");
            changes += 1;
            if changes <= most {
                region.store_bytes(start + SLOT_HEADER, &vec![7 + changes as u8; offer().slot_bytes()]);
                region.word(start).store(2 + 2 * changes, Ordering::Release);
            }
        };
        display.latest_with(frame, &mut Nobody, &mut change)
    };
    assert_eq!(again(u64::MAX), Latest::Refused(FrameFault::Torn));
    // The slot changes once more and is then accepted.
    assert_eq!(again(5), Latest::New);
    assert_eq!((display.counts().torn, region.word(layout::HELD).load(Ordering::Relaxed)), (5, 0));
    bench.is(12);
}

/// Stops a thread when it is dropped.
struct End<'a>(&'a AtomicBool);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// A thread writes slots again and again with frames of one value, whether they are held or not, and half of them with
/// an invalid header. All accepted frames have a single value.
#[test]
fn nothing_torn_is_taken_while_a_thread_scribbles() {
    let mut bench = Bench::new();
    bench.good(1, 100);
    let (start, bytes) = (layout::slot_word(&offer(), 0), offer().slot_bytes());
    let stop = AtomicBool::new(false);
    let (mut taken, mut refused) = (0, 0);
    let Bench { display, frame, region, .. } = &mut bench;
    let region = &*region;
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut number = 1u64;
            while !stop.load(Ordering::Relaxed) {
                number += 1;
                let slot = start + (number as usize % 3) * (layout::slot_word(&offer(), 1) - start);
                let sequence = region.word(slot).load(Ordering::Relaxed);
                region.word(slot).store(sequence | 1, Ordering::Relaxed);
                std::sync::atomic::fence(Ordering::SeqCst);
                let mut words = header(number);
                if number.is_multiple_of(2) {
                    words[number as usize % HEADER_WORDS] = u64::MAX;
                }
                region.store(slot + 1, &words[1..]);
                region.store_bytes(slot + SLOT_HEADER, &vec![number as u8; bytes]);
                region.word(slot).store((sequence | 1) + 1, Ordering::Release);
            }
        });
        // The thread ends with this one, also if this one panics.
        let _end = End(&stop);
        for _ in 0..20_000 {
            match display.latest(frame) {
                Latest::New => {
                    taken += 1;
                    let all = frame.channel(0).iter().chain(frame.channel(1));
                    let light = (frame.number() as u8) as f32 / 255.0;
                    assert!(all.clone().all(|v| *v == light), "torn: {:?}", all.collect::<Vec<_>>());
                }
                Latest::Refused(_) => refused += 1,
                other => assert_eq!(other, Latest::Late),
            }
        }
    });
    // The numbers depend on the machine.
    assert!(taken + refused <= 20_000);
}

/// An application may overwrite the whole region, including the display's own words. The display never reads those
/// back.
#[test]
fn random_bytes_everywhere() {
    let mut bench = Bench::new();
    bench.good(1, 100);
    let mut random = fastrand::Rng::with_seed(2);
    let words = offer().region_bytes() as usize / 8;
    for round in 0..50 {
        for at in 0..words {
            bench.region.word(at).store(random.u64(..), Ordering::Relaxed);
        }
        bench.display.ask(&request());
        assert!(matches!(bench.latest(), Latest::Late | Latest::Refused(_)), "round {round}");
        bench.is(100);
    }
    // A hole in the shared memory reads as zeros.
    use rustix::fs::FallocateFlags;
    let hole = FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE;
    rustix::fs::fallocate(bench.region.fd(), hole, 0, offer().region_bytes()).unwrap();
    assert_eq!(bench.latest(), Latest::Late);
    bench.good(2, 20);
}

fn request() -> crate::Request {
    crate::Request {
        number: 0,
        lit_ns: 1,
        period_ns: 2,
        pupil: crate::Pupil {
            center_mm: [1.0, 2.0],
            diameter_mm: 4.0,
            focus_dioptres: 0.5,
            velocity_mm_s: [0.0; 2],
            tracked: true,
        },
        wanted: crate::Wanted { kind: Kind::Views, views: [3, 2], pitch_mm: 2.0, center_mm: [0.0; 2] },
    }
}

#[test]
fn a_flood_of_bytes_and_callers_takes_nothing_away() {
    use std::io::{Read, Write};
    let mut bench = Bench::new();
    bench.good(1, 100);
    let mut callers: Vec<_> = (0..20).map(|_| UnixStream::connect(bench.folder.join("x.sock")).unwrap()).collect();
    bench.stream.set_nonblocking(true).unwrap();
    while bench.stream.write(&[0; 4096]).is_ok() {}
    // Replies are lost if no process reads them.
    for _ in 0..100_000 {
        bench.display.ask(&request());
    }
    for _ in 0..10 {
        assert_eq!(bench.latest(), Latest::Late);
    }
    bench.good(2, 60);
    assert_eq!(bench.display.counts().turned_away, 20);
    let mut message = [0; socket::GREETING];
    callers[0].read_exact(&mut message).unwrap();
    assert!(String::from_utf8_lossy(&message).contains("it already has an application, and accepts one at a time"));
}

#[test]
fn two_displays_two_applications_and_folders_that_are_not_safe() {
    let folder = folder();
    let none = Application::connect_in(&folder, "x").unwrap_err().to_string();
    assert!(none.contains("live:x: no display takes frames there ("), "{none}");
    let display = Display::open_in(&folder, "x", offer()).unwrap();
    let second = Display::open_in(&folder, "x", offer()).unwrap_err().to_string();
    assert_eq!(second, "live:x: another display takes frames there. Choose another name.");
    drop(display);
    // The socket of a dead display is replaced.
    std::fs::write(folder.join("x.sock"), "").unwrap();
    drop(Display::open_in(&folder, "x", offer()).unwrap());
    assert!(!folder.join("x.sock").exists());

    std::fs::set_permissions(&folder, PermissionsExt::from_mode(0o755)).unwrap();
    let open = Display::open_in(&folder, "x", offer()).unwrap_err().to_string();
    assert!(open.contains("open to other users. Run chmod 700"), "{open}");
    std::fs::set_permissions(&folder, PermissionsExt::from_mode(0o700)).unwrap();
    let link = folder.join("link");
    std::os::unix::fs::symlink(&folder, &link).unwrap();
    let error = Display::open_in(&link, "x", offer()).unwrap_err().to_string();
    assert!(error.contains("not a folder (a link is not accepted)"), "{error}");
    let other = Offer { slots: 2, ..offer() };
    let error = Display::open_in(&folder, "x", other).unwrap_err().to_string();
    assert_eq!(error, "live input: the number of slots is 2, but it must be 3 to 8");
    let other = Offer { size: [65_536, 65_536], views: [64, 64], ..offer() };
    assert!(matches!(Display::open_in(&folder, "x", other), Err(LiveError::Offer { .. })));
    std::fs::remove_dir_all(&folder).unwrap();
}

/// The folder keeps other users out. If it is open after all, each side checks the user of the other. This test needs
/// root.
#[test]
fn another_user_is_turned_away_by_the_kernels_word() {
    use std::os::unix::process::CommandExt;
    let mut bench = Bench::new();
    bench.good(1, 100);
    let socket = bench.folder.join("x.sock");
    std::fs::set_permissions(&bench.folder, PermissionsExt::from_mode(0o777)).unwrap();
    std::fs::set_permissions(&socket, PermissionsExt::from_mode(0o777)).unwrap();
    let code = "import socket, sys; s = socket.socket(socket.AF_UNIX); s.connect(sys.argv[1]); print(s.recv(128)[24:].strip(b'\\0').decode())";
    let mut child = std::process::Command::new("/usr/bin/env");
    child.args(["-i", "PATH=/usr/bin:/bin", "python3", "-c", code]).arg(&socket).uid(65_534).gid(65_534);
    let Ok(child) = child.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::null()).spawn() else {
        return eprintln!("not root, so another user is not tested");
    };
    let child = std::thread::spawn(move || child.wait_with_output().unwrap());
    while !child.is_finished() {
        bench.display.wait(Duration::from_millis(20));
        assert!(matches!(bench.latest(), Latest::Late));
    }
    let said = String::from_utf8(child.join().unwrap().stdout).unwrap();
    if said.is_empty() {
        return eprintln!("no python3 for that user, so another user is not tested");
    }
    let own = rustix::process::geteuid().as_raw();
    assert_eq!(said.trim(), format!("the other side belongs to user 65534, but only user {own} is accepted"));
    bench.is(100);
}

/// The application also checks what an invalid display shares and sends, before it uses it.
#[test]
fn an_application_judges_what_a_display_sends() {
    let good = layout::offer_words(&offer());
    let bytes = offer().region_bytes();
    layout::read_offer(&good, bytes).unwrap();
    layout::read_offer(&[0; layout::OFFER_WORDS], bytes).unwrap_err();
    let mut random = fastrand::Rng::with_seed(3);
    for _ in 0..100_000 {
        let mut words = good;
        words[random.usize(0..10)] ^= random.u64(1..) >> random.u32(0..63);
        // An accepted offer fits its memory.
        if let Ok(offer) = layout::read_offer(&words, bytes) {
            assert_eq!((layout::offer_words(&offer), offer.region_bytes()), (words, bytes));
        }
    }
    layout::read_offer(&good, bytes + 8).unwrap_err();
}
