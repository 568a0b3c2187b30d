//! Records the path and a digest of a file that a result was made from, so that the result can find it again.

use super::{atomic::parent, read};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::io::{self, BufReader};
use std::path::{Component, Path, PathBuf};

/// Bytes of SHA-256's 32 that a digest keeps. They are enough that no two files share one by chance.
const KEPT: usize = 16;

/// The path of a file or folder, and the digest of the data that was read from it.
///
/// Two records are equal if the data is equal. Paths are only hints.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct FileRecord {
    /// Path from the folder that holds the result, with `/` between its parts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relative: Option<String>,
    /// Absolute path of the file or folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub absolute: Option<String>,
    /// Options after a question mark, as in `views.npy?grid=9x9`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub options: Option<String>,
    /// Hexadecimal digest of the data.
    pub digest: String,
    /// Folder that holds the result from which this record was read.
    #[serde(skip)]
    beside: Option<PathBuf>,
}

impl PartialEq for FileRecord {
    fn eq(&self, other: &Self) -> bool {
        (&self.digest, &self.options) == (&other.digest, &other.options)
    }
}

impl FileRecord {
    /// Makes a record of the file or folder at `path`, which was read with these options.
    pub fn new(path: &Path, options: &str, digest: String) -> Self {
        let absolute = resolved(path).to_str().map(str::to_owned);
        let options = Some(options).filter(|options| !options.is_empty()).map(str::to_owned);
        Self { relative: None, absolute, options, digest, beside: None }
    }

    /// Makes a record of the file at `path`, from which this text was read.
    pub fn of_text(path: &Path, text: &str) -> Self {
        let mut digest = Digester::default();
        digest.part(text.as_bytes());
        Self::new(path, "", digest.finish())
    }

    /// Returns the possible paths, the likeliest first. These are the path relative to the result, then the absolute
    /// path.
    pub fn places(&self) -> Vec<PathBuf> {
        let beside = self.beside.as_ref().zip(self.relative.as_ref()).map(|(folder, path)| folder.join(path));
        let mut places: Vec<PathBuf> = beside.into_iter().chain(self.absolute.as_ref().map(PathBuf::from)).collect();
        places.dedup_by(|a, b| resolved(a) == resolved(b));
        places
    }

    /// Returns the name by which a path is opened, with its options.
    pub fn named(&self, place: &Path) -> PathBuf {
        match &self.options {
            None => place.into(),
            Some(options) => {
                let mut name = place.as_os_str().to_owned();
                name.push("?");
                name.push(options);
                name.into()
            }
        }
    }

    /// Records that the result with this record was read from `folder`.
    pub fn read_in(&mut self, folder: &Path) {
        self.beside = std::path::absolute(folder).ok();
    }

    /// Records that the result with this record is about to be written into `folder`.
    pub fn written_in(&mut self, folder: &Path) {
        let places = self.places();
        let Some(found) = places.iter().find(|place| place.exists()).or(places.first()) else { return };
        let from = folder.canonicalize().unwrap_or_else(|_| resolved(folder));
        let found = resolved(found);
        self.relative = relative(&from, &found);
        if !self.absolute.as_ref().is_some_and(|path| Path::new(path).exists()) {
            self.absolute = found.to_str().map(str::to_owned);
        }
        self.beside = Some(from);
    }

    /// Removes the paths, so that only the data identifies the record.
    pub fn forget_places(&mut self) {
        (self.relative, self.absolute) = (None, None);
    }
}

/// Returns a path without links and dots. A link at its end stays, because it may lead elsewhere later.
fn resolved(path: &Path) -> PathBuf {
    let found = match path.file_name() {
        Some(name) => parent(path).canonicalize().map(|parent| parent.join(name)),
        None => path.canonicalize(),
    };
    found.or_else(|_| std::path::absolute(path)).unwrap_or_else(|_| path.into())
}

/// Returns the way from one folder to a path, both absolute. Returns `None` on another volume, or if the path is not
/// text.
fn relative(from: &Path, to: &Path) -> Option<String> {
    let (from, to): (Vec<_>, Vec<_>) = (from.components().collect(), to.components().collect());
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    if common == 0 {
        return None;
    }
    let up = from[common..].iter().map(|_| Some(".."));
    let down = to[common..].iter().map(|part| match part {
        Component::Normal(name) => name.to_str(),
        _ => None,
    });
    Some(up.chain(down).collect::<Option<Vec<_>>>()?.join("/"))
}

/// A digest that is being computed.
#[derive(Default)]
pub struct Digester(Sha256);

impl Digester {
    /// Adds bytes and their number, so that no two lists of parts give the same digest.
    pub fn part(&mut self, bytes: &[u8]) {
        self.0.update((bytes.len() as u64).to_le_bytes());
        self.0.update(bytes);
    }

    /// Returns the digest of all parts in hexadecimal.
    pub fn finish(self) -> String {
        self.0.finalize()[..KEPT].iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// Returns the digest of a regular file's bytes.
///
/// # Errors
/// Returns the errors of the system, and [`io::ErrorKind::InvalidInput`] for anything but a regular file.
pub fn digest_file(file: &Path) -> io::Result<String> {
    let mut digest = Digester::default();
    io::copy(&mut BufReader::with_capacity(1 << 18, read::open(file)?), &mut digest.0)?;
    Ok(digest.finish())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_record_finds_its_file_beside_the_result_and_where_it_was() {
        let here = tempfile::tempdir().unwrap();
        let at = |name: &str| here.path().join(name);
        fs::create_dir_all(at("a/out")).unwrap();
        fs::write(at("a/scene"), "x").unwrap();
        let mut record = FileRecord::new(&at("a/./out/../scene"), "", digest_file(&at("a/scene")).unwrap());
        record.written_in(&at("a/out"));
        assert_eq!(record.relative.as_deref(), Some("../scene"));
        let text = serde_json::to_string(&record).unwrap();
        // If the result is moved with its surroundings, the file is found relative to it. Otherwise it is found at its
        // old path.
        fs::create_dir_all(at("b")).unwrap();
        let mut read: FileRecord = serde_json::from_str(&text).unwrap();
        read.read_in(&at("b/out"));
        let was = here.path().canonicalize().unwrap().join("a/scene");
        assert_eq!(read.places(), [at("b/out/../scene"), was.clone()]);
        assert_eq!(read, record);
        // A result that is written elsewhere has the way from there.
        read.written_in(&at("b"));
        assert_eq!((read.relative.as_deref(), read.absolute.as_deref()), (Some("../a/scene"), was.to_str()));
    }

    #[test]
    fn digests_tell_parts_and_files_apart() {
        let of = |parts: &[&str]| {
            let mut digest = Digester::default();
            parts.iter().for_each(|part| digest.part(part.as_bytes()));
            digest.finish()
        };
        assert_eq!(of(&["ab", "c"]), of(&["ab", "c"]));
        assert_ne!(of(&["ab", "c"]), of(&["a", "bc"]));
        let here = tempfile::tempdir().unwrap();
        assert!(digest_file(here.path()).is_err() && digest_file(&here.path().join("none")).is_err());
    }

    #[test]
    fn options_come_back_behind_the_name() {
        let record = FileRecord::new(Path::new("views.npy"), "grid=3x3", String::new());
        assert_eq!(record.named(Path::new("/x/views.npy")), Path::new("/x/views.npy?grid=3x3"));
        assert_eq!(FileRecord { options: None, ..record }.named(Path::new("/x/v")), Path::new("/x/v"));
    }
}
