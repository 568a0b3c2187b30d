//! The functions for scenes, which are light fields from files, built in, or from views of the caller.

use crate::arrays::{array, given, hand_over, text};
use crate::display::colors;
use crate::failure::{Failure, answer, free, starts_threads};
use crate::{EyeboxDisplay, EyeboxStatus};
use eyebox::error::Reason;
use eyebox::hologram::{Hologram, SceneRecord};
use eyebox::optics::Color;
use eyebox::produce::SceneJob;
use eyebox::reconstruction::{InputOptions, SceneReading, SolveInput};
use eyebox::scene::{Fit, LightField, Order};
use std::borrow::Cow;
use std::ffi::c_char;
use std::mem::MaybeUninit;

/// A scene as a light field. Its views are from a grid of positions in the pupil plane, and have the size of the
/// display's pictures. It never changes.
pub struct EyeboxScene {
    pub(crate) field: LightField,
    /// The name that holograms store for it.
    pub(crate) name: String,
    /// The record that identifies it.
    pub(crate) record: SceneRecord,
    /// True if it is accepted for holograms that were solved from another scene.
    other: bool,
}

impl EyeboxScene {
    /// Refuses a scene of another size than the hologram's picture. It also refuses a scene other than the hologram's
    /// own, unless the caller accepted another one.
    pub(crate) fn check(&self, hologram: &Hologram) -> Result<(), Failure> {
        match self.other {
            true => Ok(hologram.check_size(&self.field)?),
            false => Ok(hologram.check_shows(&self.record, &self.field)?),
        }
    }

    /// Reads the scene of a hologram with the settings of its solve.
    pub(crate) fn of(hologram: &Hologram, named: Option<String>, other: bool) -> Result<Self, Failure> {
        let options = InputOptions { scene: named, other_scene: other, ..InputOptions::default() };
        let input = SolveInput::open(hologram, &options)?;
        let (field, name) = (input.light_field()?, input.source().to_owned());
        let record = SceneRecord::of_source(&name, input.request().depth_map)?;
        Ok(Self { field, name, record, other })
    }
}

/// Returns the light field of the given scene, or otherwise of the scene from which the hologram was solved.
pub(crate) fn scene_of<'a>(
    scene: Option<&'a EyeboxScene>,
    hologram: &Hologram,
) -> Result<Cow<'a, LightField>, Failure> {
    match scene {
        Some(scene) => {
            scene.check(hologram)?;
            Ok(Cow::Borrowed(&scene.field))
        }
        None => Ok(Cow::Owned(EyeboxScene::of(hologram, None, false)?.field)),
    }
}

/// A light field of the caller. Each color is an array (view row, view column, row, column) of float32 without gaps.
/// The values are linear light, finite and not negative, with 1 as full scale. View (r, c) is the view from
/// x = (c - (view_columns - 1) / 2) * view_pitch_m, y = (r - (view_rows - 1) / 2) * view_pitch_m in the pupil plane.
/// Columns of views go to the right, and rows of views go down.
#[repr(C)]
pub struct EyeboxViews {
    /// The name that holograms store as their scene, or null for no name.
    pub name: *const c_char,
    /// Number of rows of views, 1 to 64.
    pub view_rows: usize,
    /// Number of columns of views, 1 to 64.
    pub view_columns: usize,
    /// Rows of each view (pixels). Views of another size than the display's pictures are scaled to fit completely.
    pub rows: usize,
    /// Columns of each view (pixels).
    pub columns: usize,
    /// Distance of neighboring views in the pupil plane (m). 0 spreads the views over the display's eyebox.
    pub view_pitch_m: f64,
    /// The values of red, or null without red. At least one of the three colors must not be null.
    pub red: *const f32,
    /// The values of green, or null without green.
    pub green: *const f32,
    /// The values of blue, or null without blue.
    pub blue: *const f32,
    /// Number of values of each of these arrays, which is view_rows * view_columns * rows * columns.
    pub count: usize,
    /// The true order of the views, if it differs from the order of the arrays. It is one or several of "transpose",
    /// "flip-rows" and "flip-columns" with commas between them. The order "as-named" states that the views are a grid
    /// in the order of the arrays, for any content of their pictures. Null states no order.
    pub order: *const c_char,
}

/// Loads a scene for a display. The `source` is "builtin:NAME", a folder of views, or a picture (docs/scenes.md). Set
/// `colors` to a sum of EYEBOX_RED, EYEBOX_GREEN and EYEBOX_BLUE, or to 0 for all colors of the display. Set `views` to
/// the number of views per axis of rendered scenes, 1 to 64, or to 0 for the default of the command. Free the scene
/// with `eyebox_scene_free`.
///
/// Fails with EYEBOX_STATUS_SCENE if the scene cannot be read, and with EYEBOX_STATUS_DISPLAY if the display lacks a
/// color.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_scene_load(
    source: *const c_char,
    display: Option<&EyeboxDisplay>,
    colors: u32,
    views: usize,
    scene: Option<&mut MaybeUninit<*mut EyeboxScene>>,
) -> EyeboxStatus {
    answer(|| {
        starts_threads();
        hand_over(scene, || {
            // SAFETY: The header requires texts that end with a zero byte.
            let name = unsafe { text(source, "source") }?.to_owned();
            let display = &given(display, "display")?.0;
            let colors = self::colors(display, colors)?;
            let views = Some(views).filter(|views| *views != 0);
            // The command loads a scene with the same job.
            let reading = SceneReading { views, ..SceneReading::default() };
            let job = SceneJob { colors, reading, ..SceneJob::new(&name, display) };
            let (field, record) = (job.load(0)?, job.record(0)?);
            Ok(EyeboxScene { field, name, record, other: false })
        })
    })
}

/// Reads the order of views from its text.
fn order(name: &str) -> Result<Order, Failure> {
    name.parse().map_err(|right: Reason| Failure::argument("views.order", format!("{name:?}"), right))
}

/// Makes a scene for a display from a light field of the caller. eyebox copies the views. Free the scene with
/// `eyebox_scene_free`.
///
/// Fails with EYEBOX_STATUS_ARGUMENT if `count` does not match the sizes or `order` is unknown. Fails with
/// EYEBOX_STATUS_SCENE if the views are wrong, such as values that are not finite or views that are not a grid. Fails
/// with EYEBOX_STATUS_DISPLAY if the display lacks a color.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_scene_from_views(
    views: Option<&EyeboxViews>,
    display: Option<&EyeboxDisplay>,
    scene: Option<&mut MaybeUninit<*mut EyeboxScene>>,
) -> EyeboxStatus {
    answer(|| {
        starts_threads();
        hand_over(scene, || {
            let (views, display) = (given(views, "views")?, &given(display, "display")?.0);
            let name = match views.name.is_null() {
                true => String::new(),
                // SAFETY: The header requires texts that end with a zero byte.
                false => unsafe { text(views.name, "views.name") }?.to_owned(),
            };
            let order = match views.order.is_null() {
                true => None,
                // SAFETY: The header requires texts that end with a zero byte.
                false => Some(order(unsafe { text(views.order, "views.order") }?)?),
            };
            let sizes = [views.view_rows, views.view_columns, views.rows, views.columns];
            let wanted = sizes.iter().try_fold(1usize, |n, size| n.checked_mul(*size)).filter(|n| *n > 0);
            let right = "four sizes that are not 0, of an array that memory holds";
            let wanted = wanted.ok_or_else(|| Failure::argument("the views' shape", format!("{sizes:?}"), right))?;
            let pixels = views.rows * views.columns;
            let of_color = |(color, at): (Color, *const f32)| {
                // SAFETY: The header requires arrays of the stated length.
                let values = unsafe { array(at, views.count, Some(wanted), "an array of views") }?;
                Ok((color, values.chunks_exact(pixels).map(<[f32]>::to_vec).collect()))
            };
            let all = [(Color::Red, views.red), (Color::Green, views.green), (Color::Blue, views.blue)];
            let taken = all.into_iter().filter(|(_, at)| !at.is_null()).map(of_color);
            let (colors, planes) = taken.collect::<Result<Vec<_>, Failure>>()?.into_iter().unzip();
            let field = LightField {
                name: name.clone(),
                grid: [views.view_rows, views.view_columns],
                height: views.rows,
                width: views.columns,
                colors,
                planes,
                view_pitch: Some(views.view_pitch_m).filter(|pitch| *pitch != 0.0),
                disparity: None,
                depth: None,
                made: None,
            };
            let field = field.admit(order)?;
            field.colors.iter().try_for_each(|color| display.optics(*color).map(drop))?;
            let (rows, columns) = display.picture_size();
            // The views as given identify the scene. Fitting them to a display does not change the record.
            let record = SceneRecord::of_views(&name, &field);
            Ok(EyeboxScene { field: field.fit(rows, columns, Fit::Contain), name, record, other: false })
        })
    })
}

/// Frees a scene. Null is allowed and has no effect.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_scene_free(scene: Option<Box<EyeboxScene>>) {
    free(scene);
}
