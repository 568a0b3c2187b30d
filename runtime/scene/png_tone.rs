//! The transfer function that a PNG states: chunks `cICP`, `sRGB` and `gAMA`, the first of them that is there. If it has a
//! color profile (`iCCP`), that decides instead of `sRGB` and `gAMA`.

use super::light::Transfer;
use crate::files::read;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

const MAGIC: [u8; 8] = *b"\x89PNG\r\n\x1a\n";
/// Chunks before the pixels that are looked at.
const MOST_CHUNKS: usize = 1000;

/// Exponents with which sRGB is approximated.
const SRGB_GAMMA: std::ops::RangeInclusive<f64> = 0.43..=0.47;
const LINEAR_GAMMA: std::ops::RangeInclusive<f64> = 0.99..=1.01;

/// Chunks of a PNG that say how values become light.
#[derive(Debug, Default)]
struct Chunks {
    /// Color primaries and transfer function of ITU-T H.273.
    code: Option<[u8; 2]>,
    is_profiled: bool,
    is_srgb: bool,
    gamma: Option<f64>,
}

/// Returns the transfer function that a picture states. `None` for other files than PNG, and for those that state none.
///
/// # Errors
/// The statement in words, if it is neither sRGB nor linear light.
pub(super) fn transfer(path: &Path) -> Result<Option<Transfer>, String> {
    // A file that cannot be read is refused by its decoder.
    let Ok(Some(chunks)) = chunks(path) else { return Ok(None) };
    match chunks {
        Chunks { code: Some([_, 1 | 4 | 6 | 13..=15]), .. } => Ok(Some(Transfer::Srgb)),
        Chunks { code: Some([_, 8]), .. } => Ok(Some(Transfer::Linear)),
        Chunks { code: Some([_, 16]), .. } => Err("the transfer function PQ of HDR".into()),
        Chunks { code: Some([_, 18]), .. } => Err("the transfer function HLG of HDR".into()),
        Chunks { code: Some([_, other]), .. } => Err(format!("the transfer function {other} of ITU-T H.273")),
        Chunks { is_profiled: true, .. } => Ok(None),
        Chunks { is_srgb: true, .. } => Ok(Some(Transfer::Srgb)),
        Chunks { gamma: Some(gamma), .. } if SRGB_GAMMA.contains(&gamma) => Ok(Some(Transfer::Srgb)),
        Chunks { gamma: Some(gamma), .. } if LINEAR_GAMMA.contains(&gamma) => Ok(Some(Transfer::Linear)),
        Chunks { gamma: Some(gamma), .. } => Err(format!("a gamma of {gamma}")),
        _ => Ok(None),
    }
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
            _ => {}
        }
        from.seek(SeekFrom::Current(skipped))?;
    }
    Ok(Some(found))
}
