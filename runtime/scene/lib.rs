//! Reads scenes as light fields, from files or built-in scenes, and measures depths and makes views.
//!
//! This crate has everything between a path (or the name of a built-in scene) and views of linear light at the size of
//! the display. It also computes the images that a camera would take of them.
//!
//! [`load`] accepts these **sources**:
//!
//! | source | content |
//! |---|---|
//! | a folder | views in PNG, JPEG, TIFF, BMP, PPM or EXR files, named by a running number or by row and column |
//! | an array | `.npy` or `.npz`, (rows of views, columns, rows of pixels, columns, colors) |
//! | a picture of many views | `FILE?grid=9x9`, `FILE?mosaic`, `FILE?lenslets` |
//! | a picture, or a frame of a video | with a depth or disparity map ([`Request::depth_map`]), reprojected to
//! views |
//! | `.ply`, `.splat`, `.spz` | splats, rendered from a camera ([`SplatViews`]) |
//! | `builtin:NAME` | a scene rendered at any resolution and number of views ([`BUILTINS`]) |
//!
//! **Folders.** The views are the files whose names differ only in their numbers. The numbers are row and column,
//! coordinates, or a running number row by row (`input_Cam000.png`). The meaning that fills a grid without gaps and
//! duplicates counts. A running number makes a square, unless the pictures show another grid. Pictures that clearly
//! show another order are refused ([`SceneError::Order`]) unless an order is stated. A `lightfield.toml` in the folder
//! may have the following keys. All are optional, and unknown keys are refused.
//!
//! ```toml
//! grid = [9, 9]             # rows, columns of views
//! files = "out_*"           # names of the views, with a `/` those in the folders of the folder
//! serpentine = true         # every second row of a running number runs backwards
//! transpose = true          # the row of the names is the column
//! flip_rows = true          # the first row is the lowest
//! flip_columns = true       # the first column is the rightmost
//! view_pitch_mm = 2.4       # between neighboring views, in the pupil plane
//! disparity = [-1.8, 2.1]   # pixels between neighboring views, positive towards the camera
//! depth_mm = [-3.0, 3.5]    # farthest, nearest
//! transfer = "srgb"         # or "linear", the transfer function of the stored values
//! keep = [9, 9]             # number of rows and columns of views to use, in the middle
//! tiles = [6, 8]            # one row of cameras is laid out in rows and columns of tiles
//! first = "bottom-left"     # tile of the leftmost camera
//! positions_mm = [[0, 0], [10, 0], [40, 5]]   # (x, y) of each camera, in the pupil plane
//! focus_mm = [-3, 0, 3]     # the pictures are a focal stack, depth at which each is sharp
//! aperture_mm = 12          # diameter of the pupil that saw the focal stack
//! ```
//!
//! Disparities and depths have the resolution of the original views. Without that file, `parameters.cfg` of the 4D
//! Light Field Benchmark gives the number of views and the disparities, or a `gt_disp*.pfm` gives the disparities. PNG
//! and JPEG are decoded by the sRGB curve, and EXR is linear light.
//!
//! **Arrays and pictures of many views** use the same file from their folder. The options `grid=9x9` (rows, columns),
//! `srgb` and `linear` after a question mark take precedence. The option `array=NAME` selects one array of an `.npz`.
//! Integers of 8 and 16 bits are decoded by the sRGB curve, and floats are light with 1 as full scale. With `lenslets`
//! a picture has one pixel of each view under each lens, and with `mosaic` views are next to each other. Without
//! `grid`, the grid is found from the places at which neighboring lines differ.
//!
//! **Pictures with a map.** The smallest and the largest value of a map are the ends of [`Request::depth`], and
//! [`Request::near`] states which of them is near. Without it, bright pixels of an 8-bit picture are near, and a 16-bit
//! picture is refused. A `.pfm`, `.npy` or EXR map has disparities if its name contains `disp`, in pixels between
//! neighboring views at the resolution of the picture. It has distances, with small values near, if its name says so.
//! Otherwise it is refused.
//!
//! **Anywhere.** If the views of a whole eyebox would be too many or too far apart, a scene is rendered from a few
//! places at a time. A [`Stage`] renders a built-in scene there, an [`Interpolator`] makes views between the views of a
//! folder, and a [`Reprojection`] reprojects a picture with its map.
//!
//! **Few views.** If the target images of the views of a folder would have ghosts, closer views are made from them, by
//! [`Layers`] if these predict the views well ([`ViewSynthesis`]).
//!
//! Signs (OPTICS 3): columns of views follow +x of the pupil, and rows +y. Content of positive disparity is near.

mod builtin;
mod depth;
mod formats;
mod light_field;
mod read;
mod splats;
mod synthesis;
#[cfg(test)]
mod tests;

pub use builtin::{BUILTINS, Builtin, Stage};
pub use depth::central::{central_depth, central_view};
pub use depth::displacement::displacement;
pub use depth::maps::{depth_maps, sequence_maps};
pub use depth::range::DepthSource;
pub use depth::range::asked_or_found;
pub use depth::survey::{Black, DARK, Light};
pub use light_field::cameras::{CamerasFound, FirstTile, Tiles};
pub use light_field::drawer::{SplatDrawer, StoredSplats};
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
pub use light_field::resize::{Fit, Resize, crop_share, crop_share_adjoint, shrink_to_share};
pub use read::eyes::of_two_eyes;
pub use read::frames::{frames, sequence};
pub use read::identity::{digest, digest_of_picture, path_and_options};
pub use read::inspect::{Exposure, Inspection, contact_sheet, inspect};
pub use read::moving_splats::MovingSplats;
pub use read::order_found::OrderFound;
pub use read::single::Reprojection;
pub use read::splats::SplatViews;
pub use splats::camera::Camera as SplatCamera;
pub use splats::path::CameraPath;
pub use synthesis::closer::ENOUGH;
pub use synthesis::given::{Layer, Places, views_of_depths, views_of_layers};
pub use synthesis::interpolate::Interpolator;
pub use synthesis::layers::Layers;
pub use synthesis::parallax::Parallax;
pub use synthesis::registered::Bend;

use eyebox_base::files::NpyArray;
use read::source::Source;
use std::path::Path;

/// Returns rows and columns of the pictures of a source, from their names and headers alone. Built-in scenes
/// and splats return `None`, because they have any size.
///
/// # Errors
/// Any [`SceneError`] that names and headers can cause.
pub fn native_size(source: &str) -> Result<Option<[usize; 2]>, SceneError> {
    match Source::of(source)? {
        Source::BuiltIn(name) => builtin::check(name).map(|()| None),
        Source::Views(kept) => kept.size().map(Some),
        Source::Picture(path) => formats::still::size(path).map(Some),
        Source::Splats(..) => Ok(None),
    }
}

/// Returns true if `source` is, by its name alone, the scene that `known` names. `known` is a source, or the name of a
/// light field.
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

/// Returns true if a file is an array that may be phases. It must be readable, have at most four axes, and have no
/// integers with three or four channels in the last axis.
pub fn may_be_phases(file: &Path) -> bool {
    NpyArray::open(file, None, |_| true).is_ok_and(|array| {
        let has_channels = array.shape.len() > 2 && matches!(array.shape.last(), Some(3 | 4));
        array.shape.len() < 5 && !(has_channels && array.kind.starts_with('u'))
    })
}

/// Returns true if a source is a picture of one view, which needs a depth map.
///
/// # Errors
/// [`SceneError::NotFound`] for a missing source, or [`SceneError::Options`] for options that are not valid.
pub fn is_single(source: &str) -> Result<bool, SceneError> {
    Ok(matches!(Source::of(source)?, Source::Picture(_)))
}

/// Returns true if a source is a file of splats.
pub fn is_splats(source: &str) -> bool {
    splats::format::Format::of(formats::options::parts(source).0).is_some()
}

/// Refuses a depth map for a source that is not a single picture.
pub fn check_map(source: &str, request: &Request) -> Result<(), SceneError> {
    match request.depth_map {
        Some(map) if !is_single(source)? => Err(SceneError::Request {
            what: "the depth map",
            value: map.display().to_string(),
            must: "left out, because this scene has views of its own and only a single picture takes a map",
        }),
        _ => Ok(()),
    }
}

/// Loads a scene and fits it to the display ([`Fit::Contain`]).
///
/// # Errors
/// Any [`SceneError`], with the name of the file.
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
        Source::Splats(_, format, options) => {
            let (field, read_as) = read::splats::load(source, format, &options, request)?;
            tracing::info!("{source}: {read_as}");
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
