//! The extension module under the Python package `eyebox`. docs/python.md describes its use, and `eyebox/__init__.py`
//! has the public names.
//!
//! `eyebox/_arguments.py` converts arguments, such as arrays of any order and kind, names and settings. The package
//! wraps results in Python classes. This crate converts values and calls the crate `eyebox`, which does the work. A
//! computation releases the lock of the interpreter. Only callbacks and checks for signals take it back.

#![deny(unsafe_op_in_unsafe_fn)]

mod arrays;
mod calibrate;
mod call;
mod camera;
mod command;
mod display;
mod engine;
mod failure;
mod far_field;
mod forked;
mod forward;
mod frames;
mod hologram;
mod internals;
mod layers;
mod measured;
mod plan;
mod pupil;
mod pupils;
mod quantity;
mod refiner;
mod scene;
mod scene_state;
mod score;
mod sequence;
mod session;
mod solve;
mod stored_picture;
mod told;
mod warn;

use pyo3::prelude::*;

/// The extension module, which the package `eyebox` imports.
#[pymodule]
mod _eyebox {
    #[pymodule_export]
    use crate::arrays::{linear_light, png};
    #[pymodule_export]
    use crate::calibrate::calibrate;
    #[pymodule_export]
    use crate::call::leave;
    #[pymodule_export]
    use crate::camera::camera_steps;
    #[pymodule_export]
    use crate::command::command;
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
    use crate::forward::ForwardModel;
    #[pymodule_export]
    use crate::hologram::Hologram;
    #[pymodule_export]
    use crate::layers::layer_views;
    #[pymodule_export]
    use crate::measured::{contact, measured};
    #[pymodule_export]
    use crate::plan::plan;
    #[pymodule_export]
    use crate::pupils::{paper_pupils, random_pupils};
    #[pymodule_export]
    use crate::quantity::{depth, quantity, size};
    #[pymodule_export]
    use crate::refiner::Refiner;
    #[pymodule_export]
    use crate::scene::Scene;
    #[pymodule_export]
    use crate::scene_state::{scene_of_state, scene_state};
    #[pymodule_export]
    use crate::score::score;
    #[pymodule_export]
    use crate::sequence::Sequence;
    #[pymodule_export]
    use crate::session::Session;
    #[pymodule_export]
    use crate::solve::{Unfinished, solve};
    #[pymodule_export]
    use crate::stored_picture::read_picture;
    #[pymodule_export]
    use crate::warn::take_warnings;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn about(module: &Bound<'_, PyModule>) -> PyResult<()> {
        // Python code of the package raises these exceptions too, so the class has defaults of the attributes.
        let base = module.py().get_type::<EyeboxError>();
        base.setattr("code", "")?;
        base.setattr("fields", pyo3::types::PyDict::new(module.py()))?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
