//! The plan of a solve, with its decisions and, on request, its time and memory.

use crate::call::{Caller, run};
use crate::display::Display;
use crate::engine::Engine;
use crate::failure::{Answer, Failure};
use crate::internals::{Loaded, Rates, ScenePlan, forecast};
use crate::scene::Scene;
use eyebox::solve::Problem;
use pyo3::prelude::*;
use serde_json::{Value, json};

/// Plans the solve of a scene with settings from a TOML text, and returns the plan as JSON. With `timed` it has the
/// time and the memory of each color, for which the engine is measured once per machine.
#[pyfunction]
pub(crate) fn plan(
    py: Python<'_>,
    scene: Py<Scene>,
    display: Py<Display>,
    settings: String,
    engine: Py<Engine>,
    timed: bool,
) -> PyResult<String> {
    run(py, engine.get().on_device, move |_: &Caller| -> Answer<String> {
        let (scene, display) = (scene.get(), &display.get().0);
        engine.get().lend(|engine| {
            let mut job = scene.job(display);
            let depth = job.reading.depth;
            job.take_settings(&settings, engine)?;
            job.reading.depth = job.reading.depth.or(depth);
            job.check_usual()?;
            let plan = job.plan(&scene.field)?;
            let forecasts = if timed { Some(forecasts(&plan, scene, display, engine)?) } else { None };
            let out = json!({
                "colors": plan.colors, "dark": plan.dark, "choices": plan.choices,
                "views_left_out": plan.outer, "views_merged": plan.merge,
                "padding": [plan.padding.rows, plan.padding.columns],
                "settings": plan.settings, "forecast": forecasts,
            });
            Ok(out.to_string())
        })
    })
}

/// Returns the seconds of a step, the peak memory in bytes and the windows of each color.
fn forecasts(
    plan: &ScenePlan,
    scene: &Scene,
    display: &eyebox::optics::Display,
    engine: &mut dyn eyebox::engine::Engine,
) -> Answer<Vec<Value>> {
    let rates = Rates::of(engine, plan.settings.storage, false, |_| ())?;
    let lit = plan.lit(display);
    let field = &scene.field;
    let left = plan.left(field, &lit);
    let values = field.height * field.width * field.colors.len() * field.grid[0] * field.grid[1];
    let one = |(done, color): (usize, &eyebox::optics::Color)| -> Answer<Value> {
        let loaded = Loaded { values, program: 0, loading: 0, memory: engine.memory(), done };
        let problem = Problem::outline(&lit, *color, plan.padding, left)?;
        let found = forecast(&problem, &plan.settings, &rates, loaded);
        Ok(json!({
            "color": color, "step_seconds": found.step_seconds, "peak_bytes": found.peak_bytes(),
            "windows": found.windows,
        }))
    };
    plan.colors.iter().enumerate().map(one).collect::<Result<_, Failure>>()
}
