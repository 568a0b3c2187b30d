//! Makes pipelines on threads of their own, while others of the device already run.

use super::device::Device;
use super::error::EngineError;
use super::pipelines::{Pipeline, Wanted};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{JoinHandle, available_parallelism};

/// Threads that make pipelines. They end with their work, or when this is dropped.
pub(super) struct Background {
    ends: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Background {
    /// Makes these pipelines in order, on a quarter of the cores, because steps run meanwhile. A step that needs one of
    /// them before makes it itself.
    pub(super) fn start(device: &Arc<Device>, missing: Vec<(Wanted, Pipeline)>) -> Self {
        let count = available_parallelism().map_or(1, |cores| cores.get().div_ceil(4)).min(missing.len());
        let (ends, queue) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(missing.into_iter())));
        let work = || {
            let (device, ends, queue) = (Arc::clone(device), Arc::clone(&ends), Arc::clone(&queue));
            move || {
                let next = || queue.lock().unwrap_or_else(PoisonError::into_inner).next();
                while let Some((wanted, pipeline)) = next().filter(|_| !ends.load(Ordering::Relaxed)) {
                    if let Err(error) = make(&device, wanted, pipeline) {
                        // A step that needs the pipeline reports the error.
                        tracing::debug!("a pipeline of {} was not made ({error})", device.report.name);
                    }
                }
                device.pipelines().save();
            }
        };
        // Without a thread, steps make their pipelines.
        let spawn = |_| std::thread::Builder::new().name("compiles".into()).spawn(work()).ok();
        let threads = (0..count).filter_map(spawn).collect();
        Self { ends, threads }
    }

    pub(super) fn is_over(&self) -> bool {
        self.threads.iter().all(JoinHandle::is_finished)
    }
}

/// Makes a pipeline, unless it was made meanwhile.
pub(super) fn make(device: &Device, wanted: Wanted, pipeline: Pipeline) -> Result<(), EngineError> {
    let maker = {
        let pipelines = device.pipelines();
        if pipelines.known(wanted.module, &wanted.constants).is_some() {
            return Ok(());
        }
        pipelines.maker.clone()
    };
    let raw = maker.make(wanted.module, pipeline.layout, &wanted.constants)?;
    device.count(|counts| counts.pipelines_in_background += 1);
    device.pipelines().insert(wanted, Pipeline { raw, ..pipeline });
    Ok(())
}

impl Drop for Background {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        // Each thread ends after its current pipeline.
        self.threads.drain(..).for_each(|thread| drop(thread.join()));
    }
}
