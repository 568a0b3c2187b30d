//! Adapts the desktop of Windows.

use super::surface::WindowHandle;
#[cfg(feature = "direct-display")]
pub(super) use super::unobserved::card_number;
pub(super) use super::unobserved::{MISSING, Observer, is_gone, is_wayland, link, survive};
use super::{PresentError, no_desktop};
use eyebox_base::reason;
use std::ffi::c_void;
use winit::event_loop::{EventLoop, EventLoopBuilder};
use winit::platform::windows::EventLoopBuilderExtWindows;
use winit::raw_window_handle::{HasWindowHandle, RawWindowHandle};
use winit::window::Window as SystemWindow;

/// A window belongs to the thread that made it. The thread that presents owns the desktop.
pub(super) fn event_loop() -> EventLoopBuilder<()> {
    let mut builder = EventLoop::builder();
    builder.with_any_thread(true);
    builder
}

/// The handle from which Vulkan makes a surface. It is valid while the window lives.
pub(super) fn handle_of(window: &SystemWindow) -> Result<WindowHandle, PresentError> {
    match window.window_handle().map(|handle| handle.as_raw()) {
        Ok(RawWindowHandle::Win32(window)) => Ok(WindowHandle::Win32 {
            instance: window.hinstance.map_or(std::ptr::null_mut(), |i| i.get() as *mut c_void),
            window: window.hwnd.get() as *mut c_void,
        }),
        Ok(_) => Err(no_desktop(reason!("window-kind", "windows of this kind are not supported"))),
        Err(e) => Err(no_desktop(reason!("no-handle", "the window has no handle ({e})"))),
    }
}
