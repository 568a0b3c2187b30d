//! Writes files that grow while something runs, such as recordings. Data up to any end, even a forced one, is kept.

use super::FileError;
use super::atomic::{is_stream, parent};
use super::staging::{self, FileDraft};
use super::timeout_writer::TimeoutWriter;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Maximum time that data waits before it goes to the file.
const EVERY: Duration = Duration::from_secs(1);

/// A file that grows by complete entries and is written to every second. Its first entry puts it in place and replaces
/// a file of its name. Before that, nothing changes there. If the disk is full, the file ends with its last complete
/// entry.
#[derive(Debug)]
pub struct GrowingFile {
    place: PathBuf,
    out: Out,
    waiting: Vec<u8>,
    /// Bytes of complete entries in the file.
    whole: u64,
    written: Option<Instant>,
}

#[derive(Debug)]
enum Out {
    /// A temporary file that is not yet in place.
    Draft(FileDraft),
    File(File),
    /// A pipe or a device, from which nothing can be taken back.
    Stream(TimeoutWriter),
    /// The file after an error.
    Ended,
}

impl GrowingFile {
    /// Begins a file that will be at `place`.
    ///
    /// # Errors
    /// Returns [`FileError::Taken`] for a folder, [`FileError::Write`] or [`FileError::Full`].
    pub fn new(place: &Path) -> Result<Self, FileError> {
        let failed = |e| FileError::write(place, e);
        let out = if is_stream(place)? {
            Out::Stream(TimeoutWriter::open(place).map_err(failed)?)
        } else {
            Out::Draft(staging::file(parent(place)).map_err(failed)?)
        };
        Ok(Self { place: place.to_path_buf(), out, waiting: Vec::new(), whole: 0, written: None })
    }

    /// Returns true if no entry was added.
    pub fn is_empty(&self) -> bool {
        self.whole == 0 && self.waiting.is_empty()
    }

    /// Adds an entry, which is all data that `fill` writes.
    ///
    /// # Errors
    /// Returns the errors of [`tend`](Self::tend) and of `fill`.
    pub fn add(&mut self, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), FileError> {
        let before = self.waiting.len();
        if let Err(e) = fill(&mut self.waiting) {
            self.waiting.truncate(before);
            return Err(FileError::write(&self.place, e));
        }
        self.tend()
    }

    /// Writes the data that has waited for a second. Call this now and then if nothing is added.
    ///
    /// # Errors
    /// Returns [`FileError::Full`] or [`FileError::Write`], once. The file then ends with the last complete entry that
    /// had room, and nothing more is written.
    pub fn tend(&mut self) -> Result<(), FileError> {
        match self.written {
            Some(written) if written.elapsed() < EVERY => Ok(()),
            _ => self.flush(),
        }
    }

    /// Writes the rest to the disk.
    ///
    /// # Errors
    /// Returns the errors of [`tend`](Self::tend).
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
                // A rest after the last complete entry does not make the file unreadable.
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
                    // Entries end with lines, so the complete lines that had room stay.
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
        // A caller that did not finish the file already has the error, or will not use it.
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
