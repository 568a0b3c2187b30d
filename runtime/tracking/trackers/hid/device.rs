//! Finds an eye tracker, starts it, reads it, and finds it again after a loss.

use super::layout::{MODE_GAZE_AND_EYES, Setting};
use super::report::Decoder;
use super::{DeviceFile, HidError, Layout};
use crate::trackers::source::{Head, news};
use crate::trackers::{About, Dropped, Event, Source, TrackerError, now_ns};
use std::time::Duration;

/// A HID device that is plugged in.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Info {
    /// Path of the device on the bus.
    pub path: String,
    /// USB number of the vendor.
    pub vendor: u16,
    /// USB number of the product.
    pub product: u16,
    /// Name of the device.
    pub name: String,
}

/// A bus of HID devices.
pub trait Bus: Send {
    /// Lists all devices that are plugged in now.
    ///
    /// # Errors
    /// [`HidError::System`] if there is no such bus.
    fn list(&mut self) -> Result<Vec<Info>, HidError>;

    /// Opens a device of this bus.
    ///
    /// # Errors
    /// [`HidError::Port`] if it is gone or not allowed.
    fn open(&mut self, info: &Info) -> Result<Box<dyn Port>, HidError>;
}

/// An open HID device. Reports start with their ID. If reports are not numbered, feature reports start with 0 and input
/// reports with their first byte.
pub trait Port: Send {
    /// Reads the report descriptor.
    ///
    /// # Errors
    /// [`HidError::Port`] if the device fails.
    fn descriptor(&mut self) -> Result<Vec<u8>, HidError>;

    /// Waits for an input report. It returns 0 bytes if none arrives within `timeout`.
    ///
    /// # Errors
    /// [`HidError::Port`] if the device is gone.
    fn read(&mut self, report: &mut [u8], timeout: Duration) -> Result<usize, HidError>;

    /// Requests the feature report with the ID `report[0]`. Returns its number of bytes.
    ///
    /// # Errors
    /// [`HidError::Port`] if the device fails.
    fn get_feature(&mut self, report: &mut [u8]) -> Result<usize, HidError>;

    /// Writes a feature report.
    ///
    /// # Errors
    /// [`HidError::Port`] if the device fails.
    fn set_feature(&mut self, report: &[u8]) -> Result<(), HidError>;
}

/// A plugged-in device with its description.
#[derive(Debug, Clone, PartialEq)]
pub struct Listed {
    /// The device on the bus.
    pub info: Info,
    /// The description of the eye tracker, or the reason why it is none.
    pub tracker: Result<About, HidError>,
}

/// Lists all devices of a bus, with their descriptions.
///
/// # Errors
/// [`HidError::System`] if there is no bus.
pub fn list(bus: &mut dyn Bus, file: Option<&DeviceFile>) -> Result<Vec<Listed>, HidError> {
    let found = bus.list()?;
    let listed = found.into_iter().map(|info| {
        let tracker = bus.open(&info).and_then(|port| Open::new(port, &info, file, 0)).map(|mut open| {
            open.ask();
            open.about
        });
        Listed { info, tracker }
    });
    Ok(listed.collect())
}

/// An open device with a known layout.
struct Open {
    port: Box<dyn Port>,
    decoder: Decoder,
    head: Head,
    start: Option<Vec<u8>>,
    about: About,
}

impl Open {
    fn new(mut port: Box<dyn Port>, info: &Info, file: Option<&DeviceFile>, latency_ns: u64) -> Result<Self, HidError> {
        let file = file.filter(|f| f.id == [info.vendor, info.product]);
        let descriptor = port.descriptor();
        let (layout, start) = match file {
            Some(file) => (file.layout.clone(), file.start.clone()),
            None => {
                let layout = Layout::of(descriptor.as_deref().map_err(Clone::clone)?, &info.name)?;
                let start = layout.mode.map(|mode| mode.report(MODE_GAZE_AND_EYES));
                (layout, start)
            }
        };
        let name = file.map_or_else(|| info.name.clone(), |f| f.name.clone());
        let head = Head {
            name: info.name.clone(),
            path: info.path.clone(),
            id: [3, info.vendor, info.product],
            descriptor: descriptor.unwrap_or_default(),
        };
        let about = About { name, kind: "hid", rate_hz: None, notes: layout.notes.clone() };
        Ok(Self { port, decoder: Decoder::new(layout, latency_ns), head, start, about })
    }

    fn feature(&mut self, setting: Option<Setting>) -> Option<f64> {
        let setting = setting?;
        let mut report = vec![0; setting.bytes + usize::from(setting.id == 0)];
        *report.first_mut()? = setting.id;
        let got = self.port.get_feature(&mut report).ok()?.min(report.len());
        // The answer of a device without IDs starts with a zero.
        setting.value(report.get(usize::from(setting.id == 0)..got)?)
    }

    /// Requests status and frequency.
    fn ask(&mut self) {
        let layout = &self.decoder.layout;
        let (frequency, status) = (layout.frequency, layout.status);
        let places: Vec<String> =
            layout.inputs.iter().flat_map(|i| &i.places).map(|p| format!("{:?}", p.role).to_lowercase()).collect();
        self.about.notes.push(format!("sends {}", places.join(", ")));
        self.about.rate_hz = self.feature(frequency).filter(|hz| *hz > 0.0);
        if let Some(status) = self.feature(status) {
            self.about.notes.push(format!("status: {}", status_name(status)));
        }
    }

    /// Requests the device to send. It is silent until then.
    fn start(&mut self) -> Result<(), HidError> {
        match &self.start {
            Some(report) => self.port.set_feature(report),
            None => Ok(()),
        }
    }
}

/// Configuration Status in words (HUTRR74).
pub(super) fn status_name(status: f64) -> String {
    match status as i64 {
        1 => "ready".into(),
        2 => "configuring".into(),
        3 => "screen setup needed".into(),
        4 => "user calibration needed".into(),
        other => format!("{other}"),
    }
}

/// Silence after which a device is requested to send again, because it may have been reset.
const SILENT_NS: u64 = 2_000_000_000;
/// Interval of searches of the bus while there is no device.
const SEARCH_NS: u64 = 500_000_000;

/// The first eye tracker of a bus, which may be unplugged and plugged in.
pub struct HidSource {
    bus: Box<dyn Bus>,
    file: Option<DeviceFile>,
    latency_ns: u64,
    open: Option<Open>,
    /// The last note about the bus, so that it is printed only once.
    said: String,
    searched_ns: Option<u64>,
    heard_ns: u64,
    silent: bool,
    buffer: Vec<u8>,
    clock: fn() -> u64,
}

impl HidSource {
    /// Searches `bus` now and whenever there is no device. With a `file`, it uses the device that the file describes.
    /// Otherwise it uses the first device of usage page 0x12.
    pub fn new(bus: Box<dyn Bus>, file: Option<DeviceFile>, latency_ns: u64) -> Self {
        Self::with_clock(bus, file, latency_ns, now_ns)
    }

    pub(super) fn with_clock(bus: Box<dyn Bus>, file: Option<DeviceFile>, latency_ns: u64, clock: fn() -> u64) -> Self {
        Self {
            bus,
            file,
            latency_ns,
            open: None,
            said: String::new(),
            searched_ns: None,
            heard_ns: 0,
            silent: false,
            buffer: vec![0; super::descriptor::LONGEST_REPORT + 1],
            clock,
        }
    }

    /// Searches for a device. Returns a note about the result.
    fn search(&mut self) -> Option<Event> {
        let found = match self.bus.list() {
            Ok(found) => found,
            Err(e) => return news(&mut self.said, e.to_string()),
        };
        let mut refused = Vec::new();
        for info in &found {
            if self.file.as_ref().is_some_and(|f| f.id != [info.vendor, info.product]) {
                continue;
            }
            let opened =
                self.bus.open(info).and_then(|port| Open::new(port, info, self.file.as_ref(), self.latency_ns));
            let mut open = match opened {
                Ok(open) => open,
                Err(HidError::NotAnEyeTracker { .. }) => continue,
                Err(e) => {
                    refused.push(format!("{}: {e}", info.name));
                    continue;
                }
            };
            open.ask();
            let text = match open.start() {
                Ok(()) => format!("{}: connected", open.about.name),
                Err(e) => format!("{}: connected, but its mode cannot be set ({e})", open.about.name),
            };
            self.open = Some(open);
            self.heard_ns = (self.clock)();
            self.silent = false;
            self.said.clear();
            return Some(Event::Note(text));
        }
        if let Some(reason) = refused.first() {
            return news(&mut self.said, format!("no eye tracker can be used ({reason})"));
        }
        let none = match &self.file {
            Some(f) => format!("{} ({:04x}:{:04x}) is not plugged in", f.name, f.id[0], f.id[1]),
            None => format!("no eye tracker among {} HID devices", found.len()),
        };
        news(&mut self.said, none)
    }

    fn lost(&mut self, reason: &HidError) -> Event {
        let name = self.open.take().map_or_else(String::new, |o| o.about.name);
        self.searched_ns = None;
        Event::Note(format!("{name}: lost ({reason})"))
    }
}

impl Source for HidSource {
    fn about(&self) -> About {
        let none =
            || About { name: "no HID eye tracker".into(), kind: "hid", rate_hz: None, notes: vec![self.said.clone()] };
        self.open.as_ref().map_or_else(none, |o| o.about.clone())
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        let now = (self.clock)();
        let Some(open) = &mut self.open else {
            if self.searched_ns.is_none_or(|at| now.saturating_sub(at) >= SEARCH_NS) {
                self.searched_ns = Some(now);
                return Ok(self.search().unwrap_or(Event::Nothing));
            }
            std::thread::sleep(timeout.min(Duration::from_nanos(SEARCH_NS)));
            return Ok(Event::Nothing);
        };
        if let Some(event) = open.decoder.clock.event() {
            return Ok(Event::Note(format!("{}: {event}", open.about.name)));
        }
        let length = match open.port.read(&mut self.buffer, timeout) {
            Ok(length) => length.min(self.buffer.len()),
            Err(e) => return Ok(self.lost(&e)),
        };
        let now = (self.clock)();
        if length == 0 {
            if now.saturating_sub(self.heard_ns) < SILENT_NS {
                return Ok(Event::Nothing);
            }
            // The request is repeated silently, after one note.
            self.heard_ns = now;
            if let Err(e) = open.start() {
                return Ok(self.lost(&e));
            }
            let first = !std::mem::replace(&mut self.silent, true);
            let text = format!("{}: silent for two seconds, so it was requested to send again", open.about.name);
            return Ok(if first { Event::Note(text) } else { Event::Nothing });
        }
        let Some(report) = self.buffer.get(..length) else { return Ok(Event::Nothing) };
        if let Some(sent) = open.decoder.layout.status_sent.filter(|s| s.id != 0 && report.first() == Some(&s.id)) {
            let status = sent.value(report).map_or_else(|| "out of range".into(), status_name);
            return Ok(Event::Note(format!("{}: {status}", open.about.name)));
        }
        let Some(sample) = open.decoder.sample(report, now) else { return Ok(Event::Nothing) };
        (self.heard_ns, self.silent) = (now, false);
        Ok(Event::Sample(sample, Some(report.into())))
    }

    fn dropped(&self) -> Dropped {
        let clock_sets = self.open.as_ref().map_or(0, |open| open.decoder.clock.sets);
        Dropped { clock_sets, ..Dropped::default() }
    }

    fn recording_head(&self) -> Option<Head> {
        self.open.as_ref().map(|o| o.head.clone())
    }
}
