//! Light fields: reading, built-in scenes, depth and disparity, target images.
//!
//! What belongs here: everything between a path (or a built-in name) and views of linear light at the display's size,
//! and what a camera would see of them.
//!
//! [`load`] takes a **source**:
//!
//! | source | what it is |
//! |---|---|
//! | a folder | views in PNG, JPEG, TIFF, BMP, PPM or EXR files, named by a running number or by row and column |
//! | an array | `.npy` or `.npz`, (rows of views, columns, rows of pixels, columns, colors) |
//! | a picture of many views | `FILE?grid=9x9`, `FILE?mosaic`, `FILE?lenslets` |
//! | a picture, or a frame of a `.y4m` video | with a depth or disparity map ([`Request::depth_map`]): views by reprojection |
//! | `builtin:NAME` | a scene rendered at any resolution and number of views: see [`BUILTINS`] |
//!
//! **Folders.** Names that differ in their numbers alone are the views, read as row and column, as coordinates, or as a running
//! number (`input_Cam000.png`, row by row; a square, unless the pictures show another grid): what fills a grid without holes
//! and doubles. Pictures that clearly show another order are refused ([`SceneError::Order`]) unless one is stated. Beside the
//! views, `lightfield.toml` may state (all keys are optional, others are refused)
//!
//! ```toml
//! grid = [9, 9]             # rows, columns of views
//! files = "out_*"           # which pictures are the views; with a `/`, in the folders of the folder
//! serpentine = true         # of a running number, every second row runs backwards
//! transpose = true          # what the names call the row is the column
//! flip_rows = true          # the first row is the lowest
//! flip_columns = true       # the first column is the rightmost
//! view_pitch_mm = 2.4       # between neighboring views, in the pupil plane
//! disparity = [-1.8, 2.1]   # pixels between neighboring views, positive towards the camera
//! depth_mm = [-3.0, 3.5]    # farthest, nearest
//! transfer = "srgb"         # or "linear": how stored values become light
//! keep = [9, 9]             # only so many rows and columns of views, in the middle
//! tiles = [6, 8]            # one row of cameras is laid out in rows and columns of tiles
//! first = "bottom-left"     # the tile of its leftmost camera
//! positions_mm = [[0, 0], [10, 0], [40, 5]]   # (x, y) of each camera, in the pupil plane
//! focus_mm = [-3, 0, 3]     # the pictures are a focal stack: at which depth each is sharp,
//! aperture_mm = 12          # and how wide the pupil was that saw them
//! ```
//!
//! Disparities and depths are those at the views' own resolution. Without that file, `parameters.cfg` of the 4D Light
//! Field Benchmark gives the number of views and the disparities, or a `gt_disp*.pfm` the disparities. PNG and JPEG
//! are decoded by the sRGB curve, EXR is linear light already.
//!
//! **Arrays and pictures of many views** ask the same file beside them. Behind a question mark, `grid=9x9` (rows, columns), `srgb` and
//! `linear` win; `array=NAME` is one of an `.npz`. Integers of 8 and 16 bits are decoded by the sRGB curve, floats are light of which 1
//! is full scale. `lenslets` says that under each lens of a picture lies a pixel of each view; `mosaic` that views lie beside each other.
//! Without `grid` it is found where neighboring lines differ.
//!
//! **Pictures with a map.** The smallest and the largest value of a map mean the ends of [`Request::depth`], and
//! [`Request::near`] says which of them is near. Left out, an 8- or 16-bit picture is bright where it is near; a `.pfm`, `.npy`
//! or EXR map holds disparities, in pixels between neighboring views at the picture's own resolution, if its name contains
//! `disp`, and distances, the small near, if its name says so; else it is refused.
//!
//! **Anywhere.** Where the views of all of an eyebox would be too many or too far apart, a scene is seen from a few places at
//! a time: a [`Stage`] renders a built-in scene there, an [`Interpolator`] makes views between those of a folder, and a
//! [`Reprojection`] shows a picture with its map.
//!
//! **Few views.** Where the views of a folder stand so far apart that their photographs would show ghosts, closer ones are made of
//! them, by [`Layers`] where these show them well ([`ViewSynthesis`]).
//!
//! Signs (OPTICS 3): columns of views follow +x of the pupil, rows +y; content of positive disparity is near.

mod builtin;
mod depth;
mod formats;
mod light_field;
mod read;
mod synthesis;
#[cfg(test)]
mod tests;

pub use builtin::{BUILTINS, Builtin, Stage};
pub use depth::central::{central_depth, central_view};
pub use depth::displacement::displacement;
pub use depth::maps::depth_maps;
pub use depth::range::DepthSource;
pub use depth::range::asked_or_found;
pub use depth::survey::{Black, DARK, Light};
pub use light_field::cameras::{CamerasFound, FirstTile, Tiles};
pub use light_field::error::SceneError;
pub use light_field::field::LightField;
pub use light_field::light::{FullScale, srgb_to_linear};
pub use light_field::natural::natural;
pub use light_field::near::Near;
pub use light_field::order::Order;
pub use light_field::photograph::ViewGrid;
pub use light_field::photographs::{MadeViews, ViewSynthesis};
pub use light_field::pyramid::{Level, Pyramid, ViewsOnDevice};
pub use light_field::request::Request;
pub use light_field::resize::{Fit, Resize, crop_share, shrink_to_share};
pub use read::frames::{frames, sequence};
pub use read::identity::{digest, digest_of_picture, path_and_options};
pub use read::inspect::{Exposure, Inspection, contact_sheet, inspect};
pub use read::order_found::OrderFound;
pub use read::single::Reprojection;
pub use synthesis::closer::ENOUGH;
#[cfg(target_os = "linux")]
pub use synthesis::given::{Layer, Places, views_of_depths, views_of_layers};
pub use synthesis::interpolate::Interpolator;
pub use synthesis::layers::Layers;
pub use synthesis::parallax::Parallax;
pub use synthesis::registered::Bend;

use eyebox_base::files::NpyArray;
use read::source::Source;
use std::path::Path;

/// Rows and columns of a source's own pictures, from their names and headers alone; none for built-in scenes, which
/// have any size.
///
/// # Errors
/// Any [`SceneError`] that names and headers can cause.
pub fn native_size(source: &str) -> Result<Option<[usize; 2]>, SceneError> {
    match Source::of(source)? {
        Source::BuiltIn(name) => builtin::check(name).map(|()| None),
        Source::Views(kept) => kept.size().map(Some),
        Source::Picture(path) => formats::still::size(path).map(Some),
    }
}

/// Whether `source` is, by its name alone, the scene that `known` names: a source, or the name of a light field.
pub fn is_named(source: &str, known: &str) -> bool {
    if let (Some(source), Some(known)) = (source.strip_prefix("builtin:"), known.strip_prefix("builtin:")) {
        return builtin::same(source, known);
    }
    let last = |path: &Path| path.file_name().map(|n| n.to_string_lossy().into_owned());
    let [own, other] = [source, known].map(|source| formats::options::parts(source).0);
    let whole = own.canonicalize().ok();
    let names = [last(own), whole.as_deref().and_then(last), own.file_stem().map(|n| n.to_string_lossy().into_owned())];
    source == known || names.iter().flatten().any(|name| name == known || Some(name) == last(other).as_ref())
}

/// Returns whether a file is an array that may be phases: it can be read, has at most four axes, and holds no integers with three
/// or four channels in the last axis.
pub fn may_be_phases(file: &Path) -> bool {
    NpyArray::open(file, None, |_| true).is_ok_and(|array| {
        let has_channels = array.shape.len() > 2 && matches!(array.shape.last(), Some(3 | 4));
        array.shape.len() < 5 && !(has_channels && array.kind.starts_with('u'))
    })
}

/// Whether a source is a picture of one view, which needs a depth map.
///
/// # Errors
/// [`SceneError::NotFound`]; [`SceneError::Options`].
pub fn is_single(source: &str) -> Result<bool, SceneError> {
    Ok(matches!(Source::of(source)?, Source::Picture(_)))
}

/// Refuses a depth map for what is no single picture.
pub fn check_map(source: &str, request: &Request) -> Result<(), SceneError> {
    match request.depth_map {
        Some(map) if !is_single(source)? => Err(SceneError::Request {
            what: "the depth map",
            value: map.display().to_string(),
            must: "left out: this scene has views of its own; a map belongs to a single picture",
        }),
        _ => Ok(()),
    }
}

/// Loads a scene and fits it to the display ([`Fit::Contain`]).
///
/// # Errors
/// Any [`SceneError`]; it names the file.
pub fn load(source: &str, request: &Request) -> Result<LightField, SceneError> {
    request.check()?;
    tracing::debug!("loading {source}");
    check_map(source, request)?;
    match Source::of(source)? {
        Source::BuiltIn(name) => builtin::load(name, request),
        Source::Picture(path) => {
            let field = read::single::load(path, request)?;
            formats::tone::warn_of_black(source, field.brightest());
            Ok(field)
        }
        Source::Views(kept) => {
            let field = read::views::checked(source, kept.read(request)?)?;
            request.check_depths(field.depth)?;
            formats::tone::warn_of_black(source, field.brightest());
            LightField { view_pitch: request.view_pitch.or(field.view_pitch), ..field }
                .with_views_for(request.display, request.photographs)
        }
    }
}
