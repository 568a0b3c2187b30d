//! Far fields in tiles. Several machines can solve their regions.

use crate::call::run;
use crate::display::{Display, colors};
use crate::engine::Engine;
use crate::failure::Answer;
use eyebox::engine::Storage;
use eyebox::produce::MemoryLimit;
use eyebox::produce::{SceneJob, TilePieces, TilesRequest};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::OnceLock;

/// For each visit, whether it is done and for which visits it waits. The number is the length of the longest chain of
/// visits.
type Graph = (Vec<bool>, Vec<Vec<usize>>, usize);

/// A scene for a far-field display in tiles, and the path of its file. Loaded data stays in memory from visit to visit.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct FarField {
    scene: String,
    display: Py<Display>,
    color_names: Vec<String>,
    settings: String,
    request: TilesRequest,
    out: PathBuf,
    pieces: OnceLock<TilePieces>,
}

impl FarField {
    fn job<'a>(&self, display: &'a Display, engine: &dyn eyebox::engine::Engine) -> Answer<SceneJob<'a>> {
        let mut job = SceneJob {
            colors: colors(&display.0, &self.color_names)?,
            tiles: Some(self.request),
            ..SceneJob::new(&self.scene, &display.0)
        };
        job.take_settings(&self.settings, engine)?;
        // The command stores regions as float32 too, with every engine.
        job.settings.storage = Storage::F32;
        Ok(job)
    }

    fn pieces(&self, display: &Display, engine: &dyn eyebox::engine::Engine) -> Answer<&TilePieces> {
        match self.pieces.get() {
            Some(pieces) => Ok(pieces),
            None => {
                let pieces = TilePieces::new(&self.job(display, engine)?, &self.request, &self.out, engine)?;
                // If another thread was faster, its pieces are the same.
                Ok(self.pieces.get_or_init(|| pieces))
            }
        }
    }
}

#[pymethods]
impl FarField {
    /// Stores the job. `request` is the passes, the bytes of memory and the pixels along each axis of the scene's
    /// views.
    #[new]
    fn new(
        scene: String,
        display: Py<Display>,
        color_names: Vec<String>,
        settings: String,
        request: (usize, u64, usize),
        out: PathBuf,
    ) -> Self {
        let (passes, memory, picture) = request;
        let request = TilesRequest { memory: MemoryLimit(memory), passes, picture };
        Self { scene, display, color_names, settings, request, out, pieces: OnceLock::new() }
    }

    /// Begins the file unless it exists, and returns the graph of its visits.
    fn begin(slf: Py<Self>, py: Python<'_>, engine: Py<Engine>) -> PyResult<Graph> {
        run(py, engine.get().on_device, move |_| {
            let far_field = slf.get();
            let display = far_field.display.get();
            engine.get().lend(|engine| {
                let pieces = far_field.pieces(display, engine)?;
                pieces.begin(&far_field.job(display, engine)?, &far_field.request, engine)?;
                let done = (0..pieces.visits()).map(|visit| pieces.is_done(visit)).collect::<Result<_, _>>()?;
                let after = (0..pieces.visits()).map(|visit| pieces.after(visit)).collect::<Result<_, _>>()?;
                Ok((done, after, pieces.longest_chain()?))
            })
        })
    }

    /// Takes a visit. Returns `false` if it was done before.
    fn visit(slf: Py<Self>, py: Python<'_>, visit: usize, engine: Py<Engine>) -> PyResult<bool> {
        run(py, engine.get().on_device, move |_| {
            let far_field = slf.get();
            let take = |engine: &mut dyn eyebox::engine::Engine| {
                Ok(far_field.pieces(far_field.display.get(), engine)?.visit(visit, engine)?)
            };
            engine.get().lend(take)
        })
    }

    /// Marks the far field at a path as finished. All visits must be done.
    #[staticmethod]
    fn finish(py: Python<'_>, out: PathBuf) -> PyResult<()> {
        run(py, false, move |_| Ok(TilePieces::finish(&out)?))
    }
}
