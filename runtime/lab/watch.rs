//! Passes progress to the observer of a long job, who may stop it between any two lists of the engine.

use eyebox::low_level::engine::EngineError;
use eyebox::low_level::quality::QualityError;
use eyebox::low_level::solve::Flow;
use std::sync::{Mutex, PoisonError};

/// Observer of a long job. It receives the name of the current part and the completed share of the job, 0 to 1.
/// [`Flow::Stop`] ends the job with the results until then. The observer is also called before each list of the engine,
/// so that a stop takes effect within a part.
pub type Observe<'a> = dyn FnMut(&str, f64) -> Flow + Send + 'a;

/// Calls the observer for the job and for its engine.
pub(crate) struct JobObserver<'a>(Mutex<Watched<'a>>);

struct Watched<'a> {
    observe: &'a mut Observe<'a>,
    what: String,
    share: f64,
    stopped: bool,
}

impl Watched<'_> {
    fn goes_on(&mut self) -> bool {
        // An observer that stopped the job is not called again.
        self.stopped = self.stopped || (self.observe)(&self.what, self.share) == Flow::Stop;
        !self.stopped
    }
}

impl<'a> JobObserver<'a> {
    pub(crate) fn new(observe: &'a mut Observe<'a>) -> Self {
        Self(Mutex::new(Watched { observe, what: String::new(), share: 0.0, stopped: false }))
    }

    /// Reports the current part and the completed share of the job, 0 to 1. Returns false once the job is stopped.
    pub(crate) fn say(&self, what: &str, share: f64) -> bool {
        let mut watched = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if watched.what != what {
            watched.what = what.to_owned();
        }
        watched.share = share;
        watched.goes_on()
    }

    /// Reports the same progress again. Returns true once the job is stopped.
    pub(crate) fn stops(&self) -> bool {
        !self.0.lock().unwrap_or_else(PoisonError::into_inner).goes_on()
    }

    /// Refuses more work once the job is stopped. Loops that use no engine call it.
    ///
    /// # Errors
    /// Returns [`EngineError::Stopped`] once the job is stopped.
    pub(crate) fn check(&self) -> Result<(), QualityError> {
        if self.stops() { Err(EngineError::Stopped.into()) } else { Ok(()) }
    }

    /// Returns true if the job was stopped.
    pub(crate) fn is_stopped(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).stopped
    }
}

/// Replaces the error of a stopped job by `None`.
pub(crate) fn unless_stopped<T>(result: Result<T, QualityError>) -> Result<Option<T>, QualityError> {
    match result {
        Ok(found) => Ok(Some(found)),
        Err(error) if is_stop(&error) => Ok(None),
        Err(error) => Err(error),
    }
}

fn is_stop(error: &QualityError) -> bool {
    use eyebox::low_level::reconstruction::ReconstructionError;
    use eyebox::low_level::solve::SolveError;
    let engine = match error {
        QualityError::Engine(engine)
        | QualityError::Reconstruction(ReconstructionError::Engine(engine))
        | QualityError::Solve(SolveError::Engine(engine)) => engine,
        _ => return false,
    };
    matches!(engine, EngineError::Stopped)
}
