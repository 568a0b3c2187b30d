//! Reads and writes NumPy's `.npy`, as far as images, maps and phases require it.
//!
//! It has floats and integers of any shape. Format:
//! <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>. The reader is here because the crates that
//! read the format build objects of a C toolchain (through their literal parser), and a build of this project requires
//! cargo alone.

use super::npy_header::Header;
use super::{FileError, read, write_file};
use crate::error::Reason;
use crate::memory;
use crate::reason;
use std::{
    io::{self, BufReader, Read, Write},
    path::{Path, PathBuf},
};

/// An array of float32.
#[derive(Debug, Clone, PartialEq)]
pub struct Npy {
    /// Length of each axis, slowest first.
    pub shape: Vec<usize>,
    /// Values in C order.
    pub values: Vec<f32>,
    /// True if the file holds integers, which are levels and never radians or light.
    pub integers: bool,
}

/// Maximum length of a header in bytes. NumPy writes 118 bytes.
const LONGEST_HEADER: usize = 65536;
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

/// Reads an `.npy` of float16, float32, float64 or integers of up to 64 bits, rounded to float32. It accepts
/// little-endian and big-endian bytes, in C or Fortran order.
///
/// # Errors
/// Returns [`FileError::Read`], or [`FileError::Content`] for another format or element type, a file that is cut short
/// or too long, and a value that is not finite (with its index).
pub fn read_npy(file: &Path) -> Result<Npy, FileError> {
    let array = read_npy_with_gaps(file)?;
    array.finite().map_err(|reason| FileError::content(file, reason))?;
    Ok(array)
}

/// Reads an `.npy` in the same way, and accepts values that are not finite, such as unknown depths.
pub fn read_npy_with_gaps(file: &Path) -> Result<Npy, FileError> {
    let open = || {
        let opened = read::open(file)?;
        let length = opened.metadata()?.len();
        Ok((BufReader::new(opened), length))
    };
    let (mut from, length) = open().map_err(|e| FileError::read(file, e))?;
    parse(file, &mut from, length)
}

/// Writes float32 in C order. `values` has the number of elements that `shape` states.
///
/// # Errors
/// Returns the errors of [`write_file`].
pub fn write_npy(file: &Path, shape: &[usize], values: &[f32]) -> Result<(), FileError> {
    assert_eq!(shape.iter().product::<usize>(), values.len(), "the shape must match the values");
    write_file(file, |out| {
        out.write_all(&npy_header("<f4", shape))?;
        write_le(out, values)
    })
}

/// Returns the bytes before the values of a `.npy` in C order. `kind` is NumPy's name of the type.
pub fn npy_header(kind: &str, shape: &[usize]) -> Vec<u8> {
    let axes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let axes = if shape.len() == 1 { axes.trim_end() } else { axes.trim_end_matches(", ") };
    let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({axes}), }}");
    // The data starts at a multiple of 64 bytes, and the header ends in a newline.
    let before = MAGIC.len() + 4;
    header.extend(std::iter::repeat_n(' ', 63 - (before + header.len()) % 64));
    header.push('\n');
    [MAGIC, &[1, 0], &(header.len() as u16).to_le_bytes(), header.as_bytes()].concat()
}

/// Writes float32 as little-endian bytes on every machine.
pub fn write_le(out: &mut dyn Write, values: &[f32]) -> io::Result<()> {
    let mut bytes = [0; 16384];
    for part in values.chunks(bytes.len() / 4) {
        for (to, v) in bytes.chunks_exact_mut(4).zip(part) {
            to.copy_from_slice(&v.to_le_bytes());
        }
        out.write_all(&bytes[..4 * part.len()])?;
    }
    Ok(())
}

impl Npy {
    /// Refuses values that are not finite, with a sentence.
    fn finite(&self) -> Result<(), Reason> {
        let Some(at) = self.values.iter().position(|v| !v.is_finite()) else { return Ok(()) };
        let index = index_of(&self.shape, at);
        Err(reason!("not-finite", "has {} at index {index:?}: every value must be a finite float32", self.values[at]))
    }
}

/// Reads the array. `length` is the length of the whole file. A shape that does not fit it is refused before memory is
/// allocated.
fn parse(file: &Path, from: &mut dyn Read, length: u64) -> Result<Npy, FileError> {
    let mut reader = NpyReader::new(file, from, length)?;
    let (count, copies) = (reader.left, 1 + usize::from(reader.header.fortran_order));
    let what = || format!("its shape {:?}", reader.header.shape);
    memory::check_available(what, memory::bytes_of(&[count, copies], 4), "read a part of it")
        .map_err(|e| FileError::content(file, Reason::of(&e)))?;
    let mut values = reader.take(count)?;
    let NpyReader { header, .. } = reader;
    if header.fortran_order {
        values = from_fortran(&header.shape, &values);
    }
    let integers = !header.descr[1..].starts_with('f');
    Ok(Npy { shape: header.shape, values, integers })
}

/// Returns the value of an element, whose bytes are little-endian.
type Value = fn(&[u8]) -> f32;

/// An array that is read in parts, in the order of its file.
pub(super) struct NpyReader<R> {
    pub header: Header,
    /// Bytes of an element, and the function that returns its value.
    element: (usize, Value),
    big: bool,
    /// Number of elements that are still to be read.
    left: usize,
    from: R,
    pub file: PathBuf,
}

impl<R: Read> NpyReader<R> {
    /// Reads the bytes before the values. `length` is the length of the whole file.
    pub fn new(file: &Path, mut from: R, length: u64) -> Result<Self, FileError> {
        let wrong = |reason: Reason| FileError::content(file, reason);
        let mut fill = |to: &mut [u8]| fill(file, &mut from, to);
        let mut start = [0; 8];
        fill(&mut start)?;
        if &start[..6] != MAGIC {
            return Err(wrong(reason!("not-npy", "is not an .npy file: it does not start with \\x93NUMPY")));
        }
        let mut size = [0; 4];
        let size = match start[6] {
            1 => fill(&mut size[..2]).map(|()| u32::from_le_bytes(size) as usize)?,
            2 | 3 => fill(&mut size).map(|()| u32::from_le_bytes(size) as usize)?,
            other => return Err(wrong(reason!("npy-version", "has .npy version {other}: 1, 2 and 3 are supported"))),
        };
        let before = if start[6] == 1 { 10 } else { 12 } + size as u64;
        if size > LONGEST_HEADER {
            let most = LONGEST_HEADER;
            return Err(wrong(reason!("npy-header-size", "has a header of {size} bytes: at most {most} are read")));
        }
        let mut header = vec![0; size];
        fill(&mut header)?;
        let header = Header::parse(&header).ok_or_else(|| {
            let text = String::from_utf8_lossy(&header[..header.len().min(100)]).escape_debug().to_string();
            wrong(reason!("npy-header", "has a header that cannot be parsed: {text}"))
        })?;
        let element = element(&header.descr).map_err(wrong)?;
        let big = match header.descr.as_bytes()[0] {
            b'<' => false,
            b'>' => true,
            b'=' | b'|' => cfg!(target_endian = "big"),
            _ => return Err(wrong(reason!("npy-type", "holds '{}': '<f4' or '<f8' is required", header.descr))),
        };
        let count = header.shape.iter().try_fold(1u64, |n, &axis| n.checked_mul(axis as u64));
        let bytes = count.and_then(|n| n.checked_mul(element.0 as u64)).and_then(|n| n.checked_add(before));
        if bytes != Some(length) {
            let wanted = bytes.map_or("more than any file holds".into(), |n| format!("{n} bytes"));
            let remedy = if bytes.is_some_and(|n| n > length) { ": it is cut short, copy it again" } else { "" };
            let reason = reason!(
                "npy-length",
                "is {length} bytes long, but its shape {:?} needs {wanted}{remedy}",
                header.shape
            );
            return Err(wrong(reason));
        }
        Ok(Self { element, big, left: (length - before) as usize / element.0, header, from, file: file.into() })
    }

    /// Returns the next `count` values, or all that remain if these are fewer.
    pub fn take(&mut self, count: usize) -> Result<Vec<f32>, FileError> {
        let ((width, value), count) = (self.element, count.min(self.left));
        let mut values = Vec::with_capacity(count);
        let mut block = vec![0; 65536.min(count * width)];
        while values.len() < count {
            let part = &mut block[..(65536 / width).min(count - values.len()) * width];
            fill(&self.file, &mut self.from, part)?;
            values.extend(part.chunks_exact_mut(width).map(|b| {
                if self.big {
                    b.reverse();
                }
                value(b)
            }));
        }
        self.left -= count;
        Ok(values)
    }
}

/// Returns the bytes of an element of this type, and the function that returns its value.
fn element(descr: &str) -> Result<(usize, Value), Reason> {
    Ok(match descr.get(1..) {
        Some("f2") => (2, |b| half::f16::from_le_bytes(first(b)).to_f32()),
        Some("f4") => (4, |b| f32::from_le_bytes(first(b))),
        Some("f8") => (8, |b| f64::from_le_bytes(first(b)) as f32),
        Some("u1" | "b1") => (1, |b| f32::from(b[0])),
        Some("i1") => (1, |b| f32::from(b[0] as i8)),
        Some("u2") => (2, |b| f32::from(u16::from_le_bytes(first(b)))),
        Some("i2") => (2, |b| f32::from(i16::from_le_bytes(first(b)))),
        Some("u4") => (4, |b| u32::from_le_bytes(first(b)) as f32),
        Some("i4") => (4, |b| i32::from_le_bytes(first(b)) as f32),
        Some("u8") => (8, |b| u64::from_le_bytes(first(b)) as f32),
        Some("i8") => (8, |b| i64::from_le_bytes(first(b)) as f32),
        kind => {
            let known = "floats ('<f2', '<f4', '<f8') or integers ('|u1', '<u2', '<i8' and the like)";
            let complex = kind.is_some_and(|k| k.starts_with('c'));
            let hint = if complex {
                ". For complex numbers, save numpy.angle(a), the phase, or numpy.abs(a) ** 2, the light"
            } else {
                ""
            };
            return Err(reason!("npy-type", "holds '{descr}': {known} are read{hint}"));
        }
    })
}

fn fill(file: &Path, from: &mut impl Read, to: &mut [u8]) -> Result<(), FileError> {
    from.read_exact(to).map_err(|e| match e.kind() {
        io::ErrorKind::UnexpectedEof => FileError::content(file, reason!("cut-short", "is cut short")),
        _ => FileError::read(file, e),
    })
}

/// Returns the first bytes. The slice must have enough of them.
fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
    bytes[..N].try_into().expect("as many bytes as the element has")
}

fn index_of(shape: &[usize], mut at: usize) -> Vec<usize> {
    let mut index = vec![0; shape.len()];
    for (i, n) in index.iter_mut().zip(shape).rev() {
        (*i, at) = (at % n, at / n);
    }
    index
}

pub(super) fn from_fortran(shape: &[usize], values: &[f32]) -> Vec<f32> {
    let mut strides = vec![1; shape.len()];
    for axis in 1..shape.len() {
        strides[axis] = strides[axis - 1] * shape[axis - 1];
    }
    let mut index = vec![0; shape.len()];
    let mut from = 0;
    values
        .iter()
        .map(|_| {
            let value = values[from];
            for axis in (0..shape.len()).rev() {
                index[axis] += 1;
                from += strides[axis];
                if index[axis] < shape[axis] {
                    break;
                }
                from -= strides[axis] * shape[axis];
                index[axis] = 0;
            }
            value
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn npy(header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend([1, 0]);
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    fn read(bytes: &[u8]) -> Result<Npy, Reason> {
        let array = parse(Path::new("a.npy"), &mut &bytes[..], bytes.len() as u64).map_err(|e| match e {
            FileError::Content { reason, .. } => reason,
            other => panic!("{other}"),
        })?;
        array.finite().map(|()| array)
    }

    #[test]
    fn what_is_written_is_read_and_aligned() {
        let here = tempfile::tempdir().unwrap();
        let file = here.path().join("a.npy");
        for shape in [&[2, 3, 4][..], &[5], &[1, 1], &[0, 3]] {
            let values: Vec<f32> = (0..shape.iter().product()).map(|i| i as f32 - 3.5).collect();
            write_npy(&file, shape, &values).unwrap();
            assert_eq!(
                read_npy(&file).unwrap(),
                Npy { shape: shape.to_vec(), values: values.clone(), integers: false }
            );
            assert_eq!((std::fs::metadata(&file).unwrap().len() as usize - 4 * values.len()) % 64, 0);
        }
    }

    #[test]
    fn every_order_and_width_is_understood() {
        let values = [1.5f32, -2.0, 3.0, 4.0, 5.0, 6.0];
        let expected = Npy { shape: vec![2, 3], values: values.to_vec(), integers: false };
        let c = "'fortran_order': False, 'shape': (2, 3), }\n";
        let le: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(read(&npy(&format!("{{'descr': '<f4', {c}"), &le)).unwrap(), expected);
        let be: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
        assert_eq!(read(&npy(&format!("{{'descr': '>f4', {c}"), &be)).unwrap(), expected);
        let wide: Vec<u8> = values.iter().flat_map(|v| f64::from(*v).to_be_bytes()).collect();
        assert_eq!(read(&npy(&format!("{{'descr': '>f8', {c}"), &wide)).unwrap(), expected);
        let columns: Vec<u8> = [0, 3, 1, 4, 2, 5].iter().flat_map(|&i: &usize| values[i].to_le_bytes()).collect();
        let u2 = read(&npy(&format!("{{'descr': '>u2', {c}"), &[0, 1, 1, 0, 0, 3, 0, 4, 0, 5, 255, 255])).unwrap();
        assert_eq!((&u2.values[..], u2.integers), (&[1.0, 256.0, 3.0, 4.0, 5.0, 65535.0][..], true));
        let i8: Vec<u8> = [-3i64, 0, 1, 2, 3, 255].iter().flat_map(|v| v.to_le_bytes()).collect();
        let i8 = read(&npy(&format!("{{'descr': '<i8', {c}"), &i8)).unwrap();
        assert_eq!((&i8.values[..], i8.integers), (&[-3.0, 0.0, 1.0, 2.0, 3.0, 255.0][..], true));
        let f = "{\"shape\": (2L, 3L), 'fortran_order': True, 'descr': '<f4'}";
        assert_eq!(read(&npy(f, &columns)).unwrap(), expected);
    }

    #[test]
    fn wrong_files_say_what_is_wrong() {
        let header = |shape: &str| format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape}), }}\n");
        let says = |bytes: &[u8], what: &str| {
            let error = read(bytes).unwrap_err();
            assert_eq!(error.code(), what, "{error}");
        };
        says(b"PK\x03\x04....", "not-npy");
        says(b"\x93NUM", "cut-short");
        says(&npy(&header("2, 3"), &[0; 23]), "npy-length");
        says(&npy(&header("2, 3"), &[0; 25]), "npy-length");
        says(&npy(&header("4294967296, 4294967296, 4294967296"), &[]), "npy-length");
        says(&npy(&header("99999999999999999999"), &[]), "npy-header");
        says(&npy(&header("1,1,1,1,1,1,1,1,1"), &[0; 4]), "npy-header");
        says(&npy(&header("1").replace("<f4", "<c8"), &[0; 8]), "npy-type");
        says(&npy(&header("1").replace("<f4", "|O"), &[0; 8]), "npy-type");
        let mut data = [0; 24];
        data[16..20].copy_from_slice(&f32::NAN.to_le_bytes());
        says(&npy(&header("2, 3"), &data), "not-finite");
        let huge = 1e300f64.to_le_bytes();
        says(&npy(&header("1,").replace("f4", "f8"), &huge), "not-finite");
    }

    proptest! {
        #[test]
        fn no_header_makes_it_panic(header in ".{0,80}", version in 0u8..5, data in prop::collection::vec(any::<u8>(), 0..40)) {
            let mut bytes = npy(&header, &data);
            bytes[6] = version;
            let _ = read(&bytes);
        }

        #[test]
        fn no_change_to_a_file_makes_it_panic(at in 0usize..150, to in any::<u8>(), cut in 0usize..160) {
            let whole = npy("{'descr': '<f4', 'fortran_order': True, 'shape': (2, 3), }\n", &[7; 24]);
            let mut bytes = whole.clone();
            bytes[at % whole.len()] = to;
            let _ = read(&bytes);
            // Only the original file is cut, because a changed one may state a shorter length.
            prop_assert!(read(&whole[..cut.min(whole.len() - 1)]).is_err());
        }
    }
}
