//! Adapts the desktops of X11 and Wayland.
//!
//! `system_windows` and `system_other` have the same functions for other systems.

use super::surface::WindowHandle;
pub(super) use super::x_observer::{Observer, link};
pub(super) use super::x_server::{is_gone, survive};
use super::{PresentError, no_desktop};
use eyebox_base::reason;
#[cfg(feature = "direct-display")]
use std::fs::File;
use winit::event_loop::{EventLoop, EventLoopBuilder};
use winit::platform::{wayland::EventLoopBuilderExtWayland, x11::EventLoopBuilderExtX11};
use winit::raw_window_handle::{HasDisplayHandle, HasWindowHandle, RawDisplayHandle, RawWindowHandle};
use winit::window::Window as SystemWindow;

/// True if the desktop is a Wayland compositor.
pub(super) fn is_wayland(desktop: &impl HasDisplayHandle) -> bool {
    desktop.display_handle().is_ok_and(|handle| matches!(handle.as_raw(), RawDisplayHandle::Wayland(_)))
}

/// The remedy for a missing desktop.
pub(super) const MISSING: &str = "set DISPLAY or WAYLAND_DISPLAY";

/// X11 and Wayland have no main thread. The thread that presents owns the desktop.
pub(super) fn event_loop() -> EventLoopBuilder<()> {
    let mut builder = EventLoop::builder();
    EventLoopBuilderExtX11::with_any_thread(&mut builder, true);
    EventLoopBuilderExtWayland::with_any_thread(&mut builder, true);
    builder
}

/// The number of an open graphics card for drivers.
#[cfg(feature = "direct-display")]
pub(super) fn card_number(card: &File) -> i32 {
    std::os::fd::AsRawFd::as_raw_fd(card)
}

/// The handle from which Vulkan makes a surface. It is valid while the window lives.
pub(super) fn handle_of(window: &SystemWindow) -> Result<WindowHandle, PresentError> {
    let gone =
        |e: winit::raw_window_handle::HandleError| no_desktop(reason!("no-handle", "the window has no handle ({e})"));
    let (window, display) = (window.window_handle().map_err(gone)?, window.display_handle().map_err(gone)?);
    match (window.as_raw(), display.as_raw()) {
        (RawWindowHandle::Xlib(window), RawDisplayHandle::Xlib(display)) => {
            let display =
                display.display.ok_or_else(|| no_desktop(reason!("no-handle", "the X display has no handle")))?;
            // This uses XCB, because every driver accepts it and not every driver accepts Xlib.
            let library = x11_dl::xlib_xcb::Xlib_xcb::open()
                .map_err(|e| no_desktop(reason!("no-library", "libX11-xcb could not be loaded ({e})")))?;
            // SAFETY: the display is the window's, which lives.
            #[allow(unsafe_code)]
            let connection = unsafe { (library.XGetXCBConnection)(display.as_ptr().cast()) };
            Ok(WindowHandle::Xcb { connection, window: window.window as u32 })
        }
        (RawWindowHandle::Wayland(window), RawDisplayHandle::Wayland(display)) => {
            Ok(WindowHandle::Wayland { display: display.display.as_ptr(), surface: window.surface.as_ptr() })
        }
        _ => Err(no_desktop(reason!("window-kind", "windows of this system are not supported: use X11 or Wayland"))),
    }
}
