//! Sequences in pieces, which other machines may solve.

use crate::display::{Display, colors};
use crate::engine::Engine;
use crate::failure::{Answer, Failure};
use crate::told::Told;
use eyebox::hologram::{SequenceParts, Start};
use eyebox::produce::{SceneEvent, SceneJob, SequencePieces, SequenceRequest};
use eyebox::solve::Flow;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::OnceLock;

/// A sequence of scenes whose holograms begin cold, at a path. What its first scene decides is kept from piece to piece.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct Sequence {
    scenes: Vec<String>,
    display: Py<Display>,
    color_names: Vec<String>,
    settings: String,
    rate: [u32; 2],
    out: PathBuf,
    pieces: OnceLock<SequencePieces>,
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

    fn pieces(&self, job: &SceneJob) -> Answer<&SequencePieces> {
        match self.pieces.get() {
            Some(pieces) => Ok(pieces),
            None => {
                let pieces = SequencePieces::new(job, &self.out)?;
                // Whoever was faster made the same.
                Ok(self.pieces.get_or_init(|| pieces))
            }
        }
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
        out: PathBuf,
    ) -> Self {
        Self { scenes, display, color_names, settings, rate, out, pieces: OnceLock::new() }
    }

    /// Solves one hologram of it into its place: whether it was not there yet; none where ctrl-C ended it.
    fn piece(&self, py: Python<'_>, index: usize, engine: &Engine) -> PyResult<Option<bool>> {
        let display = self.display.get();
        let solve = || -> Answer<Option<bool>> {
            engine.lend(|engine| {
                let job = self.job(display, engine)?;
                let pieces = self.pieces(&job)?;
                let mut told = Told::new(None);
                let mut observe = |event: &SceneEvent| match event {
                    SceneEvent::Step { .. } => told.step(|| ()),
                    _ => Flow::Continue,
                };
                let solved = pieces.solve(&job, index, engine, &mut observe);
                told.raised()?;
                Ok(solved?)
            })
        };
        Ok(py.detach(solve)?)
    }

    /// How many holograms of the sequence at a path are there.
    #[staticmethod]
    fn there(py: Python<'_>, out: PathBuf) -> PyResult<u64> {
        let look = || -> Answer<u64> {
            let parts = SequenceParts::open(&out)?;
            Ok((0..parts.planned()).filter(|index| parts.has(*index)).count() as u64)
        };
        Ok(py.detach(look)?)
    }

    /// Says that all holograms of the sequence at a path are there.
    #[staticmethod]
    fn finish(py: Python<'_>, out: PathBuf) -> PyResult<()> {
        Ok(py.detach(|| SequenceParts::open(&out)?.finish()).map_err(Failure::from)?)
    }
}
