//! Replaces the observer on systems whose outputs are not observed.

use super::link::{Link, LinkSystem};
use super::{Interference, Monitor};
#[cfg(feature = "direct-display")]
use std::fs::File;
use winit::raw_window_handle::HasDisplayHandle;
use winit::window::Window as SystemWindow;

/// The remedy for a missing desktop.
pub(super) const MISSING: &str = "log in to one";

/// Reads the interference with an output, which these systems do not report.
pub(super) struct Observer(Link);

impl Observer {
    pub(super) fn open(monitor: &Monitor, _: &SystemWindow) -> Option<Self> {
        Some(Self(link(monitor)?))
    }

    /// The link at the beginning.
    pub(super) fn link(&self) -> &Link {
        &self.0
    }

    pub(super) fn look(&self) -> Vec<Interference> {
        Vec::new()
    }
}

/// The link to a monitor, of which these systems report nothing.
pub(super) fn link(monitor: &Monitor) -> Option<Link> {
    Some(Link::unknown(LinkSystem::Other, Some(monitor.name.clone())))
}

/// These systems are not Wayland.
pub(super) fn is_wayland(_: &impl HasDisplayHandle) -> bool {
    false
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
