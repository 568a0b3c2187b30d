//! Reads and writes the two JSON documents of a hologram, each with its own checksum.

use super::{ColorHologram, Hologram, Metadata};
use crate::optics::{Color, Geometry, Wavelength};
use eyebox_base::{Reason, reason};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// Version of the layout of one hologram.
const FORMAT: u64 = 1;
/// Version of the layout of a sequence.
const SEQUENCE_FORMAT: u64 = 2;
/// Version of the layout of a hologram or sequence that is not for a relay. An older eyebox would mistake it for a
/// relay's, so it has its own number.
const GEOMETRY_FORMAT: u64 = 3;
/// The message for a sequence that was given instead of one hologram.
pub(super) const IS_SEQUENCE: &str =
    "it is a sequence of holograms, but one hologram is needed. Choose one by its number, such as `at` 0 for the first";
/// The last attribute of either document, with eight hexadecimal digits as its value.
const SEAL: &str = "\"document_crc32c\": \"";
const BLANK: &[u8; 8] = b"00000000";

/// The content of `attributes.eyebox`, in micrometers, millimeters and nanometers.
#[derive(Serialize, Deserialize)]
struct Attributes {
    format: u64,
    /// Empty if another program wrote the document.
    #[serde(default)]
    version: String,
    pitch_um: f64,
    focal_length_mm: f64,
    /// Only documents of format 3 have a geometry.
    #[serde(default, skip_serializing_if = "Geometry::is_relay")]
    geometry: Geometry,
    colors: Vec<ColorAttributes>,
    #[serde(default)]
    seed: u64,
    #[serde(default)]
    display: String,
    #[serde(default)]
    display_wavelengths_nm: BTreeMap<Color, f64>,
    #[serde(default)]
    scene: String,
    /// Null if the settings are not known.
    #[serde(default)]
    settings: Option<Metadata>,
    /// Only documents of sequences have this, which have format 2, or 3 if not for a relay.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sequence: Option<SequenceAttributes>,
}

/// The attributes that a sequence has in addition to a hologram's attributes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct SequenceAttributes {
    /// Holograms per second, as a fraction.
    pub(super) rate: [u32; 2],
    /// Colors, sub-frames, rows and columns of one hologram.
    pub(super) shape: [usize; 4],
    /// The planned number of holograms, if known.
    pub(super) planned: Option<u64>,
}

#[derive(Serialize, Deserialize)]
struct ColorAttributes {
    #[serde(default)]
    color: Option<Color>,
    wavelength_nm: f64,
    /// It is none if the exposure is not known.
    #[serde(default)]
    exposure: Option<f64>,
    #[serde(default)]
    efficiency: Option<f64>,
}

/// The content of the array's document.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Array {
    /// Numbers of colors, sub-frames, rows and columns.
    pub(super) shape: [usize; 4],
    /// Side of its tiles in pixels, if it has tiles.
    pub(super) side: Option<usize>,
    /// True if chunks end in their checksum.
    pub(super) summed: bool,
}

/// Returns the group's document of one hologram with its metadata unchanged.
#[cfg(test)]
pub(super) fn group(hologram: &Hologram) -> Vec<u8> {
    group_with(hologram, hologram.metadata.clone(), None)
}

/// Returns the group's document as it is written at `path`. With `sequence` attributes, it is the document of a
/// sequence of holograms like this one.
pub(super) fn group_at(path: &Path, hologram: &Hologram, sequence: Option<SequenceAttributes>) -> Vec<u8> {
    group_with(hologram, hologram.metadata.written_at(path), sequence)
}

/// Returns the group's document with other metadata.
pub(super) fn group_with(hologram: &Hologram, metadata: Metadata, sequence: Option<SequenceAttributes>) -> Vec<u8> {
    let attributes = Attributes {
        format: match (hologram.geometry, sequence) {
            (Geometry::Relay, None) => FORMAT,
            (Geometry::Relay, Some(_)) => SEQUENCE_FORMAT,
            (Geometry::FarField, _) => GEOMETRY_FORMAT,
        },
        version: hologram.version.clone(),
        pitch_um: in_unit(hologram.pitch, 1e6),
        focal_length_mm: in_unit(hologram.focal_length, 1e3),
        geometry: hologram.geometry,
        colors: (hologram.colors.iter())
            .map(|c| ColorAttributes {
                color: c.color,
                wavelength_nm: in_unit(c.wavelength, 1e9),
                exposure: Some(c.exposure),
                efficiency: Some(c.efficiency),
            })
            .collect(),
        seed: hologram.seed,
        display: hologram.display.clone(),
        display_wavelengths_nm: (hologram.display_wavelengths.iter())
            .map(|w| (w.color, in_unit(w.wavelength, 1e9)))
            .collect(),
        scene: hologram.scene.clone(),
        settings: Some(metadata).filter(|m| *m != Metadata::default()),
        sequence,
    };
    seal(json!({
        "zarr_format": 3,
        "node_type": "group",
        "attributes": { "eyebox": attributes, "document_crc32c": "00000000" },
    }))
}

/// Returns the array's document, with one chunk per sub-frame, or with square tiles of this side that hold all
/// sub-frames.
pub(super) fn array(shape: [usize; 4], tile: Option<usize>) -> Vec<u8> {
    let [_, frames, height, width] = shape;
    let chunk = tile.map_or([1, 1, height, width], |side| [1, frames, side, side]);
    let attributes = json!({ "unit": "radian", "document_crc32c": "00000000" });
    array_of(json!(shape), json!(chunk), &["color", "frame", "row", "column"], attributes)
}

/// Returns the array's document of a sequence. It has one chunk per hologram, so that a hologram is read and checked in
/// one piece.
pub(super) fn sequence_array(count: u64, [colors, frames, height, width]: [usize; 4], complete: bool) -> Vec<u8> {
    let (shape, chunk) = (json!([count, colors, frames, height, width]), json!([1, colors, frames, height, width]));
    let attributes = json!({ "unit": "radian", "complete": complete, "document_crc32c": "00000000" });
    array_of(shape, chunk, &["time", "color", "frame", "row", "column"], attributes)
}

fn array_of(shape: Value, chunk: Value, dimensions: &[&str], attributes: Value) -> Vec<u8> {
    seal(json!({
        "zarr_format": 3,
        "node_type": "array",
        "shape": shape,
        "data_type": "float32",
        "chunk_grid": { "name": "regular", "configuration": { "chunk_shape": chunk } },
        "chunk_key_encoding": { "name": "default", "configuration": { "separator": "/" } },
        "fill_value": 0.0,
        "codecs": [{ "name": "bytes", "configuration": { "endian": "little" } }, { "name": "crc32c" }],
        "dimension_names": dimensions,
        "attributes": attributes,
    }))
}

/// Reads the array's document of a sequence whose holograms have this shape. Returns the number of holograms, and true
/// if the sequence is complete. The error is the reason why it cannot be read.
pub(super) fn read_sequence_array(bytes: &[u8], shape: [usize; 4]) -> Result<(u64, bool), Reason> {
    let found = unseal(bytes)?;
    let count = found["shape"][0].as_u64().ok_or_else(|| reason!("shape", "its shape does not begin with a number"))?;
    let complete = found["attributes"]["complete"]
        .as_bool()
        .ok_or_else(|| reason!("not-complete", "it has no attribute `complete`"))?;
    expect_like(&found, &sequence_array(count, shape, complete), &[])?;
    Ok((count, complete))
}

/// Reads the group's document of one hologram into a hologram without phases. The error is the reason why it cannot be
/// read.
pub(super) fn read_group(bytes: &[u8]) -> Result<Hologram, Reason> {
    match read_any_group(bytes)? {
        (hologram, None) => Ok(hologram),
        (_, Some(_)) => Err(Reason::new("is-a-sequence", IS_SEQUENCE)),
    }
}

/// Reads the group's document of a hologram or of a sequence. The error is the reason why it cannot be read.
pub(super) fn read_any_group(bytes: &[u8]) -> Result<(Hologram, Option<SequenceAttributes>), Reason> {
    let document = read(bytes, false)?;
    let attributes = &document["attributes"]["eyebox"];
    // The number of a newer layout is checked before anything else in it.
    let format = match attributes["format"].as_u64() {
        Some(format @ FORMAT..=GEOMETRY_FORMAT) => format,
        Some(newer) if newer > GEOMETRY_FORMAT => {
            return Err(reason!(
                "newer-format",
                "it has format {newer} of a newer eyebox. This version reads formats {FORMAT} to {GEOMETRY_FORMAT}"
            ));
        }
        _ => return Err(reason!("no-format", "it states no format")),
    };
    let read = Attributes::deserialize(attributes).map_err(|e| reason!("attributes", "attributes.eyebox: {e}"))?;
    if (read.geometry == Geometry::Relay) != (format < GEOMETRY_FORMAT) {
        return Err(reason!(
            "format-of-geometry",
            "it has format {format}, but only format {GEOMETRY_FORMAT} has a `geometry`"
        ));
    }
    if format < GEOMETRY_FORMAT && read.sequence.is_some() != (format == SEQUENCE_FORMAT) {
        return Err(reason!(
            "format-of-sequence",
            "it has format {format}, but format {SEQUENCE_FORMAT} has a `sequence` and format {FORMAT} has none"
        ));
    }
    if !read.version.is_empty() && !is_sealed(bytes) {
        let version = read.version;
        return Err(reason!(
            "no-checksum",
            "it has no document_crc32c, but its `version` states that eyebox {version} wrote it, which writes one"
        ));
    }
    let sequence = read.sequence;
    let mut metadata = read.settings.unwrap_or_default();
    metadata.exposure_assumed |= read.colors.iter().any(|c| c.exposure.is_none());
    let known = |c: &ColorAttributes| Some((c.color?, c.wavelength_nm));
    let wavelengths = match read.display_wavelengths_nm.is_empty() {
        true if !is_sealed(bytes) => read.colors.iter().filter_map(known).collect(),
        _ => read.display_wavelengths_nm,
    };
    metadata.check().map_err(|e| reason!("settings", "attributes.eyebox.settings: {e}"))?;
    let hologram = Hologram {
        pitch: read.pitch_um / 1e6,
        focal_length: read.focal_length_mm / 1e3,
        geometry: read.geometry,
        colors: (read.colors.into_iter())
            .map(|c| ColorHologram {
                color: c.color,
                wavelength: c.wavelength_nm / 1e9,
                exposure: c.exposure.unwrap_or(1.0),
                efficiency: c.efficiency.unwrap_or(1.0),
                phases: Vec::new(),
            })
            .collect(),
        seed: read.seed,
        version: read.version,
        display: read.display,
        display_wavelengths: (wavelengths.into_iter())
            .map(|(color, nm)| Wavelength { color, wavelength: nm / 1e9 })
            .collect(),
        scene: read.scene,
        metadata,
        ..Hologram::default()
    };
    Ok((hologram, sequence))
}

/// Reads the array's document, which must have a seal if the group's document has one. If it has no seal, another
/// program wrote it, and attributes without a meaning here may be missing. The error is the reason why it cannot be
/// read.
pub(super) fn read_array(bytes: &[u8], sealed: bool) -> Result<Array, Reason> {
    let mut found = read(bytes, sealed)?;
    let shape: [usize; 4] = Deserialize::deserialize(&found["shape"])
        .map_err(|e| reason!("shape", "its shape is not four lengths: {e}"))?;
    let chunk = &found["chunk_grid"]["configuration"]["chunk_shape"];
    // A single sub-frame that is one chunk fits both layouts, and is not read as a tile.
    let whole = *chunk == json!([1, 1, shape[2], shape[3]]);
    let side = chunk[2].as_u64().filter(|side| !whole && (1..=1 << 14).contains(side)).map(|side| side as usize);
    if is_sealed(bytes) {
        expect_like(&found, &array(shape, side), &[])?;
        return Ok(Array { shape, side, summed: true });
    }
    // Zarr uses this separator if none is given.
    let keys = &mut found["chunk_key_encoding"];
    if *keys == json!({ "name": "default" }) {
        *keys = json!({ "name": "default", "configuration": { "separator": "/" } });
    }
    let summed = found["codecs"].as_array().is_none_or(|codecs| codecs.len() != 1);
    if let (false, Some(codecs)) = (summed, found["codecs"].as_array_mut()) {
        codecs.push(json!({ "name": "crc32c" }));
    }
    expect_like(&found, &array(shape, side), &["fill_value", "dimension_names"])?;
    Ok(Array { shape, side, summed })
}

/// Compares a document with the expected one as a whole. Everything but the attributes and the keys in `free` can be
/// written in one way only.
fn expect_like(found: &Value, expected: &[u8], free: &[&str]) -> Result<(), Reason> {
    let expected: Value = serde_json::from_slice(expected).expect("documents written here are readable");
    let mut keys = expected.as_object().expect("an object").iter();
    let differs = |(key, value): &(&String, &Value)| {
        *key != "attributes" && !free.contains(&key.as_str()) && found.get(key.as_str()) != Some(value)
    };
    keys.find(differs)
        .map_or(Ok(()), |(key, value)| Err(reason!("array-key", "its {key} is {}, not {value}", found[key.as_str()])))
}

/// Returns the shortest number in the larger unit that gives exactly `value` when divided by `per`.
fn in_unit(value: f64, per: f64) -> f64 {
    let plain = value * per;
    (0..17)
        .filter_map(|digits| format!("{plain:.digits$e}").parse().ok())
        .find(|v: &f64| v / per == value)
        .unwrap_or(plain)
}

/// Serializes a document and puts the CRC-32C of all its bytes into its last attribute. The sum is taken with that
/// attribute's digits as zeros. No canonical form is needed, because the sum is over the bytes that are on the disk.
fn seal(document: Value) -> Vec<u8> {
    let mut bytes = serde_json::to_vec_pretty(&document).expect("a document of strings, numbers and lists");
    bytes.push(b'\n');
    let sum = crc32c::crc32c(&bytes);
    let at = seal_place(&bytes).expect("the document ends in its seal");
    bytes[at..at + 8].copy_from_slice(format!("{sum:08x}").as_bytes());
    bytes
}

/// Returns a document, with its seal, that may change while its hologram is made.
pub(super) fn sealed(mut document: Value) -> Vec<u8> {
    document["document_crc32c"] = json!("00000000");
    seal(document)
}

/// Reads such a document. A document without a seal, written before seals existed, is accepted. The error is the reason
/// why it cannot be read.
pub(super) fn read_sealed(bytes: &[u8]) -> Result<Value, Reason> {
    if seal_place(bytes).is_some() {
        return unseal(bytes);
    }
    serde_json::from_slice(bytes).map_err(|e| reason!("not-json", "it is not JSON: {e}"))
}

/// Returns true if a document carries a checksum.
pub(super) fn is_sealed(bytes: &[u8]) -> bool {
    seal_place(bytes).is_some()
}

/// Reads a document that may have no seal because another program wrote it, unless it must be `sealed`.
fn read(bytes: &[u8], sealed: bool) -> Result<Value, Reason> {
    if sealed || is_sealed(bytes) {
        return unseal(bytes);
    }
    let document: Value = serde_json::from_slice(bytes).map_err(|e| reason!("not-json", "it is not JSON: {e}"))?;
    match &document["attributes"]["document_crc32c"] {
        Value::Null => Ok(document),
        _ => Err(reason!(
            "checksum-form",
            "its document_crc32c is not written as `\"document_crc32c\": \"` and eight digits"
        )),
    }
}

fn unseal(bytes: &[u8]) -> Result<Value, Reason> {
    let at = seal_place(bytes).ok_or_else(|| reason!("no-checksum", "it has no document_crc32c"))?;
    let mut blank = bytes.to_vec();
    blank[at..at + 8].copy_from_slice(BLANK);
    let sum = format!("{:08x}", crc32c::crc32c(&blank));
    if bytes[at..at + 8] != *sum.as_bytes() {
        let stated = String::from_utf8_lossy(&bytes[at..at + 8]).escape_debug().to_string();
        return Err(reason!("checksum", "its checksum is {sum}, but it states {stated}"));
    }
    serde_json::from_slice(bytes).map_err(|e| reason!("not-json", "it is not JSON: {e}"))
}

/// Returns the index of the digits. It uses the last mention, because the text before it may hold anything.
fn seal_place(bytes: &[u8]) -> Option<usize> {
    let at = bytes.windows(SEAL.len()).rposition(|w| w == SEAL.as_bytes())? + SEAL.len();
    (at + 8 <= bytes.len()).then_some(at)
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// Returns a document with its sum computed again, if it has a place for one.
    pub(in super::super) fn resealed(mut bytes: Vec<u8>) -> Vec<u8> {
        if let Some(at) = seal_place(&bytes) {
            bytes[at..at + 8].copy_from_slice(BLANK);
            let sum = crc32c::crc32c(&bytes);
            bytes[at..at + 8].copy_from_slice(format!("{sum:08x}").as_bytes());
        }
        bytes
    }

    #[test]
    fn lengths_are_short_for_people_and_exact_for_the_program() {
        assert_eq!((in_unit(520e-9, 1e9), in_unit(8e-6, 1e6), in_unit(0.4, 1e3)), (520.0, 8.0, 400.0));
        for value in [660.0 * 1e-9, 10.8 * 1e-6, 0.1 + 0.2, std::f64::consts::PI * 1e-7] {
            assert_eq!(in_unit(value, 1e9) / 1e9, value);
        }
    }

    #[test]
    fn a_seal_is_found_behind_settings_that_imitate_it() {
        let sealed = seal(json!({"attributes": {"a": {"document_crc32c": "12345678"}, "document_crc32c": "00000000"}}));
        assert_eq!(unseal(&sealed).unwrap()["attributes"]["a"]["document_crc32c"], "12345678");
    }

    #[test]
    fn a_newer_format_is_called_newer() {
        let text =
            String::from_utf8(seal(json!({"attributes": {"eyebox": {"format": 9}, "document_crc32c": "00000000"}})));
        assert!(read_group(text.unwrap().as_bytes()).unwrap_err().code() == "newer-format");
    }
}
