//! Sequences in pieces, which other machines may solve.

use crate::display::{Display, colors};
use crate::engine::Engine;
use crate::failure::{Answer, Failure};
use crate::hologram::Hologram;
use crate::told::Told;
use eyebox::hologram::Opening;
use eyebox::hologram::Start;
use eyebox::produce::{ProduceError, SceneEvent, SceneJob, SequenceRequest, join_pieces};
use eyebox::solve::Flow;
use pyo3::prelude::*;
use std::path::PathBuf;

/// A sequence of scenes whose holograms begin cold.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct Sequence {
    scenes: Vec<String>,
    display: Py<Display>,
    color_names: Vec<String>,
    settings: String,
    rate: [u32; 2],
}

impl Sequence {
    fn job<'a>(&self, display: &'a Display, engine: &dyn eyebox::engine::Engine) -> Answer<SceneJob<'a>> {
        let mut job = SceneJob {
            scenes: self.scenes.clone(),
            colors: colors(&display.0, &self.color_names)?,
            sequence: SequenceRequest { rate: self.rate, start: Start::Cold },
            ..SceneJob::new("", &display.0)
        };
        job.take_settings(&self.settings, engine)?;
        Ok(job)
    }
}

#[pymethods]
impl Sequence {
    #[new]
    fn new(
        scenes: Vec<String>,
        display: Py<Display>,
        color_names: Vec<String>,
        settings: String,
        rate: [u32; 2],
    ) -> Self {
        Self { scenes, display, color_names, settings, rate }
    }

    /// One hologram of it, with the first but for itself; none where ctrl-C ended it.
    fn piece(
        &self,
        py: Python<'_>,
        index: usize,
        first: Option<&Hologram>,
        engine: &Engine,
    ) -> PyResult<Option<Hologram>> {
        let display = self.display.get();
        let solve = || -> Answer<Option<Hologram>> {
            engine.lend(|engine| {
                let job = self.job(display, engine)?;
                let mut told = Told::new(None);
                let mut observe = |event: &SceneEvent| match event {
                    SceneEvent::Step { .. } => told.step(|| ()),
                    _ => Flow::Continue,
                };
                let first = first.map(|first| &first.0);
                let piece = eyebox::produce::solve_piece(&job, index, first, engine, &mut observe);
                told.raised()?;
                Ok(piece?.map(Hologram))
            })
        };
        Ok(py.detach(solve)?)
    }

    /// Joins holograms at paths into one sequence; how many were not there yet.
    fn join(&self, py: Python<'_>, pieces: Vec<PathBuf>, out: PathBuf, engine: &Engine) -> PyResult<usize> {
        let display = self.display.get();
        let join = || -> Answer<usize> {
            engine.lend(|engine| {
                let job = self.job(display, engine)?;
                let mut open = |index: usize| {
                    let path =
                        pieces.get(index).ok_or_else(|| ProduceError::Job(format!("piece {index} is missing")))?;
                    Ok(Opening::default().hologram(path)?)
                };
                Ok(join_pieces(&job, &out, &mut open).map_err(Failure::from)?.solved)
            })
        };
        Ok(py.detach(join)?)
    }
}
