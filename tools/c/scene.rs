//! Scenes: light fields of files, built in, or of the caller's own views.

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

/// A scene as a light field: views from a grid of places in the pupil plane, of a display's size. It never changes.
pub struct EyeboxScene {
    pub(crate) field: LightField,
    /// By which name holograms know it.
    pub(crate) name: String,
    /// What identifies it.
    pub(crate) record: SceneRecord,
    /// Whether it is taken for any hologram, though that was solved from another scene.
    other: bool,
}

impl EyeboxScene {
    /// Refuses a scene that is not a hologram's own, unless another was asked for, or that has another size.
    pub(crate) fn check(&self, hologram: &Hologram) -> Result<(), Failure> {
        match self.other {
            true => Ok(hologram.check_size(&self.field)?),
            false => Ok(hologram.check_shows(&self.record, &self.field)?),
        }
    }

    /// The scene of a hologram, read as it was when that was solved.
    pub(crate) fn of(hologram: &Hologram, named: Option<String>, other: bool) -> Result<Self, Failure> {
        let options = InputOptions { scene: named, other_scene: other, ..InputOptions::default() };
        let input = SolveInput::open(hologram, &options)?;
        let (field, name) = (input.light_field()?, input.source().to_owned());
        let record = SceneRecord::of_source(&name, input.request().depth_map)?;
        Ok(Self { field, name, record, other })
    }
}

/// The scene that is given, or else the one that a hologram was solved from.
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

/// A light field of the caller's own. Each colour is an array (view row, view column, row, column) without gaps, of linear light
/// in float32, finite and not negative, with 1 as full scale. View (r, c) looks from x = (c - (view_columns - 1) / 2)
/// view_pitch_m, y = (r - (view_rows - 1) / 2) view_pitch_m: columns of views go to the right, rows down.
#[repr(C)]
pub struct EyeboxViews {
    /// What holograms of it remember as their scene; null for nothing.
    pub name: *const c_char,
    /// Rows of views, 1 to 64.
    pub view_rows: usize,
    /// Columns of views, 1 to 64.
    pub view_columns: usize,
    /// Rows of each view. Views of another size than the display's pictures are scaled to fit whole.
    pub rows: usize,
    /// Columns of each view.
    pub columns: usize,
    /// Metres between neighbouring views in the pupil plane; 0 spreads them over the display's eyebox.
    pub view_pitch_m: f64,
    /// Red; null where there is none. So for the others; at least one is there.
    pub red: *const f32,
    /// Green.
    pub green: *const f32,
    /// Blue.
    pub blue: *const f32,
    /// Values of each of these arrays: view_rows view_columns rows columns.
    pub count: usize,
    /// How views stand that do not stand as the arrays have them: "transpose", "flip-rows", "flip-columns", with commas between;
    /// "as-named" takes them as a grid whatever their pictures show. Null for none of it.
    pub order: *const c_char,
}

/// Loads a scene for a display: "builtin:NAME", a folder of views, or a picture (docs/scenes.md), in the `colors` that are asked for
/// (a sum of EYEBOX_RED, EYEBOX_GREEN, EYEBOX_BLUE; 0 for all of the display's). `views` are the views per axis of scenes that are
/// rendered, 1 to 64; 0 for as many as the command takes.
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
            // SAFETY: the header asks callers for texts that end with zero.
            let name = unsafe { text(source, "source") }?.to_owned();
            let display = &given(display, "display")?.0;
            let colors = self::colors(display, colors)?;
            let views = Some(views).filter(|views| *views != 0);
            // As the command loads it.
            let reading = SceneReading { views, ..SceneReading::default() };
            let job = SceneJob { colors, reading, ..SceneJob::new(&name, display) };
            let (field, record) = (job.load(0)?, job.record(0)?);
            Ok(EyeboxScene { field, name, record, other: false })
        })
    })
}

/// The order in which views stand, by its name.
fn order(name: &str) -> Result<Order, Failure> {
    name.parse().map_err(|right: Reason| Failure::argument("views.order", format!("{name:?}"), right))
}

/// Takes over a light field of the caller's own for a display. The views are copied.
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
                // SAFETY: the header asks callers for texts that end with zero.
                false => unsafe { text(views.name, "views.name") }?.to_owned(),
            };
            let order = match views.order.is_null() {
                true => None,
                // SAFETY: the header asks callers for texts that end with zero.
                false => Some(order(unsafe { text(views.order, "views.order") }?)?),
            };
            let sizes = [views.view_rows, views.view_columns, views.rows, views.columns];
            let wanted = sizes.iter().try_fold(1usize, |n, size| n.checked_mul(*size)).filter(|n| *n > 0);
            let right = "four sizes that are not 0, of an array that memory holds";
            let wanted = wanted.ok_or_else(|| Failure::argument("the views' shape", format!("{sizes:?}"), right))?;
            let pixels = views.rows * views.columns;
            let of_color = |(color, at): (Color, *const f32)| {
                // SAFETY: the header asks callers for arrays as long as they say.
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
            // What is given identifies it, whatever becomes of it on a display.
            let record = SceneRecord::of_views(&name, &field);
            Ok(EyeboxScene { field: field.fit(rows, columns, Fit::Contain), name, record, other: false })
        })
    })
}

/// Frees a scene.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_scene_free(scene: Option<Box<EyeboxScene>>) {
    free(scene);
}
