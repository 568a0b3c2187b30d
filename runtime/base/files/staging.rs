//! Drafts: what is written beside its place before it is renamed. Each is locked by the program that writes it, so that the
//! next one that writes beside it can tell those of programs that are gone, and removes them. A program that a signal ends can
//! remove its own ([`end_without_drafts`]).

use super::os::{is_same, open_own, permit};
use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tempfile::{NamedTempFile, TempDir};

const HEAD: &str = ".eyebox-";
const TAIL: &str = ".part";

/// Whether a file or folder of this name is a draft.
pub fn is_draft(name: &str) -> bool {
    let middle = name.strip_prefix(HEAD).and_then(|rest| rest.strip_suffix(TAIL));
    middle.is_some_and(|middle| middle.bytes().all(|b| b.is_ascii_alphanumeric()))
}

/// The drafts that this program writes.
static OPEN: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn open_drafts() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    OPEN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// As long as it lives, what is at its path is a draft of this program's.
#[derive(Debug)]
pub(super) struct Open(PathBuf);

impl Open {
    /// Makes a draft; between its beginning and its being known nothing ends the program in [`end_without_drafts`].
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

/// Ends the program: what it was writing, and had not put in its place, is removed before. For programs that end by a signal,
/// from a thread of its own.
pub fn end_without_drafts(end: impl FnOnce()) {
    // Held until the end: no draft is begun any more.
    let open = open_drafts();
    for path in &*open {
        // Whoever writes into a folder may go on until the end, which makes removing it fail.
        let _ = (0..10).find(|_| fs::remove_file(path).is_ok() || fs::remove_dir_all(path).is_ok());
    }
    end();
}

/// A file in the making; gone with the value unless it is put in its place.
#[derive(Debug)]
pub(super) struct FileDraft {
    pub file: NamedTempFile,
    /// Behind the file: what it says holds until that is gone.
    _open: Open,
}

/// A new file in `folder`.
pub(super) fn file(folder: &Path) -> io::Result<FileDraft> {
    loop {
        let (file, open) = Open::make(|| builder(0o666, TAIL).tempfile_in(folder), |draft| draft.path())?;
        if is_mine(file.as_file(), file.path()) {
            remove_the_dead(folder, file.as_file());
            return Ok(FileDraft { file, _open: open });
        }
    }
}

/// A new folder in `folder`, and its lock.
pub(super) fn folder(folder: &Path) -> io::Result<(TempDir, Option<File>, Open)> {
    loop {
        let (draft, open) = Open::make(|| builder(0o777, TAIL).tempdir_in(folder), |draft| draft.path())?;
        // Only Unix opens folders.
        let Ok(lock) = File::open(draft.path()) else { return Ok((draft, None, open)) };
        if is_mine(&lock, draft.path()) {
            remove_the_dead(folder, &lock);
            return Ok((draft, Some(lock), open));
        }
    }
}

/// A new folder for what is moved aside: nobody removes it but who made it.
pub(super) fn aside(folder: &Path) -> io::Result<TempDir> {
    builder(0o777, ".old").tempdir_in(folder)
}

/// Temporary names, with the permissions that any new file gets (the umask applies) instead of the owner's alone.
fn builder(mode: u32, suffix: &'static str) -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(HEAD).suffix(suffix);
    permit(&mut builder, mode);
    builder
}

/// Locks a draft. Whoever looked for those of the dead may have found it first, and have removed it. A file system without
/// locks has none that are removed.
fn is_mine(draft: &File, path: &Path) -> bool {
    match draft.try_lock() {
        Err(TryLockError::WouldBlock) => false,
        Ok(()) if cfg!(unix) => is_same(draft, path),
        _ => true,
    }
}

/// Removes drafts of the user's whose is `mine` and whose programs are gone, once for each folder.
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
        // Locked while it is removed: who made it a moment ago finds that it is gone, and makes another.
        if open.try_lock().is_ok() && is_same(&open, &path) {
            let _ = if kind.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
            tracing::debug!("{}: a draft of a program that is gone was removed", path.display());
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
        // Once its writer is gone, so is a draft.
        let path = folder.keep();
        drop(lock);
        remove_unlocked(at, file.as_file());
        assert!(!path.exists() && file.path().exists());
    }
}
