//! Reads the layout of a device's reports from a file, which states the bytes of each number.
//!
//! ```toml
//! name = "Bench tracker"
//! vendor = 0x1234                 # USB IDs of the device
//! product = 0x5678
//! report_id = 1                   # 0 or left out if reports have no ID
//! bytes = 22                      # size of the report with its ID, shorter ones are refused
//! start = [0x05, 0x01]            # a feature report to write first, if the device needs one
//! time = { offset = 1, size = 4, scale = 1e-6 }                 # seconds per count
//!
//! [left]
//! unit = "mm"                     # mm, deg, normalized or counts
//! what = "pupil"                  # pupil or gaze
//! x = { offset = 5, size = 2, signed = true, scale = 0.001 }    # unit per count
//! y = { offset = 7, size = 2, signed = true, scale = 0.001 }
//! diameter = { offset = 9, size = 2, scale = 0.001 }            # mm per count
//! confidence = { offset = 11, size = 1, scale = 0.00392 }       # 0 to 1
//! valid = { offset = 12, size = 1 }                             # not 0 if seen
//! ```
//!
//! Offsets are bytes from the first byte of the report, including its ID if it has one. `range = [low, high]`, in raw
//! counts, refuses values outside.

use super::layout::{InputReport, Layout, Place, Role, Slot, TimeSlots};
use crate::trackers::{Quantity, TrackerError, Unit, UnitText};
use eyebox_base::error::Reason;
use eyebox_base::files::read;
use eyebox_base::reason;
use serde::Deserialize;
use std::path::Path;

/// A device with a layout that a file describes.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceFile {
    /// Name of the device.
    pub name: String,
    /// Vendor and product of the device.
    pub id: [u16; 2],
    /// The places of all numbers in the report.
    pub layout: Layout,
    /// A feature report that is written first. Its first byte is the ID.
    pub start: Option<Vec<u8>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    /// Name of the device.
    name: Option<String>,
    /// USB vendor of the device.
    vendor: u16,
    /// USB product of the device.
    product: u16,
    /// ID of the report that is read, or 0 if reports carry no ID.
    #[serde(default)]
    report_id: u8,
    /// Bytes of the report, including its ID. Shorter reports are refused.
    bytes: usize,
    /// Bytes of a feature report that starts the device.
    start: Option<Vec<u8>>,
    /// The tracker's time, in seconds.
    time: Option<SlotText>,
    /// Position of the left eye, below.
    left: Option<PlaceText>,
    /// Position of the right eye, below.
    right: Option<PlaceText>,
    /// Position of both eyes, below.
    combined: Option<PlaceText>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PlaceText {
    /// Unit of x, y and z.
    #[serde(with = "UnitText")]
    unit: Unit,
    /// The quantity of the position, which is the pupil or the gaze point.
    #[serde(default)]
    what: Quantity,
    /// Coordinate x, which points to the right.
    x: SlotText,
    /// Coordinate y, which points down.
    y: SlotText,
    /// Coordinate z, which points away from the tracker.
    z: Option<SlotText>,
    /// Diameter of the pupil, millimeters.
    diameter: Option<SlotText>,
    /// Confidence from 0 to 1.
    confidence: Option<SlotText>,
    /// A number that is not 0 if the eye was seen.
    valid: Option<SlotText>,
}

#[derive(Deserialize, Clone)]
#[serde(deny_unknown_fields)]
struct SlotText {
    /// First byte of the number in the report.
    offset: usize,
    /// Number of bytes, 1 to 8, the lowest first.
    size: u32,
    /// True if the number has a sign.
    #[serde(default)]
    signed: bool,
    /// Units per count [default: 1].
    #[serde(default = "one")]
    scale: f64,
    /// Range of valid counts. All counts are valid without it.
    range: Option<[i64; 2]>,
}

fn one() -> f64 {
    1.0
}

impl DeviceFile {
    /// Reads a device file.
    ///
    /// # Errors
    /// [`TrackerError::File`] with the file, the line and the key.
    pub fn load(file: &Path) -> Result<Self, TrackerError> {
        let text = read::text(file, read::TEXT).map_err(|e| TrackerError::file(file, e.to_string()))?;
        Self::from_toml(&text).map_err(|reason| TrackerError::file(file, reason))
    }

    /// Reads the text of a device file.
    ///
    /// # Errors
    /// The problem, with its line or key.
    pub fn from_toml(text: &str) -> Result<Self, Reason> {
        let file: File = read::toml(text)?;
        let first = usize::from(file.report_id != 0);
        let longest = super::descriptor::LONGEST_REPORT;
        if !(first + 1..=longest).contains(&file.bytes) {
            return Err(reason!(
                "report-bytes",
                "bytes is {}, but a report has {} to {longest}",
                file.bytes,
                first + 1
            ));
        }
        let slot = |key: &str, s: &SlotText, unit: f64| -> Result<Slot, Reason> {
            if !(1..=8).contains(&s.size) {
                return Err(reason!("slot-size", "{key}: size is {}, but it must be 1 to 8 bytes", s.size));
            }
            if s.offset < first || s.offset.saturating_add(s.size as usize) > file.bytes {
                return Err(reason!(
                    "slot-place",
                    "{key}: bytes {} to {} are not inside a report of {} bytes{}",
                    s.offset,
                    s.offset.saturating_add(s.size as usize) - 1,
                    file.bytes,
                    if first == 1 { " behind its ID" } else { "" }
                ));
            }
            if !(s.scale.is_finite() && s.scale != 0.0) {
                return Err(reason!("slot-scale", "{key}: scale is {}, but it must be finite and not 0", s.scale));
            }
            if s.range.is_some_and(|[low, high]| low > high) {
                return Err(reason!("slot-range", "{key}: range must begin with the smallest"));
            }
            let (bit, bits) = ((s.offset - first) * 8, s.size * 8);
            Ok(Slot { bit, bits, signed: s.signed, logical: s.range, scale: s.scale * unit, zero: 0.0 })
        };
        let place = |name: &str, role: Role, p: &PlaceText| -> Result<Place, Reason> {
            let scale = p.unit.of_stated();
            let maybe = |key: &str, s: &Option<SlotText>, unit: f64| {
                s.as_ref().map(|s| slot(&format!("{name}.{key}"), s, unit)).transpose()
            };
            Ok(Place {
                role,
                quantity: p.what,
                unit: p.unit,
                axes: [
                    Some(slot(&format!("{name}.x"), &p.x, scale)?),
                    Some(slot(&format!("{name}.y"), &p.y, scale)?),
                    maybe("z", &p.z, scale)?,
                ],
                diameter: maybe("diameter", &p.diameter, 1e-3)?,
                confidence: maybe("confidence", &p.confidence, 1.0)?,
                valid: maybe("valid", &p.valid, 1.0)?,
            })
        };
        let mut places = Vec::new();
        let all = [
            ("left", Role::Left, &file.left),
            ("right", Role::Right, &file.right),
            ("combined", Role::Gaze, &file.combined),
        ];
        for (name, role, text) in all {
            if let Some(text) = text {
                places.push(place(name, role, text)?);
            }
        }
        if places.is_empty() {
            return Err(reason!(
                "no-position",
                "no position: give [left], [right] or [combined], each with unit, x and y"
            ));
        }
        let time = match &file.time {
            Some(text) => {
                let part = slot("time", text, 1.0)?;
                if text.scale <= 0.0 {
                    return Err(reason!("time-scale", "time: scale must be positive"));
                }
                Some(TimeSlots { scale: part.scale, parts: vec![part] })
            }
            None => None,
        };
        if file.start.as_ref().is_some_and(|s| s.is_empty() || s.len() > longest) {
            return Err(reason!("start-bytes", "start must have 1 to {longest} bytes, the ID first (0 if none)"));
        }
        let input = InputReport { id: file.report_id, bytes: file.bytes, time, places };
        let layout = Layout { numbered: file.report_id != 0, inputs: vec![input], ..Layout::default() };
        let name = file.name.unwrap_or_else(|| format!("{:04x}:{:04x}", file.vendor, file.product));
        Ok(Self { name, id: [file.vendor, file.product], layout, start: file.start })
    }
}
