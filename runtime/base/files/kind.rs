//! Determines the kind of a file from its first bytes. Readers use it, so that a refusal names the file's real kind.

/// Kind of a file, determined from its content.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum FileKind {
    /// A file without any bytes.
    Empty,
    /// A picture in PNG format.
    Png,
    /// A picture in JPEG format.
    Jpeg,
    /// A picture in OpenEXR format.
    Exr,
    /// A picture in TIFF format.
    Tiff,
    /// A picture in BMP format.
    Bmp,
    /// A PBM, PGM, PPM or PAM picture.
    Pnm,
    /// A portable float map.
    Pfm,
    /// A GIF picture or animation.
    Gif,
    /// A picture in a format that no reader here decodes, by its name.
    OtherPicture(&'static str),
    /// A raw picture of a camera.
    CameraRaw,
    /// An uncompressed YUV4MPEG2 video.
    Y4m,
    /// A compressed video, by the name of its container.
    Video(&'static str),
    /// An array of NumPy.
    Npy,
    /// A NumPy archive of arrays.
    Npz,
    /// An object in Python's pickle format.
    Pickle,
    /// A file of PyTorch.
    Torch,
    /// A MATLAB file of version 5.
    Matlab,
    /// A MATLAB file of version 7.3, which is HDF5.
    Matlab73,
    /// A file in HDF5 format.
    Hdf5,
    /// An archive in ZIP format.
    Zip,
    /// A ZIP archive of a Zarr store.
    ZarrZip,
    /// An archive other than ZIP, by its name.
    Archive(&'static str),
    /// An Office document, by its name.
    Office(&'static str),
    /// A document in PDF format.
    Pdf,
    /// An HTML, XML or SVG document.
    Markup,
    /// A file of text.
    Text,
    /// A resource fork, which macOS leaves next to a file.
    AppleDouble,
    /// Another known binary format, by its name.
    Other(&'static str),
    /// A file with unknown bytes.
    Unknown,
}

/// First bytes of formats whose kind needs nothing else.
const MAGIC: &[(&[u8], FileKind)] = &[
    (b"\x89PNG\r\n\x1a\n", FileKind::Png),
    (b"\xff\xd8\xff", FileKind::Jpeg),
    (b"\x76\x2f\x31\x01", FileKind::Exr),
    (b"GIF87a", FileKind::Gif),
    (b"GIF89a", FileKind::Gif),
    (b"YUV4MPEG2", FileKind::Y4m),
    (b"\x93NUMPY", FileKind::Npy),
    (b"MATLAB 5.0 MAT-file", FileKind::Matlab),
    (b"MATLAB 7.3 MAT-file", FileKind::Matlab73),
    (b"\x89HDF\r\n\x1a\n", FileKind::Hdf5),
    (b"%PDF", FileKind::Pdf),
    (b"\x00\x05\x16\x07", FileKind::AppleDouble),
    (b"\x1a\x45\xdf\xa3", FileKind::Video("Matroska or WebM")),
    (b"\x30\x26\xb2\x75", FileKind::Video("Windows Media")),
    (b"FLV\x01", FileKind::Video("Flash")),
    (b"\x00\x00\x01\xba", FileKind::Video("MPEG")),
    (b"\x00\x00\x01\xb3", FileKind::Video("MPEG")),
    (b"OggS", FileKind::Video("Ogg")),
    (b"FUJIFILMCCD-RAW", FileKind::CameraRaw),
    (b"IIRO", FileKind::CameraRaw),
    (b"IIU\x00", FileKind::CameraRaw),
    (b"\x89LFP", FileKind::Other("a Lytro light-field file")),
    (b"8BPS", FileKind::OtherPicture("Photoshop")),
    (b"#?RADIANCE", FileKind::OtherPicture("Radiance HDR")),
    (b"#?RGBE", FileKind::OtherPicture("Radiance HDR")),
    (b"qoif", FileKind::OtherPicture("QOI")),
    (b"DDS ", FileKind::OtherPicture("DDS")),
    (b"\x00\x00\x00\x0cjP  ", FileKind::OtherPicture("JPEG 2000")),
    (b"\xff\x4f\xff\x51", FileKind::OtherPicture("JPEG 2000")),
    (b"\x00\x00\x00\x0cJXL ", FileKind::OtherPicture("JPEG XL")),
    (b"\xff\x0a", FileKind::OtherPicture("JPEG XL")),
    (b"\x00\x00\x01\x00", FileKind::OtherPicture("Windows icon")),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", FileKind::Office("an old Office document or thumbnail cache")),
    (b"\x1f\x8b", FileKind::Archive("gzip")),
    (b"BZh", FileKind::Archive("bzip2")),
    (b"\xfd7zXZ\x00", FileKind::Archive("xz")),
    (b"\x28\xb5\x2f\xfd", FileKind::Archive("Zstandard")),
    (b"7z\xbc\xaf\x27\x1c", FileKind::Archive("7-Zip")),
    (b"Rar!\x1a\x07", FileKind::Archive("RAR")),
    (b"SIMPLE  =", FileKind::Other("a FITS file")),
    (b"CDF\x01", FileKind::Other("a netCDF file")),
    (b"CDF\x02", FileKind::Other("a netCDF file")),
    (b"BLENDER", FileKind::Other("a Blender scene")),
    (b"glTF", FileKind::Other("a glTF model")),
    (b"ply\n", FileKind::Other("a PLY model")),
    (b"ply\r\n", FileKind::Other("a PLY model")),
    (b"Kaydara FBX", FileKind::Other("an FBX model")),
    (b"SQLite format 3", FileKind::Other("an SQLite database")),
    (b"PAR1", FileKind::Other("a Parquet table")),
    (b"TDSm", FileKind::Other("a LabVIEW TDMS file")),
    (b"\x7fELF", FileKind::Other("a program")),
    (b"MZ", FileKind::Other("a Windows program")),
    (b"\xcf\xfa\xed\xfe", FileKind::Other("a macOS program")),
];

impl FileKind {
    /// Determines the kind from the first bytes of a file, of which `head` holds the first 4096 or all.
    pub fn of_bytes(head: &[u8]) -> Self {
        if head.is_empty() {
            return Self::Empty;
        }
        if let Some((_, kind)) = MAGIC.iter().find(|(magic, _)| head.starts_with(magic)) {
            return *kind;
        }
        if let Some(kind) = media(head) {
            return kind;
        }
        let at = |place: usize, what: &[u8]| head.get(place..).is_some_and(|rest| rest.starts_with(what));
        match head {
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => return Self::Tiff,
            [b'B', b'M', ..] if at(6, &[0; 4]) => return Self::Bmp,
            [b'P', b'1'..=b'7', b'\n' | b'\r' | b' ' | b'\t' | b'#', ..] => return Self::Pnm,
            [b'P', b'f' | b'F', b'\n' | b'\r' | b' ', ..] => return Self::Pfm,
            [b'P', b'K', 3, 4, ..] | [b'P', b'K', 5, 6, ..] => return Self::Zip,
            [0x80, 2..=5, ..] => return Self::Pickle,
            _ => {}
        }
        if at(512, b"\x89HDF\r\n\x1a\n") {
            return Self::Hdf5;
        }
        if at(257, b"ustar") {
            return Self::Archive("tar");
        }
        if at(128, b"DICM") {
            return Self::Other("a DICOM file");
        }
        text(head).unwrap_or(Self::Unknown)
    }

    /// Returns true if eyebox decodes pictures of this kind.
    pub fn is_picture(self) -> bool {
        matches!(self, Self::Png | Self::Jpeg | Self::Exr | Self::Tiff | Self::Bmp | Self::Pnm | Self::Gif)
    }

    /// Returns a noun with its article.
    pub fn describe(self) -> String {
        match self {
            Self::Empty => "an empty file".into(),
            Self::Png => "a PNG picture".into(),
            Self::Jpeg => "a JPEG picture".into(),
            Self::Exr => "an OpenEXR picture".into(),
            Self::Tiff => "a TIFF picture".into(),
            Self::Bmp => "a BMP picture".into(),
            Self::Pnm => "a PBM, PGM or PPM picture".into(),
            Self::Pfm => "a portable float map (PFM)".into(),
            Self::Gif => "a GIF".into(),
            Self::OtherPicture(name) => format!("a {name} picture"),
            Self::CameraRaw => "a raw picture of a camera".into(),
            Self::Y4m => "a YUV4MPEG2 video".into(),
            Self::Video(name) => format!("a compressed video ({name})"),
            Self::Npy => "a NumPy array (.npy)".into(),
            Self::Npz => "a NumPy archive (.npz)".into(),
            Self::Pickle => "a Python pickle".into(),
            Self::Torch => "a PyTorch file".into(),
            Self::Matlab => "a MATLAB file".into(),
            Self::Matlab73 => "a MATLAB file of version 7.3 (HDF5)".into(),
            Self::Hdf5 => "an HDF5 file".into(),
            Self::Zip => "a ZIP archive".into(),
            Self::ZarrZip => "a Zarr store in a ZIP archive".into(),
            Self::Archive(name) => format!("a {name} archive"),
            Self::Office(name) => name.into(),
            Self::Pdf => "a PDF document".into(),
            Self::Markup => "an HTML, XML or SVG document".into(),
            Self::Text => "a text file".into(),
            Self::AppleDouble => "a resource fork that macOS left next to a file".into(),
            Self::Other(name) => name.into(),
            Self::Unknown => "a file of an unknown kind".into(),
        }
    }
}

/// Determines the kind of containers that hold pictures and films alike, which are RIFF and the boxes of ISO base
/// media.
fn media(head: &[u8]) -> Option<FileKind> {
    let part = |place: usize| head.get(place..place + 4);
    match (head.get(..4)?, part(8)) {
        (b"RIFF", Some(b"WEBP")) => return Some(FileKind::OtherPicture("WebP")),
        (b"RIFF", Some(b"AVI ")) => return Some(FileKind::Video("AVI")),
        (b"RIFF", _) => return Some(FileKind::Other("a RIFF file")),
        _ => {}
    }
    match (part(4)?, part(8)) {
        (b"ftyp", Some(b"heic" | b"heix" | b"heim" | b"heis" | b"hevc" | b"mif1" | b"msf1")) => {
            Some(FileKind::OtherPicture("HEIC"))
        }
        (b"ftyp", Some(b"avif" | b"avis")) => Some(FileKind::OtherPicture("AVIF")),
        (b"ftyp", Some(b"crx ")) => Some(FileKind::CameraRaw),
        (b"ftyp", Some(b"qt  ")) | (b"moov" | b"mdat" | b"wide", _) => Some(FileKind::Video("QuickTime")),
        (b"ftyp", _) => Some(FileKind::Video("MP4")),
        _ => None,
    }
}

/// Returns a kind of text if no byte contradicts it. Text is UTF-16 with a mark, or bytes without controls.
fn text(head: &[u8]) -> Option<FileKind> {
    if head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff") {
        return Some(FileKind::Text);
    }
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    if !head.iter().all(|b| *b >= 0x20 && *b != 0x7f || b"\t\r\n\x0c".contains(b)) {
        return None;
    }
    // The last character may be cut. A few bytes of Latin-1 are text, but many of them are not.
    let plain = head.iter().filter(|b| b.is_ascii()).count();
    let is_utf8 = str::from_utf8(head).map_or_else(|e| e.error_len().is_none(), |_| true);
    if !is_utf8 && 10 * plain < 9 * head.len() {
        return None;
    }
    Some(if head.trim_ascii_start().starts_with(b"<") { FileKind::Markup } else { FileKind::Text })
}
