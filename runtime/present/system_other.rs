//! Rejects windows on desktops that are not supported.

use super::surface::WindowHandle;
#[cfg(feature = "direct-display")]
pub(super) use super::unobserved::card_number;
pub(super) use super::unobserved::{MISSING, Observer, is_gone, is_wayland, link, survive};
use super::{PresentError, no_desktop};
use eyebox_base::reason;
use winit::event_loop::{EventLoop, EventLoopBuilder};
use winit::window::Window as SystemWindow;

/// Only the main thread may build the event loop.
pub(super) fn event_loop() -> EventLoopBuilder<()> {
    EventLoop::builder()
}

/// Rejects every window of this system.
pub(super) fn handle_of(_: &SystemWindow) -> Result<WindowHandle, PresentError> {
    Err(no_desktop(reason!("window-kind", "windows of this system are not supported: use X11, Wayland or Windows")))
}
