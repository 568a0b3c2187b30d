//! Suggests a command line that converts a file of another kind to one that eyebox reads.

use super::FileKind;
use std::path::Path;

/// The kind of data that a reader expects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Wanted {
    /// Views of a scene, or one picture.
    Scene,
    /// A depth map or a disparity map.
    DepthMap,
    /// Phases of a hologram.
    Phases,
    /// Gray levels of a picture.
    Levels,
    /// A hologram with its optics.
    Hologram,
    /// A table of numbers as text.
    Table,
}

impl Wanted {
    /// Returns a noun with its article.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Scene => "a scene",
            Self::DepthMap => "a depth map",
            Self::Phases => "phases",
            Self::Levels => "a picture of levels",
            Self::Hologram => "a hologram",
            Self::Table => "a table",
        }
    }

    /// Returns the file formats that are read as this kind of data.
    fn forms(self) -> &'static str {
        match self {
            Self::Scene => {
                "a scene is a folder of views, a NumPy array of them, a picture (PNG, JPEG, EXR, TIFF, BMP, PPM) with a depth map, \
                 a video with one, splats (.ply, .splat, .spz), or builtin:NAME"
            }
            Self::DepthMap => {
                "a depth map is a grayscale PNG, JPEG, TIFF, PGM or BMP, an EXR, a PFM or a NumPy array (.npy)"
            }
            Self::Phases => "phases are a NumPy array (.npy, .npz), or pictures (PNG, BMP, TIFF, PGM)",
            Self::Levels => "levels are a grayscale PNG, BMP, TIFF or PGM of 8 or 16 bits, or a NumPy array (.npy)",
            Self::Hologram => "a hologram is a .zarr folder, and bare phases (.npy) need the optics too",
            Self::Table => "a table is text (CSV)",
        }
    }
}

/// A file of another kind than the reader expects.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, serde::Serialize)]
#[error("{file}: it is {}, which is not read as {}; {remedy}", found.describe(), wanted.describe())]
pub struct OtherKind {
    /// Path of the file.
    pub file: String,
    /// Kind of the file, from its content.
    pub found: FileKind,
    /// Kind of data that the reader expects.
    pub wanted: Wanted,
    /// A command line that converts the file to one that is read.
    pub remedy: String,
}

/// Returns the path of a result next to `file`, with another extension, as a word of a shell. It is never the file
/// itself.
fn beside(file: &Path, ending: &str) -> String {
    let to = file.with_extension(ending);
    if to != file {
        return word(&to);
    }
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    word(&file.with_file_name(format!("{stem}-converted.{ending}")))
}

/// Quotes a path as a word of a shell.
fn word(path: &Path) -> String {
    let text = path.display().to_string();
    shlex::try_quote(&text).map_or_else(|_| text.clone(), Into::into)
}

/// Returns a command line of Python that keeps the largest array that `find` gets from the file, in C order.
fn python(file: &Path, find: &str) -> String {
    let save = "numpy.save(sys.argv[2], numpy.ascontiguousarray(a))";
    format!("python -c \"import sys, numpy; {find}; {save}\" {} {}", word(file), beside(file, "npy"))
}

const LARGEST: &str = "key=lambda v: v.size";

/// Returns the remedy for `file`, which is of kind `found`, if `wanted` is expected.
pub fn remedy(file: &Path, found: FileKind, wanted: Wanted) -> String {
    let numbers = wanted != Wanted::Table && wanted != Wanted::Hologram;
    let convert = |line: String| format!("convert it by: {line}");
    if file.extension().is_some_and(|ending| ending == "ksplat") {
        return convert(format!("npx @playcanvas/splat-transform {} {}", word(file), beside(file, "ply")));
    }
    match found {
        FileKind::Npz if numbers => {
            convert(python(file, &format!("a = max(numpy.load(sys.argv[1]).values(), {LARGEST})")))
        }
        FileKind::Matlab if numbers => {
            let arrays = "[v for v in scipy.io.loadmat(sys.argv[1]).values() if isinstance(v, numpy.ndarray)]";
            convert(python(file, &format!("import scipy.io; a = max({arrays}, {LARGEST})")))
        }
        FileKind::Hdf5 | FileKind::Matlab73 if numbers => {
            // MATLAB writes axes in the reverse order.
            let turned = if found == FileKind::Matlab73 { ".T" } else { "" };
            let find = "import h5py; f = h5py.File(sys.argv[1]); d = []; \
                        f.visititems(lambda n, v: d.append(v) if hasattr(v, 'dtype') and v.dtype.kind in 'fiu' else None)";
            convert(python(file, &format!("{find}; a = max(d, {LARGEST})[()]{turned}")))
        }
        FileKind::Pickle if numbers => {
            convert(python(file, "a = numpy.asarray(numpy.load(sys.argv[1], allow_pickle=True))"))
        }
        FileKind::Torch if numbers => {
            convert(python(file, "import torch; a = numpy.asarray(torch.load(sys.argv[1], map_location='cpu'))"))
        }
        FileKind::Text if numbers && wanted != Wanted::Scene => {
            convert(python(file, "a = numpy.genfromtxt(sys.argv[1], delimiter=',')"))
        }
        FileKind::Video(_) if wanted != Wanted::Table => {
            let filter = "yadif=deint=interlaced,scale=iw*sar:ih:out_color_matrix=bt709,setsar=1";
            let to = beside(file, "y4m");
            format!(
                "give {to}?matrix=bt709, which is made by: ffmpeg -i {} -vf '{filter}' -pix_fmt yuv444p {to}",
                word(file)
            )
        }
        FileKind::Gif if numbers => {
            let to = file.with_extension("").join("%04d.png");
            let folder = word(&file.with_extension(""));
            format!("save its frames as pictures by: mkdir {folder} && ffmpeg -i {} {}", word(file), word(&to))
        }
        FileKind::OtherPicture(_) if numbers => convert(format!("magick {} {}", word(file), beside(file, "png"))),
        FileKind::CameraRaw if numbers => {
            format!("develop it by: darktable-cli {} {}", word(file), beside(file, "tif"))
        }
        FileKind::Pdf if numbers => {
            format!("save the page as a picture by: pdftoppm -png {} {}", word(file), beside(file, ""))
        }
        FileKind::Y4m => "give it the ending .y4m".into(),
        FileKind::Zip | FileKind::ZarrZip => {
            format!("unpack it by: python -m zipfile -e {} {}", word(file), word(&unpacked(file, found)))
        }
        FileKind::Archive("tar" | "gzip" | "bzip2" | "xz" | "Zstandard" | "7-Zip" | "RAR") => {
            "unpack it and give what is in it".into()
        }
        FileKind::Office("an Excel workbook") => "save the sheet as CSV".into(),
        FileKind::AppleDouble => "give the file of the same name without ._".into(),
        FileKind::Other("a Blender scene") => "render its views by tools/blender/render_views.py".into(),
        _ => wanted.forms().into(),
    }
}

/// Returns a command line of Python that keeps one array of an archive of several.
pub fn npz_line(file: &Path, name: &str) -> String {
    let find = format!("a = numpy.load(sys.argv[1])[{}]", python_text(name));
    format!("keep the one by: {}", python(file, &find))
}

/// Returns a name as a literal of Python inside double quotes of a shell.
fn python_text(name: &str) -> String {
    let plain = name.chars().all(|c| c.is_alphanumeric() || "_-. /".contains(c));
    format!("'{}'", if plain { name } else { "NAME" })
}

/// Returns a command line of Python that copies a Zarr store of any version and compression to one that is read.
pub fn zarr_line(folder: &Path) -> String {
    let name = folder.file_stem().unwrap_or_default().to_string_lossy();
    let to = word(&folder.with_file_name(format!("{name}-plain.zarr")));
    format!(
        "python -c \"import sys, zarr; a = zarr.open_group(sys.argv[1], mode='r'); \
         b = zarr.open_group(sys.argv[2], mode='w', zarr_format=3); b.attrs.update(a.attrs); p = a['phases'][:].astype('float32'); \
         b.create_array('phases', data=p, chunks=(1, 1) + p.shape[2:], compressors=None)\" {} {to}",
        word(folder)
    )
}

/// Returns the remedy for all files of a folder of views. `first` is one of them.
pub fn remedy_of_all(folder: &Path, first: &Path, found: FileKind) -> String {
    let ending = first.extension().map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
    match found {
        FileKind::OtherPicture(_) => {
            format!("convert all of them by: magick mogrify -format png {}/*{ending}", word(folder))
        }
        FileKind::CameraRaw => format!("develop all of them to TIFF, as by: darktable-cli {0} {0}", word(folder)),
        FileKind::Npy => {
            let list = "sorted(pathlib.Path(sys.argv[1]).glob('*.npy'))";
            format!(
                "put all of them into one array, and give it as {}?grid=ROWSxCOLUMNS, by: python -c \"import sys, numpy, pathlib; numpy.save(sys.argv[2], \
                 numpy.stack([numpy.load(f) for f in {list}]))\" {} {}",
                beside(folder, "npy"),
                word(folder),
                beside(folder, "npy")
            )
        }
        other => remedy(first, other, Wanted::Scene),
    }
}

/// Returns the folder into which an archive is unpacked. A Zarr store must end in `.zarr`.
fn unpacked(file: &Path, found: FileKind) -> std::path::PathBuf {
    let bare = file.with_extension("");
    match found {
        FileKind::ZarrZip if bare.extension().is_none_or(|e| e != "zarr") => bare.with_extension("zarr"),
        _ => bare,
    }
}
