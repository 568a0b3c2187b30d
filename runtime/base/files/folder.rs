//! Holds a folder open, so that reads and writes stay in it even if another folder takes its name.

use super::atomic::write_to_disk;
use super::entry::{Kind, split};
use super::file_lock::FileLock;
use super::held::Held;
use super::read;
use std::ffi::OsString;
use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A folder that is held open. Links in it are not followed. Names in it are relative, with parts separated by `/`.
#[derive(Debug, Clone)]
pub struct Folder {
    path: PathBuf,
    held: Arc<Held>,
}

impl Folder {
    /// Opens a folder. Its path may lead through links.
    ///
    /// # Errors
    /// Returns the errors of the system, and [`io::ErrorKind::NotADirectory`] if it is not a folder.
    pub fn open(path: &Path) -> io::Result<Self> {
        Ok(Self { path: path.to_path_buf(), held: Arc::new(Held::open(path)?) })
    }

    /// Returns the path at which the folder was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns true if the path leads to something else by now.
    pub fn is_replaced(&self) -> bool {
        !self.held.is_at(&self.path)
    }

    /// Opens a regular file of this folder.
    pub fn file(&self, name: &str) -> io::Result<File> {
        read::regular(self.held.read(name)?)
    }

    /// Returns all bytes of a regular file of at most `most` bytes.
    pub fn bytes(&self, name: &str, most: u64) -> io::Result<Vec<u8>> {
        read::all(self.held.read(name)?, most)
    }

    /// Returns the length of a regular file in bytes.
    pub fn length(&self, name: &str) -> io::Result<u64> {
        Ok(self.file(name)?.metadata()?.len())
    }

    /// Returns true if an entry of this name exists. A link counts.
    pub fn has(&self, name: &str) -> bool {
        self.held.kind(name).is_ok()
    }

    /// Returns the entries of one of its folders. If `name` is empty, these are its own entries.
    pub fn entries(&self, name: &str) -> io::Result<Vec<(OsString, Kind)>> {
        self.held.entries(name)
    }

    /// Writes a new file to the disk, and creates the folders on its path. An existing file is removed first.
    pub fn write(&self, name: &str, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
        if self.held.kind(name).is_ok_and(|kind| kind != Kind::Folder) {
            self.held.remove(name)?;
        }
        write_to_disk(self.held.create(name)?, fill)
    }

    /// Writes `name` to the disk through the file `draft`, so that it is complete or unchanged. If this fails, no
    /// `draft` is left.
    pub fn replace(
        &self,
        draft: &str,
        name: &str,
        fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> io::Result<()> {
        if let Err(e) = self.write(draft, fill).and_then(|()| self.rename(draft, name)) {
            let _ = self.remove(draft);
            return Err(e);
        }
        self.held.sync(split(name)?.0)
    }

    /// Moves a file, and creates the folders on its path.
    pub fn rename(&self, from: &str, to: &str) -> io::Result<()> {
        self.held.rename(from, to)
    }

    /// Removes a file, or a link itself.
    pub fn remove(&self, name: &str) -> io::Result<()> {
        self.held.remove(name)
    }

    /// Removes an empty folder of this name.
    pub fn remove_folder(&self, name: &str) -> io::Result<()> {
        self.held.remove_folder(name)
    }

    /// Creates a folder if it does not exist.
    pub fn make(&self, name: &str) -> io::Result<()> {
        self.held.make(name)
    }

    /// Takes the lock of a lock file with this name, until the returned value is dropped. Returns `None` if another
    /// program has it. On a file system without locks everybody gets it.
    pub fn lock(&self, name: &str) -> io::Result<Option<FileLock>> {
        FileLock::take(read::regular(self.held.open_or_create(name)?)?)
    }

    /// Returns true if another program has that lock.
    pub fn is_locked(&self, name: &str) -> bool {
        let probe = || Some(matches!(self.file(name).ok()?.try_lock_shared(), Err(TryLockError::WouldBlock)));
        probe().unwrap_or(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn what_is_written_is_whole_and_stays_in_the_folder() {
        let here = tempfile::tempdir().unwrap();
        let folder = Folder::open(here.path()).unwrap();
        folder.write("a/b/c", |out| out.write_all(b"1")).unwrap();
        folder.replace("draft", "a/b/c", |out| out.write_all(b"2")).unwrap();
        let cut = folder.replace("draft", "a/b/c", |_| Err(io::ErrorKind::StorageFull.into()));
        assert!(cut.is_err() && folder.bytes("a/b/c", 9).unwrap() == b"2" && folder.length("a/b/c").unwrap() == 1);
        assert!(folder.entries("a").unwrap() == [("b".into(), Kind::Folder)] && !folder.has("a/c"));
        assert!(!folder.has("draft") && folder.replace("draft", "a/b", |_| Ok(())).is_err() && !folder.has("draft"));
        assert!(folder.bytes("a/b/c", 0).is_err() && folder.file("a/b").is_err());
        for out in ["../x", "a/../../x", "", "a/"] {
            assert!(folder.write(out, |_| Ok(())).is_err(), "{out}");
        }
        folder.remove("a/b/c").unwrap();
        folder.remove_folder("a/b").unwrap();
        assert!(folder.entries("a").unwrap().is_empty());
        fs::write(here.path().join("file"), "").unwrap();
        assert_eq!(Folder::open(&here.path().join("file")).unwrap_err().kind(), io::ErrorKind::NotADirectory);
        let lock = folder.lock("l").unwrap().unwrap();
        assert!(folder.is_locked("l") && folder.lock("l").unwrap().is_none());
        drop(lock);
        assert!(!folder.is_locked("l"));
    }

    #[cfg(unix)]
    #[test]
    fn links_are_not_followed_and_another_folder_of_its_name_is_not_read() {
        use std::os::unix::fs::symlink;
        let here = tempfile::tempdir().unwrap();
        let [path, data, moved] = ["f", "data", "moved"].map(|name| here.path().join(name));
        [&path, &data].into_iter().for_each(|p| fs::create_dir(p).unwrap());
        fs::write(data.join("x"), "mine").unwrap();
        symlink(&data, path.join("way")).unwrap();
        symlink(data.join("x"), path.join("link")).unwrap();
        let folder = Folder::open(&path).unwrap();
        assert!(folder.file("way/x").is_err() && folder.file("link").is_err() && folder.lock("link").is_err());
        assert!(folder.write("way/y", |_| Ok(())).is_err() && folder.entries("way").is_err());
        assert!(folder.remove("way/x").is_err() && folder.make("way").is_err());
        // The write replaces the link itself.
        folder.write("link", |out| out.write_all(b"new")).unwrap();
        assert_eq!(fs::read_dir(&data).unwrap().count(), 1);
        assert_eq!(fs::read(data.join("x")).unwrap(), b"mine");
        fs::rename(&path, &moved).unwrap();
        assert!(folder.is_replaced());
        fs::create_dir(&path).unwrap();
        assert!(folder.is_replaced() && folder.bytes("link", 9).unwrap() == b"new");
    }
}
