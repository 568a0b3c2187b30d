//! Sequences in pieces, which several machines can solve.

use crate::call::run;
use crate::display::{Display, colors};
use crate::engine::Engine;
use crate::failure::Answer;
use crate::forked::on_threads;
use eyebox::hologram::{SequenceParts, Start};
use eyebox::produce::{SceneEvent, SceneJob, SequencePieces, SequenceRequest};
use eyebox::solve::Flow;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::OnceLock;

/// A sequence of scenes, and the path of its file. Its holograms begin cold. The results of its first scene stay in
/// memory from piece to piece.
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

    fn pieces(&self, job: &SceneJob, engine: &dyn eyebox::engine::Engine) -> Answer<&SequencePieces> {
        match self.pieces.get() {
            Some(pieces) => Ok(pieces),
            None => {
                let pieces = SequencePieces::new(job, &self.out, engine)?;
                // If another thread was faster, its pieces are the same.
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

    /// Loads the first scene, which all pieces need.
    fn prepare(slf: Py<Self>, py: Python<'_>, engine: Py<Engine>) -> PyResult<()> {
        run(py, engine.get().on_device, move |_| {
            let sequence = slf.get();
            engine.get().lend(|engine| {
                let job = sequence.job(sequence.display.get(), engine)?;
                sequence.pieces(&job, engine).map(drop)
            })
        })
    }

    /// Solves one hologram into its place in the file, on the given number of threads. Returns `false` if it was there
    /// before, and `None` if the solve was ended early.
    #[pyo3(signature = (index, engine, threads = None))]
    fn piece(
        slf: Py<Self>,
        py: Python<'_>,
        index: usize,
        engine: Py<Engine>,
        threads: Option<usize>,
    ) -> PyResult<Option<bool>> {
        run(py, engine.get().on_device, move |caller| {
            let sequence = slf.get();
            let solve = |engine: &mut dyn eyebox::engine::Engine| {
                let job = sequence.job(sequence.display.get(), engine)?;
                let pieces = sequence.pieces(&job, engine)?;
                let mut observe = |_: &SceneEvent| if caller.is_gone() { Flow::Stop } else { Flow::Continue };
                Ok(pieces.solve(&job, index, engine, &mut observe)?)
            };
            on_threads(threads, || engine.get().lend(solve))
        })
    }

    /// Returns the number of holograms that exist in the sequence at a path.
    #[staticmethod]
    fn there(py: Python<'_>, out: PathBuf) -> PyResult<u64> {
        run(py, false, move |_| {
            let parts = SequenceParts::open(&out)?;
            Ok((0..parts.planned()).filter(|index| parts.has(*index)).count() as u64)
        })
    }

    /// Marks the sequence at a path as complete. All holograms must be there.
    #[staticmethod]
    fn finish(py: Python<'_>, out: PathBuf) -> PyResult<()> {
        run(py, false, move |_| Ok(SequenceParts::open(&out)?.finish()?))
    }
}
