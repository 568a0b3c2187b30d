//! Replaces the observer on systems whose outputs are not observed.

use super::{Interference, Monitor};
#[cfg(feature = "direct-display")]
use std::fs::File;
use winit::raw_window_handle::HasDisplayHandle;

/// The remedy for a missing desktop.
pub(super) const MISSING: &str = "log in to one";

/// Reads the interference with an output, which these systems do not report.
pub(super) struct Observer;

impl Observer {
    pub(super) fn open(_: &Monitor) -> Option<Self> {
        None
    }

    pub(super) fn look(&self) -> Vec<Interference> {
        Vec::new()
    }
}

/// True if the desktop is gone, which these systems do not report.
pub(super) fn is_gone() -> bool {
    false
}

/// On these systems the loss of the desktop ends no program.
pub(super) fn survive(_: &impl HasDisplayHandle) {}

/// Cards are no files on these systems.
#[cfg(feature = "direct-display")]
pub(super) fn card_number(_: &File) -> i32 {
    -1
}
