//! Reads splats from `.spz` files of the versions 1 to 4.
//!
//! The attributes of all splats follow each other, which are positions, opacities, colors, deviations, quaternions and
//! harmonics. Versions 1 to 3 compress all of them by gzip, and version 4 compresses each by Zstandard. The axes are x
//! to the right, y upwards and z backwards.

use crate::SceneError;
use crate::splats::cloud::{Cloud, spread};
use crate::splats::file::{self, Bytes, Opened, broken};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use eyebox_kernels::splat_colors::{C0, count};
use flate2::read::GzDecoder;
use half::f16;
use std::io::{Read, Seek, SeekFrom, Take};
use std::path::Path;

/// The first bytes of a file, after unpacking in the versions 1 to 3.
pub(crate) const MAGIC: &[u8; 4] = b"NGSP";
/// The first bytes of gzip.
pub(crate) const GZIP: &[u8; 2] = b"\x1f\x8b";
/// The largest factors by which gzip and Zstandard shrink.
const SHRINK: [u64; 2] = [1032, 1 << 15];
/// Half the range of the constant harmonic in the stored colors.
const COLOR_SCALE: f32 = 0.15;
/// Flags of the header.
const ANTIALIASED: u8 = 1;
/// The harmonics of the degrees 1 to 3 whose sign changes with y and z.
const TURNED: [bool; 15] =
    [true, true, false, true, false, false, true, false, true, false, true, true, false, true, false];
/// Splats that are read together.
const BLOCK: usize = 4096;
/// Attributes of version 4 in their order.
const STREAMS: usize = 6;

/// The header of a file.
struct Header {
    version: u32,
    splats: u64,
    degree: usize,
    fraction: u8,
    flags: u8,
    streams: usize,
    table: u64,
}

impl Header {
    fn of(bytes: &[u8; 32]) -> Result<Self, Reason> {
        let word = |i: usize| u32::from_le_bytes(std::array::from_fn(|k| bytes[4 * i + k]));
        if &bytes[..4] != MAGIC {
            return Err(reason!("header", "it has no header of a .spz file"));
        }
        let (version, degree, fraction) = (word(1), usize::from(bytes[12]), bytes[13]);
        if !(1..=4).contains(&version) {
            return Err(reason!("version", "it has version {version}, but versions 1 to 4 are read"));
        }
        if degree > 4 || fraction > 23 {
            let text = format!("its header states harmonics of degree {degree} and {fraction} fractional bits");
            return Err(reason!("header", "{text}, but at most degree 4 and 23 bits are valid"));
        }
        let streams = usize::from(bytes[15]);
        Ok(Self { version, splats: word(2).into(), degree, fraction, flags: bytes[14], streams, table: word(4).into() })
    }

    /// Returns the bytes of each attribute of a splat.
    fn bytes(&self) -> [usize; STREAMS] {
        let (place, turn) = (if self.version == 1 { 6 } else { 9 }, if self.version < 3 { 3 } else { 4 });
        [place, 1, 3, 3, turn, 3 * count(self.degree)]
    }
}

/// Reads the splats of a `.spz` file.
///
/// # Errors
/// [`SceneError::Corrupt`] for a file that is not valid, and [`SceneError::Memory`].
pub(crate) fn read(path: &Path, mut opened: Opened) -> Result<Cloud, SceneError> {
    let corrupt = |reason: Reason| SceneError::Corrupt { file: path.display().to_string(), reason };
    let mut bytes = [0; 32];
    opened.file.read_exact(&mut bytes[..4]).map_err(|e| broken(path, &e))?;
    opened.file.rewind().map_err(|e| broken(path, &e))?;
    if bytes.starts_with(MAGIC) {
        opened.file.read_exact(&mut bytes).map_err(|e| broken(path, &e))?;
        let header = Header::of(&bytes).map_err(corrupt)?;
        if header.version < 4 {
            return Err(corrupt(reason!("version", "its version {} is not compressed by gzip", header.version)));
        }
        return streams(path, opened, &header);
    }
    let mut unpacked = GzDecoder::new(opened.file);
    unpacked.read_exact(&mut bytes[..16]).map_err(|e| broken(path, &e))?;
    let header = Header::of(&bytes).map_err(corrupt)?;
    if header.version > 3 {
        return Err(corrupt(reason!("version", "its version {} is not compressed by Zstandard", header.version)));
    }
    let one: usize = header.bytes().iter().sum();
    let most = opened.length.saturating_mul(SHRINK[0]);
    let count = file::checked_count(path, header.splats, one as u64, most)?;
    let mut attributes = Attributes::new(path, count, &header)?;
    for which in 0..STREAMS {
        attributes.read(which, &mut unpacked).map_err(|e| broken(path, &e))?;
    }
    Ok(attributes.cloud)
}

/// Reads the attributes of version 4, each in a stream of its own.
fn streams(path: &Path, mut opened: Opened, header: &Header) -> Result<Cloud, SceneError> {
    let corrupt = |reason: Reason| SceneError::Corrupt { file: path.display().to_string(), reason };
    let sizes = header.bytes();
    let used = if header.degree == 0 { STREAMS - 1 } else { STREAMS };
    let begin = header.table + 16 * header.streams as u64;
    if header.streams < used || header.table < 32 || begin > opened.length {
        let text = format!("its table of {} streams begins at byte {}", header.streams, header.table);
        return Err(corrupt(reason!("streams", "{text}, but it needs {used} streams and has {} bytes", opened.length)));
    }
    let mut table = vec![[0u64; 2]; header.streams];
    opened.file.seek(SeekFrom::Start(header.table)).map_err(|e| broken(path, &e))?;
    for entry in table.iter_mut().flatten() {
        let mut bytes = [0; 8];
        opened.file.read_exact(&mut bytes).map_err(|e| broken(path, &e))?;
        *entry = u64::from_le_bytes(bytes);
    }
    let mut at = begin;
    for (i, [packed, unpacked]) in table.iter().enumerate() {
        at = at.saturating_add(*packed);
        let expected = sizes.get(i).map(|size| header.splats * *size as u64).filter(|_| i < used);
        if at > opened.length || expected.is_some_and(|n| n != *unpacked || n > packed.saturating_mul(SHRINK[1])) {
            let text = format!("its stream {i} states {packed} bytes that unpack to {unpacked}");
            return Err(corrupt(reason!("streams", "{text}, which the file and its splats contradict")));
        }
    }
    let one: usize = sizes.iter().sum();
    let count = file::checked_count(path, header.splats, one as u64, u64::MAX)?;
    let mut attributes = Attributes::new(path, count, header)?;
    let mut at = begin;
    for (which, [packed, _]) in table.iter().enumerate().take(used) {
        opened.file.seek(SeekFrom::Start(at)).map_err(|e| broken(path, &e))?;
        let mut stream = unpacked(path, Read::by_ref(&mut opened.file).take(*packed))?;
        attributes.read(which, &mut stream).map_err(|e| broken(path, &e))?;
        at += packed;
    }
    Ok(attributes.cloud)
}

type Packed<'a> = Take<&'a mut Box<dyn Bytes>>;

/// Unpacks a stream of Zstandard.
#[cfg(feature = "zstd")]
fn unpacked<'a>(path: &Path, packed: Packed<'a>) -> Result<impl Read + use<'a>, SceneError> {
    let corrupt = |error| SceneError::Corrupt { file: path.display().to_string(), reason: error };
    ruzstd::decoding::StreamingDecoder::new(packed).map_err(|e| corrupt(reason!("zstandard", "a stream: {e}")))
}

/// Refuses a stream of Zstandard.
#[cfg(not(feature = "zstd"))]
fn unpacked<'a>(path: &Path, _packed: Packed<'a>) -> Result<Packed<'a>, SceneError> {
    let reason = reason!(
        "zstandard",
        "it has version 4, and eyebox was built without Zstandard. Convert it by: npx @playcanvas/splat-transform IN.spz \
         OUT.ply"
    );
    Err(SceneError::Corrupt { file: path.display().to_string(), reason })
}

/// The splats of a file, attribute by attribute.
struct Attributes {
    cloud: Cloud,
    count: usize,
    sizes: [usize; STREAMS],
    version: u32,
    /// The size of a step of the positions.
    step: f32,
    /// Harmonics of the file, of which the degrees up to 3 are used.
    harmonics: usize,
}

impl Attributes {
    fn new(path: &Path, count: usize, header: &Header) -> Result<Self, SceneError> {
        if header.degree > 3 {
            tracing::warn!("{}: its harmonics of degree 4 are left out", path.display());
        }
        let mut cloud = file::room(path, count, header.degree.min(3))?;
        cloud.antialiased = header.flags & ANTIALIASED != 0;
        let harmonics = self::count(header.degree);
        let step = 0.5f32.powi(header.fraction.into());
        Ok(Self { cloud, count, sizes: header.bytes(), version: header.version, step, harmonics })
    }

    /// Reads an attribute of all splats.
    fn read(&mut self, which: usize, from: &mut impl Read) -> std::io::Result<()> {
        let size = self.sizes[which];
        if size == 0 {
            return Ok(());
        }
        let mut block = vec![0; BLOCK * size];
        for first in (0..self.count).step_by(BLOCK) {
            let records = &mut block[..BLOCK.min(self.count - first) * size];
            from.read_exact(records)?;
            for (i, record) in records.chunks_exact(size).enumerate() {
                self.set(which, first + i, record);
            }
        }
        Ok(())
    }

    fn set(&mut self, which: usize, at: usize, record: &[u8]) {
        let cloud = &mut self.cloud;
        let share = |i: usize| f32::from(record[i]) / 255.0;
        match which {
            0 if self.version == 1 => {
                let value = |i: usize| f16::from_le_bytes([record[2 * i], record[2 * i + 1]]).to_f32();
                cloud.places.push([value(0), -value(1), -value(2)]);
            }
            0 => {
                let value = |i: usize| {
                    let word = i32::from_le_bytes([0, record[3 * i], record[3 * i + 1], record[3 * i + 2]]);
                    (word >> 8) as f32 * self.step
                };
                cloud.places.push([value(0), -value(1), -value(2)]);
            }
            1 => cloud.opacities.push(share(0)),
            2 => cloud.colors.push([0, 1, 2].map(|i| 0.5 + C0 * (share(i) - 0.5) / COLOR_SCALE)),
            3 => {
                // The deviations stay here until the quaternion is read.
                let [x, y, z] = [0, 1, 2].map(|i| (f32::from(record[i]) / 16.0 - 10.0).exp());
                cloud.spreads.push([x, y, z, 0.0, 0.0, 0.0]);
            }
            4 => {
                let [x, y, z, ..] = cloud.spreads[at];
                let [qx, qy, qz, qw] = if self.version < 3 { first_three(record) } else { smallest_three(record) };
                cloud.spreads[at] = spread([x, y, z], [qw, qx, -qy, -qz]);
            }
            _ => {
                for i in 0..self.harmonics.min(TURNED.len()) {
                    let sign = if TURNED[i] { -1.0 } else { 1.0 };
                    let value = |color: usize| (f32::from(record[3 * i + color]) - 128.0) / 128.0;
                    cloud.rest.extend([0, 1, 2].map(|color| f16::from_f32(sign * value(color))));
                }
            }
        }
    }
}

/// Returns the quaternion (x, y, z, w) of the versions 1 and 2.
fn first_three(record: &[u8]) -> [f32; 4] {
    let [x, y, z] = [0, 1, 2].map(|i| f32::from(record[i]) / 127.5 - 1.0);
    [x, y, z, (1.0 - x * x - y * y - z * z).max(0.0).sqrt()]
}

/// Returns the quaternion (x, y, z, w) of the versions 3 and 4. The highest two bits have the index of the largest
/// component, which is not stored. Each other component has a sign and 9 bits, with the last one in the lowest bits.
fn smallest_three(record: &[u8]) -> [f32; 4] {
    const MOST: u32 = (1 << 9) - 1;
    let mut word = u32::from_le_bytes([record[0], record[1], record[2], record[3]]);
    let largest = (word >> 30) as usize;
    let (mut turn, mut squares) = ([0.0f32; 4], 0.0);
    for i in (0..4).rev().filter(|i| *i != largest) {
        let size = std::f32::consts::FRAC_1_SQRT_2 * (word & MOST) as f32 / MOST as f32;
        turn[i] = if word >> 9 & 1 == 1 { -size } else { size };
        squares += size * size;
        word >>= 10;
    }
    turn[largest] = (1.0 - squares).max(0.0).sqrt();
    turn
}
