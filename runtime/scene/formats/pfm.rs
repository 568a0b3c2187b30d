//! Portable float maps: `Pf`, width and height, a scale whose sign tells the byte order, rows from the bottom up.

use crate::light_field::near::GrayValues;
use crate::light_field::near::Kind;
use eyebox_base::error::Reason;
use eyebox_base::reason;

/// Reads a PFM file from its bytes. The scale's size is ignored, as every reader does.
///
/// # Errors
/// What is wrong, in words. Nothing is allocated before the file proves to hold it.
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
        // Exactly one white space follows the header; what follows it may look like white space too.
        rest = &rest[start + length + 1..];
        Ok(found)
    };
    match token("its kind")? {
        "Pf" => {}
        "PF" => return Err(reason!("pfm-color", "a color float map (PF): a depth map has one channel (Pf)")),
        other => return Err(reason!("not-pfm", "not a float map: it begins with {other:?}, not \"Pf\"")),
    }
    let mut axis = |what: &str| -> Result<usize, Reason> {
        let text = token(what)?;
        let value: usize = text.parse().map_err(|_| reason!("pfm-header", "{what} is {text:?}: not a number"))?;
        if (1..=65536).contains(&value) {
            Ok(value)
        } else {
            Err(reason!("pfm-size", "{what} is {value}: it must be 1 to 65536"))
        }
    };
    let (width, height) = (axis("the width")?, axis("the height")?);
    let text = token("the scale")?;
    let scale: f64 = text.parse().map_err(|_| reason!("pfm-scale", "the scale is {text:?}: not a number"))?;
    if scale == 0.0 || !scale.is_finite() {
        return Err(reason!("pfm-scale", "the scale is {scale}: its sign must tell the byte order"));
    }
    // At most 2^34: no overflow on 64 bits; refused on 32.
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
                // Two numbers in the place of one: what was meant for the header is content.
                prop_assert!(content >= n && content < bytes.len(), "{content}");
            }
        }
    }
}
