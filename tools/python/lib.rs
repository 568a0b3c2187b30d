//! The extension module under the Python package `eyebox`: docs/python.md is how it is used, `eyebox/__init__.py` what people
//! call.
//!
//! Arguments are made plain in Python (`eyebox/_arguments.py`: arrays of any order and kind, names, settings), results are made
//! comfortable there; this crate converts and passes on, what it can do is the crate `eyebox`'s. The interpreter's lock is
//! released while anything is computed, and taken back for callbacks and signals alone.

// Phases are lent to NumPy where they lie: hologram.rs.
#![deny(unsafe_op_in_unsafe_fn)]

mod arrays;
mod calibrate;
mod call;
mod display;
mod engine;
mod failure;
mod far_field;
mod forked;
mod frames;
mod hologram;
mod pupil;
mod quantity;
mod refiner;
mod scene;
mod sequence;
mod session;
mod solve;
mod told;
mod warn;

use pyo3::prelude::*;

/// The extension module.
#[pymodule]
mod _eyebox {
    #[pymodule_export]
    use crate::arrays::linear_light;
    #[pymodule_export]
    use crate::calibrate::calibrate;
    #[pymodule_export]
    use crate::call::leave;
    #[pymodule_export]
    use crate::display::{Display, presets};
    #[pymodule_export]
    use crate::engine::Engine;
    #[pymodule_export]
    use crate::failure::{
        CalibrateError, DisplayError, EncodeError, EngineError, EyeboxError, HologramError, SceneError, SessionError,
        SolveError,
    };
    #[pymodule_export]
    use crate::far_field::FarField;
    #[pymodule_export]
    use crate::hologram::Hologram;
    #[pymodule_export]
    use crate::quantity::{depth, quantity, size};
    #[pymodule_export]
    use crate::refiner::Refiner;
    #[pymodule_export]
    use crate::scene::Scene;
    #[pymodule_export]
    use crate::sequence::Sequence;
    #[pymodule_export]
    use crate::session::Session;
    #[pymodule_export]
    use crate::solve::{Unfinished, solve};
    #[pymodule_export]
    use crate::warn::take_warnings;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn about(module: &Bound<'_, PyModule>) -> PyResult<()> {
        crate::warn::listen();
        // The package's own Python code raises these exceptions too.
        let base = module.py().get_type::<EyeboxError>();
        base.setattr("code", "")?;
        base.setattr("fields", pyo3::types::PyDict::new(module.py()))?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
