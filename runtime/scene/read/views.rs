//! Fits views from any source to the display, and checks their order.

use crate::depth::range::Measured;
use crate::light_field::cameras::Tiles;
use crate::light_field::field::by_color;
use crate::light_field::light::Transfer;
use crate::light_field::resize::{Fit, Resize};
use crate::read::settings::Settings;
use crate::read::{order_found, positions, standing};
use crate::{CamerasFound, DepthSource, LightField, Order, OrderFound, Parallax, Request, SceneError};
use eyebox_base::error::Reason;
use eyebox_base::memory;
use eyebox_base::reason;
use std::path::Path;

/// A light field as it was read, with the way in which it was read.
pub(crate) struct Read {
    pub field: LightField,
    /// Description of how the places of the views were found.
    pub how: String,
    /// The stated order, or the order of the names.
    pub order: Order,
    /// True if the order is stated.
    pub order_stated: bool,
    /// The order that the pictures show.
    pub order_found: OrderFound,
    pub parallax: Option<Parallax>,
    /// The contradiction between the pictures and the positions of the cameras.
    pub cameras: Option<CamerasFound>,
    /// Rows and columns of the original pictures.
    pub size: [usize; 2],
    /// Transfer function of the stored values.
    pub transfer: String,
}

/// The conversion of pictures of one size to the size of the display.
pub(crate) struct Frame {
    /// Rows and columns of pixels on the display.
    size: [usize; 2],
    resize: Option<Resize>,
}

impl Frame {
    /// Prepares the conversion of `count` pictures with `own` rows and columns.
    pub fn new(own: [usize; 2], count: usize, request: &Request) -> Result<Self, SceneError> {
        let (height, width) = request.display.picture_size();
        let counts = [count, request.colors.len(), height, width];
        let what = || format!("{count} views of {height} x {width} pixels");
        memory::check_available(what, memory::bytes_of(&counts, 4), "take a smaller `size`, or fewer views")?;
        let size = [height, width];
        let resize = (size != own).then(|| Resize::new(own, size, Fit::default()));
        Ok(Self { size, resize })
    }

    /// Converts the planes of one picture to the size of the display.
    pub fn fit(&self, planes: Vec<Vec<f32>>) -> Vec<Vec<f32>> {
        match &self.resize {
            Some(resize) => planes.iter().map(|plane| resize.apply(plane)).collect(),
            None => planes,
        }
    }

    /// Converts a range in pixels of the original pictures to the display. Depths that follow from such pixels scale in
    /// the same way.
    pub fn scale(&self, range: [f64; 2]) -> [f64; 2] {
        self.resize.as_ref().map_or(range, |resize| resize.scale_range(range))
    }

    /// Builds the light field of all views. `views` has the planes of each, and `disparity` is in pixels of the
    /// original pictures.
    pub fn field(
        &self,
        place: &Path,
        grid: [usize; 2],
        views: impl IntoIterator<Item = Vec<Vec<f32>>>,
        request: &Request,
        stated: &Settings,
        disparity: Option<[f64; 2]>,
    ) -> LightField {
        let scale = |range: Option<[f64; 2]>| range.map(|range| self.scale(range));
        let name = place.canonicalize().unwrap_or(place.into());
        LightField {
            name: name.file_name().map_or("light field".into(), |n| n.to_string_lossy().into_owned()),
            grid,
            height: self.size[0],
            width: self.size[1],
            colors: request.colors.to_vec(),
            planes: by_color(views, request.colors.len()),
            view_pitch: stated.view_pitch,
            disparity: scale(disparity),
            depth: scale(stated.depth),
            made: None,
        }
    }
}

/// Returns the views in the requested or stated order, or in the order in which they come, with the evidence of the
/// pictures.
///
/// The argument `how` describes how they were found, and `own` is their original size. If nothing is stated, `linear`
/// names the values that are linear.
///
/// # Errors
/// [`SceneError::Settings`] if the views to keep are not in the middle.
pub(crate) fn ordered(
    place: &Path,
    field: LightField,
    request: &Request,
    stated: &Settings,
    mut how: String,
    own: [usize; 2],
    linear: Option<&str>,
) -> Result<Read, SceneError> {
    let mut field = in_one_row(place, field, stated, &mut how)?;
    let mut misplaced = None;
    if let Some(positions) = &stated.positions {
        let found = positions::resampled(place, field, positions, own, request)?;
        how += &found.how;
        (field, misplaced) = (found.field, found.cameras);
    }
    let field = match stated.keep {
        Some(keep) => kept(place, field, keep)?,
        None => field,
    };
    let asked = request.order.or(stated.order);
    let field = asked.unwrap_or_default().apply(field);
    let cameras = misplaced.or_else(|| stated.positions.is_none().then(|| standing::refused(&field, asked))?);
    let parallax = Parallax::of(&field);
    let mut order_found = order_found::found(&place.display().to_string(), parallax.as_ref(), asked.is_some());
    if let (OrderFound::AsNamedOrReversed, None) = (&order_found, asked)
        && let Some(stated) = stated_disparity(&field, request)
        && let Measured { range: Some(measured), trust: DepthSource::Measured | DepthSource::Plausible(_) } =
            field.measured()
    {
        order_found = order_found::by_depths(stated, measured);
    }
    let transfer = match (stated.tone.transfer, linear) {
        (Some(Transfer::Linear), _) => "linear, as stated".to_owned(),
        (Some(Transfer::Srgb), _) => "sRGB, as stated".into(),
        (None, Some(kind)) => format!("linear ({kind})"),
        (None, None) => "sRGB".into(),
    };
    let transfer = match stated.tone.full_scale {
        Some(white) => format!("{transfer}, white is {white}, as stated"),
        None => transfer,
    };
    let (order, order_stated) = (asked.unwrap_or_default(), asked.is_some());
    Ok(Read { field, how, order, order_stated, order_found, parallax, cameras, size: own, transfer })
}

/// Refuses views whose pictures contradict the positions of the cameras, or the order in which they come.
///
/// # Errors
/// [`SceneError::Cameras`] for the positions, or [`SceneError::Order`] for the order.
pub(crate) fn decide(name: &str, read: &Read) -> Result<(), SceneError> {
    match &read.cameras {
        Some(found) => Err(SceneError::Cameras { scene: name.into(), found: found.clone() }),
        None => order_found::check(name, &read.order_found, true),
    }
}

/// Returns the light field. It is refused if the pictures contradict the order in which the views come and no order is
/// stated.
pub(crate) fn checked(name: &str, read: Read) -> Result<LightField, SceneError> {
    decide(name, &read)?;
    if !read.order_stated && read.field.grid != [1, 1] {
        order_found::say(name, &read.order_found);
    }
    Ok(read.field)
}

/// Converts views in the stated tiles to one row of cameras.
fn in_one_row(place: &Path, field: LightField, stated: &Settings, how: &mut String) -> Result<LightField, SceneError> {
    let wrong = |reason: Reason| Err(SceneError::Settings { file: place.display().to_string(), reason });
    let (grid, first) = match (stated.tiles, stated.first) {
        (None, None) => return Ok(field),
        (Some(grid), Some(first)) => (grid, first),
        (Some(_), None) => {
            return wrong(reason!(
                "tiles-without-first",
                "tiles needs first, the tile of the leftmost camera, as in first = \"bottom-left\""
            ));
        }
        (None, Some(_)) => {
            return wrong(reason!(
                "first-without-tiles",
                "first needs tiles, the rows and columns of tiles, as in tiles = [6, 8]"
            ));
        }
    };
    let count = field.grid[0] * field.grid[1];
    if grid[0] * grid[1] != count {
        return wrong(reason!("tiles-count", "tiles is [{}, {}], but there are {count} views", grid[0], grid[1]));
    }
    let tiles = Tiles { grid, first, serpentine: stated.serpentine == Some(true) };
    *how += &format!("; {tiles}");
    Ok(field.reordered([1, count], &tiles.order()))
}

/// Returns the stated number of rows and columns of views, in the middle.
fn kept(place: &Path, field: LightField, keep: [usize; 2]) -> Result<LightField, SceneError> {
    let [rows, columns] = field.grid;
    let fits = |i: usize| (1..=field.grid[i]).contains(&keep[i]) && (field.grid[i] - keep[i]).is_multiple_of(2);
    if !(fits(0) && fits(1)) {
        let reason = reason!(
            "keep",
            "keep is [{}, {}] of {rows} x {columns} views, but it must leave out the same number on both sides",
            keep[0],
            keep[1]
        );
        return Err(SceneError::Settings { file: place.display().to_string(), reason });
    }
    Ok(field.inner([(rows - keep[0]) / 2, (columns - keep[1]) / 2]))
}

/// Returns the range of disparities that is stated as such or as depths, in pixels of the light field.
fn stated_disparity(field: &LightField, request: &Request) -> Option<[f64; 2]> {
    let cell = request.view_pitch.unwrap_or_else(|| field.cell(request.display));
    let per_pixel = request.display.focal_length * request.display.picture_pixel() / cell;
    let depths = request.depth.or(field.depth).map(|[a, b]| [a.min(b) / per_pixel, a.max(b) / per_pixel]);
    depths.or(field.disparity)
}
