//! The library's errors as Python's exceptions: its sentences, by the room that said them.

use eyebox::error::ErrorData;
use eyebox::low_level::quantity::QuantityError;
use eyebox::optics::OpticsError;
use eyebox::produce::ProduceError;
use eyebox::reconstruction::ReconstructionError;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::types::PyAnyMethods;
use pyo3::{PyErr, Python, create_exception};
use serde::Serialize;

create_exception!(
    eyebox,
    EyeboxError,
    PyValueError,
    "What eyebox refuses, or could not do. All of its own exceptions are this one."
);
create_exception!(eyebox, DisplayError, EyeboxError, "The display, or a pupil before it.");
create_exception!(eyebox, SceneError, EyeboxError, "The scene, its file or its views.");
create_exception!(eyebox, SolveError, EyeboxError, "The settings, or the solve or refinement that they ask for.");
create_exception!(eyebox, HologramError, EyeboxError, "The hologram, or its file.");
create_exception!(eyebox, EncodeError, EyeboxError, "The encoding, or what is to be encoded.");
create_exception!(eyebox, CalibrateError, EyeboxError, "The bench, its pictures, or what they do not tell.");
create_exception!(
    eyebox,
    SessionError,
    EyeboxError,
    "What is shown, the display that it is shown on, or the eye tracker."
);
create_exception!(eyebox, EngineError, EyeboxError, "The engine or its device.");

/// What went wrong, on its way to Python.
#[derive(Debug, thiserror::Error, Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
pub(crate) enum Failure {
    #[error("{0}")]
    Argument(String),
    #[error(transparent)]
    Quantity(#[from] QuantityError),
    #[error(transparent)]
    Optics(#[from] OpticsError),
    #[error(transparent)]
    Scene(#[from] eyebox::scene::SceneError),
    #[error(transparent)]
    Produce(#[from] ProduceError),
    #[error(transparent)]
    Solve(#[from] eyebox::solve::SolveError),
    #[error(transparent)]
    Hologram(#[from] eyebox::hologram::HologramError),
    #[error(transparent)]
    Evaluate(#[from] eyebox::reconstruction::EvaluateError),
    #[error(transparent)]
    Calibrate(#[from] eyebox::calibrate::CalibrateError),
    #[error(transparent)]
    Encode(#[from] eyebox::encode::EncodeError),
    #[error(transparent)]
    Engine(#[from] eyebox::engine::EngineError),
    #[error(transparent)]
    Session(eyebox::session::SessionError),
    #[error(
        "at step {0} the loss is no finite number, and the step was not taken: take smaller gains or rates, or storage = \"fp32\""
    )]
    NotFinite(usize),
    #[error(
        "{what}: this process was forked after eyebox had been used in its parent. {remedy}, or start processes by \
         multiprocessing.get_context(\"spawn\")"
    )]
    Forked { what: &'static str, remedy: &'static str },
}

impl From<ReconstructionError> for Failure {
    fn from(error: ReconstructionError) -> Self {
        error.unwrapped()
    }
}

impl From<eyebox::session::SessionError> for Failure {
    fn from(error: eyebox::session::SessionError) -> Self {
        use eyebox::session::SessionError as OfSession;
        match error {
            OfSession::Hologram(error) => Self::Hologram(error),
            OfSession::Encode(error) => Self::Encode(error),
            OfSession::Engine(error) => Self::Engine(error),
            OfSession::Solve(error) => Self::Solve(error),
            error => Self::Session(error),
        }
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        use eyebox::hologram::HologramError as OfHologram;
        let said = failure.to_string();
        let data = ErrorData::of(&failure);
        let error = match failure {
            // A text without a unit is no number to Python.
            Failure::Quantity(QuantityError::NotANumber { .. } | QuantityError::NoUnit { .. }) => {
                PyTypeError::new_err(said)
            }
            Failure::Argument(_) | Failure::Quantity(_) => PyValueError::new_err(said),
            Failure::Optics(_)
            | Failure::Produce(ProduceError::Optics(_))
            | Failure::Hologram(OfHologram::Optics(_) | OfHologram::NoDisplay | OfHologram::DisplayNotFound { .. }) => {
                DisplayError::new_err(said)
            }
            Failure::Scene(_)
            | Failure::Produce(ProduceError::Scene(_))
            | Failure::Hologram(
                OfHologram::Scene(_)
                | OfHologram::OtherScene { .. }
                | OfHologram::ChangedScene { .. }
                | OfHologram::SceneNotFound { .. }
                | OfHologram::NoScene { .. }
                | OfHologram::OtherSize { .. },
            ) => SceneError::new_err(said),
            Failure::Engine(_) | Failure::Forked { .. } | Failure::Produce(ProduceError::Engine(_)) => {
                EngineError::new_err(said)
            }
            Failure::Produce(_) | Failure::Solve(_) | Failure::NotFinite(_) => SolveError::new_err(said),
            Failure::Hologram(_) | Failure::Evaluate(_) => HologramError::new_err(said),
            Failure::Calibrate(_) => CalibrateError::new_err(said),
            Failure::Session(_) => SessionError::new_err(said),
            Failure::Encode(_) => EncodeError::new_err(said),
        };
        // An exception without these attributes still has its sentence.
        Python::attach(|py| {
            let exception = error.value(py);
            let _ = exception.setattr("code", data.code);
            let fields = serde_json::Value::Object(data.fields).to_string();
            let _ = py
                .import("json")
                .and_then(|json| json.call_method1("loads", (fields,)))
                .map(|fields| exception.setattr("fields", fields));
        });
        error
    }
}

/// What the library answers.
pub(crate) type Answer<T> = Result<T, Failure>;
