//! Errors of the library as exceptions of Python. Each kind of error has its own class, and the messages stay the same.

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
    "eyebox refused a request or could not complete it. All exceptions of eyebox derive from this class."
);
create_exception!(eyebox, DisplayError, EyeboxError, "An error of the display, or of a pupil in front of it.");
create_exception!(eyebox, SceneError, EyeboxError, "An error of the scene, its file or its views.");
create_exception!(eyebox, SolveError, EyeboxError, "An error of the settings, the solve or the refinement.");
create_exception!(eyebox, HologramError, EyeboxError, "An error of the hologram or its file.");
create_exception!(eyebox, EncodeError, EyeboxError, "An error of the encoding or its input.");
create_exception!(
    eyebox,
    CalibrateError,
    EyeboxError,
    "An error of the bench or its pictures, or of a model that the pictures do not determine."
);
create_exception!(
    eyebox,
    SessionError,
    EyeboxError,
    "An error of the content of a session, its display or its eye tracker."
);
create_exception!(eyebox, EngineError, EyeboxError, "An error of the engine or its device.");

/// An error that becomes an exception of Python.
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

/// Returns the name of the argument with which a message begins, as in `order is "x": it must be ...`.
fn argument(text: &str) -> Option<&str> {
    let (name, rest) = text.split_once(' ')?;
    let is_name = name.chars().all(|c| c.is_ascii_lowercase() || c == '_');
    let follows = ["is ", "has ", "of "].iter().any(|verb| rest.starts_with(verb));
    (is_name && follows).then_some(name)
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        let said = failure.to_string();
        let data = ErrorData::of(&failure);
        let argument = match &failure {
            Failure::Argument(text) => argument(text).map(str::to_owned),
            _ => None,
        };
        // Python code expects a number here, and a text without a unit is of the wrong type.
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
        // An exception without these attributes still has its message.
        Python::attach(|py| {
            let exception = error.value(py);
            let _ = exception.setattr("code", data.code);
            if let Some(argument) = argument {
                let _ = exception.setattr("argument", argument);
            }
            let fields = serde_json::Value::Object(data.fields).to_string();
            let _ = py
                .import("json")
                .and_then(|json| json.call_method1("loads", (fields,)))
                .map(|fields| exception.setattr("fields", fields));
        });
        error
    }
}

/// The result of a call of the library.
pub(crate) type Answer<T> = Result<T, Failure>;
