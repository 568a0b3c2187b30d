//! Determines the kind of a file on the disk from its first bytes, and of archives from the names in them.

use super::{FileKind, read, zip};
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

/// Bytes from which the kind of a file is determined. The mark of a `tar` entry ends before 512, and HDF5 may begin
/// there.
const HEAD: u64 = 4096;

/// Extensions of raw pictures that are TIFF files inside.
const RAW_ENDINGS: [&str; 10] = ["dng", "nef", "nrw", "cr2", "arw", "srw", "pef", "3fr", "iiq", "sr2"];

impl FileKind {
    /// Determines the kind of a regular file.
    ///
    /// # Errors
    /// Returns the errors of the system, like [`read::open`].
    pub fn of(file: &Path) -> io::Result<Self> {
        let mut opened = read::open(file)?;
        let mut head = Vec::new();
        Read::by_ref(&mut opened).take(HEAD).read_to_end(&mut head)?;
        let kind = Self::of_bytes(&head);
        let ending = file.extension().map_or(String::new(), |e| e.to_string_lossy().to_ascii_lowercase());
        Ok(match kind {
            Self::Zip => in_archive(opened).unwrap_or(Self::Zip),
            Self::Tiff if RAW_ENDINGS.contains(&ending.as_str()) || head.get(8..10) == Some(b"CR") => Self::CameraRaw,
            // MATLAB files of version 4 and Truevision files have no distinctive first bytes.
            Self::Unknown if ending == "mat" => Self::Matlab,
            Self::Unknown if ending == "tga" => Self::OtherPicture("Targa"),
            other => other,
        })
    }
}

/// Determines the kind of a ZIP archive from the names in it.
fn in_archive(opened: File) -> Option<FileKind> {
    let length = opened.metadata().ok()?.len();
    let entries = zip::entries(&mut BufReader::new(opened), length).ok()?;
    let any = |is: &dyn Fn(&str) -> bool| entries.iter().any(|entry| is(&entry.name));
    let ends = |name: &str, what: &str| name == what || name.ends_with(&format!("/{what}"));
    Some(if any(&|name| ["zarr.json", ".zgroup", ".zarray"].contains(&name)) {
        FileKind::ZarrZip
    } else if any(&|name| ends(name, "data.pkl")) {
        FileKind::Torch
    } else if any(&|name| name == "xl/workbook.xml") {
        FileKind::Office("an Excel workbook")
    } else if any(&|name| name == "[Content_Types].xml") {
        FileKind::Office("an Office document")
    } else if !entries.is_empty() && entries.iter().all(|entry| entry.name.ends_with(".npy")) {
        FileKind::Npz
    } else {
        FileKind::Zip
    })
}
