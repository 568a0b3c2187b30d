//! The two JSON documents of a hologram, and the checksum that each carries about itself.

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
/// Version of what an older eyebox would take for something else: a hologram, or a sequence, that is not for a relay.
const GEOMETRY_FORMAT: u64 = 3;
/// What is wrong with a sequence where one hologram is wanted.
pub(super) const IS_SEQUENCE: &str =
    "it is a sequence of holograms, and one hologram is wanted: take one by its number, such as `at` 0 for the first";
/// The last attribute of either document, with eight hexadecimal digits as its value.
const SEAL: &str = "\"document_crc32c\": \"";
const BLANK: &[u8; 8] = b"00000000";

/// `attributes.eyebox`, in the units of people.
#[derive(Serialize, Deserialize)]
struct Attributes {
    format: u64,
    /// None where another program wrote it.
    #[serde(default)]
    version: String,
    pitch_um: f64,
    focal_length_mm: f64,
    /// Of format 3.
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
    /// Null where nothing is known.
    #[serde(default)]
    settings: Option<Metadata>,
    /// Of format 2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sequence: Option<SequenceAttributes>,
}

/// What a sequence says beside what each of its holograms does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct SequenceAttributes {
    /// Holograms a second, a fraction.
    pub(super) rate: [u32; 2],
    /// Of one hologram: colours, sub-frames, rows, columns.
    pub(super) shape: [usize; 4],
    /// How many there are to be.
    pub(super) planned: Option<u64>,
}

#[derive(Serialize, Deserialize)]
struct ColorAttributes {
    #[serde(default)]
    color: Option<Color>,
    wavelength_nm: f64,
    /// None where nobody knows it.
    #[serde(default)]
    exposure: Option<f64>,
    #[serde(default)]
    efficiency: Option<f64>,
}

/// What the array's document says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Array {
    /// Colours, sub-frames, rows, columns.
    pub(super) shape: [usize; 4],
    /// Side of its tiles, where it has tiles.
    pub(super) side: Option<usize>,
    /// Whether chunks end in their checksum.
    pub(super) summed: bool,
}

/// The group's document of one hologram, as it is.
#[cfg(test)]
pub(super) fn group(hologram: &Hologram) -> Vec<u8> {
    group_with(hologram, hologram.metadata.clone(), None)
}

/// The group's document as it is written at `path`, of a sequence of holograms like this one if there are `sequence`
/// attributes.
pub(super) fn group_at(path: &Path, hologram: &Hologram, sequence: Option<SequenceAttributes>) -> Vec<u8> {
    group_with(hologram, hologram.metadata.written_at(path), sequence)
}

/// The same with other metadata.
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

/// The array's document: one chunk a sub-frame, or square tiles of this side with all sub-frames.
pub(super) fn array(shape: [usize; 4], tile: Option<usize>) -> Vec<u8> {
    let [_, frames, height, width] = shape;
    let chunk = tile.map_or([1, 1, height, width], |side| [1, frames, side, side]);
    let attributes = json!({ "unit": "radian", "document_crc32c": "00000000" });
    array_of(json!(shape), json!(chunk), &["color", "frame", "row", "column"], attributes)
}

/// The array's document of a sequence: one chunk a hologram, so that it is read and checked in one piece.
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

/// Reads the array's document of a sequence whose holograms have this shape: how many there are, and whether there will
/// be no more. Says what is wrong.
pub(super) fn read_sequence_array(bytes: &[u8], shape: [usize; 4]) -> Result<(u64, bool), Reason> {
    let found = unseal(bytes)?;
    let count = found["shape"][0].as_u64().ok_or_else(|| reason!("shape", "its shape does not begin with a number"))?;
    let complete = found["attributes"]["complete"]
        .as_bool()
        .ok_or_else(|| reason!("not-complete", "it does not say whether it is complete"))?;
    expect_like(&found, &sequence_array(count, shape, complete), &[])?;
    Ok((count, complete))
}

/// Reads the group's document of one hologram into a hologram that has no phases yet. Says what is wrong.
pub(super) fn read_group(bytes: &[u8]) -> Result<Hologram, Reason> {
    match read_any_group(bytes)? {
        (hologram, None) => Ok(hologram),
        (_, Some(_)) => Err(Reason::new("is-a-sequence", IS_SEQUENCE)),
    }
}

/// Reads the group's document of a hologram or of a sequence. Says what is wrong.
pub(super) fn read_any_group(bytes: &[u8]) -> Result<(Hologram, Option<SequenceAttributes>), Reason> {
    let document = read(bytes, false)?;
    let attributes = &document["attributes"]["eyebox"];
    // A newer layout is told by its number before anything else in it is judged.
    let format = match attributes["format"].as_u64() {
        Some(format @ FORMAT..=GEOMETRY_FORMAT) => format,
        Some(newer) if newer > GEOMETRY_FORMAT => {
            return Err(reason!(
                "newer-format",
                "it has format {newer}, made by a newer eyebox: this one reads formats {FORMAT} to {GEOMETRY_FORMAT}"
            ));
        }
        _ => return Err(reason!("no-format", "it states no format")),
    };
    let read = Attributes::deserialize(attributes).map_err(|e| reason!("attributes", "attributes.eyebox: {e}"))?;
    if (read.geometry == Geometry::Relay) != (format < GEOMETRY_FORMAT) {
        return Err(reason!(
            "format-of-geometry",
            "it has format {format}, and {GEOMETRY_FORMAT} has a `geometry`, the others have not"
        ));
    }
    if format < GEOMETRY_FORMAT && read.sequence.is_some() != (format == SEQUENCE_FORMAT) {
        return Err(reason!(
            "format-of-sequence",
            "it has format {format}, and {SEQUENCE_FORMAT} has `sequence`, {FORMAT} has not"
        ));
    }
    if !read.version.is_empty() && !is_sealed(bytes) {
        let version = read.version;
        return Err(reason!(
            "no-checksum",
            "it carries no document_crc32c, and eyebox {version}, which wrote it by its `version`, has one"
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

/// Reads the array's document, which is sealed where the group's is. Without a seal, another program wrote it, and what
/// has no meaning here may be missing. Says what is wrong.
pub(super) fn read_array(bytes: &[u8], sealed: bool) -> Result<Array, Reason> {
    let mut found = read(bytes, sealed)?;
    let shape: [usize; 4] = Deserialize::deserialize(&found["shape"])
        .map_err(|e| reason!("shape", "its shape is not four lengths: {e}"))?;
    let chunk = &found["chunk_grid"]["configuration"]["chunk_shape"];
    // The whole of a single sub-frame is both.
    let whole = *chunk == json!([1, 1, shape[2], shape[3]]);
    let side = chunk[2].as_u64().filter(|side| !whole && (1..=1 << 14).contains(side)).map(|side| side as usize);
    if is_sealed(bytes) {
        expect_like(&found, &array(shape, side), &[])?;
        return Ok(Array { shape, side, summed: true });
    }
    // The separator that Zarr takes where none is said.
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

/// There is one way to say everything but the attributes and what is `free`, so documents are compared as a whole.
fn expect_like(found: &Value, expected: &[u8], free: &[&str]) -> Result<(), Reason> {
    let expected: Value = serde_json::from_slice(expected).expect("what is written here can be read");
    let mut keys = expected.as_object().expect("an object").iter();
    let differs = |(key, value): &(&String, &Value)| {
        *key != "attributes" && !free.contains(&key.as_str()) && found.get(key.as_str()) != Some(value)
    };
    keys.find(differs)
        .map_or(Ok(()), |(key, value)| Err(reason!("array-key", "its {key} is {}, not {value}", found[key.as_str()])))
}

/// The number in the unit of people that, divided by `per`, gives back exactly `value`; the shortest such.
fn in_unit(value: f64, per: f64) -> f64 {
    let plain = value * per;
    (0..17)
        .filter_map(|digits| format!("{plain:.digits$e}").parse().ok())
        .find(|v: &f64| v / per == value)
        .unwrap_or(plain)
}

/// Serialises a document and puts into its last attribute the CRC-32C of all its bytes, taken with that attribute's
/// digits as zeros. No canonical form is needed: the bytes that lie on the disk are what is summed.
fn seal(document: Value) -> Vec<u8> {
    let mut bytes = serde_json::to_vec_pretty(&document).expect("a document of strings, numbers and lists");
    bytes.push(b'\n');
    let sum = crc32c::crc32c(&bytes);
    let at = seal_place(&bytes).expect("the document ends in its seal");
    bytes[at..at + 8].copy_from_slice(format!("{sum:08x}").as_bytes());
    bytes
}

/// A document that may change while its hologram is made, with its seal.
pub(super) fn sealed(mut document: Value) -> Vec<u8> {
    document["document_crc32c"] = json!("00000000");
    seal(document)
}

/// Reads such a document. One from before they were sealed is taken as it is. Says what is wrong.
pub(super) fn read_sealed(bytes: &[u8]) -> Result<Value, Reason> {
    if seal_place(bytes).is_some() {
        return unseal(bytes);
    }
    serde_json::from_slice(bytes).map_err(|e| reason!("not-json", "it is no JSON: {e}"))
}

/// Whether a document carries a checksum.
pub(super) fn is_sealed(bytes: &[u8]) -> bool {
    seal_place(bytes).is_some()
}

/// Reads a document that another program may have written, without a seal, unless it must be `sealed`.
fn read(bytes: &[u8], sealed: bool) -> Result<Value, Reason> {
    if sealed || is_sealed(bytes) {
        return unseal(bytes);
    }
    let document: Value = serde_json::from_slice(bytes).map_err(|e| reason!("not-json", "it is no JSON: {e}"))?;
    match &document["attributes"]["document_crc32c"] {
        Value::Null => Ok(document),
        _ => Err(reason!(
            "checksum-form",
            "its document_crc32c is not written as `\"document_crc32c\": \"` and eight digits"
        )),
    }
}

fn unseal(bytes: &[u8]) -> Result<Value, Reason> {
    let at = seal_place(bytes).ok_or_else(|| reason!("no-checksum", "it carries no document_crc32c"))?;
    let mut blank = bytes.to_vec();
    blank[at..at + 8].copy_from_slice(BLANK);
    let sum = format!("{:08x}", crc32c::crc32c(&blank));
    if bytes[at..at + 8] != *sum.as_bytes() {
        let stated = String::from_utf8_lossy(&bytes[at..at + 8]).escape_debug().to_string();
        return Err(reason!("checksum", "its checksum is {sum}, and it states {stated}"));
    }
    serde_json::from_slice(bytes).map_err(|e| reason!("not-json", "it is no JSON: {e}"))
}

/// Where the digits stand: after the last mention, for what comes before it may hold anything.
fn seal_place(bytes: &[u8]) -> Option<usize> {
    let at = bytes.windows(SEAL.len()).rposition(|w| w == SEAL.as_bytes())? + SEAL.len();
    (at + 8 <= bytes.len()).then_some(at)
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// A document with the sum that it has now, where it has a place for one.
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
