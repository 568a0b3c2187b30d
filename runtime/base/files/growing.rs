//! Files that grow for as long as something lasts: recordings. What was written up to any end, by force too, is there.

use super::FileError;
use super::atomic::{is_stream, parent};
use super::staging::{self, FileDraft};
use super::timeout_writer::TimeoutWriter;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How long what was written may wait for the file.
const EVERY: Duration = Duration::from_secs(1);

/// A file that grows by whole entries and is written to every second. Its first entry puts it in its place, where a file of its
/// name is replaced; before that nothing has changed there. Where the disk is full, it ends with its last whole entry.
#[derive(Debug)]
pub struct GrowingFile {
    place: PathBuf,
    out: Out,
    waiting: Vec<u8>,
    /// Bytes of whole entries in the file.
    whole: u64,
    written: Option<Instant>,
}

#[derive(Debug)]
enum Out {
    /// Not yet in its place.
    Draft(FileDraft),
    File(File),
    /// A pipe or a device, of which nothing can be taken back.
    Stream(TimeoutWriter),
    /// It failed.
    Ended,
}

impl GrowingFile {
    /// Begins a file that will be at `place`.
    ///
    /// # Errors
    /// [`FileError::Taken`] for a folder; [`FileError::Write`], [`FileError::Full`].
    pub fn new(place: &Path) -> Result<Self, FileError> {
        let failed = |e| FileError::write(place, e);
        let out = if is_stream(place)? {
            Out::Stream(TimeoutWriter::open(place).map_err(failed)?)
        } else {
            Out::Draft(staging::file(parent(place)).map_err(failed)?)
        };
        Ok(Self { place: place.to_path_buf(), out, waiting: Vec::new(), whole: 0, written: None })
    }

    /// Whether nothing came to be in it.
    pub fn is_empty(&self) -> bool {
        self.whole == 0 && self.waiting.is_empty()
    }

    /// Adds an entry, all that `fill` writes.
    ///
    /// # Errors
    /// As [`tend`](Self::tend); those of `fill`.
    pub fn add(&mut self, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), FileError> {
        let before = self.waiting.len();
        if let Err(e) = fill(&mut self.waiting) {
            self.waiting.truncate(before);
            return Err(FileError::write(&self.place, e));
        }
        self.tend()
    }

    /// Writes what has waited for a second; to be called now and then where nothing is added.
    ///
    /// # Errors
    /// [`FileError::Full`], [`FileError::Write`]: once; then the file ends with the last whole entry that had room, and nothing
    /// more is written.
    pub fn tend(&mut self) -> Result<(), FileError> {
        match self.written {
            Some(written) if written.elapsed() < EVERY => Ok(()),
            _ => self.flush(),
        }
    }

    /// Writes the rest, to the disk.
    ///
    /// # Errors
    /// As [`tend`](Self::tend).
    pub fn finish(mut self) -> Result<(), FileError> {
        self.flush()?;
        match &self.out {
            Out::File(file) => file.sync_all().map_err(|e| FileError::write(&self.place, e)),
            _ => Ok(()),
        }
    }

    fn flush(&mut self) -> Result<(), FileError> {
        if self.waiting.is_empty() {
            return Ok(());
        }
        self.written = Some(Instant::now());
        let written = self.write();
        self.waiting.clear();
        if written.is_err() {
            if let Out::File(file) = &self.out {
                // What is left behind the last whole entry is readable all the same.
                let _ = file.set_len(self.whole);
            }
            self.out = Out::Ended;
        }
        written.map_err(|e| FileError::write(&self.place, e))
    }

    fn write(&mut self) -> io::Result<()> {
        if matches!(self.out, Out::Draft(..))
            && let Out::Draft(draft) = std::mem::replace(&mut self.out, Out::Ended)
        {
            draft.file.as_file().write_all(&self.waiting)?;
            self.out = Out::File(draft.file.persist(&self.place).map_err(|e| e.error)?);
            self.whole = self.waiting.len() as u64;
            return Ok(());
        }
        let file: &mut dyn Write = match &mut self.out {
            Out::File(file) => file,
            Out::Stream(stream) => stream,
            Out::Draft(..) | Out::Ended => return Ok(()),
        };
        let mut left = &self.waiting[..];
        while !left.is_empty() {
            match file.write(left) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(n) => left = &left[n..],
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => {
                    // Entries end with lines: those that had room stay.
                    let had_room = &self.waiting[..self.waiting.len() - left.len()];
                    self.whole += had_room.iter().rposition(|b| *b == b'\n').map_or(0, |at| at as u64 + 1);
                    return Err(e);
                }
            }
        }
        self.whole += self.waiting.len() as u64;
        Ok(())
    }
}

impl Drop for GrowingFile {
    fn drop(&mut self) {
        // Who did not finish it was told why, or will not hear it.
        let _ = self.flush();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn it_is_in_its_place_from_the_first_entry_on_and_ends_whole() {
        let here = tempfile::tempdir().unwrap();
        let file = here.path().join("a");
        fs::write(&file, "old").unwrap();
        drop(GrowingFile::new(&file).unwrap());
        assert_eq!(fs::read(&file).unwrap(), b"old");
        let mut growing = GrowingFile::new(&file).unwrap();
        assert!(growing.is_empty());
        growing.add(|out| out.write_all(b"1\n")).unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"1\n");
        let cut = growing.add(|out| out.write_all(b"x").and(Err(io::ErrorKind::InvalidData.into())));
        assert!(cut.is_err());
        growing.add(|out| out.write_all(b"2\n")).unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"1\n", "a second has not passed");
        growing.finish().unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"1\n2\n");
        assert_eq!(fs::read_dir(here.path()).unwrap().count(), 1);
        assert!(GrowingFile::new(here.path()).is_err() && GrowingFile::new(&here.path().join("none/a")).is_err());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_device_is_said_once() {
        let mut growing = GrowingFile::new(Path::new("/dev/full")).unwrap();
        let error = growing.add(|out| out.write_all(b"1\n")).unwrap_err();
        assert!(matches!(error, FileError::Full { .. }), "{error}");
        growing.add(|out| out.write_all(b"2\n")).unwrap();
        growing.finish().unwrap();
    }
}
