//! Decodes text as programs write it, in UTF-8 or UTF-16, with or without a mark, and with any ends of lines.

/// Decodes text to UTF-8 without a mark, in which every line ends in LF or CR LF. A CR alone also ends a line of the
/// input. Bytes in another encoding are returned as the error.
pub fn decode(bytes: Vec<u8>) -> Result<String, Vec<u8>> {
    let text = match &bytes[..] {
        [0xff, 0xfe, rest @ ..] => utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => utf16(rest, u16::from_be_bytes),
        [0xef, 0xbb, 0xbf, rest @ ..] => str::from_utf8(rest).ok().map(str::to_owned),
        // Without a mark, every second byte of UTF-16 is 0 for Latin letters, and no byte of UTF-8 is.
        [first, 0, ..] if *first != 0 => utf16(&bytes, u16::from_le_bytes),
        [0, second, ..] if *second != 0 => utf16(&bytes, u16::from_be_bytes),
        _ => match String::from_utf8(bytes) {
            Ok(text) => return Ok(with_lines(text)),
            Err(e) => return Err(e.into_bytes()),
        },
    };
    text.map(with_lines).ok_or(bytes)
}

fn utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> Option<String> {
    let pairs = bytes.chunks_exact(2);
    let units = pairs.clone().map(|b| unit([b[0], b[1]]));
    let text: Result<String, _> = char::decode_utf16(units).collect();
    text.ok().filter(|text| pairs.remainder().is_empty() && !text.contains('\0'))
}

/// Turns each CR without a following LF into an end of a line.
fn with_lines(text: String) -> String {
    let alone = text.bytes().zip(text.bytes().skip(1).chain([0])).any(|(a, b)| a == b'\r' && b != b'\n');
    if !alone {
        return text;
    }
    let kept = text.replace("\r\n", "\n");
    kept.replace('\r', "\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::read::lines;
    use std::io::BufRead;

    #[test]
    fn every_encoding_and_end_of_line_gives_the_same_text() {
        let text = "level,phase\n0,0.5\n1,\u{3c0}\n";
        let wide = |text: &str, big: bool| -> Vec<u8> {
            text.encode_utf16().flat_map(|u| if big { u.to_be_bytes() } else { u.to_le_bytes() }).collect()
        };
        let cases: [Vec<u8>; 8] = [
            text.into(),
            [b"\xef\xbb\xbf", text.as_bytes()].concat(),
            [&b"\xff\xfe"[..], &wide(text, false)].concat(),
            [&b"\xfe\xff"[..], &wide(text, true)].concat(),
            wide(text, false),
            wide(text, true),
            text.replace('\n', "\r").into(),
            [&b"\xff\xfe"[..], &wide(&text.replace('\n', "\r"), false)].concat(),
        ];
        let here = tempfile::tempdir().unwrap();
        let file = here.path().join("a.csv");
        for bytes in cases {
            assert_eq!(decode(bytes.clone()).unwrap(), text, "{bytes:x?}");
            std::fs::write(&file, &bytes).unwrap();
            let read: Vec<String> = lines(&file, 1000).unwrap().lines().map(Result::unwrap).collect();
            assert_eq!(read, ["level,phase", "0,0.5", "1,\u{3c0}"], "{bytes:x?}");
        }
        // LF and CR LF are both kept, and bytes that are not text are returned.
        assert_eq!(decode(b"a\r\nb\r\n".to_vec()).unwrap(), "a\r\nb\r\n");
        for bytes in [&[0xff, 0xfe, 0x00][..], &[0x80, 0x81], &[0xff, 0xfe, 0x00, 0xd8]] {
            assert_eq!(decode(bytes.to_vec()).unwrap_err(), bytes);
        }
    }
}
