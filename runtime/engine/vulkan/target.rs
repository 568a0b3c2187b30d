//! What a screen shows on: a window of a desktop, or a display that no desktop drives.

use super::direct::Direct;
use crate::gpu::Instance;
use ash::{khr, vk};
use std::ffi::{CStr, c_void};

/// A window of the system's, as its own library names it.
#[derive(Debug, Clone, Copy)]
pub enum WindowHandle {
    /// Of an X server, by XCB.
    Xcb {
        /// `xcb_connection_t *`.
        connection: *mut c_void,
        /// The window.
        window: u32,
    },
    /// Of an X server, by Xlib.
    Xlib {
        /// `Display *`.
        display: *mut c_void,
        /// The window.
        window: u64,
    },
    /// Of a Wayland compositor.
    Wayland {
        /// `wl_display *`.
        display: *mut c_void,
        /// `wl_surface *`.
        surface: *mut c_void,
    },
}

impl WindowHandle {
    /// The extension that makes surfaces of it.
    pub(super) fn extension(&self) -> &'static CStr {
        match self {
            Self::Xcb { .. } => khr::xcb_surface::NAME,
            Self::Xlib { .. } => khr::xlib_surface::NAME,
            Self::Wayland { .. } => khr::wayland_surface::NAME,
        }
    }
}

/// What a surface is made of.
pub(super) enum Target {
    Window(WindowHandle),
    Direct(Direct),
}

impl Target {
    /// A surface on it.
    ///
    /// # Safety
    /// The instance has the extension of this kind of target, and the window's handles are valid.
    pub(super) unsafe fn surface(&self, instance: &Instance) -> Result<vk::SurfaceKHR, vk::Result> {
        // SAFETY: the caller says so.
        unsafe {
            match self {
                Self::Window(window) => make_surface(instance, *window),
                Self::Direct(direct) => direct.surface(),
            }
        }
    }

    /// The only device that can show on it, and its display.
    pub(super) fn direct(&self) -> Option<(vk::PhysicalDevice, vk::DisplayKHR)> {
        match self {
            Self::Window(_) => None,
            Self::Direct(direct) => Some((direct.physical, direct.display)),
        }
    }

    /// For people: that there is no surface on it any more.
    pub(super) fn gone(&self) -> &'static str {
        match self {
            Self::Window(_) => "the window's surface is gone: it was closed, or the display was unplugged",
            Self::Direct(_) => "the display is gone: it was unplugged, or another program took it",
        }
    }
}

/// A surface on a window.
///
/// # Safety
/// The instance has the extension of this kind of window, and its handles are valid.
pub(super) unsafe fn make_surface(instance: &Instance, window: WindowHandle) -> Result<vk::SurfaceKHR, vk::Result> {
    let (entry, raw) = (&instance.entry, &instance.raw);
    // SAFETY: the caller says so.
    unsafe {
        match window {
            WindowHandle::Xcb { connection, window } => khr::xcb_surface::Instance::new(entry, raw).create_xcb_surface(
                &vk::XcbSurfaceCreateInfoKHR::default().connection(connection.cast()).window(window),
                None,
            ),
            WindowHandle::Xlib { display, window } => khr::xlib_surface::Instance::new(entry, raw).create_xlib_surface(
                &vk::XlibSurfaceCreateInfoKHR::default().dpy(display.cast()).window(window as _),
                None,
            ),
            WindowHandle::Wayland { display, surface } => khr::wayland_surface::Instance::new(entry, raw)
                .create_wayland_surface(
                    &vk::WaylandSurfaceCreateInfoKHR::default().display(display.cast()).surface(surface.cast()),
                    None,
                ),
        }
    }
}
