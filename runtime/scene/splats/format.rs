//! Determines the format of a file of splats, and reads it.

use crate::SceneError;
use crate::splats::cloud::Cloud;
use crate::splats::file::Opened;
use crate::splats::options::Options;
use crate::splats::{plain, ply, spz};
use eyebox_base::error::Reason;
use std::io::Read;
use std::path::Path;

/// The name of the built-in scene.
pub(crate) const BUILTIN: &str = "builtin:still-life-splats";
/// The file of the built-in scene, which `builtin/as_splats.rs` writes.
const STILL_LIFE: &[u8] = include_bytes!("still-life.spz");

/// A format of splats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    /// Polygon files with the properties of 3D Gaussian splatting.
    Ply,
    /// Records of 32 bytes.
    Plain,
    /// Attributes of all splats, which are compressed.
    Spz,
    /// The splats of the built-in scene.
    BuiltIn,
}

impl Format {
    /// Returns the format of a regular file, by its first bytes, or by its ending if the format has none.
    pub fn of(path: &Path) -> Option<Self> {
        if path == Path::new(BUILTIN) {
            return Some(Self::BuiltIn);
        }
        let mut opened = eyebox_base::files::read::open(path).ok()?;
        let mut head = Vec::new();
        Read::by_ref(&mut opened).take(8).read_to_end(&mut head).ok()?;
        let ends = |ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
        if head.starts_with(b"ply\n") || head.starts_with(b"ply\r\n") {
            Some(Self::Ply)
        } else if head.starts_with(spz::MAGIC) || head.starts_with(spz::GZIP) && ends("spz") {
            Some(Self::Spz)
        } else {
            ends("splat").then_some(Self::Plain)
        }
    }

    /// Returns the name of the format.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ply => ".ply",
            Self::Plain => ".splat",
            Self::Spz => ".spz",
            Self::BuiltIn => "built in",
        }
    }

    /// Reads the options after the question mark.
    pub fn options(self, query: &str) -> Result<Options, Reason> {
        let options = Options::parse(query)?;
        Ok(if self == Self::BuiltIn { options.of_builtin() } else { options })
    }
}

/// Reads a file of splats.
///
/// # Errors
/// [`SceneError::Corrupt`] for a file that is not valid, and [`SceneError::Memory`].
pub(crate) fn read(path: &Path, format: Format) -> Result<Cloud, SceneError> {
    let opened = match format {
        Format::BuiltIn => Opened::of_bytes(STILL_LIFE),
        _ => Opened::new(path)?,
    };
    let mut cloud = match format {
        Format::Ply => ply::read(path, opened)?,
        Format::Plain => plain::read(path, opened)?,
        Format::Spz | Format::BuiltIn => spz::read(path, opened)?,
    };
    let corrupt = |reason| SceneError::Corrupt { file: path.display().to_string(), reason };
    let damaged = cloud.clean().map_err(corrupt)?;
    if damaged > 0 {
        let count = cloud.len() + damaged;
        tracing::warn!(
            "{}: {damaged} of {count} splats have values that are not finite and are left out",
            path.display()
        );
    }
    Ok(cloud)
}
