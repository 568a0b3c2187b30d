//! Reads phases in Zarr arrays that other programs wrote.
//!
//! Chunks may have any shape, with float32 or float64 values that are not compressed. Any other form is refused, and
//! the message gives the command line that converts it.

use super::HologramError;
use super::chunks::{GROUP, check_memory, check_sum, damaged, none, unreadable};
use super::document;
use crate::files::{Folder, zarr_line};
use eyebox_base::{Reason, reason};
use serde_json::Value;
use std::io;
use std::path::Path;

/// The largest number of chunks of an array.
const MOST_CHUNKS: u64 = 1 << 20;
/// The largest number of bytes of a chunk.
const LONGEST_CHUNK: u64 = 1 << 32;

/// The storage layout of an array's phases.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stored {
    /// Numbers of colors, sub-frames, rows and columns.
    pub shape: [usize; 4],
    chunk: [usize; 4],
    /// Bytes per value, 4 or 8.
    width: usize,
    big: bool,
    /// True if a chunk ends in its CRC-32C.
    summed: bool,
    separator: String,
    /// Phase of a chunk that is missing.
    fill: f32,
}

/// The error for a store that is not a hologram of this program, with the reason and the command line that converts it.
fn refused(folder: &Path, why: Reason) -> HologramError {
    none(
        folder,
        why.reworded(|why| format!("another program wrote it, and {why}. Convert it with: {}", zarr_line(folder))),
    )
}

/// Refuses a store of Zarr's version 2, which has no `zarr.json`.
pub(super) fn check_version(folder: &Folder) -> Result<(), HologramError> {
    let old = [".zgroup", ".zarray", ".zattrs"].iter().any(|name| folder.has(name));
    if old && !folder.has(GROUP) {
        Err(refused(folder.path(), reason!("zarr-2", "it is in Zarr's version 2")))
    } else {
        Ok(())
    }
}

/// Returns the error for a group's document that cannot be read.
pub(super) fn of_group(folder: &Folder, bytes: &[u8], reason: Reason) -> HologramError {
    let file = folder.path().join(GROUP);
    // A document of this program states its version.
    let others = serde_json::from_slice::<Value>(bytes)
        .is_ok_and(|document| document["attributes"]["eyebox"]["version"].as_str().is_none_or(str::is_empty));
    match document::is_sealed(bytes) {
        true if is_rewritten(bytes) => rewritten(folder.path()),
        false if others => none(&file, reason.reworded(|text| format!("another program wrote it, and {text}"))),
        _ => damaged(&file, reason),
    }
}

/// Returns true if another program rewrote a sealed document. Its checksum is wrong, and its layout is not of this
/// program.
fn is_rewritten(bytes: &[u8]) -> bool {
    let Ok(document) = serde_json::from_slice::<Value>(bytes) else { return false };
    let ours = serde_json::to_vec_pretty(&document).unwrap_or_default();
    bytes.trim_ascii_end() != ours || !bytes.ends_with(b"\n")
}

/// The error for a sealed document that another program rewrote.
fn rewritten(folder: &Path) -> HologramError {
    let file = folder.join(GROUP);
    let found = reason!("rewritten", "another program changed it after eyebox had written it");
    let line = "python -c \"import sys, json; d = json.load(open(sys.argv[1])); a = d['attributes']; \
                a.pop('document_crc32c'); a['eyebox'].pop('version'); json.dump(d, open(sys.argv[1], 'w'))\"";
    let decide = format!("If the change is intended, remove its checksum with: {line} {}", file.display());
    HologramError::doubtful(&file, found, &decide)
}

impl Stored {
    /// Reads the document of the array of `folder`.
    ///
    /// # Errors
    /// Returns [`HologramError::NotAHologram`], with the command line that converts the array, if its layout is not
    /// supported.
    pub fn of(folder: &Folder, bytes: &[u8]) -> Result<Self, HologramError> {
        Self::parse(bytes).map_err(|why| refused(folder.path(), why))
    }

    fn parse(bytes: &[u8]) -> Result<Self, Reason> {
        let found: Value =
            serde_json::from_slice(bytes).map_err(|e| reason!("not-json", "its phases/zarr.json is not JSON: {e}"))?;
        let lengths = |value: &Value| -> Option<Vec<usize>> {
            value.as_array()?.iter().map(|n| n.as_u64().and_then(|n| usize::try_from(n).ok())).collect()
        };
        let shape = lengths(&found["shape"]).and_then(|axes| <[usize; 4]>::try_from(axes).ok());
        let shape = shape.ok_or_else(|| {
            reason!(
                "foreign-shape",
                "its phases have the shape {}, but the axes (color, sub-frame, row, column) are needed",
                found["shape"]
            )
        })?;
        let chunk = lengths(&found["chunk_grid"]["configuration"]["chunk_shape"]);
        let chunk = chunk.and_then(|axes| <[usize; 4]>::try_from(axes).ok()).filter(|axes| !axes.contains(&0));
        let chunk = chunk.ok_or_else(|| reason!("chunk-lengths", "its chunks do not have four lengths"))?;
        let width = match found["data_type"].as_str() {
            Some("float32") => 4,
            Some("float64") => 8,
            _ => {
                return Err(reason!("foreign-type", "its phases are {}, not float32 radians", found["data_type"]));
            }
        };
        let (mut big, mut summed) = (false, false);
        for codec in found["codecs"].as_array().ok_or_else(|| reason!("no-codecs", "it lists no codecs"))? {
            match codec["name"].as_str() {
                Some("bytes") => big = codec["configuration"]["endian"] == "big",
                Some("crc32c") => summed = true,
                Some("sharding_indexed") => return Err(reason!("shards", "its chunks are in shards")),
                Some(name @ ("zstd" | "gzip" | "blosc" | "zlib" | "bz2" | "lz4")) => {
                    return Err(reason!("compressed", "its phases are compressed ({name})"));
                }
                _ => return Err(reason!("codec", "its phases are coded by {}", codec["name"])),
            }
        }
        let encoding = &found["chunk_key_encoding"];
        let default = if encoding["name"] == "v2" { "." } else { "/" };
        let separator = encoding["configuration"]["separator"].as_str().unwrap_or(default).to_owned();
        if encoding["name"] != "default" || !["/", "."].contains(&separator.as_str()) {
            return Err(reason!("chunk-names", "its chunks are named by {encoding}"));
        }
        let fill = found["fill_value"].as_f64().unwrap_or(0.0) as f32;
        let stored = Self { shape, chunk, width, big, summed, separator, fill };
        let count = stored.grid().iter().try_fold(1u64, |n, &axis| n.checked_mul(axis as u64));
        let bytes = chunk.iter().try_fold(width as u64 + 4, |n, &axis| n.checked_mul(axis as u64));
        if shape.contains(&0) || count.is_none_or(|n| n > MOST_CHUNKS) || bytes.is_none_or(|n| n > LONGEST_CHUNK) {
            return Err(reason!("chunks", "its shape {shape:?} in chunks of {chunk:?} is not supported"));
        }
        Ok(stored)
    }

    /// Returns the number of chunks along each axis.
    fn grid(&self) -> [usize; 4] {
        [0, 1, 2, 3].map(|i| self.shape[i].div_ceil(self.chunk[i]))
    }

    /// Reads the phases of every color. They may be any numbers.
    ///
    /// # Errors
    /// Returns [`HologramError::File`], [`HologramError::Damaged`] or [`HologramError::Memory`].
    pub fn read(&self, folder: &Folder) -> Result<Vec<Vec<f32>>, HologramError> {
        check_memory(folder.path(), &self.shape)?;
        let [colors, frames, height, width] = self.shape;
        let mut phases = vec![vec![self.fill; frames * height * width]; colors];
        let [a, b, c, d] = self.grid();
        for index in (0..a * b * c * d).map(|i| [i / (b * c * d), i / (c * d) % b, i / d % c, i % d]) {
            let numbers = index.map(|i| i.to_string()).join(&self.separator);
            let name = format!("phases/c{}{numbers}", self.separator);
            let Some(values) = self.chunk(folder, &name)? else { continue };
            let from = [0, 1, 2, 3].map(|i| index[i] * self.chunk[i]);
            let to = [0, 1, 2, 3].map(|i| (from[i] + self.chunk[i]).min(self.shape[i]));
            for (color, phases) in (from[0]..to[0]).zip(&mut phases[from[0]..to[0]]) {
                for frame in from[1]..to[1] {
                    for row in from[2]..to[2] {
                        let at = ((color - from[0]) * self.chunk[1] + frame - from[1]) * self.chunk[2] + row - from[2];
                        let line = &values[at * self.chunk[3]..][..to[3] - from[3]];
                        let place = (frame * height + row) * width + from[3];
                        phases[place..place + line.len()].copy_from_slice(line);
                    }
                }
            }
        }
        Ok(phases)
    }

    /// Returns the values of a chunk. Returns none for a missing chunk, all values of which are `fill`.
    fn chunk(&self, folder: &Folder, name: &str) -> Result<Option<Vec<f32>>, HologramError> {
        let count: usize = self.chunk.iter().product();
        let expected = count * self.width + 4 * usize::from(self.summed);
        let bytes = match folder.bytes(name, LONGEST_CHUNK) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == io::ErrorKind::NotFound && !folder.is_replaced() => return Ok(None),
            Err(e) => return Err(unreadable(folder, name, e)),
        };
        if bytes.len() != expected {
            let reason = reason!("length", "it is {} bytes long, not {expected}", bytes.len());
            return Err(damaged(&folder.path().join(name), reason));
        }
        let (values, sum) = bytes.split_at(count * self.width);
        if let (true, Ok(stated)) = (self.summed, sum.try_into()) {
            check_sum(folder, name, values, stated)?;
        }
        let value = |b: &[u8]| -> f32 {
            let mut all = [0; 8];
            all[..b.len()].copy_from_slice(b);
            if self.big {
                all[..b.len()].reverse();
            }
            match b.len() {
                4 => f32::from_le_bytes([all[0], all[1], all[2], all[3]]),
                _ => f64::from_le_bytes(all) as f32,
            }
        };
        Ok(Some(values.chunks_exact(self.width).map(value).collect()))
    }
}
