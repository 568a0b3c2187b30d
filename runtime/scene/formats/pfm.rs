//! Reads portable float maps (PFM).
//!
//! A file has `Pf`, width and height, a scale whose sign is the byte order, and then rows from the bottom up.

use crate::light_field::near::GrayValues;
use crate::light_field::near::Kind;
use eyebox_base::error::Reason;
use eyebox_base::reason;

/// Reads a PFM file from its bytes. The magnitude of the scale is ignored, as in every reader.
///
/// # Errors
/// The fault in words. Nothing is allocated until the length of the file matches its header.
pub(crate) fn parse(bytes: &[u8]) -> Result<GrayValues, Reason> {
    let mut rest = bytes;
    let mut token = |what: &str| -> Result<&str, Reason> {
        let start = rest
            .iter()
            .position(|b| !b.is_ascii_whitespace())
            .ok_or_else(|| reason!("pfm-header", "the header ends before {what}"))?;
        let length = rest[start..].iter().take(32).position(u8::is_ascii_whitespace);
        let length = length.ok_or_else(|| reason!("pfm-header", "the header ends in {what}"))?;
        let found = std::str::from_utf8(&rest[start..start + length])
            .map_err(|_| reason!("pfm-header", "{what} is not text"))?;
        // Exactly one whitespace character follows the header, because the next byte may also look like whitespace.
        rest = &rest[start + length + 1..];
        Ok(found)
    };
    match token("its kind")? {
        "Pf" => {}
        "PF" => return Err(reason!("pfm-color", "it is a color float map (PF), but a depth map has one channel (Pf)")),
        other => return Err(reason!("not-pfm", "not a float map, since it begins with {other:?} instead of \"Pf\"")),
    }
    let mut axis = |what: &str| -> Result<usize, Reason> {
        let text = token(what)?;
        let value: usize = text.parse().map_err(|_| reason!("pfm-header", "{what} {text:?} is not a number"))?;
        if (1..=65536).contains(&value) {
            Ok(value)
        } else {
            Err(reason!("pfm-size", "{what} is {value}, but it must be 1 to 65536"))
        }
    };
    let (width, height) = (axis("the width")?, axis("the height")?);
    let text = token("the scale")?;
    let scale: f64 = text.parse().map_err(|_| reason!("pfm-scale", "the scale {text:?} is not a number"))?;
    if scale == 0.0 || !scale.is_finite() {
        return Err(reason!("pfm-scale", "the scale is {scale}, but its sign must give the byte order"));
    }
    // The product is at most 2^34, so it does not overflow on 64 bits and is refused on 32 bits.
    let needed = (width as u64) * (height as u64) * 4;
    if rest.len() as u64 != needed {
        return Err(reason!("pfm-length", "{height} x {width} values need {needed} bytes, {} are there", rest.len()));
    }
    let value = |b: &[u8]| {
        let b = [b[0], b[1], b[2], b[3]];
        if scale < 0.0 { f32::from_le_bytes(b) } else { f32::from_be_bytes(b) }
    };
    let values = rest.chunks_exact(width * 4).rev().flat_map(|row| row.chunks_exact(4).map(value)).collect();
    Ok(GrayValues { height, width, kind: Kind::Floats, values, range: None })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn rows_run_upwards_and_the_sign_is_the_byte_order() {
        let mut little = b"Pf\n2 2\n-1.0\n".to_vec();
        let mut big = b"Pf 2 2 1\n".to_vec();
        for v in [3.0f32, 4.0, 1.0, 2.0] {
            little.extend(v.to_le_bytes());
            big.extend(v.to_be_bytes());
        }
        let read = parse(&little).unwrap();
        assert_eq!(read.values, [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(parse(&big).unwrap(), read);
        assert!(parse(&little[..little.len() - 1]).unwrap_err().code() == "pfm-length");
        assert!(parse(b"PF 1 1 -1\n").unwrap_err().code() == "pfm-color");
        assert!(parse(b"Pf 4000000000 1 -1\n").is_err());
        assert!(parse(b"Pf 65536 65536 -1\n").unwrap_err().code() == "pfm-length");
    }

    proptest! {
        #[test]
        fn anything_is_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = parse(&bytes);
        }

        #[test]
        fn any_header_is_read_or_refused(
            w in prop_oneof!["[0-9 .eE+-]{0,12}", "[1-9]"],
            h in prop_oneof!["[0-9]{0,22}", "[1-9]"],
            s in prop_oneof!["[-+0-9.einfaN]{0,8}", "-?1.0"],
            n in 0usize..64,
        ) {
            let mut bytes = format!("Pf\n{w} {h}\n{s}\n").into_bytes();
            bytes.extend(std::iter::repeat_n(0u8, n));
            if let Ok(map) = parse(&bytes) {
                prop_assert_eq!(map.values.len(), map.height * map.width);
                let content = map.values.len() * 4;
                if [&w, &h, &s].into_iter().all(|part| part.split_whitespace().count() == 1) {
                    prop_assert_eq!(content, n);
                }
                // With two numbers instead of one, a part of the header is content.
                prop_assert!(content >= n && content < bytes.len(), "{content}");
            }
        }
    }
}
