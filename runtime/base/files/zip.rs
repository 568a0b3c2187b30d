//! Reads ZIP archives as far as NumPy's `.npz` requires it.
//!
//! It has stored and deflated files, with sizes of 32 or 64 bits. Format: PKWARE's APPNOTE.TXT 6.3.10. The reader is
//! here because a crate for it brings encryption, and more code than it replaces.

use flate2::{Crc, read::DeflateDecoder};
use std::io::{self, BufReader, Read, Seek, SeekFrom};

/// Length of the last record with the longest comment after it, in bytes.
const END: u64 = 65535 + 22;
/// Longest table of contents that is read, in bytes.
const CONTENTS: u64 = 16 << 20;

/// A file in an archive.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Entry {
    pub name: String,
    /// Length of the unpacked file in bytes.
    pub length: u64,
    method: u16,
    packed: u64,
    crc: u32,
    /// Position of the local header in the archive.
    at: u64,
}

fn wrong(reason: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, reason.into())
}

fn number(bytes: &[u8], at: usize, width: usize) -> io::Result<u64> {
    let part = bytes.get(at..at + width).ok_or_else(|| wrong("the archive is cut short"))?;
    Ok(part.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b)))
}

/// Returns the table of contents of an archive of `length` bytes.
///
/// # Errors
/// Returns the errors of reading, and [`io::ErrorKind::InvalidData`] for a file that is not such an archive.
pub(super) fn entries<R: Read + Seek>(from: &mut R, length: u64) -> io::Result<Vec<Entry>> {
    let tail = part(from, length.saturating_sub(END), length.min(END))?;
    let last = tail.windows(4).rposition(|w| w == b"PK\x05\x06");
    let last = last.ok_or_else(|| wrong("it is not a ZIP archive, or it is cut short: it has no table of contents"))?;
    let mut table = [number(&tail, last + 12, 4)?, number(&tail, last + 16, 4)?];
    if table.contains(&u64::from(u32::MAX)) {
        // Values that do not fit 32 bits are in a separate record. The one before the last record has its position.
        let locator = last.checked_sub(20).filter(|at| tail[*at..].starts_with(b"PK\x06\x07"));
        let at = number(&tail, locator.ok_or_else(|| wrong("the archive lacks its ZIP64 record"))? + 8, 8)?;
        let record = part(from, at, 56)?;
        table = [number(&record, 40, 8)?, number(&record, 48, 8)?];
    }
    let [size, at] = table;
    if size > CONTENTS {
        return Err(wrong(format!("the archive's table of contents has {size} bytes: at most {CONTENTS} are read")));
    }
    let table = part(from, at, size)?;
    let (mut found, mut at) = (Vec::new(), 0);
    while at < table.len() {
        let (entry, next) = entry(&table, at)?;
        found.push(entry);
        at = next;
    }
    Ok(found)
}

/// Returns one file of the table, and the position of the next.
fn entry(table: &[u8], at: usize) -> io::Result<(Entry, usize)> {
    if !table[at..].starts_with(b"PK\x01\x02") {
        return Err(wrong("the archive's table of contents is damaged"));
    }
    let field = |offset: usize, width: usize| number(table, at + offset, width);
    let lengths = [field(28, 2)?, field(30, 2)?, field(32, 2)?].map(|n| n as usize);
    let name = table.get(at + 46..at + 46 + lengths[0]).ok_or_else(|| wrong("the archive is cut short"))?;
    // The unpacked size, the packed size and the position. Values that are full are in the extra field, in this order.
    let mut sizes = [field(24, 4)?, field(20, 4)?, field(42, 4)?];
    let (mut extra, end) = (at + 46 + lengths[0], at + 46 + lengths[0] + lengths[1]);
    while extra + 4 <= end {
        let (kind, size) = (number(table, extra, 2)?, number(table, extra + 2, 2)? as usize);
        if kind == 1 {
            let full = sizes.iter_mut().filter(|s| **s == u64::from(u32::MAX));
            for (i, value) in full.enumerate() {
                *value = number(table, extra + 4 + 8 * i, 8)?;
            }
        }
        extra += 4 + size;
    }
    let name = String::from_utf8_lossy(name).into_owned();
    if field(8, 2)? & 1 != 0 {
        return Err(wrong(format!("{name} in the archive is encrypted")));
    }
    let [length, packed, place] = sizes;
    let entry = Entry { name, length, method: field(10, 2)? as u16, packed, crc: field(16, 4)? as u32, at: place };
    Ok((entry, end + lengths[2]))
}

/// Returns `count` bytes from a position on. Memory is allocated only for bytes that exist.
fn part<R: Read + Seek>(from: &mut R, at: u64, count: u64) -> io::Result<Vec<u8>> {
    from.seek(SeekFrom::Start(at))?;
    let mut bytes = Vec::new();
    from.take(count).read_to_end(&mut bytes)?;
    if bytes.len() as u64 == count { Ok(bytes) } else { Err(wrong("the archive is cut short")) }
}

impl Entry {
    /// Returns a reader of the unpacked bytes. Reading the last of them fails if their checksum is wrong.
    ///
    /// # Errors
    /// Returns the errors of reading, and [`io::ErrorKind::InvalidData`] for a damaged archive or an unknown packing
    /// method.
    pub fn open<R: Read + Seek + Send + 'static>(&self, mut from: R) -> io::Result<Box<dyn Read + Send>> {
        let header = part(&mut from, self.at, 30)?;
        if !header.starts_with(b"PK\x03\x04") {
            return Err(wrong(format!("the archive is damaged: {} is not where it should be", self.name)));
        }
        let skipped = 30 + number(&header, 26, 2)? + number(&header, 28, 2)?;
        from.seek(SeekFrom::Start(self.at.saturating_add(skipped)))?;
        let packed = BufReader::new(from).take(self.packed);
        let bytes: Box<dyn Read + Send> = match self.method {
            0 => Box::new(packed),
            8 => Box::new(DeflateDecoder::new(packed)),
            method => return Err(wrong(format!("{} is packed by method {method}: 0 and 8 are read", self.name))),
        };
        Ok(Box::new(Checked { from: bytes, left: self.length, sum: Crc::new(), wanted: self.crc }))
    }
}

/// Bytes with an expected checksum.
struct Checked {
    from: Box<dyn Read + Send>,
    left: u64,
    sum: Crc,
    wanted: u32,
}

impl Read for Checked {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let most = (to.len() as u64).min(self.left) as usize;
        let count = self.from.read(&mut to[..most])?;
        self.sum.update(&to[..count]);
        self.left -= count as u64;
        if count == 0 && most > 0 {
            return Err(wrong("the archive is cut short"));
        }
        if self.left == 0 && count > 0 && self.sum.sum() != self.wanted {
            return Err(wrong("the archive is damaged: a checksum is wrong"));
        }
        Ok(count)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use flate2::{Compression, write::DeflateEncoder};
    use std::io::{Cursor, Write};

    /// Returns an archive of these files, with every second one deflated. If `wide` is true, sizes have 64 bits.
    pub(in crate::files) fn archive(files: &[(&str, &[u8])], wide: bool) -> Vec<u8> {
        let (mut out, mut table) = (Vec::new(), Vec::new());
        for (i, (name, bytes)) in files.iter().enumerate() {
            let (method, packed) = if i % 2 == 0 {
                (0u16, bytes.to_vec())
            } else {
                let mut encoder = DeflateEncoder::new(Vec::new(), Compression::default());
                encoder.write_all(bytes).unwrap();
                (8, encoder.finish().unwrap())
            };
            let mut sum = Crc::new();
            sum.update(bytes);
            let at = out.len() as u64;
            let full = [bytes.len() as u64, packed.len() as u64, at];
            let short = full.map(|n| if wide { u32::MAX } else { n as u32 }.to_le_bytes());
            let extra = if wide {
                [vec![1, 0, 24, 0], full.iter().flat_map(|n| n.to_le_bytes()).collect()].concat()
            } else {
                Vec::new()
            };
            let common = |v: &mut Vec<u8>, extra: usize| {
                v.extend([&[45, 0, 0, 0][..], &method.to_le_bytes(), &[0; 4], &sum.sum().to_le_bytes()].concat());
                v.extend([short[1], short[0]].concat());
                v.extend([(name.len() as u16).to_le_bytes(), (extra as u16).to_le_bytes()].concat());
            };
            out.extend(b"PK\x03\x04");
            common(&mut out, 0);
            out.extend(name.as_bytes());
            out.extend(&packed);
            table.extend(b"PK\x01\x02\x2d\x00");
            common(&mut table, extra.len());
            table.extend([0; 10]);
            table.extend(short[2]);
            table.extend(name.as_bytes());
            table.extend(extra);
        }
        let (at, size) = (out.len() as u64, table.len() as u64);
        out.extend(&table);
        if wide {
            let record = out.len() as u64;
            out.extend([&b"PK\x06\x06"[..], &44u64.to_le_bytes(), &[0; 28]].concat());
            out.extend([size.to_le_bytes(), at.to_le_bytes()].concat());
            out.extend([&b"PK\x06\x07"[..], &[0; 4], &record.to_le_bytes(), &[1, 0, 0, 0]].concat());
        }
        out.extend([&b"PK\x05\x06"[..], &[0; 8]].concat());
        let short = |n: u64| if wide { u32::MAX } else { n as u32 }.to_le_bytes();
        out.extend([&short(size)[..], &short(at), b"\x03\x00end"].concat());
        out
    }

    fn all(bytes: &[u8]) -> io::Result<Vec<(String, Vec<u8>)>> {
        let read = |entry: Entry| {
            let mut unpacked = Vec::new();
            entry.open(Cursor::new(bytes.to_vec()))?.read_to_end(&mut unpacked)?;
            Ok((entry.name, unpacked))
        };
        entries(&mut Cursor::new(bytes), bytes.len() as u64)?.into_iter().map(read).collect()
    }

    #[test]
    fn stored_and_deflated_files_are_read() {
        let long: Vec<u8> = (0..20000u32).map(|i| ((i * i) >> 7) as u8).collect();
        let files: [(&str, &[u8]); 3] = [("a.npy", b"hello"), ("b.npy", &long), ("c", b"")];
        for wide in [false, true] {
            let read = all(&archive(&files, wide)).unwrap();
            let wanted = files.map(|(name, bytes)| (name.to_owned(), bytes.to_vec()));
            assert!(read == wanted, "wide {wide}");
        }
    }

    #[test]
    fn damage_is_an_error_and_never_a_panic() {
        let long: Vec<u8> = (0..300u32).map(|i| ((i * i) >> 3) as u8).collect();
        for wide in [false, true] {
            let whole = archive(&[("a", &long), ("b", &long)], wide);
            let sound = all(&whole).unwrap();
            for at in 0..whole.len() {
                for flip in [1, 0x80, 0xff] {
                    let mut bytes = whole.clone();
                    bytes[at] ^= flip;
                    if let Ok(read) = all(&bytes) {
                        assert!(read.iter().zip(&sound).all(|(a, b)| a.1 == b.1), "byte {at} of {}", whole.len());
                    }
                }
                let cut = all(&whole[..at]);
                assert!(cut.is_err() || cut.unwrap() == sound, "cut at {at}");
            }
        }
    }
}
