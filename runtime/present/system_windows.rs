//! The desktop of Windows.

use super::surface::WindowHandle;
use super::{Interference, Monitor, PresentError, no_desktop};
use std::ffi::c_void;
#[cfg(feature = "direct-display")]
use std::fs::File;
use winit::event_loop::{EventLoop, EventLoopBuilder};
use winit::platform::windows::EventLoopBuilderExtWindows;
use winit::raw_window_handle::{HasDisplayHandle, HasWindowHandle, RawWindowHandle};
use winit::window::Window as SystemWindow;

/// What to do where there is no desktop.
pub(super) const MISSING: &str = "log in to one";

/// Windows belong to the thread that made them: who presents owns the desktop.
pub(super) fn event_loop() -> EventLoopBuilder<()> {
    let mut builder = EventLoop::builder();
    builder.with_any_thread(true);
    builder
}

/// What Vulkan makes a surface of. It is good for as long as the window lives.
pub(super) fn handle_of(window: &SystemWindow) -> Result<WindowHandle, PresentError> {
    match window.window_handle().map(|handle| handle.as_raw()) {
        Ok(RawWindowHandle::Win32(window)) => Ok(WindowHandle::Win32 {
            instance: window.hinstance.map_or(std::ptr::null_mut(), |i| i.get() as *mut c_void),
            window: window.hwnd.get() as *mut c_void,
        }),
        Ok(_) => Err(no_desktop("windows of this kind are not known here".into())),
        Err(e) => Err(no_desktop(format!("the window has no handle ({e})"))),
    }
}

/// The desktop is always there.
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
