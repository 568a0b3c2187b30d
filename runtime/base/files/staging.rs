//! Manages the temporary files and folders that are written next to a destination before they are renamed.
//!
//! The program that writes a temporary name locks it. The next program that writes in the same folder can then
//! recognize the temporary names of programs that have ended, and removes them. A program that a signal ends can remove
//! its own ([`end_without_drafts`]).

use super::file_lock::FileLock;
use super::os::{is_same, open_own, permit};
use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tempfile::{NamedTempFile, TempDir};

const HEAD: &str = ".eyebox-";
const TAIL: &str = ".part";

/// Returns true if a name in a folder is temporary in this sense.
pub fn is_draft(name: &str) -> bool {
    let middle = name.strip_prefix(HEAD).and_then(|rest| rest.strip_suffix(TAIL));
    middle.is_some_and(|middle| middle.bytes().all(|b| b.is_ascii_alphanumeric()))
}

/// The temporary paths that this program writes.
static OPEN: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn open_drafts() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    OPEN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Marks a path as temporary and as written by this program, until this is dropped.
#[derive(Debug)]
pub(super) struct Open(PathBuf);

impl Open {
    /// Makes a temporary file or folder and records it. In between, [`end_without_drafts`] cannot end the program.
    fn make<T>(make: impl FnOnce() -> io::Result<T>, path: impl Fn(&T) -> &Path) -> io::Result<(T, Self)> {
        let mut open = open_drafts();
        let draft = make()?;
        let path = path(&draft).to_path_buf();
        open.insert(path.clone());
        Ok((draft, Self(path)))
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        open_drafts().remove(&self.0);
    }
}

/// Ends the program by `end`, and removes its temporary files first. It is for programs that end by a signal, and is
/// called from a separate thread.
pub fn end_without_drafts(end: impl FnOnce()) {
    // The lock is held until the end, so no new temporary file begins.
    let open = open_drafts();
    for path in &*open {
        // Another thread may write into a folder until the end, which makes removing it fail.
        let _ = (0..10).find(|_| fs::remove_file(path).is_ok() || fs::remove_dir_all(path).is_ok());
    }
    end();
}

/// A temporary file, which is removed when this is dropped, unless it was put in place.
#[derive(Debug)]
pub(super) struct FileDraft {
    pub file: NamedTempFile,
    /// This field comes after the file, because the path is temporary until the file is gone.
    _open: Open,
}

/// Makes a new temporary file in `folder`.
pub(super) fn file(folder: &Path) -> io::Result<FileDraft> {
    loop {
        let (file, open) = Open::make(|| builder(0o666, TAIL).tempfile_in(folder), |draft| draft.path())?;
        if is_mine(file.as_file(), file.path()) {
            remove_the_dead(folder, file.as_file());
            return Ok(FileDraft { file, _open: open });
        }
    }
}

/// Makes a new temporary folder in `folder`, with its lock.
pub(super) fn folder(folder: &Path) -> io::Result<(TempDir, Option<FileLock>, Open)> {
    loop {
        let (draft, open) = Open::make(|| builder(0o777, TAIL).tempdir_in(folder), |draft| draft.path())?;
        // Only Unix can open folders.
        let Ok(lock) = File::open(draft.path()) else { return Ok((draft, None, open)) };
        if is_mine(&lock, draft.path()) {
            remove_the_dead(folder, &lock);
            return Ok((draft, Some(FileLock::held(lock)), open));
        }
    }
}

/// Makes a new folder for contents that are moved aside. No other program removes it.
pub(super) fn aside(folder: &Path) -> io::Result<TempDir> {
    builder(0o777, ".old").tempdir_in(folder)
}

/// Returns a builder of temporary names, with the permissions of any new file (minus the umask) instead of permissions
/// for the owner only.
fn builder(mode: u32, suffix: &'static str) -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(HEAD).suffix(suffix);
    permit(&mut builder, mode);
    builder
}

/// Locks a temporary file or folder. Another program that cleans up after ended programs may have found it first, and
/// may have removed it. On a file system without locks nothing is cleaned up in this way.
fn is_mine(draft: &File, path: &Path) -> bool {
    match draft.try_lock() {
        Err(TryLockError::WouldBlock) => false,
        Ok(()) if cfg!(unix) => is_same(draft, path),
        _ => true,
    }
}

/// Removes temporary files of the user of `mine` whose programs have ended, once for each folder.
fn remove_the_dead(folder: &Path, mine: &File) {
    static LOOKED_AT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    let first = |path| LOOKED_AT.lock().is_ok_and(|mut known| known.insert(path));
    if cfg!(unix) && folder.canonicalize().is_ok_and(first) {
        remove_unlocked(folder, mine);
    }
}

fn remove_unlocked(folder: &Path, mine: &File) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let (path, Ok(kind)) = (entry.path(), entry.file_type()) else { continue };
        if !entry.file_name().to_str().is_some_and(is_draft) || !(kind.is_file() || kind.is_dir()) {
            continue;
        }
        let Ok(open) = open_own(&path, mine) else { continue };
        // The path is locked while it is removed. A program that made it a moment ago finds that it is gone, and makes
        // another.
        if open.try_lock().is_ok() && is_same(&open, &path) {
            let _ = if kind.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
            tracing::debug!("{}: removed a temporary file of a program that has ended", path.display());
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn drafts_of_the_dead_are_removed_and_nothing_else() {
        let here = tempfile::tempdir().unwrap();
        let at = here.path();
        let (FileDraft { file, _open }, (folder, lock, _folder_open)) = (file(at).unwrap(), folder(at).unwrap());
        fs::create_dir(at.join(".eyebox-DEAD01.part")).unwrap();
        fs::write(at.join(".eyebox-DEAD01.part/zarr.json"), "{}").unwrap();
        fs::write(at.join(".eyebox-DEAD02.part"), "").unwrap();
        let kept = [".eyebox-a-b.part", ".eyebox-DEAD03.old", "eyebox-DEAD04.part", ".eyebox-LINK05.part"];
        kept[..3].iter().for_each(|name| fs::write(at.join(name), "mine").unwrap());
        let data = tempfile::tempdir().unwrap();
        fs::write(data.path().join("x"), "mine").unwrap();
        std::os::unix::fs::symlink(data.path(), at.join(kept[3])).unwrap();
        remove_unlocked(at, file.as_file());
        let left: BTreeSet<PathBuf> = fs::read_dir(at).unwrap().map(|e| e.unwrap().path()).collect();
        let mine = [file.path(), folder.path()].map(Path::to_path_buf);
        assert_eq!(left, kept.iter().map(|name| at.join(name)).chain(mine).collect());
        assert!(data.path().join("x").exists());
        // When its writer is gone, the temporary folder is removed.
        let path = folder.keep();
        drop(lock);
        remove_unlocked(at, file.as_file());
        assert!(!path.exists() && file.path().exists());
    }
}
