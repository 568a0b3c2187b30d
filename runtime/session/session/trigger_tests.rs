//! Tests triggers of whole sessions on pseudo-terminals, with a slow reader, lost pulses and a line that goes.

use crate::hologram::{ColorHologram, Hologram, SequenceWriter};
use crate::optics::Display;
use crate::session::*;
use crate::solve::SplitMix;
use serial2::SerialPort;
use std::collections::BTreeMap;
use std::os::fd::AsRawFd;
use std::path::Path;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(60);

/// Returns one end of a pseudo-terminal, and the file of the other end.
fn pair() -> (SerialPort, String) {
    let (mut near, far) = SerialPort::pair().unwrap();
    near.set_read_timeout(Duration::from_millis(200)).unwrap();
    near.set_write_timeout(PATIENCE).unwrap();
    let path = std::fs::read_link(format!("/proc/self/fd/{}", far.as_raw_fd())).unwrap();
    (near, path.display().to_string())
}

/// Makes a sequence for a display with these tables of triggers.
fn play(folder: &Path, count: usize, tables: &str) -> Play {
    let display = Display { height: 12, width: 16, ..Display::preset("plm").unwrap() };
    let text = format!("{}\n{tables}", display.to_toml());
    let display = Display::from_toml(&text, "bench").unwrap();
    let colors = || {
        let one = |c: &crate::optics::Wavelength| ColorHologram {
            color: Some(c.color),
            wavelength: c.wavelength,
            exposure: 0.4,
            efficiency: 0.4,
            phases: vec![0.5; 8 * 192],
        };
        display.wavelengths.iter().map(one).collect()
    };
    let hologram = Hologram { height: 12, width: 16, ..Hologram::on(&display, 8, colors()) };
    let path = folder.join("x.zarr");
    let mut writer = SequenceWriter::create(&path, &hologram, [60, 1], None).unwrap();
    (0..count).for_each(|_| writer.append(&hologram).unwrap());
    writer.finish().unwrap();
    Play::open(&path, &display).unwrap()
}

fn ended(session: Session) -> Ended {
    let begun = Instant::now();
    while session.is_running() {
        assert!(begun.elapsed() < PATIENCE);
        std::thread::sleep(Duration::from_millis(2));
    }
    session.stop()
}

fn memory() -> Output {
    Output::Memory { simulated: false, sink: None }
}

/// Returns the rows of a list as its columns by name.
fn rows(file: &Path) -> Vec<BTreeMap<String, String>> {
    let text = std::fs::read_to_string(file).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row = |line: &str| names.iter().map(|n| (*n).to_owned()).zip(line.split(',').map(str::to_owned)).collect();
    lines.map(row).collect()
}

#[test]
fn each_set_has_its_pulse_and_the_list_says_which_were_missed() {
    let folder = tempfile::tempdir().unwrap();
    let (near, path) = pair();
    let play = play(folder.path(), 40, &format!("[trigger_out]\nserial = \"{path}\"\nsignal = \"number\"\n"));
    let record = folder.path().join("record");
    let (send, lights) = channel();
    let options = SessionOptions {
        record: Some(record.clone()),
        light_observer: Some(Box::new(move |light: &SetLight| send.send(*light).unwrap())),
        ..SessionOptions::default()
    };
    let session = Session::start(play, memory(), options).unwrap();
    // The reader stops at random.
    let reader = std::thread::spawn(move || {
        let (mut random, mut read) = (SplitMix(3), Vec::new());
        let mut bytes = [0; 3];
        while let Ok(length @ 1..) = near.read(&mut bytes) {
            read.extend_from_slice(&bytes[..length]);
            std::thread::sleep(Duration::from_millis((40.0 * random.unit()) as u64));
        }
        read
    });
    let ended = ended(session);
    ended.result.unwrap();
    let read = reader.join().unwrap();
    let rows = rows(&record.join("triggers.csv"));
    let account = ended.statistics.report.account;
    let report = ended.statistics.trigger_out.unwrap();
    assert_eq!(rows.len() as u64, account.sets - account.idle_sets);
    assert!(rows.iter().enumerate().all(|(i, row)| row["set"] == i.to_string()));
    let sent: Vec<u8> =
        rows.iter().filter(|r| r["pulse"] == "sent").map(|r| r["set"].parse::<u64>().unwrap() as u8).collect();
    let late = rows.iter().filter(|r| r["pulse"] == "late").count();
    assert_eq!(sent, read);
    assert_eq!([report.sent, report.late, report.full, report.lost], [read.len() as u64, late as u64, 0, 0]);
    assert_eq!(report.sent + report.late, rows.len() as u64);
    let lights: Vec<SetLight> = lights.iter().collect();
    assert_eq!(lights.len(), rows.len());
    for (light, row) in lights.iter().zip(&rows) {
        assert_eq!(light.content.to_string(), row["content"]);
        assert_eq!(light.reported_ns.map(|ns| ns.to_string()).unwrap_or_default(), row["reported_light_ns"]);
        assert_eq!(row["new"], u8::from(light.new).to_string());
    }
    assert!(lights.iter().filter(|light| light.reported_ns.is_some()).count() > rows.len() / 2);
}

#[test]
fn a_line_that_goes_is_told_and_takes_nothing_away() {
    let folder = tempfile::tempdir().unwrap();
    let (near, path) = pair();
    let tables = format!("[trigger_out]\nserial = \"{path}\"\non = \"content\"\n");
    let session = Session::start(play(folder.path(), 60, &tables), memory(), SessionOptions::default()).unwrap();
    let mut byte = [0];
    let begun = Instant::now();
    while !matches!(near.read(&mut byte), Ok(1)) {
        assert!(begun.elapsed() < PATIENCE);
    }
    assert_eq!(byte, [255]);
    drop(near);
    let ended = ended(session);
    ended.result.unwrap();
    let report = ended.statistics.trigger_out.unwrap();
    let account = ended.statistics.report.account;
    assert!(report.sent > 0 && report.lost > 0, "{report:?}");
    assert_eq!(report.sent + report.lost + report.late + report.full, account.shown);
}

#[test]
fn pulses_advance_a_sequence_one_by_one() {
    let folder = tempfile::tempdir().unwrap();
    let (near, path) = pair();
    let tables = format!("[trigger_in]\nserial = \"{path}\"\nsignal = \"number\"\n");
    let record = folder.path().join("record");
    let options = SessionOptions { record: Some(record.clone()), ..SessionOptions::default() };
    let session = Session::start(play(folder.path(), 4, &tables), memory(), options).unwrap();
    let shown = |count| {
        let begun = Instant::now();
        while session.status().account.shown < count {
            assert!(begun.elapsed() < PATIENCE);
            std::thread::sleep(Duration::from_millis(2));
        }
    };
    shown(1);
    // Content waits for the pulse, however long that takes.
    let sets = session.status().account.sets;
    while session.status().account.sets < sets + 5 {
        std::thread::sleep(Duration::from_millis(2));
    }
    assert_eq!(session.status().account.shown, 1);
    for (i, number) in [10_u8, 11, 14].into_iter().enumerate() {
        near.write_all(&[number]).unwrap();
        shown(i as u64 + 2);
    }
    near.write_all(&[15]).unwrap();
    let ended = ended(session);
    ended.result.unwrap();
    assert_eq!(ended.statistics.ended_by, Ending::End);
    let report = ended.statistics.trigger_in.unwrap();
    assert_eq!(report, PulseReport { received: 4, advanced: 4, too_early: 0, lost: 2 });
    let rows = rows(&record.join("pulses.csv"));
    assert_eq!(rows.iter().map(|r| &r["content"][..]).collect::<Vec<_>>(), ["1", "2", "3", ""]);
    assert_eq!(rows.iter().map(|r| &r["lost_before"][..]).collect::<Vec<_>>(), ["0", "0", "2", "0"]);
}

#[test]
fn a_line_that_is_missing_is_refused_before_anything_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    for table in ["trigger_out", "trigger_in"] {
        let place = folder.path().join(table);
        std::fs::create_dir(&place).unwrap();
        let play = play(&place, 1, &format!("[{table}]\nserial = \"/nowhere\"\n"));
        let refused = Session::start(play, memory(), SessionOptions::default()).err().unwrap();
        assert!(matches!(refused, SessionError::Trigger(_)), "{refused:?}");
    }
}
