//! Defines the errors of scenes.

use crate::CamerasFound;
use crate::light_field::light::FullScale;
use eyebox_base::error::Reason;
use eyebox_base::files::{FileError, OtherKind, reason_to_read};
use eyebox_base::memory::TooLarge;
use eyebox_base::reason;
use eyebox_optics::{OpticsError, depths_in_words};
use std::{io, path::Path};

/// A scene that cannot be loaded. Every variant names the file or folder.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
#[allow(missing_docs, reason = "fields that their names explain")]
pub enum SceneError {
    /// The views do not fit into memory.
    #[error(transparent)]
    Memory(#[from] TooLarge),
    /// The path is neither a file nor a folder.
    #[error("{path}: no such {what}{}", eyebox_base::files::similar(path).map_or(String::new(), |name| format!(", but \
             there is {name}")))]
    NotFound {
        path: String,
        /// The kind of thing that was expected there.
        what: &'static str,
    },
    /// The file or folder cannot be read.
    #[error("{path}: {reason}")]
    Unreadable {
        path: String,
        /// The reason that the system gives.
        reason: Reason,
    },
    /// The file is of a kind that is not supported here.
    #[error(transparent)]
    Kind(#[from] OtherKind),
    /// The folder has no numbered picture.
    #[error(
        "{folder}: no views here, but expected numbered PNG, JPEG or EXR files such as input_Cam000.png or view_3_7.png"
    )]
    Empty { folder: String },
    /// The views of the folder are in folders of its own.
    #[error("{folder}: no views here, but in its folders. Give one of them, as {inner}")]
    Deeper {
        folder: String,
        /// The first folder in it that has views.
        inner: String,
    },
    /// Numbered pictures do not fill a grid.
    #[error("{folder}: the views are not a grid: {reason}")]
    NotAGrid {
        folder: String,
        /// The number of pictures, and the statements that would make a grid.
        reason: Reason,
    },
    /// Folders may be the rows of one light field, or light fields themselves.
    #[error(
        "{folder}: {rows} folders of {columns} views each. State `files = \"*/*\"` in its lightfield.toml for the \
         rows of one light field, or name each by itself ({first} ...) for the frames of a sequence"
    )]
    Rows {
        folder: String,
        rows: usize,
        /// Number of views in each folder.
        columns: usize,
        /// The first of the folders.
        first: String,
    },
    /// One view of the grid does not exist.
    #[error(
        "{file}: this view is missing, because the others make a grid of {rows} x {columns}, so add it. Otherwise \
         state in lightfield.toml the `grid = [rows, columns]` of the existing views if they are evenly spaced, or \
         `positions_mm` if they are not"
    )]
    MissingView {
        /// The file that should exist.
        file: String,
        rows: usize,
        columns: usize,
    },
    /// Rows and columns of views are not evenly spaced, by the numbers in their names.
    #[error(
        "{folder}: by the numbers in the names the views are not evenly spaced. State `positions_mm = {{ x = {x:?}, y \
         = {y:?} }}` in lightfield.toml if these are positions of cameras in millimeters, or `grid = [{rows}, \
         {columns}]` if the views are evenly spaced",
        rows = y.len(), columns = x.len()
    )]
    Uneven {
        folder: String,
        /// Numbers of the columns.
        x: Vec<f64>,
        /// Numbers of the rows.
        y: Vec<f64>,
    },
    /// The positions of the cameras contradict the grid of the views.
    #[error("{scene}: {found}")]
    Cameras {
        scene: String,
        /// The positions that the pictures show.
        found: CamerasFound,
    },
    /// The order of the views contradicts their names.
    #[error(
        "{folder}: {reason}. State {flags}{} for this order, while `order` as-named leaves them as they come",
        keys.as_ref().map_or(String::new(), |keys| format!(" (or {keys} in lightfield.toml)"))
    )]
    Order {
        folder: String,
        /// The evidence in the pictures.
        reason: Reason,
        /// The orders that read the views correctly.
        flags: String,
        /// The keys of lightfield.toml with the same effect. It is `None` if there is no such file.
        keys: Option<String>,
    },
    /// One or two views differ from the prediction of all others.
    #[error(
        "{scene}: {views} not what the others predict ({found:.0} dB, the others {others:.0} dB), because {cause}. \
         Fix it, or take the views as they are with `photographs` cells"
    )]
    OddViews {
        scene: String,
        /// The views, in words.
        views: String,
        /// Accuracy with which the others predict the worst of them, dB.
        found: f64,
        /// Accuracy with which the others predict each other, dB.
        others: f64,
        /// The likely cause, in words.
        cause: String,
    },
    /// Two pictures must have one size and have not.
    #[error(
        "{file}: {height} x {width} pixels, but {other} has {other_height} x {other_width}{}",
        if [height, width] == [other_width, other_height] && height != width {
            ", so exchange its rows and columns"
        } else {
            ", so give both one size"
        }
    )]
    Size {
        file: String,
        height: usize,
        width: usize,
        /// The file with which it is compared.
        other: String,
        other_height: usize,
        other_width: usize,
    },
    /// The metadata of a picture rotate it, and its depth map was made from the pixels as they are stored.
    #[error(
        "{file}: {height} x {width} pixels, but {other} is turned by its EXIF orientation {orientation} to {width} x \
         {height}, so turn the map likewise, or save the picture upright"
    )]
    Turned {
        file: String,
        height: usize,
        width: usize,
        other: String,
        /// The EXIF orientation of the picture, 2 to 8.
        orientation: u8,
    },
    /// The file is cut short, damaged, or of another kind than its name says.
    #[error("{file}: {reason}")]
    Corrupt {
        file: String,
        /// The reason that the decoder gives.
        reason: Reason,
    },
    /// A pixel is not valid light, because it is not a number, infinite or negative.
    #[error("{file}: the value at row {row}, column {column} is {value}, but it must be {must}")]
    Value {
        file: String,
        /// Row of the first such pixel.
        row: usize,
        /// Column of the first such pixel.
        column: usize,
        /// The value of this pixel.
        value: f32,
        /// The values that are allowed.
        must: &'static str,
    },
    /// A video does not state its matrix.
    #[error("{file}: nothing says whether its matrix is BT.601 or BT.709. State it, as in {file}?matrix=bt709")]
    Matrix { file: String },
    /// The transfer function of a picture is not supported.
    #[error(
        "{file}: it states {found}, which is not supported, so convert it to sRGB, or state that it is sRGB or linear \
         light (transfer in lightfield.toml, or FILE?srgb, FILE?linear)"
    )]
    Transfer {
        file: String,
        /// The statement in words.
        #[serde(rename = "reason")]
        found: Reason,
    },
    /// The value of white of pictures is not known.
    #[error("{file}: {found}, and nothing says which value is white, so {}", how.states(file, *white))]
    FullScale {
        file: String,
        /// The values in words.
        found: String,
        /// The likely value of white.
        white: f32,
        /// The way to state the value of white.
        how: FullScale,
    },
    /// Pictures have several kinds of values, and one full scale cannot be right for all of them.
    #[error(
        "{file}: its pictures have different numbers of bits, so no full scale is right for all of them. Save them \
         alike, each with white as the largest value"
    )]
    MixedScales { file: String },
    /// Every pixel of the pictures is transparent.
    #[error("{file}: every pixel is fully transparent, so nothing is visible. Save it without its alpha channel")]
    Transparent { file: String },
    /// A value in `lightfield.toml` or `parameters.cfg` is not valid.
    #[error("{file}: {reason}")]
    Settings {
        file: String,
        /// The key, and its allowed values.
        reason: Reason,
    },
    /// A picture without a map has no depth.
    #[error(
        "{file}: a single picture needs a depth map. Give one by `depth_map`, or a folder of views, or {file}?mosaic \
         if the picture shows views next to each other"
    )]
    NoDepthMap { file: String },
    /// A depth map does not show which of its values are near.
    #[error("{file}: {reason}, so say which values are near by {decides}")]
    Ambiguous {
        file: String,
        /// The values of the map in words.
        reason: Reason,
        /// The statements that decide it.
        decides: &'static str,
    },
    /// Depth maps and pictures do not correspond one to one.
    #[error(
        "{what}. Give `depth_map` once for each picture, in their order, or a folder of maps with their names or \
         numbers"
    )]
    Maps {
        /// The maps and pictures that were found.
        what: String,
    },
    /// No built-in scene has this name, or it does not take a setting.
    #[error("{name}: {reason} (the built-in scenes are {known})")]
    Builtin {
        /// The requested name, with its settings.
        name: String,
        /// The reason for the refusal.
        reason: Reason,
        /// The names of the built-in scenes.
        known: String,
    },
    /// The display does not have a color, or its optics refuse a value.
    #[error(transparent)]
    Optics(#[from] OpticsError),
    /// The options after the question mark of a source are not valid.
    #[error("{scene}: {reason}")]
    Options {
        scene: String,
        /// The option, and its allowed values.
        reason: Reason,
    },
    /// The views show too little of their depths.
    #[error(
        "the depth of the scene is measured as {measured}, but only {percent} % of its detail is found again in \
         neighboring views. State the depths by `depth`, or by depth_mm in lightfield.toml"
    )]
    Depth {
        /// The measured depths, for people.
        measured: String,
        /// The percentage of the detail whose depth is certain.
        percent: u8,
    },
    /// No scene can satisfy the request.
    #[error("{what} is {value}, but it must be {must}")]
    Request {
        /// The part of the request.
        what: &'static str,
        /// The value of this part, in the unit of the command.
        value: String,
        /// The values that are allowed.
        must: &'static str,
    },
}

impl SceneError {
    /// Returns the error for measured depths that are not trusted. `percent` is the percentage of the scene's detail
    /// whose depth is certain.
    pub fn doubtful_depth(depth: [f64; 2], percent: u8, focal_length: f64) -> Self {
        Self::Depth { measured: depths_in_words(depth, focal_length), percent }
    }

    /// Returns the error for a pixel at this row and column that is not valid light.
    pub(crate) fn no_light(file: impl ToString, [row, column]: [usize; 2], value: f32) -> Self {
        Self::Value { file: file.to_string(), row, column, value, must: "finite and not negative" }
    }

    /// Returns the error for a picture of another size than `other`, (rows, columns) each.
    pub(crate) fn size(file: &Path, [height, width]: [usize; 2], other: String, size: [usize; 2]) -> Self {
        let [other_height, other_width] = size;
        Self::Size { file: file.display().to_string(), height, width, other, other_height, other_width }
    }

    /// Returns the error that the system reported for a file or folder.
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
