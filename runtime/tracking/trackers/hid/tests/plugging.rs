//! Tests a device that comes, goes, is silent or floods, behind the bus and without hardware.

use super::super::device::{Bus, HidSource, Info, Port, status_name};
use super::super::{DeviceFile, HidError, list};
use super::{report, tracker};
use crate::trackers::{Event, Source, Stream};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// The plugged-in devices and their behavior, shared with the test.
#[derive(Default)]
struct Desk {
    devices: Vec<Info>,
    descriptor: Vec<u8>,
    /// Reports that wait to be read.
    reports: Vec<Vec<u8>>,
    /// A report that is repeated forever.
    flood: Option<Vec<u8>>,
    written: Vec<Vec<u8>>,
    broken: Option<&'static str>,
}

#[derive(Clone, Default)]
struct FakeBus(Arc<Mutex<Desk>>);

struct FakePort(Arc<Mutex<Desk>>);

impl Bus for FakeBus {
    fn list(&mut self) -> Result<Vec<Info>, HidError> {
        Ok(self.0.lock().unwrap().devices.clone())
    }

    fn open(&mut self, _: &Info) -> Result<Box<dyn Port>, HidError> {
        match self.0.lock().unwrap().broken {
            Some(why) => Err(HidError::Port(why.into())),
            None => Ok(Box::new(FakePort(Arc::clone(&self.0)))),
        }
    }
}

impl Port for FakePort {
    fn descriptor(&mut self) -> Result<Vec<u8>, HidError> {
        Ok(self.0.lock().unwrap().descriptor.clone())
    }

    fn read(&mut self, out: &mut [u8], _: Duration) -> Result<usize, HidError> {
        let mut desk = self.0.lock().unwrap();
        if desk.devices.is_empty() {
            return Err(HidError::Port("unplugged".into()));
        }
        let next = if desk.reports.is_empty() { desk.flood.clone() } else { Some(desk.reports.remove(0)) };
        let Some(next) = next else { return Ok(0) };
        out[..next.len()].copy_from_slice(&next);
        Ok(next.len())
    }

    fn get_feature(&mut self, report: &mut [u8]) -> Result<usize, HidError> {
        assert_eq!(report[0], 0x13);
        report.copy_from_slice(&[0x13, 1, 120, 0]);
        Ok(4)
    }

    fn set_feature(&mut self, report: &[u8]) -> Result<(), HidError> {
        self.0.lock().unwrap().written.push(report.to_vec());
        Ok(())
    }
}

fn info() -> Info {
    Info { path: "a".into(), vendor: 0x1234, product: 0x5678, name: "Tracker".into() }
}

fn desk() -> FakeBus {
    let bus = FakeBus::default();
    *bus.0.lock().unwrap() = Desk { devices: vec![info()], descriptor: tracker(), ..Desk::default() };
    bus
}

const GOOD: [i32; 8] = [0, 0, -32_000, 0, 600_000, 32_000, 0, 600_000];

fn note(event: Event) -> String {
    match event {
        Event::Note(text) => text,
        other => panic!("{other:?}"),
    }
}

/// A clock that the test moves. Each test that uses it has its own.
macro_rules! clock {
    ($name:ident, $function:ident) => {
        static $name: AtomicU64 = AtomicU64::new(1_000_000_000);
        fn $function() -> u64 {
            $name.load(Ordering::SeqCst)
        }
    };
}

#[test]
fn it_is_found_started_lost_and_found_again() {
    clock!(NOW, now);
    let bus = desk();
    bus.0.lock().unwrap().devices.clear();
    let mut source = HidSource::with_clock(Box::new(bus.clone()), None, 0, now);
    let step = |source: &mut HidSource| source.next(Duration::ZERO).unwrap();
    assert!(note(step(&mut source)).contains('0') && source.recording_head().is_none());
    NOW.fetch_add(600_000_000, Ordering::SeqCst);
    assert_eq!(step(&mut source), Event::Nothing, "said once");
    bus.0.lock().unwrap().devices.push(info());
    assert_eq!(step(&mut source), Event::Nothing, "searched twice a second, no more");
    NOW.fetch_add(600_000_000, Ordering::SeqCst);
    assert!(note(step(&mut source)).contains("Tracker") && source.recording_head().is_some());
    assert_eq!(bus.0.lock().unwrap().written, [[0x14, 3]], "asked for gaze and eyes");
    let about = source.about();
    assert_eq!((about.rate_hz, about.kind), (Some(120.0), "hid"));
    assert!(about.notes.iter().any(|n| n.ends_with(&status_name(1.0))), "{:?}", about.notes);
    assert_eq!(source.recording_head().unwrap().descriptor, tracker());

    bus.0.lock().unwrap().reports = vec![report(1, GOOD), vec![0x13, 4], vec![0x77; 9], report(2, GOOD)];
    assert!(matches!(step(&mut source), Event::Sample(s, Some(r)) if s.valid() && r.len() == 65));
    assert!(note(step(&mut source)).ends_with(&status_name(4.0)));
    assert_eq!(step(&mut source), Event::Nothing, "a foreign report");
    assert!(matches!(step(&mut source), Event::Sample(..)));

    bus.0.lock().unwrap().devices.clear();
    assert!(note(step(&mut source)).contains("unplugged") && source.recording_head().is_none());
    assert!(note(step(&mut source)).contains('0'), "none among 0");
    bus.0.lock().unwrap().devices.push(info());
    NOW.fetch_add(600_000_000, Ordering::SeqCst);
    assert!(note(step(&mut source)).contains("Tracker") && source.recording_head().is_some());
    assert_eq!(bus.0.lock().unwrap().written.len(), 2);
}

#[test]
fn a_silent_one_is_asked_again_and_that_is_said_once() {
    clock!(NOW, now);
    let bus = desk();
    let mut source = HidSource::with_clock(Box::new(bus.clone()), None, 0, now);
    let mut notes = Vec::new();
    for _ in 0..100 {
        NOW.fetch_add(100_000_000, Ordering::SeqCst);
        if let Event::Note(text) = source.next(Duration::ZERO).unwrap() {
            notes.push(text);
        }
    }
    assert_eq!(notes.len(), 2, "{notes:?}");
    assert!(notes[1].contains("Tracker") && notes[1] != notes[0], "{notes:?}");
    assert!((4..7).contains(&bus.0.lock().unwrap().written.len()));
}

#[test]
fn others_are_left_alone_and_a_locked_one_is_told() {
    let bus = desk();
    bus.0.lock().unwrap().descriptor = vec![0x05, 0x01, 0x09, 0x06, 0xa1, 0x01, 0xc0];
    let mut source = HidSource::new(Box::new(bus.clone()), None, 0);
    assert!(note(source.next(Duration::ZERO).unwrap()).contains('1') && source.recording_head().is_none());
    assert!(bus.0.lock().unwrap().written.is_empty(), "nothing is written to a keyboard");
    let listed = list(&mut bus.clone(), None).unwrap();
    assert!(
        matches!(&listed[0].tracker, Err(HidError::NotAnEyeTracker { reason, .. }) if reason.code() == "no-eye-tracker")
    );

    bus.0.lock().unwrap().broken = Some("permission denied");
    let mut source = HidSource::new(Box::new(bus), None, 0);
    assert!(note(source.next(Duration::ZERO).unwrap()).contains("permission denied"));
}

#[test]
fn a_file_takes_its_device_and_starts_it() {
    let text = "vendor = 0x1234\nproduct = 0x5678\nbytes = 4\nstart = [9, 1]\n[combined]\nunit = \"counts\"\nx = { offset = 0, size = 2 }\ny = { offset = 2, size = 2 }\n";
    let file = DeviceFile::from_toml(text).unwrap();
    let bus = desk();
    bus.0.lock().unwrap().descriptor.clear();
    bus.0.lock().unwrap().reports = vec![vec![1, 0, 2, 0]];
    let mut source = HidSource::new(Box::new(bus.clone()), Some(file.clone()), 0);
    note(source.next(Duration::ZERO).unwrap());
    assert!(source.recording_head().is_some());
    assert_eq!(bus.0.lock().unwrap().written, [[9, 1]]);
    let Event::Sample(sample, _) = source.next(Duration::ZERO).unwrap() else { panic!("a sample") };
    assert_eq!(sample.combined.unwrap().position, [1.0, 2.0]);
    bus.0.lock().unwrap().devices[0].product = 1;
    let mut source = HidSource::new(Box::new(bus), Some(file), 0);
    assert!(note(source.next(Duration::ZERO).unwrap()).contains("1234:5678"));
}

#[test]
fn a_flood_keeps_the_newest_and_memory_flat() {
    let bus = desk();
    bus.0.lock().unwrap().flood = Some(report(5, GOOD));
    let stream = Stream::start(Box::new(HidSource::new(Box::new(bus.clone()), None, 0))).unwrap();
    let until = Instant::now() + Duration::from_secs(20);
    while stream.status().samples < 50_000 && Instant::now() < until {
        std::thread::yield_now();
    }
    let status = stream.status();
    assert!(status.samples >= 50_000 && status.dropped > 40_000, "{status:?}");
    assert!(stream.arrived().count() <= 256);
    // Then the device is unplugged. The stream continues and reports it.
    bus.0.lock().unwrap().devices.clear();
    let mut notes = Vec::new();
    while !notes.iter().any(|n: &String| n.contains("unplugged")) && Instant::now() < until {
        notes.extend(stream.note());
        let _ = stream.next(Duration::from_millis(1));
    }
    assert!(notes.iter().any(|n| n.contains("unplugged")), "{notes:?}");
    assert!(!stream.status().ended);
}
