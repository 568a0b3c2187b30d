//! Where an offscreen display's video frames go besides: a file of bytes, or memory shared with another program.

use super::PresentError;
use crate::files::FileError;
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Takes every video frame.
#[derive(Debug)]
pub enum Sink {
    /// One after the other, (row, column, channel), into a file or a pipe.
    Raw {
        /// The file.
        file: PathBuf,
        /// It, opened.
        out: BufWriter<File>,
    },
    /// The newest, in a file that others map: in `/dev/shm` that is memory. 64 bytes of header, all numbers
    /// little-endian, and the picture:
    ///
    /// | byte | what |
    /// |---|---|
    /// | 0 | `eyebox-1` |
    /// | 8 | u64 sequence number: odd while the picture is written, else twice the number of video frames so far |
    /// | 16 | u32 rows, u32 columns, u32 channels, u32 zero |
    /// | 32 | i64 desired present time, ns on the player's clock |
    ///
    /// A reader takes the sequence number, copies, and takes it again: where they differ or are odd, it tries again.
    Shared {
        /// The file.
        file: PathBuf,
        /// It, opened.
        out: File,
        /// Video frames so far.
        count: u64,
    },
}

const HEADER: u64 = 64;

impl Sink {
    /// Appends to a new file, or writes to a pipe that is there.
    ///
    /// # Errors
    /// [`PresentError::File`].
    pub fn raw(file: &Path) -> Result<Self, PresentError> {
        let out = File::create(file).map_err(|e| FileError::write(file, e))?;
        Ok(Self::Raw { file: file.into(), out: BufWriter::new(out) })
    }

    /// For pictures of (rows, columns, channels). Not on Windows, where a file that is written and one that is mapped need
    /// not be the same at every moment.
    ///
    /// # Errors
    /// [`PresentError::File`].
    pub fn shared(file: &Path, [rows, columns, channels]: [usize; 3]) -> Result<Self, PresentError> {
        let failed = |e| FileError::write(file, e);
        if cfg!(windows) {
            let reason = "Windows does not share memory through files: take `--raw` into a file or a pipe";
            return Err(failed(io::Error::new(io::ErrorKind::Unsupported, reason)).into());
        }
        let out = OpenOptions::new().read(true).write(true).create(true).truncate(true).open(file).map_err(failed)?;
        out.set_len(HEADER + (rows * columns * channels) as u64).map_err(failed)?;
        let mut header = [0u8; HEADER as usize];
        header[..8].copy_from_slice(b"eyebox-1");
        for (place, value) in header[16..28].chunks_exact_mut(4).zip([rows, columns, channels]) {
            place.copy_from_slice(&(value as u32).to_le_bytes());
        }
        let mut sink = Self::Shared { file: file.into(), out, count: 0 };
        sink.at(0, &header).map_err(failed)?;
        Ok(sink)
    }

    /// One video frame.
    ///
    /// # Errors
    /// [`PresentError::File`].
    pub fn put(&mut self, picture: &[u8], desired_present_time_ns: i64) -> Result<(), PresentError> {
        self.write(picture, desired_present_time_ns).map_err(|e| FileError::write(self.file(), e).into())
    }

    fn write(&mut self, picture: &[u8], desired_present_time_ns: i64) -> io::Result<()> {
        let number = match self {
            Self::Raw { out, .. } => return out.write_all(picture),
            Self::Shared { count, .. } => {
                *count += 1;
                2 * *count
            }
        };
        self.at(8, &(number - 1).to_le_bytes())?;
        self.at(HEADER, picture)?;
        self.at(32, &desired_present_time_ns.to_le_bytes())?;
        self.at(8, &number.to_le_bytes())
    }

    /// What is still on its way, to the file.
    ///
    /// # Errors
    /// [`PresentError::File`].
    pub fn finish(&mut self) -> Result<(), PresentError> {
        let flushed = match self {
            Self::Raw { out, .. } => out.flush(),
            Self::Shared { out, .. } => out.flush(),
        };
        flushed.map_err(|e| FileError::write(self.file(), e).into())
    }

    fn at(&mut self, place: u64, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Raw { .. } => Ok(()),
            Self::Shared { out, .. } => {
                out.seek(SeekFrom::Start(place))?;
                out.write_all(bytes)
            }
        }
    }

    fn file(&self) -> &Path {
        match self {
            Self::Raw { file, .. } | Self::Shared { file, .. } => file,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(windows)]
    #[test]
    fn shared_memory_is_refused() {
        let here = tempfile::tempdir().unwrap();
        let error = Sink::shared(&here.path().join("s"), [2, 3, 1]).unwrap_err().to_string();
        assert!(error.contains("--raw") && !here.path().join("s").exists(), "{error}");
    }

    #[cfg(not(windows))]
    #[test]
    fn raw_is_all_and_shared_is_the_newest() {
        let here = tempfile::tempdir().unwrap();
        let (raw, shared) = (here.path().join("r"), here.path().join("s"));
        let mut sinks = [Sink::raw(&raw).unwrap(), Sink::shared(&shared, [2, 3, 1]).unwrap()];
        for sink in &mut sinks {
            sink.put(b"abcdef", 5).unwrap();
            sink.put(b"ghijkl", -7).unwrap();
            sink.finish().unwrap();
        }
        assert_eq!(std::fs::read(&raw).unwrap(), b"abcdefghijkl");
        let bytes = std::fs::read(&shared).unwrap();
        assert_eq!((&bytes[..8], &bytes[64..]), (&b"eyebox-1"[..], &b"ghijkl"[..]));
        assert_eq!((bytes[8], bytes[16], bytes[20], bytes[24]), (4, 2, 3, 1));
        assert_eq!(i64::from_le_bytes(bytes[32..40].try_into().unwrap()), -7);
        #[cfg(target_os = "linux")]
        {
            let mut full = Sink::raw(Path::new("/dev/full")).unwrap();
            let put = (0..10_000).find_map(|_| full.put(b"abcdef", 0).err()).expect("a full disk");
            assert!(put.to_string().contains("full"), "{put}");
        }
    }
}
