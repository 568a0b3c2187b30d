//! Opens a source by its name.

use super::guard::Guard;
use super::hid::{DeviceFile, HidSource, system_bus};
use super::line::LineSource;
#[cfg(feature = "trackers")]
use super::pupil_labs::PupilCoreSource;
use super::recording::{Recording, RecordingSource};
use super::simulated::{Settings, SimulatedSource};
use super::udp::UdpSource;
use super::{Source, TrackerError};
use eyebox_base::reason;
use std::path::PathBuf;
use std::time::Duration;

/// The default port of Pupil Remote.
const PUPIL_REMOTE_PORT: u16 = 50020;

/// A source by name, as on the command line.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Spec {
    /// `hid`, the first HID eye tracker.
    Hid,
    /// `FILE.hid`, a recording of reports.
    Recording(PathBuf),
    /// `FILE.jsonl`, recorded lines of JSON.
    Lines(PathBuf),
    /// `pupil://HOST[:PORT]`, the network interface of Pupil Core.
    Pupil {
        /// Name or address of the machine.
        host: String,
        /// Port of Pupil Remote.
        port: u16,
    },
    /// `udp://[HOST]:PORT`, with the address to listen at. The default is loopback.
    Udp {
        /// Address of this machine.
        host: String,
        /// Port to listen at.
        port: u16,
    },
    /// `mouse`, whose positions come from a window.
    Mouse,
    /// `simulated[:SEED]`, a simulated eye.
    Simulated(u64),
}

impl std::str::FromStr for Spec {
    type Err = TrackerError;

    fn from_str(text: &str) -> Result<Self, TrackerError> {
        let wrong = || TrackerError::Spec { name: text.into() };
        let address = |rest: &str, default: Option<u16>| -> Option<(String, u16)> {
            let rest = rest.strip_suffix('/').unwrap_or(rest);
            // [::1]:50020 is an IPv6 address, and the colons in brackets belong to it.
            let (host, port) = match rest.strip_prefix('[') {
                Some(rest) => {
                    let (host, rest) = rest.split_once(']')?;
                    (host, if rest.is_empty() { None } else { Some(rest.strip_prefix(':')?) })
                }
                None => rest.split_once(':').map_or((rest, None), |(h, p)| (h, Some(p))),
            };
            let port = match port {
                Some(port) => port.parse().ok().filter(|p| *p != 0)?,
                None => default?,
            };
            Some((host.to_owned(), port))
        };
        if let Some(rest) = text.strip_prefix("pupil://") {
            let (host, port) =
                address(rest, Some(PUPIL_REMOTE_PORT)).filter(|(h, _)| !h.is_empty()).ok_or_else(wrong)?;
            return Ok(Self::Pupil { host, port });
        }
        if let Some(rest) = text.strip_prefix("udp://") {
            let (host, port) = address(rest, None).ok_or_else(wrong)?;
            return Ok(Self::Udp { host: if host.is_empty() { "127.0.0.1".into() } else { host }, port });
        }
        match text {
            "hid" => return Ok(Self::Hid),
            "mouse" => return Ok(Self::Mouse),
            "simulated" => return Ok(Self::Simulated(0)),
            _ => {}
        }
        if let Some(seed) = text.strip_prefix("simulated:") {
            return seed.parse().map(Self::Simulated).map_err(|_| wrong());
        }
        let path = PathBuf::from(text);
        match path.extension().and_then(|e| e.to_str()) {
            Some("hid") => Ok(Self::Recording(path)),
            Some("jsonl") => Ok(Self::Lines(path)),
            _ => Err(wrong()),
        }
    }
}

/// The options of a source.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Delay between the eye and the arrival of its sample, as far as the source cannot measure it.
    pub latency: Duration,
    /// The description of a HID device with a layout of its own.
    pub device_file: Option<PathBuf>,
    /// True for recordings and the simulated eye in real time. Otherwise they are as fast as they can be read, with the
    /// times of real time.
    pub real_time: bool,
    /// Rate of the simulated tracker, samples per second.
    pub rate_hz: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { latency: Duration::ZERO, device_file: None, real_time: true, rate_hz: 120.0 }
    }
}

/// Opens a source. A source that has to wait for a device or a peer is opened and waits.
///
/// # Errors
/// A file or an address cannot be used, or the unit of numbers is unknown. The mouse gives [`TrackerError::Setting`],
/// because a window has to open it ([`pushed::mouse`](super::pushed::mouse)).
pub fn open(spec: &Spec, options: &Options) -> Result<Box<dyn Source>, TrackerError> {
    let latency_ns = u64::try_from(options.latency.as_nanos()).unwrap_or(u64::MAX);
    let file = options.device_file.as_deref().map(DeviceFile::load).transpose()?;
    let source: Box<dyn Source> = match spec {
        Spec::Hid => Box::new(HidSource::new(system_bus()?, file, latency_ns)),
        Spec::Recording(path) => {
            let recording = Recording::load(path)?;
            let layout = file.as_ref().map(|f| &f.layout);
            let source = RecordingSource::new(recording, layout, options.real_time, latency_ns);
            Box::new(source.map_err(|e| TrackerError::file(path, e.to_string()))?)
        }
        Spec::Lines(path) => Box::new(LineSource::open(path, options.real_time, latency_ns)?),
        #[cfg(feature = "trackers")]
        Spec::Pupil { host, port } => Box::new(PupilCoreSource::new(host, *port, latency_ns)),
        #[cfg(not(feature = "trackers"))]
        Spec::Pupil { .. } => {
            return Err(TrackerError::Setting(reason!(
                "no-trackers-feature",
                "pupil:// needs a build with the feature `trackers`"
            )));
        }
        Spec::Udp { host, port } => Box::new(UdpSource::bind(host, *port, latency_ns)?),
        Spec::Mouse => {
            return Err(TrackerError::Setting(reason!(
                "mouse-without-window",
                "the mouse is a tracker in a window only"
            )));
        }
        Spec::Simulated(seed) => {
            let settings = Settings { rate_hz: options.rate_hz, seed: *seed, ..Settings::default() };
            Box::new(SimulatedSource::new(settings, options.real_time)?)
        }
    };
    Ok(Box::new(Guard::new(source)))
}
