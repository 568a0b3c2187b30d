//! Reads recordings in the text format of hid-recorder, which people attach to bug reports.
//!
//! | line | content |
//! |---|---|
//! | `R: LENGTH BYTE BYTE ...` | report descriptor, bytes in hexadecimal |
//! | `N: NAME`, `P: PATH`, `I: BUS VENDOR PRODUCT` | the device |
//! | `E: SECONDS.MICROSECONDS LENGTH BYTE ...` | a report |
//! | `D: INDEX` | the lines from here on are of another device |
//! | `# ...` | a remark |
//!
//! A replay is in real time, or as fast as the file can be read with the recorded times. It uses the decoder of live
//! devices.

use super::hid::{Decoder, HidError, Layout};
pub use super::source::Head;
use super::source::{About, Dropped, Event, Source, end_of, wait_for};
use super::time_unit::timeline;
use super::{TrackerError, now_ns};
use eyebox_base::error::Reason;
use eyebox_base::files::read;
use eyebox_base::reason;
use std::io::{self, BufRead, Read, Write};
use std::path::Path;
use std::time::Duration;

/// Longest recording that is read, bytes.
const LONGEST: u64 = 256 << 20;
const LONGEST_LINE: u64 = 256 << 10;
const MOST_DEVICES: usize = 256;

/// A report of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recorded {
    /// Time since the recording's start, microseconds.
    pub time_us: u64,
    /// Index of the report's device.
    pub device: usize,
    /// The report, with its ID if it has one.
    pub report: Vec<u8>,
}

/// The devices and reports of a recording.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Recording {
    /// The devices of the recording.
    pub devices: Vec<Head>,
    /// The reports in their order.
    pub reports: Vec<Recorded>,
    /// Notes for the user, in sentences.
    pub notes: Vec<String>,
}

impl Recording {
    /// Reads a recording from a file.
    ///
    /// # Errors
    /// [`TrackerError::File`] with file and line.
    pub fn load(file: &Path) -> Result<Self, TrackerError> {
        let open = read::lines(file, LONGEST).map_err(|e| TrackerError::file(file, e.to_string()))?;
        Self::read(open).map_err(|reason| TrackerError::file(file, reason))
    }

    /// Reads the text of a recording.
    ///
    /// # Errors
    /// The problem, with its line.
    pub fn read(text: impl BufRead) -> Result<Self, Reason> {
        let mut text = text.take(LONGEST);
        let mut recording = Self::default();
        let mut device = 0;
        let mut line = Vec::new();
        for number in 1.. {
            line.clear();
            let got = (&mut text).take(LONGEST_LINE).read_until(b'\n', &mut line).map_err(|e| e.to_string())?;
            if got == 0 {
                break;
            }
            if got as u64 == LONGEST_LINE {
                return Err(reason!("line-length", "line {number}: longer than {LONGEST_LINE} bytes, no recording"));
            }
            let whole = line.ends_with(b"\n");
            let line = String::from_utf8_lossy(&line);
            match recording.line(line.trim(), &mut device) {
                Ok(()) => {}
                // The recording program was killed, or its disk was full.
                Err(_) if !whole && !recording.reports.is_empty() => {
                    recording.notes.push(format!("the recording is cut off in line {number}, which is left out"));
                }
                Err(reason) => return Err(reason.within(format!("line {number}"))),
            }
        }
        if text.limit() == 0 {
            return Err(reason!("recording-length", "longer than {} MiB", LONGEST >> 20));
        }
        if recording.devices.iter().all(|d| d.descriptor.is_empty()) {
            return Err(reason!(
                "no-descriptor",
                "no report descriptor (a line that starts with 'R:'), so not a recording of hid-recorder"
            ));
        }
        Ok(recording)
    }

    fn line(&mut self, line: &str, device: &mut usize) -> Result<(), Reason> {
        let wrong = "expected a letter and a colon, as in 'R: 2 05 12'";
        let Some((tag, rest)) = line.split_once(':').filter(|(tag, _)| tag.len() == 1 && !line.starts_with('#')) else {
            // Other text may be between the lines. Before the first device it means another kind of file.
            let remark = line.is_empty() || line.starts_with('#') || !self.devices.is_empty();
            return if remark { Ok(()) } else { Err(Reason::new("not-a-recording", wrong)) };
        };
        let rest = rest.trim();
        match tag {
            "D" => {
                *device = rest.parse().map_err(|_| reason!("device-index", "D: expected the index of a device"))?;
                if *device >= MOST_DEVICES {
                    return Err(reason!("devices-count", "D: device {device}, but the limit is {MOST_DEVICES}"));
                }
            }
            "R" => self.device(*device).descriptor = bytes(rest)?,
            "N" => self.device(*device).name = rest.into(),
            "P" => self.device(*device).path = rest.into(),
            "I" => {
                let mut words = rest.split_whitespace();
                let mut word = || u16::from_str_radix(words.next()?, 16).ok();
                let id = [word(), word(), word()];
                let [Some(bus), Some(vendor), Some(product)] = id else {
                    return Err(reason!("device-id", "I: expected bus, vendor and product in hexadecimal"));
                };
                self.device(*device).id = [bus, vendor, product];
            }
            "E" => {
                let (time, rest) = rest
                    .split_once(char::is_whitespace)
                    .ok_or_else(|| reason!("report", "E: expected a time and bytes"))?;
                let time_us =
                    microseconds(time).ok_or_else(|| reason!("report-time", "E: expected a time such as 0.001000"))?;
                let report = bytes(rest.trim())?;
                self.reports.push(Recorded { time_us, device: *device, report });
            }
            // Other letters belong to later versions.
            _ => {}
        }
        Ok(())
    }

    fn device(&mut self, index: usize) -> &mut Head {
        if self.devices.len() <= index {
            self.devices.resize_with(index + 1, Head::default);
        }
        &mut self.devices[index]
    }
}

/// Reads `LENGTH BYTE BYTE ...`, with the length in decimal and bytes in hexadecimal.
fn bytes(text: &str) -> Result<Vec<u8>, Reason> {
    let mut words = text.split_whitespace();
    let length: usize = words
        .next()
        .and_then(|w| w.parse().ok())
        .ok_or_else(|| reason!("report-length", "expected a number of bytes"))?;
    let byte = |w: &str| u8::from_str_radix(w, 16).ok().filter(|_| w.len() == 2);
    let bytes: Option<Vec<u8>> = words.map(byte).collect();
    let bytes = bytes.ok_or_else(|| reason!("report-digits", "expected bytes of two hexadecimal digits"))?;
    if bytes.len() == length {
        Ok(bytes)
    } else {
        Err(reason!("report-length", "{} bytes, but {length} are announced", bytes.len()))
    }
}

/// Reads a time exactly, which a float would not do.
fn microseconds(text: &str) -> Option<u64> {
    let (seconds, fraction) = text.split_once('.').unwrap_or((text, ""));
    if fraction.len() > 6 || !fraction.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let seconds: u64 = seconds.parse().ok()?;
    let fraction: u64 = format!("{fraction:0<6}").parse().ok()?;
    seconds.checked_mul(1_000_000)?.checked_add(fraction)
}

/// Writes the head of a recording.
///
/// # Errors
/// The errors of `out`.
pub fn write_head(out: &mut dyn Write, head: &Head) -> io::Result<()> {
    writeln!(out, "R: {} {}", head.descriptor.len(), hex(&head.descriptor))?;
    writeln!(out, "N: {}", head.name.replace(['\n', '\r'], " "))?;
    writeln!(out, "P: {}", head.path.replace(['\n', '\r'], " "))?;
    let [bus, vendor, product] = head.id;
    writeln!(out, "I: {bus:x} {vendor:04x} {product:04x}")
}

/// Writes one report of a recording.
///
/// # Errors
/// The errors of `out`.
pub fn write_report(out: &mut dyn Write, time_us: u64, report: &[u8]) -> io::Result<()> {
    writeln!(out, "E: {}.{:06} {} {}", time_us / 1_000_000, time_us % 1_000_000, report.len(), hex(report))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect::<Vec<_>>().join(" ")
}

/// Replays the reports of a recording.
#[derive(Debug)]
pub struct RecordingSource {
    name: String,
    head: Head,
    reports: std::vec::IntoIter<Recorded>,
    /// Arrival of each report, nanoseconds from the first.
    arrivals: std::vec::IntoIter<u64>,
    decoder: Decoder,
    start_ns: u64,
    real_time: bool,
    notes: Vec<String>,
    sets: u64,
}

impl RecordingSource {
    /// Replays the first eye tracker of a recording. In `real_time` it takes as long as the recording took. Otherwise
    /// it is as fast as it can be read, with the recorded times counted from now.
    ///
    /// # Errors
    /// [`HidError::NotAnEyeTracker`] or [`HidError::Descriptor`] if no device can be used.
    pub fn new(
        recording: Recording,
        layout: Option<&Layout>,
        real_time: bool,
        latency_ns: u64,
    ) -> Result<Self, HidError> {
        let mut refused = None;
        for (device, head) in recording.devices.iter().enumerate().filter(|(_, h)| !h.descriptor.is_empty()) {
            let found = layout.cloned().map_or_else(|| Layout::of(&head.descriptor, &head.name), Ok);
            let layout = match found {
                Ok(layout) => layout,
                Err(e) => {
                    refused.get_or_insert(e);
                    continue;
                }
            };
            let mut notes: Vec<String> = recording.notes.iter().chain(&layout.notes).cloned().collect();
            let mut reports = recording.reports;
            reports.retain(|report| report.device == device);
            let times: Vec<i128> = reports.iter().map(|report| 1000 * i128::from(report.time_us)).collect();
            let (arrivals, sets) = timeline(&times);
            if sets > 0 {
                notes.push(format!("its clock was set {sets} times, and the replay continues with its usual step"));
            }
            return Ok(Self {
                name: head.name.clone(),
                head: head.clone(),
                reports: reports.into_iter(),
                arrivals: arrivals.into_iter(),
                decoder: Decoder::new(layout, latency_ns),
                start_ns: now_ns(),
                real_time,
                notes,
                sets,
            });
        }
        Err(refused.unwrap_or(HidError::Port("the recording has no device".into())))
    }
}

impl Source for RecordingSource {
    fn about(&self) -> About {
        About { name: self.name.clone(), kind: "recording", rate_hz: None, notes: self.notes.clone() }
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        let until = end_of(timeout);
        loop {
            if let Some(event) = self.decoder.clock.event() {
                return Ok(Event::Note(format!("{}: {event}", self.name)));
            }
            let Some(arrival) = self.arrivals.as_slice().first() else { return Ok(Event::End) };
            let due = self.start_ns.saturating_add(*arrival);
            if self.real_time && !wait_for(due, until) {
                return Ok(Event::Nothing);
            }
            self.arrivals.next();
            let Some(next) = self.reports.next() else { return Ok(Event::End) };
            if let Some(sample) = self.decoder.sample(&next.report, due) {
                return Ok(Event::Sample(sample, Some(next.report.into())));
            }
        }
    }

    fn dropped(&self) -> Dropped {
        Dropped { clock_sets: self.sets + self.decoder.clock.sets, ..Dropped::default() }
    }

    fn recording_head(&self) -> Option<Head> {
        Some(self.head.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again() {
        let head =
            Head { name: "A: tracker".into(), path: "usb-1".into(), id: [3, 0x15e4, 0x132], descriptor: vec![5, 0x12] };
        let mut text = Vec::new();
        write_head(&mut text, &head).unwrap();
        write_report(&mut text, 5_000_007, &[1, 0xfe]).unwrap();
        text.extend(b"# remark: with a colon\r\nD: 1\nR: 1 c0\nX: later\n\nE: 6.5 0\n");
        let recording = Recording::read(&text[..]).unwrap();
        assert_eq!(recording.devices[0], head);
        assert_eq!(recording.devices[1].descriptor, [0xc0]);
        assert_eq!(recording.reports[0], Recorded { time_us: 5_000_007, device: 0, report: vec![1, 0xfe] });
        assert_eq!(recording.reports[1], Recorded { time_us: 6_500_000, device: 1, report: vec![] });
    }

    /// A file that is cut off in its last line, as by a full disk, keeps all lines before it and has a note.
    #[test]
    fn a_last_line_that_is_cut_off_is_left_out() {
        let whole = "R: 1 05\nE: 0.000100 2 01 fe\nE: 0.000200 2 03 04";
        let end = whole.rfind("E:").unwrap();
        for cut in end + 2..whole.len() {
            let recording = Recording::read(&whole.as_bytes()[..cut]).unwrap();
            assert_eq!((recording.reports.len(), recording.notes.len()), (1, 1), "{}", &whole[end..cut]);
            assert!(recording.notes[0].contains("line 3"));
        }
        let recording = Recording::read(whole.as_bytes()).unwrap();
        assert_eq!((recording.reports.len(), recording.notes.len()), (2, 0));
    }

    #[test]
    fn mistakes_name_their_line() {
        for (text, what) in [
            ("R: 2 05\n", "report-length"),
            ("R: 1 05\nE: x 1 00\n", "report-time"),
            ("R: 1 05\nE: 0.1 1 zz\n", "report-digits"),
            ("R: 1 05\nE: 0.1 1 5\n", "report-digits"),
            ("R: 1 05\nE: 0.1 2 00", "report-length"),
            ("R: 1 05\nD: 99999999999\n", "devices-count"),
            ("R: 1 05\nD: 999\n", "devices-count"),
            ("R: 1 05\nI: 3 x 1\n", "device-id"),
            ("hello\n", "not-a-recording"),
            ("https://x\n", "not-a-recording"),
            ("N: name\n", "no-descriptor"),
            ("", "no-descriptor"),
        ] {
            let error = Recording::read(text.as_bytes()).unwrap_err();
            assert_eq!(error.code(), what, "{error}");
        }
        let long = [vec![b'x'; 300 << 10], b"\n".to_vec()].concat();
        assert_eq!(Recording::read(&long[..]).unwrap_err().code(), "line-length");
    }
}
