//! The command `eyebox`, which the package installs. Its code is the command's own, so both behave the same.

use pyo3::prelude::*;
use std::ffi::OsString;

/// Runs the command with its arguments, the first of which is the name of the program. Returns the exit code. A process
/// runs it once.
#[pyfunction]
pub(crate) fn command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| eyebox_command::main(arguments))
}
