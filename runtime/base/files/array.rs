//! Reads the values of an array in a `.npy` or `.npz` file in parts.

use super::npy::{NpyReader, from_fortran};
use super::{FileError, FileKind, npz_line, read, zip};
use crate::memory;
use crate::reason;
use std::io::{BufReader, Read};
use std::path::Path;

/// An array with values that are still to be read.
pub struct NpyArray {
    reader: NpyReader<Box<dyn Read + Send>>,
    /// Length of each axis, slowest first.
    pub shape: Vec<usize>,
    /// NumPy's name of the element type, without the byte order, such as `u1` or `f4`.
    pub kind: String,
    /// In Fortran order all values are read at once. These are the ones that are not yet taken.
    read: Option<std::vec::IntoIter<f32>>,
}

impl NpyArray {
    /// Opens a `.npy`, or the array `name` of an `.npz` (`numpy.savez`, `numpy.savez_compressed`). Without a name, it
    /// opens the only array whose shape is `wanted`.
    ///
    /// # Errors
    /// Returns the errors of [`read_npy`](super::read_npy), and [`FileError::Content`] for a damaged archive, or one
    /// with no such array or several.
    pub fn open(file: &Path, name: Option<&str>, wanted: impl Fn(&[usize]) -> bool) -> Result<Self, FileError> {
        let remedy = |names: &[&str]| {
            let one = names.first().copied().unwrap_or("NAME");
            format!("name one of {}, as in {}?array={one}", names.join(", "), file.display())
        };
        Self::open_or(file, name, wanted, remedy)
    }

    /// Opens the only array whose shape is `wanted`, of a file whose name takes no options.
    ///
    /// # Errors
    /// Returns the errors of [`open`](Self::open). If there are several arrays, the error has a command line that keeps
    /// one of them.
    pub fn only(file: &Path, wanted: impl Fn(&[usize]) -> bool) -> Result<Self, FileError> {
        let remedy = |names: &[&str]| {
            let line = names.first().map_or_else(|| "put one into it".into(), |name| npz_line(file, name));
            format!("it has {}, {line}", names.join(", "))
        };
        Self::open_or(file, None, wanted, remedy)
    }

    fn open_or(
        file: &Path,
        name: Option<&str>,
        wanted: impl Fn(&[usize]) -> bool,
        remedy: impl Fn(&[&str]) -> String,
    ) -> Result<Self, FileError> {
        let unreadable = |e| FileError::read(file, e);
        let open = || read::open(file).map_err(unreadable);
        let length = open()?.metadata().map_err(unreadable)?.len();
        if !matches!(FileKind::of(file).map_err(unreadable)?, FileKind::Npz | FileKind::Zip) {
            return Self::new(file, Box::new(BufReader::new(open()?)), length);
        }
        let entries = zip::entries(&mut BufReader::new(open()?), length).map_err(unreadable)?;
        let arrays = || entries.iter().filter_map(|entry| Some((entry.name.strip_suffix(".npy")?, entry)));
        let array = |entry: &zip::Entry| Self::new(file, entry.open(open()?).map_err(unreadable)?, entry.length);
        let names = || arrays().map(|(name, _)| name).collect::<Vec<_>>();
        if let Some(name) = name {
            let found = arrays().find(|(its, _)| *its == name);
            let none = || reason!("no-such-array", "has no array '{name}': it has {}", names().join(", "));
            return array(found.ok_or_else(|| FileError::content(file, none()))?.1);
        }
        let mut found = Vec::new();
        for (_, entry) in arrays() {
            found.push(array(entry)?);
        }
        if found.len() > 1 {
            found.retain(|array| wanted(&array.shape));
        }
        let count = found.len();
        let which = || {
            let count = if count == 0 { "none of its arrays has" } else { "several of its arrays have" };
            reason!("no-such-shape", "{count} a shape that fits: {}", remedy(&names()))
        };
        found.pop().filter(|_| count == 1).ok_or_else(|| FileError::content(file, which()))
    }

    fn new(file: &Path, from: Box<dyn Read + Send>, length: u64) -> Result<Self, FileError> {
        let reader = NpyReader::new(file, from, length)?;
        let shape = reader.header.shape.clone();
        // The byte order is the first character.
        let kind = reader.header.descr[1..].to_owned();
        Ok(Self { reader, shape, kind, read: None })
    }

    /// Returns the next `count` values in C order. The array must still have this number of values.
    ///
    /// # Errors
    /// Returns the errors of [`read_npy`](super::read_npy). Any values are accepted.
    pub fn take(&mut self, count: usize) -> Result<Vec<f32>, FileError> {
        if !self.reader.header.fortran_order {
            return self.reader.take(count);
        }
        if self.read.is_none() {
            let all: usize = self.shape.iter().product();
            let what = || format!("its shape {:?} in Fortran order", self.shape);
            let promised = memory::check_available(what, memory::bytes_of(&[all, 2], 4), "save it in C order");
            promised.map_err(|e| FileError::content(&self.reader.file, e.to_string()))?;
            let values = self.reader.take(all)?;
            self.read = Some(from_fortran(&self.shape, &values).into_iter());
        }
        Ok(self.read.iter_mut().flat_map(|values| values.take(count)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{npy_header, write_npy, zip::tests::archive};
    use super::*;
    use crate::error::ErrorData;

    #[test]
    fn arrays_are_read_a_part_at_a_time_from_either_file() {
        let here = tempfile::tempdir().unwrap();
        let values: Vec<f32> = (0..24).map(|i| i as f32 * 0.5).collect();
        let (npy, npz) = (here.path().join("a.npy"), here.path().join("a.npz"));
        write_npy(&npy, &[2, 3, 4], &values).unwrap();
        let one = std::fs::read(&npy).unwrap();
        let parts = |array: &mut NpyArray| [array.take(10).unwrap(), array.take(14).unwrap()].concat();
        assert_eq!(parts(&mut NpyArray::open(&npy, None, |_| false).unwrap()), values);

        let other = [npy_header("|u1", &[5]), vec![1, 2, 3, 4, 5]].concat();
        std::fs::write(&npz, archive(&[("x.npy", &other), ("views.npy", &one)], true)).unwrap();
        let open = |name, axes| NpyArray::open(&npz, name, |shape| shape.len() == axes);
        let mut views = open(None, 3).unwrap();
        assert_eq!((&views.shape[..], &views.kind[..]), (&[2, 3, 4][..], "f4"));
        assert_eq!(parts(&mut views), values);
        assert_eq!(open(Some("x"), 3).unwrap().kind, "u1");
        for (name, axes, says) in [(Some("y"), 3, "content/no-such-array"), (None, 2, "content/no-such-shape")] {
            let error = open(name, axes).err().unwrap();
            assert_eq!(ErrorData::of(&error).code, says, "{error}");
        }

        // The same in Fortran order, of halves.
        let order = (0..4).flat_map(|k| (0..3).flat_map(move |j| (0..2).map(move |i| (i * 3 + j) * 4 + k)));
        let halves = order.flat_map(|i| half::f16::from_f32(values[i]).to_le_bytes());
        let header = String::from_utf8(npy_header("<f2", &[2, 3, 4])[10..].to_vec()).unwrap().replace("False", "True ");
        let bytes = [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes()].concat();
        std::fs::write(&npy, bytes.into_iter().chain(halves).collect::<Vec<_>>()).unwrap();
        assert_eq!(parts(&mut NpyArray::open(&npy, None, |_| true).unwrap()), values);
    }
}
