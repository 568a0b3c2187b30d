//! Holds the lock of an open file until it is dropped.

use std::fs::{File, TryLockError};
use std::io;

/// The lock of a file or a folder, until it is dropped.
///
/// The lock belongs to the open file. A child process has a copy of the open file until it starts its own program, and
/// closing the file would leave the lock to this copy. Therefore dropping this releases the lock for all copies.
#[derive(Debug)]
pub struct FileLock(File);

impl FileLock {
    /// Locks an open file. Returns `None` if it is locked already. On a file system without locks everybody gets it.
    ///
    /// # Errors
    /// Returns the errors of the system.
    pub fn take(file: File) -> io::Result<Option<Self>> {
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(e)) if e.kind() != io::ErrorKind::Unsupported => Err(e),
            _ => Ok(Some(Self(file))),
        }
    }

    /// Returns the locked file.
    pub(super) fn file(&self) -> &File {
        &self.0
    }

    /// Returns the lock of a file that was locked before.
    pub(super) fn held(file: File) -> Self {
        Self(file)
    }
}

impl Drop for FileLock {
    fn drop(&mut self) {
        let _ = self.0.unlock();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_of_the_open_file_does_not_keep_the_lock() {
        let here = tempfile::tempdir().unwrap();
        let open = || File::create(here.path().join("lock")).unwrap();
        let file = open();
        let _copy = file.try_clone().unwrap();
        let lock = FileLock::take(file).unwrap();
        assert!(lock.is_some() && FileLock::take(open()).unwrap().is_none());
        drop(lock);
        assert!(FileLock::take(open()).unwrap().is_some());
    }
}
