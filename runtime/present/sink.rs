//! Writes the video frames of an offscreen display to a file of bytes, or to memory that programs share.

use super::PresentError;
use eyebox_base::error::Reason;
use eyebox_base::files::{FileError, TimeoutWriter};
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A file that receives every video frame.
#[derive(Debug)]
pub struct Sink {
    file: PathBuf,
    out: Out,
}

#[derive(Debug)]
enum Out {
    /// All frames one after the other, (row, column, channel), in a file or a pipe.
    Raw(BufWriter<TimeoutWriter>),
    /// The newest frame, with the number of frames.
    Shared(File, u64),
}

const HEADER: u64 = 64;
const MAGIC: &[u8; 8] = b"eyebox-1";

/// Options that follow no link and wait for no reader.
fn carefully() -> OpenOptions {
    let mut options = File::options();
    options.write(true);
    #[cfg(unix)]
    {
        use rustix::fs::OFlags;
        use std::os::unix::fs::OpenOptionsExt;
        options.custom_flags((OFlags::NONBLOCK | OFlags::NOFOLLOW).bits() as i32);
    }
    options
}

fn exists(file: &Path, why: &str) -> FileError {
    FileError::taken(file, Reason::new("exists", why))
}

/// Rejects an existing file, because it belongs to the user. Pipes and devices are accepted.
fn is_free(file: &Path) -> Result<(), FileError> {
    match std::fs::metadata(file).is_ok_and(|there| there.is_file()) {
        true => Err(exists(file, "already exists and is not overwritten: remove it or give another name")),
        false => Ok(()),
    }
}

/// Opens a new file, or an existing pipe or device.
fn raw_file(file: &Path) -> Result<TimeoutWriter, FileError> {
    let failed = |e| FileError::write(file, e);
    is_free(file)?;
    match std::fs::metadata(file) {
        Ok(_) => TimeoutWriter::open(file).map_err(failed),
        Err(_) => carefully().create_new(true).open(file).map(TimeoutWriter::new).map_err(failed),
    }
}

/// Opens a file of this length that other programs map. It is a new file or an existing one of eyebox. A file of
/// another length is replaced and not cut, because another program may still have it mapped.
fn shared_file(file: &Path, length: u64) -> Result<File, FileError> {
    let failed = |e| FileError::write(file, e);
    let new = || carefully().read(true).create_new(true).open(file);
    match std::fs::symlink_metadata(file) {
        Err(_) => new().map_err(failed),
        Ok(there) => {
            let mut begins = [0; MAGIC.len()];
            let opened = if there.is_file() { carefully().read(true).open(file).ok() } else { None };
            let ours = opened.filter(|mut f| f.read_exact(&mut begins).is_ok() && begins == *MAGIC);
            match ours {
                Some(ours) if ours.metadata().is_ok_and(|m| m.len() == length) => Ok(ours),
                Some(_) => std::fs::remove_file(file).and_then(|()| new()).map_err(failed),
                None => Err(exists(
                    file,
                    "already exists and was not made by eyebox, or is a link: remove it or give another name",
                )),
            }
        }
    }
}

impl Sink {
    /// Rejects a file that [`raw`](Self::raw) would reject, before any computation for it.
    ///
    /// # Errors
    /// [`PresentError::File`] with a [`FileError::Taken`].
    pub fn check_raw(file: &Path) -> Result<(), PresentError> {
        Ok(is_free(file)?)
    }

    /// Writes into a new file, or into an existing pipe. A pipe that takes nothing for 5 s, or has no reader for that
    /// time, is given up.
    ///
    /// # Errors
    /// [`PresentError::File`], with a [`FileError::Taken`] for an existing file.
    pub fn raw(file: &Path) -> Result<Self, PresentError> {
        Ok(Self { file: file.into(), out: Out::Raw(BufWriter::new(raw_file(file)?)) })
    }

    /// Stores the newest picture of (rows, columns, channels) in a file that other programs map. In `/dev/shm` that is
    /// memory. Windows is not supported, because there a written file and a mapped one may differ at times. The file
    /// has 64 bytes of header, with all numbers little-endian, and the picture:
    ///
    /// | byte | what |
    /// |---|---|
    /// | 0 | `eyebox-1` |
    /// | 8 | u64 sequence number, odd while the picture is written, otherwise twice the number of video frames that the file has held |
    /// | 16 | u32 rows, u32 columns, u32 channels, u32 zero |
    /// | 32 | i64 desired present time, ns on the player's clock |
    ///
    /// A reader reads the sequence number, copies, and reads it again. If the two differ or are odd, it tries again.
    ///
    /// # Errors
    /// [`PresentError::File`], with a [`FileError::Taken`] for an existing file of another kind.
    pub fn shared(file: &Path, [rows, columns, channels]: [usize; 3]) -> Result<Self, PresentError> {
        // Live input (tools/live-input) also has a sequence number of this kind. It does not share this code, because
        // its memory is sealed and mapped, and its reader holds the slots. Any program may cut this file, so system
        // calls write it and no map does.
        let failed = |e| FileError::write(file, e);
        if cfg!(windows) {
            let reason = "Windows does not share memory through files: use `raw` with a file or a pipe";
            return Err(failed(io::Error::new(io::ErrorKind::Unsupported, reason)).into());
        }
        let length = HEADER + (rows * columns * channels) as u64;
        let out = shared_file(file, length)?;
        out.set_len(length).map_err(failed)?;
        let mut header = header_of(&out).map_err(failed)?;
        let before = header;
        header[..8].copy_from_slice(MAGIC);
        for (place, value) in header[16..28].chunks_exact_mut(4).zip([rows, columns, channels]) {
            place.copy_from_slice(&(value as u32).to_le_bytes());
        }
        // An existing file keeps its count. If its picture has another shape or is torn, the number is odd until the
        // first picture.
        let number = u64::from_le_bytes(header[8..16].try_into().expect("eight bytes")).min(u64::MAX >> 1);
        let count = number.div_ceil(2);
        if number > 0 && (number % 2 == 1 || header[16..28] != before[16..28]) {
            header[8..16].copy_from_slice(&(2 * count + 1).to_le_bytes());
        }
        put_at(&out, 0, &header).map_err(failed)?;
        Ok(Self { file: file.into(), out: Out::Shared(out, count) })
    }

    /// Writes one video frame.
    ///
    /// # Errors
    /// [`PresentError::File`] if the write fails.
    pub fn put(&mut self, picture: &[u8], desired_present_time_ns: i64) -> Result<(), PresentError> {
        let written = match &mut self.out {
            Out::Raw(out) => out.write_all(picture),
            Out::Shared(out, count) => {
                *count += 1;
                let number = 2 * *count;
                put_at(out, 8, &(number - 1).to_le_bytes())
                    .and_then(|()| put_at(out, HEADER, picture))
                    .and_then(|()| put_at(out, 32, &desired_present_time_ns.to_le_bytes()))
                    .and_then(|()| put_at(out, 8, &number.to_le_bytes()))
            }
        };
        written.map_err(|e| FileError::write(&self.file, e).into())
    }

    /// Writes all pending data to the file.
    ///
    /// # Errors
    /// [`PresentError::File`] if the write fails.
    pub fn finish(&mut self) -> Result<(), PresentError> {
        let flushed = match &mut self.out {
            Out::Raw(out) => out.flush(),
            Out::Shared(out, _) => out.flush(),
        };
        flushed.map_err(|e| FileError::write(&self.file, e).into())
    }
}

/// The header of a file that other programs map.
fn header_of(mut file: &File) -> io::Result<[u8; HEADER as usize]> {
    let mut header = [0; HEADER as usize];
    file.seek(SeekFrom::Start(0))?;
    file.read_exact(&mut header)?;
    Ok(header)
}

/// Writes into the middle of a file.
fn put_at(mut out: &File, place: u64, bytes: &[u8]) -> io::Result<()> {
    out.seek(SeekFrom::Start(place))?;
    out.write_all(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox_base::error::ErrorData;

    #[cfg(windows)]
    #[test]
    fn shared_memory_is_refused() {
        let here = tempfile::tempdir().unwrap();
        let error = Sink::shared(&here.path().join("s"), [2, 3, 1]).unwrap_err();
        assert!(error.to_string().contains("`raw`") && !here.path().join("s").exists(), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn what_is_somebodys_stays_and_a_map_that_is_held_is_not_cut() {
        let here = tempfile::tempdir().unwrap();
        let at = |name: &str| here.path().join(name);
        std::fs::write(at("notes"), "mine").unwrap();
        std::os::unix::fs::symlink(at("notes"), at("link")).unwrap();
        for name in ["notes", "link"] {
            let errors = [Sink::raw(&at(name)).unwrap_err(), Sink::shared(&at(name), [2, 3, 1]).unwrap_err()];
            assert!(errors.iter().all(|e| ErrorData::of(e).code.ends_with("taken/exists")), "{errors:?}");
        }
        assert_eq!(std::fs::read(at("notes")).unwrap(), b"mine");
        drop(Sink::shared(&at("s"), [2, 3, 1]).unwrap());
        let held = File::open(at("s")).unwrap();
        drop(Sink::shared(&at("s"), [2, 2, 1]).unwrap());
        assert_eq!((held.metadata().unwrap().len(), std::fs::metadata(at("s")).unwrap().len()), (70, 68));
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
        // The next writer continues the count. The old picture stays readable unless it has another shape.
        drop(Sink::shared(&shared, [2, 3, 1]).unwrap());
        assert_eq!(std::fs::read(&shared).unwrap(), bytes);
        let mut again = Sink::shared(&shared, [3, 2, 1]).unwrap();
        assert_eq!(std::fs::read(&shared).unwrap()[8], 5);
        again.put(b"mnopqr", 1).unwrap();
        again.finish().unwrap();
        assert_eq!(std::fs::read(&shared).unwrap()[8], 6);
        #[cfg(target_os = "linux")]
        {
            let mut full = Sink::raw(Path::new("/dev/full")).unwrap();
            let put = (0..10_000).find_map(|_| full.put(b"abcdef", 0).err()).expect("a full disk");
            assert!(ErrorData::of(&put).code.ends_with("full"), "{put}");
        }
    }
}
