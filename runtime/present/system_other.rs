//! Desktops whose windows are not known here.

use super::surface::WindowHandle;
use super::{Interference, Monitor, PresentError, no_desktop};
#[cfg(feature = "direct-display")]
use std::fs::File;
use winit::event_loop::{EventLoop, EventLoopBuilder};
use winit::raw_window_handle::HasDisplayHandle;
use winit::window::Window as SystemWindow;

/// What to do where there is no desktop.
pub(super) const MISSING: &str = "log in to one";

/// Only the main thread may build it.
pub(super) fn event_loop() -> EventLoopBuilder<()> {
    EventLoop::builder()
}

/// Refuses every window.
pub(super) fn handle_of(_: &SystemWindow) -> Result<WindowHandle, PresentError> {
    Err(no_desktop("windows of this system are not known here: those of X11, Wayland and Windows are".into()))
}

/// Nothing is known of it.
pub(super) fn is_gone() -> bool {
    false
}

/// Reads what interferes with an output, which this system does not report.
pub(super) struct Observer;

impl Observer {
    pub(super) fn open(_: &Monitor) -> Option<Self> {
        None
    }

    pub(super) fn look(&self) -> Vec<Interference> {
        Vec::new()
    }
}

/// There is nothing to be done.
pub(super) fn survive(_: &impl HasDisplayHandle) {}

/// Cards are no files.
#[cfg(feature = "direct-display")]
pub(super) fn card_number(_: &File) -> i32 {
    -1
}
