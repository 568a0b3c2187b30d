//! Determines the kind of a source from its text, which is a built-in scene, a folder or a file with options.

use crate::formats::options::{Options, Tiling, parts};
use crate::formats::{picture, video};
use crate::light_field::cameras::Quilt;
use crate::read::views::Read;
use crate::read::{array, capture, folder, frames, given, mosaic};
use crate::splats::{self, format::Format};
use crate::{Request, SceneError};
use eyebox_base::error::Reason;
use eyebox_base::files::{FileError, FileKind, Wanted};
use eyebox_base::reason;
use std::path::Path;

/// A source that names a scene. Its file or folder exists.
pub(crate) enum Source<'a> {
    /// The name of a built-in scene, with its settings.
    BuiltIn(&'a str),
    /// Views that are stored in files.
    Views(ViewSource<'a>),
    /// A picture of one view, or a frame of a video.
    Picture(&'a Path),
    /// A file of splats, and the camera in front of them.
    Splats(&'a Path, Format, splats::options::Options),
}

/// The storage of views.
pub(crate) enum ViewSource<'a> {
    /// A folder with one file per view.
    Folder(&'a Path),
    /// One array with all views.
    Array(&'a Path, Options),
    /// One picture with all views.
    Mosaic(&'a Path, Tiling, Options),
}

impl ViewSource<'_> {
    /// Returns rows and columns of a view's own pixels, from names and headers alone if these are sufficient.
    pub fn size(&self) -> Result<[usize; 2], SceneError> {
        match self {
            Self::Folder(path) => match given::find(path)? {
                Some(given) => given.size(),
                None => folder::list(path).map(|l| l.size).map_err(|error| frames::explain(path, error)),
            },
            Self::Array(path, options) => array::size(path, options),
            Self::Mosaic(path, tiling, options) => mosaic::size(path, *tiling, options),
        }
    }

    /// Reads the views in any order.
    pub fn read(&self, request: &Request) -> Result<Read, SceneError> {
        match self {
            Self::Folder(path) => match given::find(path)? {
                Some(given) => given.read(path, request),
                None => folder::read(path, request).map_err(|error| frames::explain(path, error)),
            },
            Self::Array(path, options) => array::read(path, options, request),
            Self::Mosaic(path, tiling, options) => mosaic::read(path, *tiling, options, request),
        }
    }
}

impl<'a> Source<'a> {
    /// Determines the source of this text.
    ///
    /// # Errors
    /// [`SceneError::NotFound`]. [`SceneError::Kind`] for an unsupported kind of file. [`SceneError::Options`].
    pub fn of(source: &'a str) -> Result<Self, SceneError> {
        let (path, query) = parts(source);
        let wrong = |reason: Reason| SceneError::Options { scene: source.into(), reason };
        if let Some(format) = Format::of(path) {
            return Ok(Self::Splats(path, format, format.options(query).map_err(wrong)?));
        }
        if let Some(name) = source.strip_prefix("builtin:") {
            return Ok(Self::BuiltIn(name));
        }
        if video::named(Path::new(source)).is_some_and(|(file, _)| file.is_file()) {
            return Ok(Self::Picture(Path::new(source)));
        }
        if !query.is_empty() && video::named(path).is_some() && path.is_file() {
            let takes = "a video takes frame=NUMBER, and depth=left (right, top or bottom) for the half that has the \
                         depths, and a .y4m file matrix=bt601 or matrix=bt709, with & between";
            return Err(SceneError::Options {
                scene: source.into(),
                reason: reason!("option-of-another", "'{query}': {takes}"),
            });
        }
        if !path.exists() {
            return Err(SceneError::NotFound { path: source.into(), what: "folder, picture, array or built-in scene" });
        }
        if path.is_dir() {
            let says = "a folder takes no options, because its lightfield.toml has the settings";
            capture::refused(path)?;
            return if query.is_empty() {
                Ok(Self::Views(ViewSource::Folder(path)))
            } else {
                Err(wrong(reason!("option", "'{query}': {says}")))
            };
        }
        let kind = FileKind::of(path).map_err(|e| SceneError::unreadable(path, &e))?;
        // A damaged archive of arrays counts as a plain archive.
        let is_npz = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npz"));
        let is_array = matches!(kind, FileKind::Npy | FileKind::Npz) || (kind == FileKind::Zip && is_npz);
        if !is_array && !kind.is_picture() {
            return Err(FileError::of_kind(path, kind, Wanted::Scene).into());
        }
        if kind == FileKind::Gif {
            // A still GIF has a size, and an animation is refused.
            picture::size(path, picture::ONE)?;
        }
        let options = Options::parse(query, is_array).map_err(wrong)?;
        Ok(match options.tiling {
            _ if is_array => Self::Views(ViewSource::Array(path, options)),
            None if query.is_empty() && Quilt::of(path).is_none() => Self::Picture(path),
            None if Quilt::of(path).is_some() => Self::Views(ViewSource::Mosaic(path, Tiling::Views, options)),
            // A grid alone means views next to each other.
            None if options.grid.is_some() => Self::Views(ViewSource::Mosaic(path, Tiling::Views, options)),
            // The picture reads the statements about its values.
            None => Self::Picture(Path::new(source)),
            Some(tiling) => Self::Views(ViewSource::Mosaic(path, tiling, options)),
        })
    }
}
