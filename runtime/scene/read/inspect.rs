//! Describes a scene as it is read, for people who inspect it before they compute.

use super::splats;
use crate::light_field::resize::{Fit, Resize};
use crate::read::source::Source;
use crate::{DepthSource, Layers, LightField, Parallax, Reprojection, Request, SceneError, read::views};
use crate::{Order, OrderFound};
use eyebox_optics::{Color, Display, Geometry, dioptres};
use serde::Serialize;

/// A scene as it is read. Lengths are in meters unless the name has another unit.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Inspection {
    /// Name of the scene.
    pub name: String,
    /// Rows and columns of views.
    pub grid: [usize; 2],
    /// Description of how the grid of views was found.
    pub found_by: String,
    /// Rows and columns of pixels of the original pictures. It is `None` if the pictures are made for the display.
    pub own_size: Option<[usize; 2]>,
    /// Rows and columns of pixels on the display.
    pub size: [usize; 2],
    /// Transfer function of the stored values.
    pub transfer: String,
    /// The meaning of the values of a picture's depth map, and the reason.
    pub depth_map: Option<String>,
    /// The order in which the views are read.
    pub order: Order,
    /// The message with which other commands refuse the scene, about its order, its depths or its views.
    pub doubt: Option<String>,
    /// True if the pictures confirm the order, and false if they contradict it. It is `None` if the pictures show no
    /// order, or show everything but near and far.
    pub order_confirmed: Option<bool>,
    /// Smallest and largest movement from column to column, and from row to row, in pixels of the display. Each axis is
    /// measured by itself. It is `None` if nothing moves, or if nothing can be measured.
    pub parallax_px: [Option<[f64; 2]>; 2],
    /// Smallest and largest disparity, in pixels of the display between neighboring views.
    pub disparity_px: [f64; 2],
    /// Farthest and nearest depth in millimeters.
    pub depth_mm: [f64; 2],
    /// Farthest and nearest depth in diopters.
    pub depth_dioptres: [f64; 2],
    /// True if the scene states its depths, and false if they are measured.
    pub depth_is_stated: bool,
    /// Distance of neighboring views in the pupil plane, in millimeters.
    pub view_pitch_mm: f64,
    /// Movement of the nearest content against the farthest from view to view, in pixels of the display. Beyond one
    /// pixel, wide pupils see ghosts.
    pub aliasing_px: f64,
    /// Views per axis that would keep `aliasing_px` to one pixel.
    pub views_without_aliasing: usize,
    /// The light of each color.
    pub exposure: Vec<Exposure>,
}

/// The linear light of one color.
#[derive(Debug, Clone, Copy, Serialize)]
#[non_exhaustive]
pub struct Exposure {
    /// The color of this light.
    pub color: Color,
    /// The brightest value, with 1 as full scale.
    pub brightest: f64,
    /// The mean value, with 1 as full scale.
    pub mean: f64,
    /// Share of the pixels that are black (below 1/4096 of full scale).
    pub black: f64,
    /// Share of the pixels at or above full scale.
    pub clipped: f64,
}

/// Loads a scene in any order and describes it.
///
/// # Errors
/// The errors of [`crate::load`], without the error for an order that the pictures contradict.
pub fn inspect(source: &str, request: &Request) -> Result<(Inspection, LightField), SceneError> {
    request.check()?;
    crate::check_map(source, request)?;
    let named = Source::of(source)?;
    let has_views = matches!(named, Source::Views(_));
    let mut depth_map = None;
    let display = request.display;
    // Views that are smaller than the display are examined at their own size, because upscaled pixels have no new
    // detail.
    let (mut own_display, mut scale) = (display.clone(), 1.0);
    if let (Source::Views(kept), Geometry::Relay) = (&named, display.geometry) {
        let [height, width] = kept.size()?;
        let times = (display.height as f64 / height as f64).min(display.width as f64 / width as f64);
        if times > 1.0 {
            (own_display.height, own_display.width, scale) = (height, width, times);
        }
    }
    let request = &Request { display: &own_display, depth: request.depth.map(|d| d.map(|z| z / scale)), ..*request };
    let (field, found_by, own_size, transfer, order, says) = if let Source::Views(kept) = &named {
        let read = kept.read(request)?;
        let doubt = views::decide(source, &read).err().map(|e| e.to_string());
        let confirmed = match read.order_found {
            OrderFound::AsNamed => Some(true),
            OrderFound::Unknown | OrderFound::AsNamedOrReversed => None,
            OrderFound::Other { .. } => Some(false),
        };
        let field = LightField { view_pitch: request.view_pitch.or(read.field.view_pitch), ..read.field };
        (field, read.how, Some(read.size), read.transfer, read.order, (doubt, confirmed, read.parallax))
    } else if let Source::Splats(_, format, options) = &named {
        let (field, read_as) = splats::load(source, *format, options, request)?;
        let parallax = Parallax::of(&field);
        (field, read_as, None, "sRGB".to_owned(), Order::default(), (None, Some(true), parallax))
    } else {
        let field = crate::load(source, request)?;
        let parallax = Parallax::of(&field);
        let (how, transfer) = match &named {
            Source::Picture(path) => {
                let [picture, map] = Reprojection::new(path, request)?.read_as().clone();
                depth_map = Some(map);
                ("a picture with a depth map", picture)
            }
            _ => ("built in", "linear".to_owned()),
        };
        (field, how.into(), crate::native_size(source)?, transfer, Order::default(), (None, Some(true), parallax))
    };
    let (own_depth, source) = match request.depth.filter(|_| request.depth_map.is_none()) {
        Some([a, b]) => ([a.min(b), a.max(b)], DepthSource::Stated),
        None => field.reach(&own_display),
    };
    let depth = own_depth.map(|z| z * scale);
    let per_pixel = display.focal_length * display.picture_pixel() / field.cell(display);
    let (doubt, order_confirmed, parallax) = says;
    let doubt = doubt.or_else(|| Some(source.sure(depth, display.focal_length).err()?.to_string()));
    let doubt = match doubt {
        None if has_views => odd_views(&field, &own_display, own_depth)?,
        doubt => doubt,
    };
    let inspection = Inspection {
        name: field.name.clone(),
        grid: field.grid,
        found_by,
        own_size,
        size: display.picture_size().into(),
        transfer,
        depth_map,
        order,
        doubt,
        order_confirmed,
        parallax_px: parallax.map_or([None; 2], |p| p.movement.map(|range| range.map(|r| r.map(|px| px * scale)))),
        disparity_px: depth.map(|z| z / per_pixel),
        depth_mm: depth.map(|z| z * 1e3),
        depth_dioptres: depth.map(|z| dioptres(z, display.focal_length)),
        depth_is_stated: source == DepthSource::Stated,
        view_pitch_mm: field.cell(display) * 1e3,
        aliasing_px: field.aliasing(display, depth),
        views_without_aliasing: field.views_without_aliasing(display, depth, display.eyebox_min()),
        exposure: exposure(&field),
    };
    Ok((inspection, field))
}

/// Pixels along the longer side of the views that are compared.
const COMPARED: usize = 96;

/// Returns the message about one or two views that the others do not predict.
fn odd_views(field: &LightField, display: &Display, depth: [f64; 2]) -> Result<Option<String>, SceneError> {
    let longer = field.height.max(field.width);
    if field.grid[0].max(field.grid[1]) < 3 || longer < 16 {
        return Ok(None);
    }
    let rate = COMPARED.min(longer) as f64 / longer as f64;
    let [height, width] = [field.height, field.width].map(|n| (n as f64 * rate).round().max(1.0) as usize);
    let small = field.only(field.colors[0]).fit(height, width, Fit::Stretch);
    // The copy has fewer pixels, so content moves by fewer pixels.
    let layers = Layers::new(&small, display, depth.map(|z| z * rate))?;
    Ok(layers.odd_views(&field.name).map(|odd| odd.to_string()))
}

fn exposure(field: &LightField) -> Vec<Exposure> {
    let light = field.light().into_iter().zip(&field.planes);
    let one = |(light, views): (crate::Light, &Vec<Vec<f32>>)| {
        let count = views.iter().map(Vec::len).sum::<usize>().max(1) as f64;
        let share = |is: &dyn Fn(f32) -> bool| views.iter().flatten().filter(|v| is(**v)).count() as f64 / count;
        Exposure {
            color: light.color,
            brightest: light.brightest,
            mean: light.mean,
            black: share(&|v| v < 1.0 / 4096.0),
            clipped: share(&|v| v >= 0.9995),
        }
    };
    light.map(one).collect()
}

/// Draws all views next to each other as they are read, in at most `most` pixels along each axis. Returns rows and
/// columns of pixels, and one plane of linear light per color.
pub fn contact_sheet(field: &LightField, most: usize) -> ([usize; 2], Vec<Vec<f32>>) {
    const GAP: usize = 2;
    let [rows, columns] = field.grid;
    let times = ((field.height + GAP) * rows).max((field.width + GAP) * columns) as f64 / most.max(1) as f64;
    let small =
        [field.height, field.width].map(|n| (((n + GAP) as f64 / times.max(1.0)) as usize).saturating_sub(GAP).max(1));
    let resize = Resize::new([field.height, field.width], small, Fit::Contain);
    let [high, wide] = [rows * (small[0] + GAP) - GAP, columns * (small[1] + GAP) - GAP];
    let sheet = |views: &Vec<Vec<f32>>| {
        let mut sheet = vec![0.25f32; high * wide];
        for (i, view) in views.iter().enumerate() {
            let view = resize.apply(view);
            let at = i / columns * (small[0] + GAP) * wide + i % columns * (small[1] + GAP);
            for (y, row) in view.chunks_exact(small[1]).enumerate() {
                sheet[at + y * wide..][..small[1]].copy_from_slice(row);
            }
        }
        sheet
    };
    ([high, wide], field.planes.iter().map(sheet).collect())
}
