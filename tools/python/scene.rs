//! Scenes, which are light fields from files, built-in names or arrays.

use crate::arrays::{picture, values};
use crate::call::{Caller, run};
use crate::display::{Display, colors};
use crate::engine::Engine;
use crate::failure::{Answer, Failure};
use crate::pupil::{Numbers, pupil};
use eyebox::hologram::{Hologram, SceneRecord};
use eyebox::optics::Color;
use eyebox::produce::SceneJob;
use eyebox::reconstruction::{InputOptions, SceneReading, SceneSource, SolveInput};
use eyebox::scene::{Fit, LightField, Near, Order, ViewSynthesis};
use numpy::{IntoPyArray, PyArray1, PyArray3, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use std::path::PathBuf;

/// A scene as a light field with the size of a display's pictures. It never changes.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct Scene {
    pub(crate) field: LightField,
    /// The name of the scene in holograms.
    pub(crate) source: String,
    /// The record that identifies the scene.
    pub(crate) record: SceneRecord,
    /// The options with which the scene was read. Holograms of the scene store them.
    pub(crate) asked: SceneOptions,
}

/// The views per axis, their pitch in meters, a depth map, the depths of its ends in meters, and names. These are the
/// name of the near values, the order of the views, and the synthesis of views.
type Options =
    (Option<usize>, Option<f64>, Option<PathBuf>, Option<[f64; 2]>, Option<String>, Option<String>, Option<String>);

/// The pitch of views in meters, their order, the name of the synthesis of views, and the farthest and nearest depth in
/// meters.
type ArrayOptions = (Option<f64>, Option<String>, Option<String>, Option<[f64; 2]>);

#[derive(Clone, Default, serde::Serialize, serde::Deserialize)]
pub(crate) struct SceneOptions {
    view_pitch: Option<f64>,
    views: Option<usize>,
    depth_map: Option<PathBuf>,
    depth: Option<[f64; 2]>,
    near: Option<Near>,
    order: Option<Order>,
    photographs: Option<ViewSynthesis>,
}

/// Finds an order of views by its name.
fn order_of(name: &str) -> Answer<Order> {
    name.parse().map_err(|must| Failure::Argument(format!("order is {name:?}: {must}")))
}

/// Finds the near values of a depth map by their name.
fn near_of(name: &str) -> Answer<Near> {
    Ok(match name {
        "small" => Near::Small,
        "large" => Near::Large,
        "bright" => Near::Bright,
        "dark" => Near::Dark,
        _ => return Err(Failure::Argument(format!("near is {name:?}: it must be small, large, bright or dark"))),
    })
}

/// Finds a synthesis of views by its name.
fn synthesis_of(name: &str) -> Answer<ViewSynthesis> {
    use ViewSynthesis::{Auto, Between, Cells, Layers};
    let found = [Auto, Cells, Layers, Between].into_iter().find(|one| one.to_string() == name);
    let wrong = || Failure::Argument(format!("view_synthesis is {name:?}: it must be auto, cells, layers or between"));
    found.ok_or_else(wrong)
}

impl Scene {
    /// Reads the named scene, or the scene of the hologram, with the options of the solve.
    pub(crate) fn of(hologram: &Hologram, named: Option<String>, other_scene: bool) -> Answer<Self> {
        let options = InputOptions { scene: named, other_scene, ..InputOptions::default() };
        let input = SolveInput::open(hologram, &options)?;
        let (field, source) = (input.light_field()?, input.source().to_owned());
        let record = SceneRecord::of_source(&source, input.request().depth_map)?;
        Ok(Self { field, source, record, asked: SceneOptions::default() })
    }

    /// Makes a job for the colors of the scene, with the options with which it was read.
    pub(crate) fn job<'a>(&self, display: &'a eyebox::optics::Display) -> SceneJob<'a> {
        let job = job(&self.source, display, self.field.colors.clone(), &self.asked);
        SceneJob { record: Some(self.record.clone()), ..job }
    }
}

fn job<'a>(
    source: &str,
    display: &'a eyebox::optics::Display,
    colors: Vec<Color>,
    asked: &SceneOptions,
) -> SceneJob<'a> {
    SceneJob {
        colors,
        reading: SceneReading {
            view_pitch_mm: asked.view_pitch.map(|metres| metres * 1e3),
            views: asked.views,
            depth_maps: asked.depth_map.iter().cloned().collect(),
            depth: asked.depth,
            near: asked.near,
            order: asked.order,
            photographs: asked.photographs,
        },
        ..SceneJob::new(source, display)
    }
}

#[pymethods]
impl Scene {
    /// Loads a scene as the command does. A `name` is for files that hold arrays of the caller and go away. The views
    /// then identify the scene.
    #[staticmethod]
    fn load(
        py: Python<'_>,
        source: String,
        display: Py<Display>,
        color_names: Vec<String>,
        options: Options,
        name: Option<String>,
    ) -> PyResult<Self> {
        let (views, view_pitch, depth_map, depth, near, order, synthesis) = options;
        let near = near.as_deref().map(near_of).transpose()?;
        let order = order.as_deref().map(order_of).transpose()?;
        let photographs = synthesis.as_deref().map(synthesis_of).transpose()?;
        let asked = SceneOptions { view_pitch, views, depth_map, depth, near, order, photographs };
        run(py, false, move |_| {
            let display = &display.get().0;
            let job = job(&source, display, colors(display, &color_names)?, &asked);
            let field = job.load(0)?;
            let Some(name) = name else {
                let record = job.record(0)?;
                return Ok(Self { field, source, record, asked });
            };
            let field = LightField { name: name.clone(), ..field };
            let record = SceneRecord::of_views(&name, &field);
            Ok(Self { field, source: name, record, asked: SceneOptions { depth_map: None, depth: None, ..asked } })
        })
    }

    /// Makes a scene from arrays (view row, view column, row, column) of linear light, one per color.
    #[staticmethod]
    fn of_views(
        py: Python<'_>,
        source: String,
        display: Py<Display>,
        color_names: Vec<String>,
        arrays: Vec<PyReadonlyArrayDyn<'_, f32>>,
        options: ArrayOptions,
    ) -> PyResult<Self> {
        let colors = colors(&display.get().0, &color_names)?;
        let (view_pitch, order, synthesis, depth) = options;
        let order = order.as_deref().map(order_of).transpose()?;
        let photographs = synthesis.as_deref().map(synthesis_of).transpose()?;
        let mut shape = [0; 4];
        let mut planes = Vec::with_capacity(arrays.len());
        for array in &arrays {
            let (own, _) = values::<4>(array, "views")?;
            if own.contains(&0) || (!planes.is_empty() && own != shape) {
                let right = "four sizes that are not 0, the same for each colour";
                return Err(Failure::Argument(format!("views has the shape {own:?}: it must have {right}")).into());
            }
            shape = own;
            let size = own[2] * own[3];
            // Signal handlers run Python code, which may write into the array. Each view therefore borrows it again.
            let copy = |view: usize| -> PyResult<Vec<f32>> {
                py.check_signals()?;
                let (_, light) = values::<4>(array, "views")?;
                Ok(light[view * size..][..size].to_vec())
            };
            planes.push((0..own[0] * own[1]).map(copy).collect::<PyResult<_>>()?);
        }
        let [view_rows, view_columns, height, width] = shape;
        let field = LightField {
            name: source.clone(),
            grid: [view_rows, view_columns],
            height,
            width,
            colors,
            planes,
            view_pitch,
            disparity: None,
            depth,
            made: None,
        };
        run(py, false, move |_| {
            let field = field.admit(order)?;
            // The given views identify the scene, not the views that are scaled for a display.
            let record = SceneRecord::of_views(&source, &field);
            let display = &display.get().0;
            let (rows, columns) = display.picture_size();
            let fits = (field.height, field.width) == (rows, columns);
            let field = if fits { field } else { field.fit(rows, columns, Fit::Contain) };
            let field = field.with_views_for(display, photographs.unwrap_or(ViewSynthesis::Cells))?;
            Ok(Self {
                field,
                source,
                record,
                asked: SceneOptions { view_pitch, photographs, ..SceneOptions::default() },
            })
        })
    }

    #[getter]
    fn source(&self) -> &str {
        &self.source
    }

    /// The rows and columns of views, then the rows and columns of pixels.
    #[getter]
    fn shape(&self) -> [usize; 4] {
        let LightField { grid: [rows, columns], height, width, .. } = self.field;
        [rows, columns, height, width]
    }

    #[getter]
    fn colors(&self) -> Vec<String> {
        self.field.colors.iter().map(Color::to_string).collect()
    }

    /// Returns the farthest and the nearest depth in front of a display in meters, or `None` if they are unknown.
    fn depth_range(&self, display: &Display) -> Option<[f64; 2]> {
        self.field.depth_range(&display.0)
    }

    /// Returns the distance between neighboring views in the pupil plane of a display, in meters.
    fn view_pitch(&self, display: &Display) -> f64 {
        self.field.cell(&display.0)
    }

    /// Returns a copy of the views of one color, one after the other.
    fn views<'py>(&self, py: Python<'py>, color: usize) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let views = self.field.planes.get(color);
        let views = views.ok_or_else(|| Failure::Argument(format!("color is {color}: there are fewer")))?;
        Ok(views.concat().into_pyarray(py))
    }

    /// Computes the target image through a pupil (row, column, color).
    fn photograph(
        slf: Py<Self>,
        py: Python<'_>,
        display: Py<Display>,
        at: Numbers,
        engine: Py<Engine>,
    ) -> PyResult<Bound<'_, PyArray3<f32>>> {
        let on_device = engine.get().on_device;
        let take = move |_: &Caller| -> Answer<_> {
            let (pupil, display, field) = (pupil(at), &display.get().0, &slf.get().field);
            for color in &field.colors {
                display.check_pupil(*color, pupil)?;
            }
            let scene = SceneSource::new(field.clone(), display)?;
            engine.get().lend(|engine| Ok(scene.photograph(&pupil, engine)?))
        };
        picture(py, &run(py, on_device, take)?)
    }
}
