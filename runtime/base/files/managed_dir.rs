//! Replaces files in a folder of results only if eyebox wrote them. A list next to the files records this.

use super::{FileError, FolderDraft, is_draft, read, write_file};
use crate::error::Reason;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The list holds, for every written file, the CRC-32C of its contents or of the contents that are about to be written.
const LIST: &str = "eyebox-files.json";

/// A folder in which files are replaced only if eyebox wrote them and they are unchanged.
#[derive(Debug)]
pub struct ManagedDir {
    folder: PathBuf,
    list: List,
    overwrite: bool,
}

#[derive(Debug, Default, Serialize, Deserialize)]
struct List {
    files: BTreeMap<String, BTreeSet<String>>,
}

impl ManagedDir {
    /// Checks a folder, which need not exist, before anything is computed for it. `names` are the files that will be
    /// written. A name that ends in `/` is a folder in which all files must be written by eyebox. If `overwrite` is
    /// true, anything there is replaced.
    ///
    /// # Errors
    /// Returns [`FileError::Taken`] for a file that eyebox did not write, or that was changed since.
    pub fn open(folder: &Path, names: &[&str], overwrite: bool) -> Result<Self, FileError> {
        if folder.is_file() {
            return Err(FileError::is_a_file(folder));
        }
        let list = read::bytes(&folder.join(LIST), read::TABLE).ok();
        let list = list.and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default();
        let own = Self { folder: folder.to_path_buf(), list, overwrite };
        for name in names {
            let Some(inside) = name.strip_suffix('/') else {
                own.check(name)?;
                continue;
            };
            match fs::symlink_metadata(folder.join(inside)) {
                Ok(there) if there.is_dir() => {
                    let entries = fs::read_dir(folder.join(inside)).into_iter().flatten().flatten();
                    let files = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
                    // A temporary file of a program that was killed is removed when the next one is made.
                    for file in files.filter(|file| !is_draft(file)) {
                        own.check(&format!("{name}{file}"))?;
                    }
                }
                Ok(_) => own.check(inside)?,
                Err(_) => {}
            }
        }
        Ok(own)
    }

    /// Returns the path of the folder.
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// Writes files, each completely or not at all, and creates the folders on their paths.
    ///
    /// # Errors
    /// Returns the errors of [`open`](Self::open), [`FileError::Full`] or [`FileError::Write`].
    pub fn write(&mut self, files: Vec<(String, Vec<u8>)>) -> Result<(), FileError> {
        for (name, bytes) in &files {
            self.check(name)?;
            // If the program is killed from here on, the old and the new contents both count as its own.
            let stands = self.sum(name);
            self.list.files.insert(name.clone(), stands.into_iter().chain([sum(bytes)]).collect());
        }
        self.keep_list()?;
        for (name, bytes) in files {
            let file = self.folder.join(name);
            let folder = file.parent().unwrap_or(&self.folder);
            fs::create_dir_all(folder).map_err(|e| FileError::write(folder, e))?;
            write_file(&file, |out| out.write_all(&bytes))?;
        }
        Ok(())
    }

    /// Records that a folder of this name belongs to eyebox, before it is created.
    ///
    /// # Errors
    /// Returns the errors of [`write`](Self::write).
    pub fn claim(&mut self, name: &str) -> Result<(), FileError> {
        self.check(name)?;
        self.list.files.insert(name.to_owned(), BTreeSet::new());
        self.keep_list()
    }

    fn keep_list(&self) -> Result<(), FileError> {
        fs::create_dir_all(&self.folder).map_err(|e| FileError::write(&self.folder, e))?;
        write_file(&self.folder.join(LIST), |out| Ok(serde_json::to_writer_pretty(out, &self.list)?))
    }

    /// Refuses a file that eyebox did not write.
    fn check(&self, name: &str) -> Result<(), FileError> {
        let path = self.folder.join(name);
        let ours = match fs::symlink_metadata(&path) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => true,
            Ok(there) if there.is_dir() => self.list.files.contains_key(name),
            _ => self.list.files.get(name).is_some_and(|known| self.sum(name).is_some_and(|sum| known.contains(&sum))),
        };
        if ours || self.overwrite {
            return Ok(());
        }
        let left =
            "eyebox did not write it, or it was changed since: give another folder, or set `overwrite` to replace it";
        Err(FileError::taken(&path, Reason::new("not-ours", left)))
    }

    /// Returns the sum of the file there. Returns `None` for a link, and for anything else that is not a regular file.
    fn sum(&self, name: &str) -> Option<String> {
        let path = self.folder.join(name);
        let regular = fs::symlink_metadata(&path).is_ok_and(|there| there.is_file());
        regular.then(|| read::bytes(&path, read::RESULTS).ok())?.map(|bytes| sum(&bytes))
    }
}

/// Writes files into a folder that appears completely, with the list by which [`holds_only_own`] recognizes them.
pub fn write_listed<E: From<FileError>>(
    draft: &FolderDraft,
    files: impl Iterator<Item = Result<(String, Vec<u8>), E>>,
) -> Result<(), E> {
    let mut list = List::default();
    for file in files {
        let (name, bytes) = file?;
        draft.write(&name, |out| out.write_all(&bytes))?;
        list.files.insert(name, [sum(&bytes)].into());
    }
    Ok(draft.write(LIST, |out| Ok(serde_json::to_writer_pretty(out, &list)?))?)
}

/// Returns true if a folder holds only files that [`write_listed`] wrote, unchanged.
pub fn holds_only_own(folder: &Path) -> bool {
    let entries = fs::read_dir(folder).and_then(Iterator::collect::<io::Result<Vec<_>>>).unwrap_or_default();
    let names: Vec<String> = entries.iter().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).filter(|name| *name != LIST).collect();
    names.len() < entries.len() && ManagedDir::open(folder, &names, false).is_ok()
}

fn sum(bytes: &[u8]) -> String {
    format!("{:08x}", crc32c::crc32c(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ErrorData;

    fn files(text: &str) -> Vec<(String, Vec<u8>)> {
        ["a.html", "figures/b.svg"].map(|name| (name.to_owned(), text.as_bytes().to_vec())).to_vec()
    }

    #[test]
    fn only_what_was_written_here_is_replaced() {
        let here = tempfile::tempdir().unwrap();
        let at = here.path().join("new");
        let open = |overwrite| ManagedDir::open(&at, &["a.html", "figures/", "h.zarr"], overwrite);
        open(false).unwrap().write(files("1")).unwrap();
        open(false).unwrap().write(files("2")).unwrap();
        assert_eq!(fs::read(at.join("figures/b.svg")).unwrap(), b"2");
        let refused = |what: &str| {
            let error = open(false).unwrap_err();
            assert_eq!(ErrorData::of(&error).code, "taken/not-ours", "{error}");
            assert!(matches!(&error, FileError::Taken { path, .. } if path.ends_with(what)), "{error}");
        };
        fs::write(at.join("figures/mine.svg"), "mine").unwrap();
        refused("mine.svg");
        fs::remove_file(at.join("figures/mine.svg")).unwrap();
        fs::create_dir(at.join("h.zarr")).unwrap();
        refused("h.zarr");
        fs::remove_dir(at.join("h.zarr")).unwrap();
        open(false).unwrap().claim("h.zarr").unwrap();
        fs::create_dir(at.join("h.zarr")).unwrap();
        let mut opened = open(false).unwrap();
        fs::write(at.join("a.html"), "2 and mine").unwrap();
        refused("a.html");
        assert!(matches!(opened.write(files("3")), Err(FileError::Taken { .. })), "put there meanwhile");
        open(true).unwrap().write(files("3")).unwrap();
        assert_eq!(fs::read(at.join("a.html")).unwrap(), b"3");
        open(false).unwrap();
    }

    /// If the program is killed between the list and the files, the next run accepts both the old and the new file as
    /// its own.
    #[test]
    fn what_was_cut_off_is_known_again() {
        let here = tempfile::tempdir().unwrap();
        let at = here.path();
        ManagedDir::open(at, &[], false).unwrap().write(files("1")).unwrap();
        let old = fs::read(at.join("a.html")).unwrap();
        ManagedDir::open(at, &[], false).unwrap().write(files("2")).unwrap();
        fs::write(at.join("a.html"), old).unwrap();
        fs::write(at.join("figures/.eyebox-DEAD01.part"), "2").unwrap();
        let mut own = ManagedDir::open(at, &["a.html", "figures/"], false).unwrap();
        own.write(files("3")).unwrap();
        assert_eq!(fs::read(at.join("a.html")).unwrap(), b"3");
    }
}
