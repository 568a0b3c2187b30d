//! Holds a folder by its path on systems without descriptors of folders. Links are rejected before a name is opened.

use super::entry::{Kind, split};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// Returns the number of the volume, and of the file or folder on it.
fn id(path: &Path) -> io::Result<(u64, u64)> {
    let there = winapi_util::file::information(winapi_util::Handle::from_path_any(path)?)?;
    Ok((there.volume_serial_number(), there.file_index()))
}

#[derive(Debug)]
pub(super) struct Held {
    path: PathBuf,
    /// Another folder of the same name has another number.
    id: (u64, u64),
}

impl Held {
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        if !fs::metadata(path)?.is_dir() {
            return Err(io::ErrorKind::NotADirectory.into());
        }
        Ok(Self { path: path.to_path_buf(), id: id(path)? })
    }

    pub(super) fn is_at(&self, path: &Path) -> bool {
        id(path).is_ok_and(|there| there == self.id)
    }

    pub(super) fn read(&self, name: &str) -> io::Result<File> {
        File::open(self.find(name, false)?)
    }

    pub(super) fn open_or_create(&self, name: &str) -> io::Result<File> {
        File::options().read(true).append(true).create(true).open(self.find(name, true)?)
    }

    pub(super) fn create(&self, name: &str) -> io::Result<File> {
        File::create_new(self.find(name, true)?)
    }

    pub(super) fn kind(&self, name: &str) -> io::Result<Kind> {
        let (way, last) = split(name)?;
        Ok(kind_of(fs::symlink_metadata(self.enter(way, false)?.join(last))?.file_type()))
    }

    pub(super) fn entries(&self, name: &str) -> io::Result<Vec<(OsString, Kind)>> {
        let entry = |e: io::Result<fs::DirEntry>| e.and_then(|e| Ok((e.file_name(), kind_of(e.file_type()?))));
        fs::read_dir(self.enter(name, false)?)?.map(entry).collect()
    }

    pub(super) fn rename(&self, from: &str, to: &str) -> io::Result<()> {
        fs::rename(self.find(from, false)?, self.find(to, true)?)
    }

    pub(super) fn sync(&self, _: &str) -> io::Result<()> {
        Ok(())
    }

    pub(super) fn remove(&self, name: &str) -> io::Result<()> {
        let (way, last) = split(name)?;
        fs::remove_file(self.enter(way, false)?.join(last))
    }

    pub(super) fn remove_folder(&self, name: &str) -> io::Result<()> {
        let (way, last) = split(name)?;
        fs::remove_dir(self.enter(way, false)?.join(last))
    }

    pub(super) fn make(&self, name: &str) -> io::Result<()> {
        self.enter(name, true).map(drop)
    }

    /// Returns the path of a file, which must not be a link.
    fn find(&self, name: &str, make: bool) -> io::Result<PathBuf> {
        let (way, last) = split(name)?;
        let file = self.enter(way, make)?.join(last);
        if fs::symlink_metadata(&file).is_ok_and(|there| there.is_symlink()) {
            return Err(link());
        }
        Ok(file)
    }

    fn enter(&self, way: &str, make: bool) -> io::Result<PathBuf> {
        let mut at = self.path.clone();
        for part in way.split('/').filter(|part| !part.is_empty()) {
            at.push(part);
            match fs::symlink_metadata(&at) {
                Ok(there) if there.is_dir() => {}
                Ok(_) => return Err(link()),
                Err(_) if make => fs::create_dir(&at).or_else(|e| if at.is_dir() { Ok(()) } else { Err(e) })?,
                Err(e) => return Err(e),
            }
        }
        Ok(at)
    }
}

fn link() -> io::Error {
    io::Error::new(
        io::ErrorKind::InvalidInput,
        "there is a link at this path or on the way, and links in it are not followed",
    )
}

fn kind_of(kind: fs::FileType) -> Kind {
    match (kind.is_file(), kind.is_dir()) {
        (true, _) => Kind::File,
        (_, true) => Kind::Folder,
        _ => Kind::Other,
    }
}
