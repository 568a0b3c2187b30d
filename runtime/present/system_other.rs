//! Desktops whose windows are not known here.

use super::surface::WindowHandle;
#[cfg(feature = "direct-display")]
pub(super) use super::unobserved::card_number;
pub(super) use super::unobserved::{MISSING, Observer, is_gone, survive};
use super::{PresentError, no_desktop};
use eyebox_base::reason;
use winit::event_loop::{EventLoop, EventLoopBuilder};
use winit::window::Window as SystemWindow;

/// Only the main thread may build it.
pub(super) fn event_loop() -> EventLoopBuilder<()> {
    EventLoop::builder()
}

/// Refuses every window.
pub(super) fn handle_of(_: &SystemWindow) -> Result<WindowHandle, PresentError> {
    Err(no_desktop(reason!(
        "window-kind",
        "windows of this system are not known here: those of X11, Wayland and Windows are"
    )))
}
