//! Systems whose outputs are not observed: the same answers for all of them.

use super::{Interference, Monitor};
#[cfg(feature = "direct-display")]
use std::fs::File;
use winit::raw_window_handle::HasDisplayHandle;

/// What to do where there is no desktop.
pub(super) const MISSING: &str = "log in to one";

/// Reads what interferes with an output, which these systems do not report.
pub(super) struct Observer;

impl Observer {
    pub(super) fn open(_: &Monitor) -> Option<Self> {
        None
    }

    pub(super) fn look(&self) -> Vec<Interference> {
        Vec::new()
    }
}

/// Whether the desktop went away, which these systems do not report.
pub(super) fn is_gone() -> bool {
    false
}

/// Nothing ends a program whose desktop goes away.
pub(super) fn survive(_: &impl HasDisplayHandle) {}

/// Cards are no files.
#[cfg(feature = "direct-display")]
pub(super) fn card_number(_: &File) -> i32 {
    -1
}
