//! `eyebox tracker list` lists trackers, and `eyebox tracker describe` explains report descriptors.

use super::watch::{said, say};
use crate::Failure;
use crate::talk::print_report;
use clap::Args;
use eyebox::low_level::trackers::TrackerError;
use eyebox::low_level::trackers::hid::{self, Description, DeviceFile};
use eyebox::low_level::trackers::recording::Recording;
use serde_json::json;
use std::fmt::Write as _;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The arguments of `eyebox tracker list`.
#[derive(Args)]
pub struct List {
    /// TOML file that describes a HID device with a layout of its own
    #[arg(help_heading = "Eye", long, value_name = "FILE.toml")]
    pub device_file: Option<PathBuf>,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// The arguments of `eyebox tracker describe`.
#[derive(Args)]
pub struct Describe {
    /// A HID report descriptor (binary, text in hexadecimal, or the first of a recording of hid-recorder)
    pub file: PathBuf,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// Prints the meaning of a report descriptor.
pub fn describe(Describe { file, json }: &Describe) -> Result<(), Failure> {
    let wrong = |reason: String| Failure::from(TrackerError::file(file, reason));
    let bytes = descriptor_of(file)?;
    let description = Description::of(&bytes).map_err(|e| wrong(e.to_string()))?;
    let text = if *json {
        serde_json::to_string_pretty(&description).map_err(|e| wrong(e.to_string()))?
    } else {
        description.to_string().trim_end().to_owned()
    };
    said(say(&text))
}

/// Returns the bytes of a descriptor from a recording, from text in hexadecimal, or from a binary file.
fn descriptor_of(file: &Path) -> Result<Vec<u8>, Failure> {
    let wrong = |reason: String| Failure::from(TrackerError::file(file, reason));
    // The beginning is enough to find the format, and a recording may be long.
    let mut start = Vec::new();
    let open = eyebox::low_level::files::read::open(file).map_err(|e| wrong(e.to_string()))?;
    open.take(256 << 10).read_to_end(&mut start).map_err(|e| wrong(e.to_string()))?;
    let Some(text) = std::str::from_utf8(&start).ok().filter(|t| !t.contains('\0')) else { return Ok(start) };
    if text.lines().any(|l| l.starts_with("R:")) {
        let recording = Recording::load(file)?;
        let first = recording.devices.into_iter().map(|d| d.descriptor).find(|d| !d.is_empty());
        return first.ok_or_else(|| wrong("the recording has no descriptor".into()));
    }
    // Listings have comments after the bytes.
    let code = |line| -> &str { str::split(line, '#').next().and_then(|l| l.split("//").next()).unwrap_or_default() };
    let words = || text.lines().map(code).flat_map(|l| l.split([' ', '\t', ','])).filter(|w| !w.is_empty());
    let digits = |w: &str| w.trim_start_matches("0x").trim_start_matches("0X").to_owned();
    let is_hex = |w: &str| !w.is_empty() && w.len().is_multiple_of(2) && w.bytes().all(|b| b.is_ascii_hexdigit());
    if words().next().is_some() && words().all(|w| is_hex(&digits(w))) {
        let hex: String = words().map(digits).collect();
        return (0..hex.len() / 2)
            .map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).map_err(|e| wrong(e.to_string())))
            .collect();
    }
    Ok(start)
}

/// Lists the trackers of this machine and the other sources.
pub fn list(args: &List) -> Result<(), Failure> {
    let file = args.device_file.as_deref().map(DeviceFile::load).transpose()?;
    let listed = hid::system_bus().and_then(|mut bus| hid::list(bus.as_mut(), file.as_ref()));
    // Missing HID is no error, because the other sources exist all the same.
    let (found, problem) = match listed {
        Ok(found) => (found, None),
        Err(e) => (Vec::new(), Some(e.to_string())),
    };
    if args.json {
        let devices: Vec<_> = found
            .iter()
            .map(|d| {
                json!({
                    "path": d.info.path, "vendor": d.info.vendor, "product": d.info.product, "name": d.info.name,
                    "eye_tracker": d.tracker.is_ok(), "reason": d.tracker.as_ref().err().map(ToString::to_string),
                    "rate_hz": d.tracker.as_ref().ok().and_then(|t| t.rate_hz),
                    "notes": d.tracker.as_ref().map(|t| t.notes.clone()).unwrap_or_default(),
                })
            })
            .collect();
        print_report(json!({ "hid": devices, "problem": problem, "sources": SOURCES.map(|s| s.0) }));
        return Ok(());
    }
    let mut text = String::new();
    let trackers = found.iter().filter(|d| d.tracker.is_ok()).count();
    match &problem {
        Some(problem) => text += &format!("hid         {problem}\n"),
        None => {
            let _ = writeln!(text, "hid         {trackers} eye trackers among {} HID devices", found.len());
        }
    }
    for d in &found {
        let _ = write!(text, "            {} ({:04x}:{:04x}): ", d.info.name, d.info.vendor, d.info.product);
        match &d.tracker {
            Ok(about) => {
                let rate = about.rate_hz.map_or_else(String::new, |hz| format!("{hz} Hz; "));
                let _ = writeln!(text, "{rate}{}", about.notes.join("; "));
            }
            Err(e) => {
                let _ = writeln!(text, "{e}");
            }
        }
    }
    for (name, what) in SOURCES.iter().skip(1) {
        let _ = writeln!(text, "{name:11} {what}");
    }
    said(say(text.trim_end()))
}

const SOURCES: [(&str, &str); 6] = [
    ("hid", "HID devices of usage page 0x12"),
    ("FILE.hid", "a recording of hid-recorder"),
    ("FILE.jsonl", "recorded samples"),
    ("pupil://", "Pupil Core's network interface, pupil://HOST[:50020]"),
    ("udp://", "lines of JSON in datagrams, udp://:PORT for loopback, otherwise udp://HOST:PORT"),
    ("simulated", "a simulated eye before a simulated tracker, simulated[:SEED]"),
];
