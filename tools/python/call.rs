//! Calls that take long. The work runs on its own thread. The thread that called waits for it, runs callbacks and
//! checks Python for signals, so ctrl-C ends any call at once. Work that cannot be interrupted is abandoned and ends by
//! itself.

use crate::failure::Answer;
use crate::{forked, warn};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread::{Builder, JoinHandle, sleep};
use std::time::{Duration, Instant};

/// The period of the checks for signals. People notice delays above 100 ms.
const PERIOD: Duration = Duration::from_millis(50);
/// The stack of the work's thread in bytes, as large as the stack of the main thread.
const STACK: usize = 8 << 20;
/// The longest time that the exit of the process waits for abandoned work on a Vulkan device. The driver must not be
/// unloaded while such work runs.
const EXIT_LIMIT: Duration = Duration::from_secs(5);

/// Abandoned calls that use a Vulkan device. Each entry is alive as long as its work runs.
static ABANDONED: Mutex<Vec<Weak<()>>> = Mutex::new(Vec::new());

type Question = Box<dyn FnOnce(Python<'_>) -> PyResult<()> + Send>;

/// The connection from the work to the thread that called.
pub(crate) struct Caller {
    questions: Sender<Question>,
    gone: Arc<AtomicBool>,
}

impl Caller {
    /// Returns whether the caller no longer waits for the result. If so, the work should end early.
    pub(crate) fn is_gone(&self) -> bool {
        self.gone.load(Ordering::Relaxed)
    }

    /// Runs `question` on the caller's thread and returns its answer. Returns `None` if the caller is gone. The
    /// question may also raise an exception, which ends the call and returns `None`.
    pub(crate) fn ask<R: Send + 'static>(
        &self,
        question: impl FnOnce(Python<'_>) -> PyResult<R> + Send + 'static,
    ) -> Option<R> {
        if self.is_gone() {
            return None;
        }
        let (answer, answered) = channel();
        let ask = move |py: Python<'_>| question(py).map(|right| drop(answer.send(right)));
        self.questions.send(Box::new(ask)).ok()?;
        answered.recv().ok()
    }
}

/// The running work of a call whose caller is gone.
pub(crate) struct Rest<T>(JoinHandle<Answer<T>>);

impl<T> Rest<T> {
    /// Waits for the end of the work. The caller has already requested an early end.
    pub(crate) fn finish(self, py: Python<'_>) -> PyResult<T> {
        while !self.0.is_finished() {
            py.detach(|| sleep(PERIOD / 10));
            py.check_signals()?;
        }
        Ok(self.0.join().unwrap_or_else(|panic| resume_unwind(panic))?)
    }
}

/// The way in which a call ended.
pub(crate) enum Outcome<T> {
    Done(T),
    /// A signal handler or a callback raised an exception, and the work may still run.
    Raised(PyErr, Rest<T>),
}

/// Runs work until its end, or until a signal handler or a callback raises an exception. `on_device` is true for work
/// that uses a Vulkan device.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    on_device: bool,
    work: impl FnOnce(&Caller) -> Answer<T> + Send + 'static,
) -> PyResult<T> {
    match start(py, on_device, work)? {
        Outcome::Done(result) => Ok(result),
        Outcome::Raised(error, _) => Err(error),
    }
}

/// Starts work and waits until it ends, or until a signal handler or a callback raises an exception.
pub(crate) fn start<T: Send + 'static>(
    py: Python<'_>,
    on_device: bool,
    work: impl FnOnce(&Caller) -> Answer<T> + Send + 'static,
) -> PyResult<Outcome<T>> {
    warn::listen();
    let (questions, asked) = channel();
    let (gone, runs) = (Arc::new(AtomicBool::new(false)), Arc::new(()));
    let caller = Caller { questions, gone: Arc::clone(&gone) };
    let running = Arc::clone(&runs);
    let run = move || {
        let done = forked::on_live_threads(|| work(&caller));
        drop(running);
        done
    };
    let thread = Builder::new().name("eyebox call".into()).stack_size(STACK).spawn(run);
    let thread = thread.map_err(|e| PyRuntimeError::new_err(format!("a thread to compute on: {e}")))?;
    match listen(py, asked) {
        Ok(()) => Ok(Outcome::Done(py.detach(|| thread.join()).unwrap_or_else(|panic| resume_unwind(panic))?)),
        Err(error) => {
            if on_device {
                ABANDONED.lock().unwrap_or_else(PoisonError::into_inner).push(Arc::downgrade(&runs));
            }
            gone.store(true, Ordering::SeqCst);
            Ok(Outcome::Raised(error, Rest(thread)))
        }
    }
}

/// Answers the questions of the work until the work ends.
fn listen(py: Python<'_>, mut asked: Receiver<Question>) -> PyResult<()> {
    loop {
        let question;
        (asked, question) = py.detach(move || {
            let question = asked.recv_timeout(PERIOD);
            (asked, question)
        });
        if let Err(RecvTimeoutError::Disconnected) = question {
            return Ok(());
        }
        py.check_signals()?;
        if let Ok(question) = question {
            question(py)?;
        }
    }
}

/// Runs when the process exits. It waits for abandoned work on Vulkan devices and removes temporary files.
#[pyfunction]
pub(crate) fn leave(py: Python<'_>) {
    let begun = Instant::now();
    let runs = || ABANDONED.lock().unwrap_or_else(PoisonError::into_inner).iter().any(|run| run.strong_count() > 0);
    py.detach(|| {
        while runs() && begun.elapsed() < EXIT_LIMIT {
            sleep(PERIOD / 10);
        }
        eyebox::files::end_without_drafts(|| ());
    });
}
