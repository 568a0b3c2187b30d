//! Holds a folder by its descriptor. Each part of a name is opened in turn, and a link on the way is an error.

use super::entry::{Kind, split};
use rustix::fd::{AsFd, BorrowedFd, OwnedFd};
use rustix::fs::{AtFlags, Dir, FileType, Mode, OFlags, fsync, mkdirat, openat, renameat, statat, unlinkat};
use rustix::io::Errno;
use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;

const FOLDER: OFlags = OFlags::RDONLY.union(OFlags::DIRECTORY).union(OFlags::NOFOLLOW).union(OFlags::CLOEXEC);
/// Opening a pipe waits for its writer, unless this flag is set.
const FILE: OFlags = OFlags::NOFOLLOW.union(OFlags::NONBLOCK).union(OFlags::CLOEXEC);

#[derive(Debug)]
pub(super) struct Held(File);

impl Held {
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        let mut options = File::options();
        Ok(Self(options.read(true).custom_flags(OFlags::DIRECTORY.bits() as i32).open(path)?))
    }

    pub(super) fn is_at(&self, path: &Path) -> bool {
        let same = |a: fs::Metadata, b: fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
        fs::metadata(path).is_ok_and(|there| self.0.metadata().is_ok_and(|held| same(held, there)))
    }

    pub(super) fn read(&self, name: &str) -> io::Result<File> {
        self.open_as(name, FILE | OFlags::RDONLY, false)
    }

    pub(super) fn open_or_create(&self, name: &str) -> io::Result<File> {
        self.open_as(name, FILE | OFlags::RDWR | OFlags::CREATE, true)
    }

    pub(super) fn create(&self, name: &str) -> io::Result<File> {
        self.open_as(name, FILE | OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL, true)
    }

    fn open_as(&self, name: &str, flags: OFlags, make: bool) -> io::Result<File> {
        let (way, last) = split(name)?;
        let folder = self.enter(way, make)?;
        Ok(openat(self.at(&folder), last, flags, Mode::from_raw_mode(0o666)).map_err(explain)?.into())
    }

    pub(super) fn kind(&self, name: &str) -> io::Result<Kind> {
        let (way, last) = split(name)?;
        let stat = statat(self.at(&self.enter(way, false)?), last, AtFlags::SYMLINK_NOFOLLOW)?;
        Ok(kind_of(FileType::from_raw_mode(stat.st_mode)))
    }

    pub(super) fn entries(&self, name: &str) -> io::Result<Vec<(OsString, Kind)>> {
        // Opened again, because a folder is read from its beginning.
        let folder = openat(self.at(&self.enter(name, false)?), ".", FOLDER, Mode::empty())?;
        let mut found = Vec::new();
        for entry in Dir::read_from(&folder)? {
            let entry = entry?;
            let name = entry.file_name();
            if [&b"."[..], b".."].contains(&name.to_bytes()) {
                continue;
            }
            let kind = match entry.file_type() {
                FileType::Unknown => FileType::from_raw_mode(statat(&folder, name, AtFlags::SYMLINK_NOFOLLOW)?.st_mode),
                known => known,
            };
            found.push((OsStr::from_bytes(name.to_bytes()).to_owned(), kind_of(kind)));
        }
        Ok(found)
    }

    pub(super) fn rename(&self, from: &str, to: &str) -> io::Result<()> {
        let ((way, from), (new_way, to)) = (split(from)?, split(to)?);
        let (old, new) = (self.enter(way, false)?, self.enter(new_way, true)?);
        Ok(renameat(self.at(&old), from, self.at(&new), to)?)
    }

    pub(super) fn sync(&self, way: &str) -> io::Result<()> {
        match fsync(self.at(&self.enter(way, false)?)) {
            // Some network file systems cannot do this, and report it.
            Ok(()) | Err(Errno::INVAL | Errno::OPNOTSUPP) => Ok(()),
            Err(e) => Err(e.into()),
        }
    }

    pub(super) fn remove(&self, name: &str) -> io::Result<()> {
        self.unlink(name, AtFlags::empty())
    }

    pub(super) fn remove_folder(&self, name: &str) -> io::Result<()> {
        self.unlink(name, AtFlags::REMOVEDIR)
    }

    fn unlink(&self, name: &str, flags: AtFlags) -> io::Result<()> {
        let (way, last) = split(name)?;
        Ok(unlinkat(self.at(&self.enter(way, false)?), last, flags)?)
    }

    pub(super) fn make(&self, name: &str) -> io::Result<()> {
        self.enter(name, true).map(drop)
    }

    fn at<'a>(&'a self, folder: &'a Option<OwnedFd>) -> BorrowedFd<'a> {
        folder.as_ref().map_or(self.0.as_fd(), AsFd::as_fd)
    }

    /// Opens a folder inside this one. Returns `None` for this folder itself.
    fn enter(&self, way: &str, make: bool) -> io::Result<Option<OwnedFd>> {
        let mut at = None;
        for part in way.split('/').filter(|part| !part.is_empty()) {
            if make {
                match mkdirat(self.at(&at), part, Mode::from_raw_mode(0o777)) {
                    Ok(()) | Err(Errno::EXIST) => {}
                    Err(e) => return Err(e.into()),
                }
            }
            at = Some(openat(self.at(&at), part, FOLDER, Mode::empty()).map_err(explain)?);
        }
        Ok(at)
    }
}

/// Explains the errors that links cause.
fn explain(e: Errno) -> io::Error {
    let reason = match e {
        Errno::LOOP => "it is a link, and links in it are not followed",
        Errno::NOTDIR => "a link or a file is at the path of a folder, and links in it are not followed",
        e => return e.into(),
    };
    io::Error::new(io::ErrorKind::InvalidInput, reason)
}

fn kind_of(kind: FileType) -> Kind {
    match kind {
        FileType::RegularFile => Kind::File,
        FileType::Directory => Kind::Folder,
        _ => Kind::Other,
    }
}
