//! Opens and reads regular files without waiting, up to a limit for each kind of file.
//!
//! All files are read in this way. A pipe, a terminal or a device instead of a file would block for ever or never end.
//! A file of 3 GB instead of a table would be read to its last byte. Both are refused before a byte is read.

#[cfg(feature = "image-formats")]
use super::FileError;
use super::{kind::FileKind, text::decode};
use crate::error::Reason;
use crate::reason;
use serde::de::DeserializeOwned;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::path::Path;

/// Longest text that a person writes, such as a display, a calibration or settings of a light field, in bytes.
pub const TEXT: u64 = 1 << 20;
/// Longest table and document in bytes.
pub const TABLE: u64 = 16 << 20;
/// Longest cached file, and longest results, in bytes.
pub const RESULTS: u64 = 256 << 20;
/// Bytes from which the encoding of a text is determined.
const ENCODING: u64 = 8192;
/// Longest picture or map in bytes.
pub const PICTURE: u64 = 1 << 30;

/// Opens a regular file. Anything else is refused, after opening it and without waiting for it.
///
/// # Errors
/// Returns the errors of the system, and [`io::ErrorKind::InvalidInput`] for anything but a regular file.
pub fn open(file: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.read(true);
    // Opening a pipe waits for its writer, unless this flag is set. Regular files ignore the flag.
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, rustix::fs::OFlags::NONBLOCK.bits() as i32);
    regular(options.open(file)?)
}

/// Opens a regular file for reading through a buffer.
#[cfg(feature = "image-formats")]
pub(super) fn buffered(file: &Path) -> Result<BufReader<File>, FileError> {
    open(file).map(BufReader::new).map_err(|e| FileError::read(file, e))
}

/// Returns the opened file, if it is a regular file.
pub(super) fn regular(opened: File) -> io::Result<File> {
    let kind = opened.metadata()?.file_type();
    if kind.is_file() {
        return Ok(opened);
    }
    let what = if kind.is_dir() { "a folder" } else { "a pipe or a device" };
    Err(io::Error::new(io::ErrorKind::InvalidInput, format!("it is {what}, and only regular files are read")))
}

/// Returns all bytes of a regular file of at most `most` bytes.
///
/// # Errors
/// Returns the errors of [`open`], [`io::ErrorKind::InvalidData`] for longer files, and [`io::ErrorKind::OutOfMemory`].
pub fn bytes(file: &Path, most: u64) -> io::Result<Vec<u8>> {
    all(open(file)?, most)
}

/// Returns all bytes of an opened regular file of at most `most` bytes.
pub(super) fn all(opened: File, most: u64) -> io::Result<Vec<u8>> {
    let opened = regular(opened)?;
    let length = opened.metadata()?.len();
    let too_long = |n: u64| {
        let why = format!("it is {n} bytes long, but at most {most} bytes of such a file are read");
        io::Error::new(io::ErrorKind::InvalidData, why)
    };
    if length > most {
        return Err(too_long(length));
    }
    let mut read = Vec::new();
    read.try_reserve_exact(length as usize).map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
    // Files of the operating system state 0 as their length, and files may grow.
    opened.take(most + 1).read_to_end(&mut read)?;
    if read.len() as u64 > most { Err(too_long(read.len() as u64)) } else { Ok(read) }
}

/// Returns the text of a regular file of at most `most` bytes. It may be UTF-8 or UTF-16, with any ends of lines.
///
/// # Errors
/// Returns the errors of [`bytes`], and [`io::ErrorKind::InvalidData`] for a file that is not text.
pub fn text(file: &Path, most: u64) -> io::Result<String> {
    let no_text = |bytes: Vec<u8>| {
        let why = match FileKind::of_bytes(&bytes[..bytes.len().min(4096)]) {
            FileKind::Text => "its text is neither UTF-8 nor UTF-16: save it as UTF-8".into(),
            other => format!("it is not text, but {}: give a text file (UTF-8)", other.describe()),
        };
        io::Error::new(io::ErrorKind::InvalidData, why)
    };
    decode(bytes(file, most)?).map_err(no_text)
}

/// Opens a text file whose lines are read one at a time. Another encoding than plain UTF-8 is decoded as a whole, up to
/// `most` bytes.
///
/// # Errors
/// Returns the errors of [`bytes`], and [`io::ErrorKind::InvalidData`] for a file that is not text in a known encoding.
pub fn lines(file: &Path, most: u64) -> io::Result<Box<dyn BufRead>> {
    let mut opened = open(file)?;
    let mut head = Vec::new();
    Read::by_ref(&mut opened).take(ENCODING).read_to_end(&mut head)?;
    let marked =
        head.starts_with(&[0xff, 0xfe]) || head.starts_with(&[0xfe, 0xff]) || head.starts_with(b"\xef\xbb\xbf");
    let wide = head.iter().take(2).any(|b| *b == 0);
    let by_cr = head.contains(&b'\r') && !head.contains(&b'\n');
    if marked || wide || by_cr {
        return Ok(Box::new(Cursor::new(text(file, most)?.into_bytes())));
    }
    Ok(Box::new(BufReader::new(Cursor::new(head).chain(opened))))
}

/// Reads a text as TOML. The error states the line and the fault.
pub fn toml<T: DeserializeOwned>(text: &str) -> Result<T, Reason> {
    let one_line = |message: &str| message.trim().replace('\n', " ");
    let read = toml::from_str(text).map_err(|e| {
        let line = e.span().map_or(0, |s| text[..s.start.min(text.len())].matches('\n').count() + 1);
        match text.lines().nth(line.saturating_sub(1)).and_then(decimal_comma) {
            Some(number) => reason!(
                "decimal-comma",
                "line {line}: {number} has a decimal comma: write {}",
                number.replace(',', ".")
            ),
            None => reason!("toml", "line {line}: {}", one_line(e.message())),
        }
    })?;
    // Only this second way detects a list that is too long for its key.
    let table: toml::Value = toml::from_str(text).map_err(|e| one_line(e.message()))?;
    T::deserialize(table).map_err(|e| one_line(&e.to_string()))?;
    Ok(read)
}

/// Returns the first number with a decimal comma in a line of TOML, outside of lists, whose commas separate numbers.
fn decimal_comma(line: &str) -> Option<&str> {
    let is_part = |c: char| c.is_ascii_digit() || matches!(c, '+' | '-' | '_');
    let (mut depth, mut quote) = (0, None);
    for (at, c) in line.char_indices() {
        match (quote, c) {
            (Some(open), c) if open == c => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') => quote = Some(c),
            (None, '#') => return None,
            (None, '[') => depth += 1,
            (None, ']') => depth -= 1,
            (None, ',') if depth == 0 => {
                let start = line[..at].trim_end_matches(is_part).len();
                let end = line.len() - line[at + 1..].trim_start_matches(is_part).len();
                let digits = |part: &str| part.contains(|c: char| c.is_ascii_digit());
                if digits(&line[start..at]) && digits(&line[at + 1..end]) {
                    return Some(&line[start..end]);
                }
            }
            _ => {}
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decimal_comma_is_named_and_lists_are_not() {
        for (line, number) in [
            ("pitch_um = 3,74", Some("3,74")),
            ("  focal_length_mm =-20,5 # mm", Some("-20,5")),
            ("a = { red = 640,5 }", Some("640,5")),
            ("a = [1,2]", None),
            ("a = { b = 1, c = 2 }", None),
            ("name = \"3,74\"", None),
            ("# 3,74", None),
        ] {
            assert_eq!(decimal_comma(line), number, "{line}");
        }
        let answer = toml::<std::collections::BTreeMap<String, f64>>("a = 1.5\nb = 3,74\n").unwrap_err();
        assert!(answer.code() == "decimal-comma" && answer.text().contains("line 2"), "{answer}");
    }

    #[test]
    fn only_regular_files_of_bounded_length_are_read() {
        let here = tempfile::tempdir().unwrap();
        let file = here.path().join("a");
        std::fs::write(&file, "12345").unwrap();
        assert_eq!(text(&file, 5).unwrap(), "12345");
        assert!(bytes(&file, 4).is_err(), "the limit holds");
        std::fs::write(&file, [0xff, 0x80, 0xff]).unwrap();
        assert!(text(&file, 5).is_err(), "it is no text");
        assert!(bytes(here.path(), 5).is_err());
        // A file that is longer than memory is refused without allocating memory for it.
        std::fs::File::create(&file).unwrap().set_len(1 << 40).unwrap();
        assert!(bytes(&file, PICTURE).unwrap_err().to_string().contains("1099511627776"));
    }

    #[test]
    fn lists_that_are_too_long_are_refused() {
        #[derive(serde::Deserialize, Debug)]
        #[allow(dead_code)]
        struct Read {
            resolution: [usize; 2],
        }
        assert_eq!(toml::<Read>("resolution = [1, 2]").unwrap().resolution, [1, 2]);
        let error = toml::<Read>("resolution = [1, 2, 3]").unwrap_err();
        assert!(error.text().contains("resolution") && !error.text().contains('\n'), "{error}");
        assert!(toml::<Read>("\nresolution = [1]").unwrap_err().text().contains("line 2"));
    }

    #[cfg(unix)]
    #[test]
    fn pipes_and_devices_are_refused_at_once() {
        let here = tempfile::tempdir().unwrap();
        let pipe = here.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        for file in [pipe.as_path(), Path::new("/dev/zero")] {
            assert!(bytes(file, 5).is_err(), "{}", file.display());
        }
    }
}
