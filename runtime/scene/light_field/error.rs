//! What can be wrong with a scene.

use crate::CamerasFound;
use crate::light_field::light::FullScale;
use eyebox_base::error::Reason;
use eyebox_base::files::{FileError, OtherKind, reason_to_read};
use eyebox_base::memory::TooLarge;
use eyebox_base::reason;
use eyebox_optics::{OpticsError, depths_in_words};
use std::{io, path::Path};

/// A scene that cannot be loaded: every variant names the file or folder.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
#[allow(missing_docs, reason = "fields that their names explain")]
pub enum SceneError {
    /// Views that memory does not hold.
    #[error(transparent)]
    Memory(#[from] TooLarge),
    /// Neither a file nor a folder.
    #[error("{path}: no such {what}{}", eyebox_base::files::similar(path).map_or(String::new(), |name| format!("; there is {name}")))]
    NotFound {
        path: String,
        /// What was expected there.
        what: &'static str,
    },
    /// A file or folder that cannot be read.
    #[error("{path}: {reason}")]
    Unreadable {
        path: String,
        /// What the system says.
        reason: Reason,
    },
    /// A file of another kind than those that are read here.
    #[error(transparent)]
    Kind(#[from] OtherKind),
    /// A folder without a numbered picture.
    #[error(
        "{folder}: no views here: expected numbered PNG, JPEG or EXR files such as input_Cam000.png or view_3_7.png"
    )]
    Empty { folder: String },
    /// A folder whose views are in folders of its own.
    #[error("{folder}: no views here, but in its folders: give one of them, as {inner}")]
    Deeper {
        folder: String,
        /// The first folder in it that has views.
        inner: String,
    },
    /// Numbered pictures that do not fill a grid.
    #[error("{folder}: the views are not a grid: {reason}")]
    NotAGrid {
        folder: String,
        /// How many there are, and what would be a grid.
        reason: Reason,
    },
    /// Folders that may be the rows of one light field, or light fields.
    #[error(
        "{folder}: {rows} folders of {columns} views each: `files = \"*/*\"` in its lightfield.toml makes them the rows of one light \
         field, and each named by itself ({first} ...) the frames of a sequence"
    )]
    Rows {
        folder: String,
        rows: usize,
        /// Views in each.
        columns: usize,
        /// The first of them.
        first: String,
    },
    /// One view of the grid is not there.
    #[error(
        "{file}: this view is missing: the others make a grid of {rows} x {columns}: add it, or state in lightfield.toml the \
         `grid = [rows, columns]` of those that are there if they are evenly spaced, or `positions_mm` if they are not"
    )]
    MissingView {
        /// The file that should exist.
        file: String,
        rows: usize,
        columns: usize,
    },
    /// Views in rows and columns that are not evenly spaced, by the numbers in their names.
    #[error(
        "{folder}: by the numbers in the names the views are not evenly spaced: state `positions_mm = {{ x = {x:?}, y = {y:?} }}` in \
         lightfield.toml if these are positions of cameras in millimeters, or `grid = [{rows}, {columns}]` if the views are evenly spaced",
        rows = y.len(), columns = x.len()
    )]
    Uneven {
        folder: String,
        /// Numbers of the columns,
        x: Vec<f64>,
        /// and of the rows.
        y: Vec<f64>,
    },
    /// Views whose cameras do not stand as the views are read.
    #[error("{scene}: {found}")]
    Cameras {
        scene: String,
        /// What the pictures show.
        found: CamerasFound,
    },
    /// Views that stand in another order than their names say.
    #[error(
        "{folder}: {reason}: {flags}{} reads them so, `order` as-named leaves them as they come",
        keys.as_ref().map_or(String::new(), |keys| format!(" (or {keys} in lightfield.toml)"))
    )]
    Order {
        folder: String,
        /// What is seen.
        reason: Reason,
        /// The orders that read them right.
        flags: String,
        /// The keys of lightfield.toml that do; none where there is no such file.
        keys: Option<String>,
    },
    /// Views that are unlike what all others say they should be.
    #[error(
        "{scene}: {views} not what the others predict ({found:.0} dB, the others {others:.0} dB): {cause}; mend it, or take the \
         views as they are with `photographs` cells"
    )]
    OddViews {
        scene: String,
        /// Which.
        views: String,
        /// How well the others predict the worst of them, dB,
        found: f64,
        /// and how well they predict each other.
        others: f64,
        /// What is likely.
        cause: String,
    },
    /// Two pictures of one size were expected.
    #[error(
        "{file}: {height} x {width} pixels, but {other} has {other_height} x {other_width}{}",
        if [height, width] == [other_width, other_height] && height != width {
            ": exchange its rows and columns"
        } else {
            ": give both one size"
        }
    )]
    Size {
        file: String,
        height: usize,
        width: usize,
        /// The file that it is compared with.
        other: String,
        other_height: usize,
        other_width: usize,
    },
    /// A depth map of a picture that its metadata turn, made of the pixels as they are stored.
    #[error(
        "{file}: {height} x {width} pixels, but {other} is turned by its EXIF orientation {orientation} to {width} x {height}: \
         turn the map likewise, or save the picture upright"
    )]
    Turned {
        file: String,
        height: usize,
        width: usize,
        other: String,
        /// The EXIF orientation of the picture, 2 to 8.
        orientation: u8,
    },
    /// A file that is cut short, damaged, or of another kind than its name says.
    #[error("{file}: {reason}")]
    Corrupt {
        file: String,
        /// What the decoder says.
        reason: Reason,
    },
    /// A pixel that is no light: not a number, infinite or negative.
    #[error("{file}: the value at row {row}, column {column} is {value}: it must be {must}")]
    Value {
        file: String,
        /// Row of the first such pixel.
        row: usize,
        /// Its column.
        column: usize,
        /// What is there.
        value: f32,
        /// What would be right.
        must: &'static str,
    },
    /// A video that does not state its matrix.
    #[error("{file}: nothing says whether its matrix is BT.601 or BT.709: state it, as in {file}?matrix=bt709")]
    Matrix { file: String },
    /// A picture whose values become light in a way that is not read.
    #[error(
        "{file}: it states {found}, which is not read: convert it to sRGB, or say that it is meant as sRGB or linear light (transfer \
         in lightfield.toml, or FILE?srgb, FILE?linear)"
    )]
    Transfer {
        file: String,
        /// The statement, in words.
        #[serde(rename = "reason")]
        found: Reason,
    },
    /// Pictures whose value of white is not known.
    #[error("{file}: {found}, and nothing says which value is white: {}", how.states(file, *white))]
    FullScale {
        file: String,
        /// The values, in words.
        found: String,
        /// The value that is likely.
        white: f32,
        /// The way to state it.
        how: FullScale,
    },
    /// Pictures of several kinds, and a full scale that is not that of all of them.
    #[error(
        "{file}: its pictures have different numbers of bits, so that no full scale is right for all of them: save them alike, each \
         with white as the largest value"
    )]
    MixedScales { file: String },
    /// Pictures that are transparent all over.
    #[error("{file}: every pixel is fully transparent, so that nothing is seen: save it without its alpha channel")]
    Transparent { file: String },
    /// `lightfield.toml` or `parameters.cfg` says something that cannot be.
    #[error("{file}: {reason}")]
    Settings {
        file: String,
        /// Which key, and what it must be.
        reason: Reason,
    },
    /// A picture alone has no depth.
    #[error(
        "{file}: a single picture needs a depth map: give one by `depth_map`, or a folder of views, or {file}?mosaic if the picture \
         shows views beside each other"
    )]
    NoDepthMap { file: String },
    /// A depth map that does not show which of its values are near.
    #[error("{file}: {reason}: say which values are near: {decides}")]
    Ambiguous {
        file: String,
        /// The values of the map, in words.
        reason: Reason,
        /// The statements that decide it.
        decides: &'static str,
    },
    /// Depth maps that do not belong to the pictures one by one.
    #[error(
        "{what}: give `depth_map` once for each picture, in their order, or a folder of maps with their names or numbers"
    )]
    Maps {
        /// What was found.
        what: String,
    },
    /// No built-in scene of that name, or a parameter that it does not take.
    #[error("{name}: {reason}; the built-in scenes are {known}")]
    Builtin {
        /// What was asked for.
        name: String,
        /// What is wrong with it.
        reason: Reason,
        /// Their names.
        known: String,
    },
    /// A color that the display does not have.
    #[error(transparent)]
    Optics(#[from] OpticsError),
    /// What stands behind the question mark of a source is not understood.
    #[error("{scene}: {reason}")]
    Options {
        scene: String,
        /// Which option, and what would be right.
        reason: Reason,
    },
    /// Depths that views show too little of.
    #[error(
        "the depth of the scene is measured as {measured}, though only {percent} % of its detail is found again in neighboring \
         views: it must be given: by `depth`, or by depth_mm in lightfield.toml"
    )]
    Depth {
        /// What was measured, for people.
        measured: String,
        /// The share of the detail that is sure, per cent.
        percent: u8,
    },
    /// A request that no scene can meet.
    #[error("{what} is {value}: it must be {must}")]
    Request {
        /// Which part of the request.
        what: &'static str,
        /// Its value, in the unit of the command.
        value: String,
        /// What would be right.
        must: &'static str,
    },
}

impl SceneError {
    /// Depths that were measured, and not to be trusted: so many per cent of the scene's detail are sure.
    pub fn doubtful_depth(depth: [f64; 2], percent: u8, focal_length: f64) -> Self {
        Self::Depth { measured: depths_in_words(depth, focal_length), percent }
    }

    /// A pixel at this row and column that is no light.
    pub(crate) fn no_light(file: impl ToString, [row, column]: [usize; 2], value: f32) -> Self {
        Self::Value { file: file.to_string(), row, column, value, must: "finite and not negative" }
    }

    /// A picture of another size than `other`, (rows, columns) each.
    pub(crate) fn size(file: &Path, [height, width]: [usize; 2], other: String, size: [usize; 2]) -> Self {
        let [other_height, other_width] = size;
        Self::Size { file: file.display().to_string(), height, width, other, other_height, other_width }
    }

    /// What the system said of a file or folder.
    pub(crate) fn unreadable(path: &Path, error: &io::Error) -> Self {
        let path = path.display().to_string();
        match error.kind() {
            io::ErrorKind::NotFound => Self::NotFound { path, what: "file" },
            _ => Self::Unreadable { path, reason: reason_to_read(error).into() },
        }
    }
}

impl From<FileError> for SceneError {
    fn from(error: FileError) -> Self {
        match error {
            FileError::Kind(other) => Self::Kind(other),
            FileError::Content { file, reason } => Self::Corrupt { file, reason },
            FileError::Read { file, source } => Self::unreadable(Path::new(&file), &source),
            FileError::Write { file, .. }
            | FileError::Denied { file, .. }
            | FileError::Full { file, .. }
            | FileError::Taken { path: file, .. } => {
                Self::Unreadable { path: file, reason: reason!("not-readable", "it cannot be read") }
            }
        }
    }
}
