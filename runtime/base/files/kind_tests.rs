//! Checks the kinds of files by their content, and the remedies.

use super::convert::{remedy, remedy_of_all, zarr_line};
use super::zip::tests::archive;
use super::*;
use std::fs;

/// Returns the first bytes of a file, its name, and its kind.
fn rows() -> Vec<(Vec<u8>, &'static str, FileKind)> {
    use FileKind as K;
    let at = |place: usize, what: &[u8]| [&vec![1; place][..], what].concat();
    let box_of = |brand: &str| format!("\0\0\0\x18ftyp{brand}\0\0\0\0").into_bytes();
    let npy = npy_header("<f4", &[0]);
    vec![
        (vec![], "a.png", K::Empty),
        (b"\x89PNG\r\n\x1a\n".to_vec(), "a", K::Png),
        (b"\xff\xd8\xff\xe0".to_vec(), "a.png", K::Jpeg),
        (b"\x76\x2f\x31\x01".to_vec(), "a", K::Exr),
        (b"II*\0\x08\0\0\0".to_vec(), "a", K::Tiff),
        (b"MM\0*\0\0\0\x08".to_vec(), "a.TIF", K::Tiff),
        (b"II*\0\x08\0\0\0".to_vec(), "a.dng", K::CameraRaw),
        (b"II*\0\x10\0\0\0CR\x02\0".to_vec(), "a", K::CameraRaw),
        (b"FUJIFILMCCD-RAW 0201".to_vec(), "a.raf", K::CameraRaw),
        (box_of("crx "), "a.cr3", K::CameraRaw),
        (b"BM\x46\0\0\0\0\0\0\0".to_vec(), "a", K::Bmp),
        (b"P6\n2 2\n255\n".to_vec(), "a", K::Pnm),
        (b"Pf\n2 2\n-1\n".to_vec(), "a", K::Pfm),
        (b"GIF89a".to_vec(), "a", K::Gif),
        (b"RIFF\x10\0\0\0WEBPVP8L".to_vec(), "a", K::OtherPicture("WebP")),
        (box_of("heic"), "a.jpg", K::OtherPicture("HEIC")),
        (box_of("mif1"), "a", K::OtherPicture("HEIC")),
        (box_of("avif"), "a", K::OtherPicture("AVIF")),
        (b"8BPS\0\x01".to_vec(), "a", K::OtherPicture("Photoshop")),
        (b"#?RADIANCE\n".to_vec(), "a", K::OtherPicture("Radiance HDR")),
        (vec![0, 0, 2, 0, 0], "a.tga", K::OtherPicture("Targa")),
        (b"\0\0\0\x0cjP  \r\n\x87\n".to_vec(), "a", K::OtherPicture("JPEG 2000")),
        (b"YUV4MPEG2 W2 H2\n".to_vec(), "a", K::Y4m),
        (box_of("isom"), "a", K::Video("MP4")),
        (box_of("qt  "), "a", K::Video("QuickTime")),
        (b"\0\0\0\x08wide\0\0\0\0mdat".to_vec(), "a", K::Video("QuickTime")),
        (b"\x1a\x45\xdf\xa3".to_vec(), "a", K::Video("Matroska or WebM")),
        (b"RIFF\x10\0\0\0AVI LIST".to_vec(), "a", K::Video("AVI")),
        (npy.clone(), "a", K::Npy),
        (archive(&[("a.npy", &npy)], false), "a", K::Npz),
        (archive(&[("zarr.json", b"{}"), ("c/0", b"1")], true), "a", K::ZarrZip),
        (archive(&[("archive/data.pkl", b"1")], false), "a", K::Torch),
        (
            archive(&[("[Content_Types].xml", b"1"), ("xl/workbook.xml", b"2")], false),
            "a",
            K::Office("an Excel workbook"),
        ),
        (archive(&[("v_0.png", b"1")], false), "a.npz", K::Zip),
        (b"\x80\x04\x95\x10".to_vec(), "a", K::Pickle),
        (b"MATLAB 5.0 MAT-file, Platform".to_vec(), "a", K::Matlab),
        (b"MATLAB 7.3 MAT-file, Platform".to_vec(), "a", K::Matlab73),
        (vec![0, 0, 0, 0, 1, 0, 0, 0], "a.mat", K::Matlab),
        (b"\x89HDF\r\n\x1a\n".to_vec(), "a", K::Hdf5),
        (at(512, b"\x89HDF\r\n\x1a\n"), "a", K::Hdf5),
        (at(257, b"ustar"), "a", K::Archive("tar")),
        (b"\x1f\x8b\x08".to_vec(), "a", K::Archive("gzip")),
        (b"%PDF-1.7".to_vec(), "a", K::Pdf),
        (b"\0\x05\x16\x07\0\x02".to_vec(), "._v.png", K::AppleDouble),
        (b"root:x:0:0:root:/root:/bin/bash\n".to_vec(), "passwd", K::Text),
        (b"\xff\xfel\0e\0".to_vec(), "a.csv", K::Text),
        ("Phase (\u{b0})".as_bytes().to_vec(), "a.csv", K::Text),
        (b"<svg xmlns='http://www.w3.org/2000/svg'>".to_vec(), "a", K::Markup),
        (b"\x89LFP\r\n\x1a\n".to_vec(), "a", K::Other("a Lytro light-field file")),
        (vec![3, 1, 4, 1, 5, 9, 2, 6], "a.bin", K::Unknown),
    ]
}

#[test]
fn files_are_known_by_their_content() {
    let here = tempfile::tempdir().unwrap();
    for (bytes, name, kind) in rows() {
        let file = here.path().join(name);
        fs::write(&file, &bytes).unwrap();
        assert_eq!(FileKind::of(&file).unwrap(), kind, "{name}: {:x?}", &bytes[..bytes.len().min(16)]);
        assert!(!kind.describe().is_empty());
    }
    // A folder and a missing file give errors of the system.
    assert!(FileKind::of(here.path()).is_err() && FileKind::of(&here.path().join("none")).is_err());
}

#[test]
fn every_kind_has_a_remedy_in_one_line_whatever_is_wanted() {
    let wanted = [Wanted::Scene, Wanted::DepthMap, Wanted::Phases, Wanted::Levels, Wanted::Hologram, Wanted::Table];
    for (_, name, kind) in rows() {
        for wanted in wanted {
            let line = remedy(Path::new(name), kind, wanted);
            assert!(line.len() > 10 && !line.contains('\n'), "{kind:?}, {wanted:?}: {line}");
            let error = FileError::of_kind(Path::new(name), kind, wanted);
            assert!(
                matches!(error, FileError::Kind(OtherKind { found, wanted: w, .. }) if found == kind && w == wanted)
            );
        }
    }
}

#[cfg(unix)]
#[test]
fn names_in_remedies_are_words_of_a_shell() {
    let file = Path::new("my data/it's $HOME.mat");
    let lines = [
        remedy(file, FileKind::Matlab, Wanted::Scene),
        remedy_of_all(file, &file.join("a.webp"), FileKind::OtherPicture("WebP")),
        zarr_line(file),
    ];
    for line in lines {
        let command = line.split_once("by: ").map_or(&*line, |(_, command)| command);
        let words = shlex::split(command).unwrap_or_else(|| panic!("{command}"));
        assert!(words.iter().any(|word| word.starts_with("my data/it's $HOME")), "{words:?}");
    }
}
