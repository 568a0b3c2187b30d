//! What Vulkan makes a surface of, of a window that winit made.

use super::surface::WindowHandle;
use super::{PresentError, no_desktop};
use winit::raw_window_handle::{HasDisplayHandle, HasWindowHandle, RawDisplayHandle, RawWindowHandle};
use winit::window::Window as SystemWindow;

/// It is good for as long as the window lives.
pub(super) fn handle_of(window: &SystemWindow) -> Result<WindowHandle, PresentError> {
    let gone = |e: winit::raw_window_handle::HandleError| no_desktop(format!("the window has no handle ({e})"));
    let (window, display) = (window.window_handle().map_err(gone)?, window.display_handle().map_err(gone)?);
    match (window.as_raw(), display.as_raw()) {
        (RawWindowHandle::Xlib(window), RawDisplayHandle::Xlib(display)) => {
            let display = display.display.ok_or_else(|| no_desktop("the X display has no handle".into()))?;
            // XCB, for every driver takes that, and not every one Xlib.
            let library = x11_dl::xlib_xcb::Xlib_xcb::open()
                .map_err(|e| no_desktop(format!("libX11-xcb could not be loaded ({e})")))?;
            // SAFETY: the display is the window's, which lives.
            #[allow(unsafe_code)]
            let connection = unsafe { (library.XGetXCBConnection)(display.as_ptr().cast()) };
            Ok(WindowHandle::Xcb { connection, window: window.window as u32 })
        }
        (RawWindowHandle::Wayland(window), RawDisplayHandle::Wayland(display)) => {
            Ok(WindowHandle::Wayland { display: display.display.as_ptr(), surface: window.surface.as_ptr() })
        }
        _ => Err(no_desktop("windows of this system are not known here: X11 and Wayland are".into())),
    }
}
