//! Tests device memory between a display and applications that follow the rules or break them. The device is a file in
//! memory.

use crate::device::{self, DeviceMemory, WORDS};
use crate::region::Region;
use crate::{
    Application, Content, DeviceIds, Dioptres, Display, Frame, FrameFault, FrameInfo, Kind, Latest, LiveError, Offer,
    Sample, Transfer, ViewTaker, layout,
};
use rustix::fs::MemfdFlags;
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

const IDS: DeviceIds = DeviceIds { device: *b"a device of ours", driver: *b"its driver, too." };

fn offer() -> Offer {
    Offer {
        size: [6, 7],
        colors: [false, true, false],
        kinds: Kind::ALL.to_vec(),
        views: [1, 2],
        layers: 2,
        slots: 3,
        pixel_angle: 2e-5,
        eyebox_mm: [20.0, 18.0],
    }
}

/// A device that decodes nothing.
#[derive(Default)]
struct Device {
    /// True if it takes color and depth that came through the region.
    takes_depth: bool,
    /// True if it leaves color and depth of its own memory to the host.
    returns_depth: bool,
    /// The shared memory, with the words of all slots.
    memory: Option<Region>,
    stride: u64,
    has_none: bool,
    is_gone: bool,
    /// The slot and the copied bytes of the last frame.
    taken: Option<(usize, Vec<u8>)>,
    /// Functions that run in the middle of the next copies.
    middle: Vec<Box<dyn FnOnce()>>,
    unshared: u32,
}

impl ViewTaker for Device {
    fn take(&mut self, samples: &[u8], info: &FrameInfo) -> Option<Result<(), FrameFault>> {
        assert!(!info.on_device && !matches!(info.content, Content::Layers(_)));
        (self.takes_depth && info.content == Content::ColorAndDepth).then(|| {
            // The samples have no slot.
            self.taken = Some((usize::MAX, samples.to_vec()));
            Ok(())
        })
    }

    fn device(&self) -> Option<DeviceIds> {
        (!self.is_gone).then_some(IDS)
    }

    fn share(&mut self, slots: u32, room: u64) -> Option<(DeviceMemory, OwnedFd)> {
        if self.has_none {
            return None;
        }
        self.stride = room.next_multiple_of(256);
        let bytes = self.stride * u64::from(slots);
        let memory = Region::new(bytes).unwrap();
        let fd = memory.fd().try_clone().unwrap();
        self.memory = Some(memory);
        let (memory_type, usage) = (3, 0x23);
        let (memory_bytes, slot_stride) = (bytes, self.stride);
        Some((DeviceMemory { ids: IDS, memory_bytes, buffer_bytes: bytes, slot_stride, memory_type, usage }, fd))
    }

    fn take_shared(&mut self, slot: usize, samples: &mut [u8], info: &FrameInfo) -> Result<bool, FrameFault> {
        self.memory.as_ref().unwrap().load_bytes(slot * self.stride as usize / 8, samples);
        let copy = samples.to_vec();
        if !self.middle.is_empty() {
            self.middle.remove(0)();
        }
        if copy[0] == 255 {
            return Err(FrameFault::Value { channel: 0, index: 0, found: f32::NAN, must: "0 to 65504" });
        }
        if self.returns_depth && info.content == Content::ColorAndDepth {
            return Ok(false);
        }
        self.taken = Some((slot, copy));
        Ok(true)
    }

    fn unshare(&mut self) {
        (self.memory, self.unshared) = (None, self.unshared + 1);
    }
}

struct Bench {
    folder: PathBuf,
    display: Display,
    frame: Frame,
    device: Device,
}

impl Bench {
    fn new(name: &str, device: Device) -> Self {
        let folder = std::env::temp_dir().join(format!("eyebox-shared-{}-{name}", std::process::id()));
        let display = Display::open_in(&folder, "x", offer()).unwrap();
        Self { folder, frame: display.frame(), display, device }
    }

    fn latest(&mut self) -> Latest {
        self.display.latest_to(&mut self.frame, &mut self.device)
    }

    /// Returns the result of an application's call while the display answers.
    fn answered<T: Send + 'static>(&mut self, ask: impl FnOnce() -> T + Send + 'static) -> T {
        let asking = std::thread::spawn(ask);
        while !asking.is_finished() {
            self.display.wait(Duration::from_millis(1));
            self.latest();
        }
        asking.join().unwrap()
    }

    fn application(&mut self) -> Application {
        let folder = self.folder.clone();
        self.answered(move || Application::connect_in(&folder, "x").unwrap())
    }

    /// Connects an application with shared memory, and returns the memory that it received.
    fn sharing(&mut self) -> (Application, DeviceMemory, Region) {
        let mut application = self.application();
        let (application, shared) = self.answered(move || {
            let shared = application.share(Duration::from_secs(20)).unwrap();
            (application, shared)
        });
        let (memory, fd) = shared.unwrap();
        let there = Region::received(fd, memory.memory_bytes).unwrap();
        (application, memory, there)
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

fn views(on_device: bool) -> FrameInfo {
    let content = Content::Views { grid: [1, 2], pitch_mm: 1.0 };
    FrameInfo { on_device, ..FrameInfo::new(content, Sample::U8, Transfer::Srgb) }
}

/// Leaves a frame of one value on the device.
fn give(application: &mut Application, memory: &DeviceMemory, there: &Region, value: u8) -> usize {
    put(application, memory, there, &views(true), &[value; 84])
}

/// Leaves these samples on the device.
fn put(
    application: &mut Application,
    memory: &DeviceMemory,
    there: &Region,
    info: &FrameInfo,
    samples: &[u8],
) -> usize {
    let slot = application.begin(info).unwrap();
    let index = slot.index();
    there.store_bytes(index * memory.slot_stride as usize / 8, samples);
    slot.publish();
    index
}

/// Describes color and depth of 42 pixels of one color. In float32, the depth begins at byte 192.
fn depth(sample: Sample, on_device: bool) -> FrameInfo {
    FrameInfo { on_device, ..FrameInfo::new(Content::ColorAndDepth, sample, Transfer::Linear) }
}

/// Color and depth have the layout of the region, on the device and in the region, and layers are never on the device.
#[test]
fn color_and_depth_come_by_the_device_too() {
    let mut bench = Bench::new("depth", Device::default());
    let (mut application, memory, there) = bench.sharing();
    for (sample, from, all) in [(Sample::U8, 64, 232), (Sample::F16, 128, 296), (Sample::F32, 192, 360)] {
        let mut samples = vec![3; all];
        samples[from..].fill(5);
        let slot = put(&mut application, &memory, &there, &depth(sample, true), &samples);
        assert_eq!(bench.latest(), Latest::New);
        assert_eq!(bench.device.taken.take(), Some((slot, samples)));
        let frame = &bench.frame;
        assert!(frame.is_taken() && frame.channel(0).is_empty() && frame.dioptres().is_empty());
        assert_eq!(*frame.info(), depth(sample, true));
    }
    // The same content comes through the region, first decoded by the host and then by the device.
    let dioptres: Vec<f32> = (0..42).map(|i| i as f32 / 8.0).collect();
    application.send(&depth(Sample::U8, false), &[51; 42], &dioptres).unwrap();
    assert_eq!((bench.latest(), bench.device.taken.take()), (Latest::New, None));
    assert!(!bench.frame.is_taken() && bench.frame.channel(0) == [0.2; 42] && bench.frame.dioptres() == dioptres);
    bench.device.takes_depth = true;
    application.send(&depth(Sample::U8, false), &[51; 42], &dioptres).unwrap();
    assert_eq!(bench.latest(), Latest::New);
    let (_, samples) = bench.device.taken.take().unwrap();
    assert!(samples.len() == 232 && samples[..42] == [51; 42]);
    let stored: Vec<f32> = samples[64..].chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    assert!(bench.frame.is_taken() && bench.frame.dioptres().is_empty() && stored == dioptres);
    // The device leaves the frame in its memory to the host, which decodes and checks it.
    (bench.device.takes_depth, bench.device.returns_depth) = (false, true);
    for wrong in [false, true] {
        let mut samples = samples.clone();
        if wrong {
            samples[64..68].copy_from_slice(&f32::NAN.to_le_bytes());
        }
        put(&mut application, &memory, &there, &depth(Sample::U8, true), &samples);
        let found = bench.latest();
        assert!(if wrong { matches!(found, Latest::Refused(FrameFault::Value { .. })) } else { found == Latest::New });
        assert!(!bench.frame.is_taken() && bench.frame.channel(0) == [0.2; 42] && bench.frame.dioptres() == dioptres);
    }
    let layers = Content::Layers(Dioptres::new(&[0.5]));
    let layers = FrameInfo { content: layers, ..depth(Sample::U8, true) };
    let fault = application.begin(&layers).map(drop).unwrap_err();
    assert!(fault.to_string().ends_with("the place of the samples 1, but it must be 0"), "{fault}");
    let layers = FrameInfo { on_device: false, ..layers };
    application.send(&layers, &[9; 84], &[]).unwrap();
    assert_eq!((bench.latest(), bench.frame.is_taken()), (Latest::New, false));
}

#[test]
fn frames_come_by_the_device_where_the_application_asks_for_it() {
    let mut bench = Bench::new("asks", Device::default());
    let (mut application, memory, there) = bench.sharing();
    assert_eq!((application.device(), memory.ids, memory.memory_type, memory.usage), (Some(IDS), IDS, 3, 0x23));
    for value in 1..5 {
        let slot = give(&mut application, &memory, &there, value);
        assert_eq!(bench.latest(), Latest::New);
        assert_eq!(bench.device.taken.take(), Some((slot, vec![value; 84])));
        assert!(bench.frame.is_taken() && bench.frame.channel(0).is_empty() && bench.frame.info().on_device);
        // Frames of the region and of other kinds come between them.
        application.send(&views(false), &[value; 84], &[]).unwrap();
        assert_eq!(bench.latest(), Latest::New);
        assert!(!bench.frame.is_taken() && bench.device.taken.is_none() && bench.frame.channel(0).len() == 84);
    }
    // Values that are no light are refused, and the frame before stays.
    give(&mut application, &memory, &there, 255);
    assert!(matches!(bench.latest(), Latest::Refused(FrameFault::Value { .. })));
    assert_eq!((bench.frame.number(), bench.latest()), (8, Latest::Late));
    drop(application);
    assert_eq!((bench.latest(), bench.device.unshared), (Latest::Gone, 1));
    // The next application must request its own memory.
    let mut application = bench.application();
    assert!(application.begin(&views(true)).is_err() && bench.device.memory.is_none());
}

#[test]
fn where_there_is_none_the_region_serves() {
    let mut bench = Bench::new("none", Device { has_none: true, ..Device::default() });
    let mut application = bench.application();
    assert_eq!(application.device(), Some(IDS));
    let (mut application, shared) = bench.answered(move || {
        let shared = application.share(Duration::from_secs(20)).unwrap();
        (application, shared)
    });
    assert!(shared.is_none() && application.device().is_none());
    application.send(&views(false), &[9; 84], &[]).unwrap();
    assert_eq!(bench.latest(), Latest::New);
    drop((application, bench));
    let mut bench = Bench::new("gone", Device { is_gone: true, ..Device::default() });
    let mut application = bench.application();
    assert!(application.device().is_none() && application.share(Duration::from_secs(20)).unwrap().is_none());
}

/// An application that writes into a slot during its copy, names slots that it did not receive, or overwrites all
/// words.
#[test]
fn hostile_applications_take_nothing_away() {
    let mut bench = Bench::new("hostile", Device::default());
    let mut application = bench.application();
    // The frame claims to be on a device that the application never requested.
    let words = layout::header_words(&offer(), &views(true), 1);
    let start = layout::slot_word(&offer(), 1);
    let put = |application: &Application, sequence: u64, number: u64| {
        let region = application.region();
        region.store(start + 1, &words[1..]);
        region.word(start + 1).store(number, Ordering::Relaxed);
        region.word(start).store(sequence, Ordering::Release);
    };
    put(&application, 2, 1);
    let Latest::Refused(fault) = bench.latest() else { panic!("it was taken") };
    assert!(fault.to_string().ends_with("the place of the samples 1, but it must be 0"), "{fault}");
    application.region().word(layout::SHARES).store(u64::MAX, Ordering::Relaxed);
    assert_eq!((application.device(), bench.latest()), (None, Latest::Late));
    drop(application);
    assert_eq!(bench.latest(), Latest::Gone);

    let memory;
    let there;
    (application, memory, there) = bench.sharing();
    give(&mut application, &memory, &there, 7);
    assert_eq!(bench.latest(), Latest::New);
    // The slot changes during four copies and is stable afterwards.
    let region = std::sync::Arc::new(
        Region::received(application.region().fd().try_clone().unwrap(), offer().region_bytes()).unwrap(),
    );
    for _ in 0..4 {
        let region = std::sync::Arc::clone(&region);
        let mut sequence = 100;
        bench.device.middle.push(Box::new(move || {
            sequence += region.word(start).load(Ordering::Relaxed);
            region.word(start).store(2 * sequence, Ordering::Release);
        }));
    }
    there.store_bytes(memory.slot_stride as usize / 8, &[8; 84]);
    put(&application, 50, 60);
    assert_eq!(
        (bench.latest(), bench.frame.number(), bench.display.counts().torn),
        (Latest::Refused(FrameFault::Torn), 1, 4)
    );
    assert_eq!((bench.latest(), bench.frame.number()), (Latest::New, 60));
    // The application overwrites the display's words, but the display never reads them back.
    for at in layout::DEVICE..layout::DEVICE + WORDS {
        application.region().word(at).store(u64::MAX, Ordering::Relaxed);
    }
    application.region().word(layout::WANTED).store(u64::MAX, Ordering::Relaxed);
    put(&application, 70, 61);
    assert_eq!((bench.latest(), bench.frame.number(), bench.device.unshared), (Latest::New, 61, 0));
    assert_eq!(bench.device.taken, Some((1, vec![8; 84])));
}

/// A display whose device fails disconnects the application that writes there. An application that uses only the region
/// continues.
#[test]
fn a_device_that_fails_ends_its_applications_alone() {
    let mut bench = Bench::new("fails", Device::default());
    let (mut application, memory, there) = bench.sharing();
    give(&mut application, &memory, &there, 1);
    assert_eq!(bench.latest(), Latest::New);
    bench.device.is_gone = true;
    assert_eq!((bench.latest(), bench.device.unshared), (Latest::Gone, 1));
    assert!(matches!(application.wait(Duration::from_secs(10)), Err(LiveError::Gone)));
    let mut application = bench.application();
    assert!(application.device().is_none());
    application.send(&views(false), &[3; 84], &[]).unwrap();
    assert_eq!(bench.latest(), Latest::New);
}

#[test]
fn what_could_be_cut_is_sealed_and_what_cannot_hold_the_slots_is_refused() {
    let fd = rustix::fs::memfd_create("loose", MemfdFlags::ALLOW_SEALING).unwrap();
    rustix::fs::ftruncate(&fd, 8192).unwrap();
    assert!(device::is_fixed(&fd));
    rustix::fs::ftruncate(&fd, 4096).unwrap_err();
    // The seals of this memory are sealed, so that it can always be cut.
    let fd = rustix::fs::memfd_create("cut", MemfdFlags::empty()).unwrap();
    assert!(!device::is_fixed(&fd));

    let good = DeviceMemory {
        ids: IDS,
        memory_bytes: 4096,
        buffer_bytes: 3072,
        slot_stride: 1024,
        memory_type: 1,
        usage: 0x23,
    };
    assert_eq!(DeviceMemory::of(&good.words(), 3, 1000), Some(good));
    for (slots, room) in [(4, 1000), (3, 1025), (u32::MAX, 1)] {
        assert_eq!(DeviceMemory::of(&good.words(), slots, room), None);
    }
    let mut random = fastrand::Rng::with_seed(5);
    for _ in 0..100_000 {
        let mut words = good.words();
        let odd = [0, 1, 1 << 31, u64::MAX, random.u64(..)];
        words[random.usize(4..8)] = odd[random.usize(0..odd.len())];
        if let Some(found) = DeviceMemory::of(&words, 3, 1000) {
            assert!(found.slot_stride >= 1000 && u128::from(found.slot_stride) * 3 <= u128::from(found.buffer_bytes));
            assert!(found.buffer_bytes <= found.memory_bytes);
        }
    }
}
