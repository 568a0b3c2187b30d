//! Reads the transfer function and the color primaries that a PNG states.
//!
//! The first of the chunks `cICP`, `sRGB`, and `gAMA` with `cHRM` that exists decides. A color profile (`iCCP`) takes
//! precedence over all of them but `cICP`.

use crate::light_field::light::Transfer;
use eyebox_base::error::Reason;
use eyebox_base::files::{Primaries, read};
use eyebox_base::reason;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

const MAGIC: [u8; 8] = *b"\x89PNG\r\n\x1a\n";
/// Largest number of chunks before the pixels that are read.
const MOST_CHUNKS: usize = 1000;

/// Exponents that approximate sRGB, and linear light.
const SRGB_GAMMA: std::ops::RangeInclusive<f64> = 0.43..=0.47;
const LINEAR_GAMMA: std::ops::RangeInclusive<f64> = 0.99..=1.01;

/// Chunks of a PNG that determine how values become light.
#[derive(Debug, Default)]
struct Chunks {
    /// Color primaries and transfer function of ITU-T H.273.
    code: Option<[u8; 2]>,
    is_profiled: bool,
    is_srgb: bool,
    gamma: Option<f64>,
    primaries: Option<Primaries>,
}

/// The statements of a PNG about its colors.
#[derive(Default)]
pub(crate) struct Stated {
    pub transfer: Option<Transfer>,
    pub primaries: Option<Primaries>,
}

/// Returns the statements of a picture. Files other than PNG have none.
///
/// # Errors
/// The statement in words, if the transfer function is neither sRGB nor linear light, or if the primaries are unknown.
pub(crate) fn stated(path: &Path) -> Result<Stated, Reason> {
    // The decoder refuses a file that cannot be read.
    let Ok(Some(chunks)) = chunks(path) else { return Ok(Stated::default()) };
    let transfer = match chunks {
        Chunks { code: Some([_, 1 | 4 | 6 | 13..=15]), .. } => Some(Transfer::Srgb),
        Chunks { code: Some([_, 8]), .. } => Some(Transfer::Linear),
        Chunks { code: Some([_, 16]), .. } => return Err(reason!("pq", "the transfer function PQ of HDR")),
        Chunks { code: Some([_, 18]), .. } => return Err(reason!("hlg", "the transfer function HLG of HDR")),
        Chunks { code: Some([_, other]), .. } => {
            return Err(reason!("transfer", "the transfer function {other} of ITU-T H.273"));
        }
        Chunks { is_profiled: true, .. } => None,
        Chunks { is_srgb: true, .. } => Some(Transfer::Srgb),
        Chunks { gamma: Some(gamma), .. } if SRGB_GAMMA.contains(&gamma) => Some(Transfer::Srgb),
        Chunks { gamma: Some(gamma), .. } if LINEAR_GAMMA.contains(&gamma) => Some(Transfer::Linear),
        Chunks { gamma: Some(gamma), .. } => return Err(reason!("gamma", "a gamma of {gamma}")),
        _ => None,
    };
    let primaries = match chunks {
        // The code 2 leaves the primaries open.
        Chunks { code: Some([2, _]), .. } => None,
        Chunks { code: Some([code, _]), .. } => match Primaries::of_code(code) {
            None => return Err(reason!("primaries", "the color primaries {code} of ITU-T H.273")),
            known => known,
        },
        Chunks { is_profiled: false, is_srgb: false, primaries, .. } => primaries,
        _ => None,
    };
    Ok(Stated { transfer, primaries })
}

/// Reads the chromaticities of the chunk `cHRM`, with white first, in steps of 1/100,000.
fn chromaticities(bytes: [u8; 32]) -> Primaries {
    let at = |i: usize| {
        let [x, y] = [8 * i, 8 * i + 4].map(|i| [bytes[i], bytes[i + 1], bytes[i + 2], bytes[i + 3]]);
        [x, y].map(|v| f64::from(u32::from_be_bytes(v)) / 1e5)
    };
    Primaries([at(1), at(2), at(3), at(0)])
}

fn chunks(path: &Path) -> io::Result<Option<Chunks>> {
    let mut from = BufReader::new(read::open(path)?);
    let mut magic = [0; 8];
    from.read_exact(&mut magic)?;
    if magic != MAGIC {
        return Ok(None);
    }
    let mut found = Chunks::default();
    for _ in 0..MOST_CHUNKS {
        let mut head = [0; 8];
        from.read_exact(&mut head)?;
        let [length, kind] = [0, 4].map(|i| [head[i], head[i + 1], head[i + 2], head[i + 3]]);
        let length = u32::from_be_bytes(length);
        let mut skipped = i64::from(length) + 4;
        match &kind {
            b"IDAT" | b"IEND" => break,
            b"iCCP" => found.is_profiled = true,
            b"sRGB" => found.is_srgb = true,
            b"gAMA" | b"cICP" if length == 4 => {
                let mut value = [0; 4];
                from.read_exact(&mut value)?;
                skipped = 4;
                if &kind == b"cICP" {
                    found.code = Some([value[0], value[1]]);
                } else {
                    found.gamma = Some(f64::from(u32::from_be_bytes(value)) / 1e5);
                }
            }
            b"cHRM" if length == 32 => {
                let mut bytes = [0; 32];
                from.read_exact(&mut bytes)?;
                skipped = 4;
                found.primaries = Some(chromaticities(bytes));
            }
            _ => {}
        }
        from.seek(SeekFrom::Current(skipped))?;
    }
    Ok(Some(found))
}
