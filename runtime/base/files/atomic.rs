//! Writes files and folders that appear completely or not at all.

use super::os::{canonical, exchange, is_same, sync_folder};
use super::timeout_writer::TimeoutWriter;
use super::{FileError, FileLock, staging};
use crate::error::Reason;
use crate::reason;
use std::{
    fs::{self, File, TryLockError},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

/// Time that a writer waits for its turn.
const LOCK_TIMEOUT: Duration = Duration::from_secs(5);

/// Writes `file` through `fill`. The data goes to a temporary file in the same folder and to the disk, and then a
/// rename puts it in place.
///
/// A destination that is a pipe or a device is written to directly, because a rename would replace the device. The
/// write fails if nobody reads the pipe.
///
/// # Errors
/// Returns [`FileError::Full`] or [`FileError::Write`], and leaves `file` unchanged.
pub fn write_file(file: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), FileError> {
    let failed = |e| FileError::write(file, e);
    if is_stream(file)? {
        let mut out = BufWriter::new(TimeoutWriter::open(file).map_err(failed)?);
        return fill(&mut out).and_then(|()| out.flush()).map_err(failed);
    }
    let draft = staging::file(parent(file)).map_err(failed)?;
    let mut out = BufWriter::new(draft.file.as_file());
    fill(&mut out).and_then(|()| out.flush()).map_err(failed)?;
    drop(out);
    draft.file.as_file().sync_all().map_err(failed)?;
    draft.file.persist(file).map_err(|e| failed(e.error))?;
    sync_folder(parent(file)).map_err(failed)
}

/// Refuses a path that cannot be written to, before anything is computed for it.
///
/// # Errors
/// Returns [`FileError::Write`], [`FileError::Full`] or [`FileError::Taken`].
pub fn check_place(file: &Path) -> Result<(), FileError> {
    if is_stream(file)? {
        return Ok(());
    }
    staging::file(parent(file)).map(drop).map_err(|e| FileError::write(file, e))
}

/// Returns true if `file` is a pipe or a device, which is written to directly. Refuses a folder.
pub(super) fn is_stream(file: &Path) -> Result<bool, FileError> {
    match fs::metadata(file) {
        Ok(there) if there.is_dir() => Err(FileError::taken(
            file,
            reason!("is-a-folder", "is a folder, and a file cannot replace it: give another place"),
        )),
        there => Ok(there.is_ok_and(|there| !there.is_file())),
    }
}

/// A temporary folder next to its destination. It is removed when this is dropped, unless [`put`](Self::put) moved it.
pub struct FolderDraft {
    /// The lock comes before the folder, so that it is dropped first. Removing a folder takes a file descriptor, and
    /// this may be the last one.
    _lock: Option<FileLock>,
    draft: tempfile::TempDir,
    open: staging::Open,
    place: PathBuf,
    ours: fn(&Path) -> bool,
}

impl FolderDraft {
    /// Starts a folder that will be at `place`.
    ///
    /// `ours` returns true if a folder that exists there may be replaced. It is called now, and again before that
    /// folder is removed.
    ///
    /// # Errors
    /// Returns [`FileError::Taken`] if anything else exists there, [`FileError::Write`] or [`FileError::Full`].
    pub fn new(place: &Path, ours: fn(&Path) -> bool) -> Result<Self, FileError> {
        // A link is followed, so that the folder it points to is replaced and not the link.
        let place = canonical(place).unwrap_or_else(|_| place.to_path_buf());
        match fs::metadata(&place) {
            Ok(there) if !there.is_dir() => return Err(FileError::is_a_file(&place)),
            Ok(_) if !is_empty(&place) && !ours(&place) => {
                let left = "has other contents, so it is not replaced: give another place or remove it";
                return Err(FileError::taken(&place, Reason::new("holds-something-else", left)));
            }
            _ => {}
        }
        let (draft, lock, open) = staging::folder(parent(&place)).map_err(|e| FileError::write(&place, e))?;
        Ok(Self { _lock: lock, draft, open, place, ours })
    }

    /// Writes a file of the folder, with a `name` relative to it. Folders on its path are created.
    ///
    /// # Errors
    /// Returns [`FileError::Full`] or [`FileError::Write`] with the final path of the file.
    pub fn write(&self, name: &str, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), FileError> {
        let file = self.draft.path().join(name);
        let write = || {
            fs::create_dir_all(parent(&file))?;
            write_to_disk(File::create_new(&file)?, fill)
        };
        write().map_err(|e| FileError::write(&self.place.join(name), e))
    }

    /// Moves the folder to its destination, and replaces the folder that it may replace. The destination is never
    /// absent if the file system can exchange two names at once (ext4, xfs, btrfs, tmpfs, overlayfs).
    ///
    /// # Errors
    /// Returns [`FileError::Write`], or [`FileError::Taken`] if something else is there by now. The old contents then
    /// stay.
    pub fn put(self) -> Result<(), FileError> {
        self.put_by(|from, to| fs::rename(from, to), LOCK_TIMEOUT)
    }

    fn put_by(self, rename: impl Fn(&Path, &Path) -> io::Result<()>, patience: Duration) -> Result<(), FileError> {
        let Self { draft, _lock, open, place, ours } = self;
        let failed = |e| FileError::write(&place, e);
        let new = draft.path();
        for folder in folders_of(new).map_err(failed)? {
            sync_folder(&folder).map_err(failed)?;
        }
        // From here on, the temporary path may hold the old folder of the destination.
        drop(open);
        let begun = Instant::now();
        // Other writers may act between a look and a rename. A file system may also give the same answer repeatedly.
        let may_retry = || {
            std::thread::sleep(patience / 5000);
            begun.elapsed() < patience
        };
        let mut replaces_empty = cfg!(unix);
        loop {
            let there = turn(&place);
            if there.as_ref().is_some_and(|there| !is_same(there.file(), &place)) && may_retry() {
                continue;
            }
            let exists = place.exists();
            let free = !exists || is_empty(&place);
            if free && exists && !replaces_empty {
                let _ = fs::remove_dir(&place);
            }
            if !free {
                replace(draft, &place, ours)?;
                return sync_folder(parent(&place)).map_err(failed);
            }
            match rename(new, &place) {
                Ok(()) => {
                    // The folder is no longer at its temporary path.
                    drop(draft.keep());
                    return sync_folder(parent(&place)).map_err(failed);
                }
                // On local file systems of Unix, a rename replaces an empty folder. FUSE, SMB and network storage may
                // refuse.
                Err(_) if exists && replaces_empty => replaces_empty = false,
                Err(e) if !matches!(e.kind(), io::ErrorKind::DirectoryNotEmpty | io::ErrorKind::AlreadyExists) => {
                    return Err(failed(e));
                }
                // Another writer has put a folder there in the meantime.
                Err(_) if may_retry() => {}
                Err(e) => return Err(failed(e)),
            }
        }
    }
}

/// Writers of one destination take turns by a lock on the folder there, so that none removes a folder that another
/// inspects. A foreign lock is not waited for longer than a writer would take.
fn turn(place: &Path) -> Option<FileLock> {
    let there = File::open(place).ok().filter(|_| place.is_dir())?;
    let begun = Instant::now();
    loop {
        match there.try_lock() {
            Ok(()) => return Some(FileLock::held(there)),
            Err(TryLockError::WouldBlock) if begun.elapsed() < LOCK_TIMEOUT => std::thread::sleep(LOCK_TIMEOUT / 1000),
            Err(_) => return None,
        }
    }
}

/// Replaces and removes a folder that `ours` permits to replace.
fn replace(draft: tempfile::TempDir, place: &Path, ours: fn(&Path) -> bool) -> Result<(), FileError> {
    let changed = |path: &Path| {
        let left =
            "something else was put there in the meantime, so it is not replaced: give another place or remove it";
        FileError::taken(path, Reason::new("taken-meanwhile", left))
    };
    let new = draft.path();
    if !ours(place) {
        return Err(changed(place));
    }
    if exchange(new, place).is_err() {
        move_aside(new, place)?;
        drop(draft.keep());
    } else if !ours(new) {
        // Something was put into the old folder after it had been inspected.
        if exchange(new, place).is_err() {
            let (kept, old) = (draft.path(), draft.path().with_extension("old"));
            fs::rename(kept, &old).map_err(|e| FileError::write(&old, e))?;
            return Err(changed(&old));
        }
        return Err(changed(place));
    }
    // After an exchange the temporary name holds the old folder, and dropping `draft` removes it.
    Ok(())
}

/// Moves the old folder aside first, for file systems that cannot exchange two names at once.
fn move_aside(new: &Path, place: &Path) -> Result<(), FileError> {
    let failed = |e| FileError::write(place, e);
    let aside = staging::aside(parent(place)).map_err(failed)?;
    // The target is inside that folder, because only Unix replaces an empty folder by a rename.
    let old = aside.path().join("old");
    fs::rename(place, &old).map_err(failed)?;
    if let Err(e) = fs::rename(new, place) {
        if fs::rename(&old, place).is_err() {
            // The old folder is never deleted here.
            let _ = aside.keep();
            let reason = reason!("not-replaced", "could not be replaced ({e}), and is now at {}", old.display());
            return Err(FileError::taken(place, reason));
        }
        return Err(failed(e));
    }
    Ok(())
}

/// Writes a new file through a buffer, and flushes it to the disk.
pub(super) fn write_to_disk(new: File, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut out = BufWriter::new(new);
    fill(&mut out)?;
    out.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()
}

fn is_empty(folder: &Path) -> bool {
    fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none())
}

fn folders_of(root: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = vec![root.to_path_buf()];
    let mut next = 0;
    while next < found.len() {
        for entry in fs::read_dir(&found[next])? {
            let entry = entry?;
            if entry.file_type()?.is_dir() {
                found.push(entry.path());
            }
        }
        next += 1;
    }
    Ok(found)
}

pub(super) fn parent(file: &Path) -> &Path {
    file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_is_replaced_whole_or_stays() {
        let here = tempfile::tempdir().unwrap();
        let file = here.path().join("a");
        write_file(&file, |w| w.write_all(b"old")).unwrap();
        let error = write_file(&file, |w| {
            w.write_all(b"new and lon")?;
            Err(io::ErrorKind::StorageFull.into())
        });
        assert!(matches!(error, Err(FileError::Full { .. })), "{error:?}");
        assert_eq!(fs::read(&file).unwrap(), b"old");
        write_file(&file, |w| w.write_all(b"new")).unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert_eq!(names(here.path()), ["a"]);
        assert!(matches!(write_file(here.path(), |_| Ok(())), Err(FileError::Taken { .. })));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_device_is_called_full() {
        let error = write_file(Path::new("/dev/full"), |w| w.write_all(&[0; 100_000])).unwrap_err();
        assert!(matches!(error, FileError::Full { .. }), "{error}");
        assert!(error.to_string().contains("/dev/full"));
    }

    #[test]
    fn a_folder_is_replaced_whole_or_stays() {
        let here = tempfile::tempdir().unwrap();
        let place = here.path().join("f");
        let fill = |text: &'static str| {
            let draft = FolderDraft::new(&place, |f| f.join("mark").exists())?;
            draft.write("mark", |_| Ok(()))?;
            draft.write("deep/er", |w| w.write_all(text.as_bytes()))?;
            draft.put()
        };
        fill("1").unwrap();
        fill("2").unwrap();
        assert_eq!(fs::read(place.join("deep/er")).unwrap(), b"2");
        assert_eq!(names(here.path()), ["f"], "the old one and the draft are gone");

        let draft = FolderDraft::new(&place, |_| true).unwrap();
        let full = draft.write("x", |_| Err(io::ErrorKind::StorageFull.into())).unwrap_err();
        assert!(full.to_string().replace('\\', "/").contains("f/x"), "{full}");
        drop(draft);
        assert_eq!((names(here.path()), names(&place)), (vec!["f".into()], vec!["deep".into(), "mark".into()]));

        fs::remove_file(place.join("mark")).unwrap();
        assert!(matches!(fill("3"), Err(FileError::Taken { .. })));
        assert_eq!(fs::read(place.join("deep/er")).unwrap(), b"2");
        fs::write(here.path().join("file"), b"").unwrap();
        assert!(matches!(FolderDraft::new(&here.path().join("file"), |_| true), Err(FileError::Taken { .. })));
    }

    /// FUSE, SMB and network storage may refuse to rename onto an empty folder, or onto anything at all.
    #[test]
    fn a_folder_is_put_where_rename_replaces_nothing_and_is_given_up_where_it_never_succeeds() {
        let here = tempfile::tempdir().unwrap();
        let place = here.path().join("f");
        let draft = || {
            let draft = FolderDraft::new(&place, |_| true).unwrap();
            draft.write("a", |_| Ok(())).unwrap();
            draft
        };
        for refusal in [io::ErrorKind::AlreadyExists, io::ErrorKind::DirectoryNotEmpty, io::ErrorKind::PermissionDenied]
        {
            fs::create_dir(&place).unwrap();
            let strict = |from: &Path, to: &Path| if to.exists() { Err(refusal.into()) } else { fs::rename(from, to) };
            draft().put_by(strict, LOCK_TIMEOUT).unwrap();
            assert_eq!((names(here.path()), names(&place)), (vec!["f".into()], vec!["a".into()]), "{refusal:?}");
            fs::remove_dir_all(&place).unwrap();

            fs::create_dir(&place).unwrap();
            let error = draft().put_by(|_, _| Err(refusal.into()), LOCK_TIMEOUT / 50).unwrap_err();
            assert!(matches!(error, FileError::Write { .. } | FileError::Denied { .. }), "{error:?}");
            let _ = fs::remove_dir(&place);
            assert!(names(here.path()).is_empty(), "{refusal:?}: {:?}", names(here.path()));
        }
    }

    /// The last writer wins, no writer fails, and no other file is left. Other systems cannot exchange names at once.
    #[cfg(target_os = "linux")]
    #[test]
    fn writers_of_one_folder_do_not_stop_each_other() {
        let here = tempfile::tempdir().unwrap();
        let place = here.path().join("f");
        let write = |i: usize| {
            let draft = FolderDraft::new(&place, |_| true).unwrap();
            draft.write("a", |w| write!(w, "{i}")).unwrap();
            draft.write("b", |w| write!(w, "{i}")).unwrap();
            draft.put().unwrap();
        };
        std::thread::scope(|scope| (0..8).for_each(|i| drop(scope.spawn(move || (0..20).for_each(|_| write(i))))));
        let read = |name| fs::read(place.join(name)).unwrap();
        assert_eq!(read("a"), read("b"), "one writer's, whole");
        assert_eq!(names(here.path()), ["f"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_keeps_pointing_at_the_new_folder() {
        let here = tempfile::tempdir().unwrap();
        let (place, link) = (here.path().join("f"), here.path().join("l"));
        fs::create_dir(&place).unwrap();
        std::os::unix::fs::symlink(&place, &link).unwrap();
        let draft = FolderDraft::new(&link, |_| true).unwrap();
        draft.write("a", |_| Ok(())).unwrap();
        draft.put().unwrap();
        assert!(link.is_symlink() && place.join("a").exists());
    }
}
