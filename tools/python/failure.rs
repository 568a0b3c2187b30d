//! The library's errors as Python's exceptions: its sentences, by the room that said them.

use crate::quantity::QuantityError;
use eyebox::ErrorKind;
use eyebox::error::ErrorData;
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
    Quantity(QuantityError),
    #[error(transparent)]
    Library(eyebox::Error),
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

impl<E: Into<eyebox::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Library(error.into())
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        let said = failure.to_string();
        let data = ErrorData::of(&failure);
        // A text without a unit is no number to Python.
        let no_unit =
            matches!(failure, Failure::Quantity(QuantityError::NotANumber { .. } | QuantityError::NoUnit { .. }));
        let kind = match failure {
            Failure::Argument(_) | Failure::Quantity(_) => None,
            Failure::Library(error) => Some(error.kind()),
            Failure::NotFinite(_) => Some(ErrorKind::Solve),
            Failure::Forked { .. } => Some(ErrorKind::Engine),
        };
        let error = match kind {
            None if no_unit => PyTypeError::new_err(said),
            None => PyValueError::new_err(said),
            Some(ErrorKind::Display) => DisplayError::new_err(said),
            Some(ErrorKind::Scene) => SceneError::new_err(said),
            Some(ErrorKind::Solve) => SolveError::new_err(said),
            Some(ErrorKind::Hologram | ErrorKind::File) => HologramError::new_err(said),
            Some(ErrorKind::Encode) => EncodeError::new_err(said),
            Some(ErrorKind::Calibrate) => CalibrateError::new_err(said),
            Some(ErrorKind::Session) => SessionError::new_err(said),
            Some(ErrorKind::Engine) => EngineError::new_err(said),
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
