//! Creates folders for later output, and removes them again if they stay empty.

use super::FileError;
use std::fs;
use std::path::{Path, PathBuf};

/// A folder that was created, with its new parents. When this is dropped, the empty ones among them are removed. A
/// folder that existed before stays.
#[derive(Debug)]
pub struct CreatedDirGuard {
    made: Vec<PathBuf>,
}

impl CreatedDirGuard {
    /// Creates a folder if it does not exist.
    ///
    /// # Errors
    /// Returns [`FileError::Write`] if the folder cannot be created.
    pub fn new(folder: &Path) -> Result<Self, FileError> {
        let missing = folder.ancestors().take_while(|at| !at.as_os_str().is_empty() && !at.exists());
        // The innermost is removed first.
        let made = Self { made: missing.map(Path::to_path_buf).collect() };
        fs::create_dir_all(folder).map_err(|e| FileError::write(folder, e))?;
        Ok(made)
    }
}

impl Drop for CreatedDirGuard {
    fn drop(&mut self) {
        // A folder with contents is not removed.
        self.made.iter().for_each(|folder| drop(fs::remove_dir(folder)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_folders_that_were_made_go_and_all_others_stay() {
        let temp = tempfile::tempdir().unwrap();
        let at = temp.path();
        drop(CreatedDirGuard::new(&at.join("a/b")).unwrap());
        assert!(!at.join("a").exists());
        fs::create_dir(at.join("mine")).unwrap();
        drop(CreatedDirGuard::new(&at.join("mine/b")).unwrap());
        assert!(at.join("mine").exists() && !at.join("mine/b").exists());
        let made = CreatedDirGuard::new(&at.join("a/b")).unwrap();
        fs::write(at.join("a/b/c"), "").unwrap();
        drop(made);
        assert!(at.join("a/b/c").exists());
        assert!(CreatedDirGuard::new(&at.join("a/b/c/d")).is_err());
    }
}
