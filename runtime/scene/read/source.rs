//! What a source is, by its text: a built-in scene, a folder, or a file, with options behind a question mark.

use crate::formats::options::{Options, Tiling, parts};
use crate::formats::{picture, video};
use crate::light_field::cameras::Quilt;
use crate::read::views::Read;
use crate::read::{array, folder, frames, mosaic, stack};
use crate::{Request, SceneError};
use eyebox_base::error::Reason;
use eyebox_base::files::{FileError, FileKind, Wanted};
use eyebox_base::reason;
use std::path::Path;

/// What a source names. What is a file or folder is there.
pub(crate) enum Source<'a> {
    /// The name of a built-in scene, with its settings.
    BuiltIn(&'a str),
    /// Views that are kept.
    Views(ViewSource<'a>),
    /// A picture of one view, or a frame of a video.
    Picture(&'a Path),
}

/// Where views are kept.
pub(crate) enum ViewSource<'a> {
    /// In a folder, a file each.
    Folder(&'a Path),
    /// In one array.
    Array(&'a Path, Options),
    /// In one picture.
    Mosaic(&'a Path, Tiling, Options),
}

impl ViewSource<'_> {
    /// Rows and columns of a view's own pixels, from names and headers alone where these say enough.
    pub fn size(&self) -> Result<[usize; 2], SceneError> {
        match self {
            Self::Folder(path) => match stack::find(path)? {
                Some(stack) => stack.size(),
                None => folder::list(path).map(|l| l.size).map_err(|error| frames::explain(path, error)),
            },
            Self::Array(path, options) => array::size(path, options),
            Self::Mosaic(path, tiling, options) => mosaic::size(path, *tiling, options),
        }
    }

    /// Reads them in whatever order.
    pub fn read(&self, request: &Request) -> Result<Read, SceneError> {
        match self {
            Self::Folder(path) => match stack::find(path)? {
                Some(stack) => stack.read(path, request),
                None => folder::read(path, request).map_err(|error| frames::explain(path, error)),
            },
            Self::Array(path, options) => array::read(path, options, request),
            Self::Mosaic(path, tiling, options) => mosaic::read(path, *tiling, options, request),
        }
    }
}

impl<'a> Source<'a> {
    /// Of this text.
    ///
    /// # Errors
    /// [`SceneError::NotFound`]; [`SceneError::Kind`] for a file of no kind that is read; [`SceneError::Options`].
    pub fn of(source: &'a str) -> Result<Self, SceneError> {
        if let Some(name) = source.strip_prefix("builtin:") {
            return Ok(Self::BuiltIn(name));
        }
        if video::named(Path::new(source)).is_some_and(|(file, _)| file.is_file()) {
            return Ok(Self::Picture(Path::new(source)));
        }
        let (path, query) = parts(source);
        let is_video = |path: &Path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("y4m"));
        if !query.is_empty() && is_video(path) && path.is_file() {
            let takes = "a video takes matrix=bt601 or matrix=bt709, and frame=NUMBER, with & between";
            return Err(SceneError::Options {
                scene: source.into(),
                reason: reason!("option-of-another", "'{query}': {takes}"),
            });
        }
        if !path.exists() {
            return Err(SceneError::NotFound { path: source.into(), what: "folder, picture, array or built-in scene" });
        }
        let wrong = |reason: Reason| SceneError::Options { scene: source.into(), reason };
        if path.is_dir() {
            let says = "a folder takes none: its lightfield.toml says how it is read";
            return if query.is_empty() {
                Ok(Self::Views(ViewSource::Folder(path)))
            } else {
                Err(wrong(reason!("option", "'{query}': {says}")))
            };
        }
        let kind = FileKind::of(path).map_err(|e| SceneError::unreadable(path, &e))?;
        // A damaged archive of arrays is an archive as any other.
        let is_npz = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npz"));
        let is_array = matches!(kind, FileKind::Npy | FileKind::Npz) || (kind == FileKind::Zip && is_npz);
        if !is_array && !kind.is_picture() {
            return Err(FileError::of_kind(path, kind, Wanted::Scene).into());
        }
        if kind == FileKind::Gif {
            // A still one has a size, an animation is refused.
            picture::size(path, picture::ONE)?;
        }
        let options = Options::parse(query, is_array).map_err(wrong)?;
        Ok(match options.tiling {
            _ if is_array => Self::Views(ViewSource::Array(path, options)),
            None if query.is_empty() && Quilt::of(path).is_none() => Self::Picture(path),
            None if Quilt::of(path).is_some() => Self::Views(ViewSource::Mosaic(path, Tiling::Views, options)),
            // A grid alone is one of views beside each other.
            None if options.grid.is_some() => Self::Views(ViewSource::Mosaic(path, Tiling::Views, options)),
            // The picture reads what is stated about its values.
            None => Self::Picture(Path::new(source)),
            Some(tiling) => Self::Views(ViewSource::Mosaic(path, tiling, options)),
        })
    }
}
