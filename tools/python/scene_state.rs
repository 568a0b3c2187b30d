//! The state of a scene apart from its views, with which another process makes the same scene again.

use crate::arrays::values;
use crate::failure::Failure;
use crate::internals::{LightField, MadeViews, ViewSynthesis};
use crate::scene::{Scene, SceneOptions};
use eyebox::hologram::SceneRecord;
use eyebox::optics::Color;
use numpy::PyReadonlyArrayDyn;
use pyo3::prelude::*;
use serde::{Deserialize, Serialize};

/// The fields of [`MadeViews`] in their order.
type Made = (ViewSynthesis, [usize; 2], f64, f64, Option<(usize, [f64; 2])>, Option<[f64; 2]>);

#[derive(Serialize, Deserialize)]
struct State {
    name: String,
    colors: Vec<Color>,
    view_pitch: Option<f64>,
    disparity: Option<[f64; 2]>,
    depth: Option<[f64; 2]>,
    made: Option<Made>,
    source: String,
    record: SceneRecord,
    asked: SceneOptions,
}

/// Returns everything of a scene but its views as JSON.
#[pyfunction]
pub(crate) fn scene_state(scene: &Scene) -> PyResult<String> {
    let LightField { name, colors, view_pitch, disparity, depth, made, .. } = &scene.field;
    let state = State {
        name: name.clone(),
        colors: colors.clone(),
        view_pitch: *view_pitch,
        disparity: *disparity,
        depth: *depth,
        made: made.map(|m| (m.by, m.grid, m.cell, m.aliasing, m.layers, m.held_back)),
        source: scene.source.clone(),
        record: scene.record.clone(),
        asked: scene.asked.clone(),
    };
    Ok(serde_json::to_string(&state).map_err(|e| Failure::Argument(e.to_string()))?)
}

/// Makes the scene of a state and its views (view row, view column, row, column), one array per color.
#[pyfunction]
pub(crate) fn scene_of_state(state: &str, arrays: Vec<PyReadonlyArrayDyn<'_, f32>>) -> PyResult<Scene> {
    let state: State = serde_json::from_str(state).map_err(|e| Failure::Argument(format!("state: {e}")))?;
    let mut shape = [0; 4];
    let mut planes = Vec::with_capacity(arrays.len());
    for array in &arrays {
        let (own, light) = values::<4>(array, "views")?;
        shape = own;
        planes.push(light.chunks((own[2] * own[3]).max(1)).map(<[f32]>::to_vec).collect());
    }
    let [rows, columns, height, width] = shape;
    let State { name, colors, view_pitch, disparity, depth, made, source, record, asked } = state;
    let made = made.map(|(by, grid, cell, aliasing, layers, held_back)| MadeViews {
        by,
        grid,
        cell,
        aliasing,
        layers,
        held_back,
    });
    let grid = [rows, columns];
    let field = LightField { name, grid, height, width, colors, planes, view_pitch, disparity, depth, made };
    field.check().map_err(Failure::from)?;
    Ok(Scene { field, source, record, asked })
}
