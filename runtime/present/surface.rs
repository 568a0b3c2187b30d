//! Makes the Vulkan surface of a window of a desktop, or of a display that no desktop drives.

#![allow(unsafe_code)]

use super::timing::SurfaceTimes;
use ash::{ext, khr, vk};
use eyebox_compute::gpu::presentation::{
    FIRST_PIXEL_OUT, FIRST_PIXEL_VISIBLE, PRESENT_ID2, PRESENT_TIMING, PRESENT_WAIT2, SurfacePresentId2,
    SurfacePresentTiming, SurfacePresentWait2,
};
use eyebox_compute::gpu::{Device, EngineError, Instance};
use std::ffi::{CStr, c_void};
use std::fs::File;
use std::sync::Arc;

/// A window of the system, with the handles of its library.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub enum WindowHandle {
    /// A window of an X server, with the handles of XCB.
    Xcb {
        /// The connection, an `xcb_connection_t *`.
        connection: *mut c_void,
        /// The XCB number of the window.
        window: u32,
    },
    /// A window of an X server, with the handles of Xlib.
    Xlib {
        /// The connection, a `Display *` of Xlib.
        display: *mut c_void,
        /// The Xlib number of the window.
        window: u64,
    },
    /// A window of a Wayland compositor.
    Wayland {
        /// The connection, a `wl_display *` of Wayland.
        display: *mut c_void,
        /// The surface, a `wl_surface *` of Wayland.
        surface: *mut c_void,
    },
    /// A window of Windows.
    Win32 {
        /// The module, an `HINSTANCE` of Windows.
        instance: *mut c_void,
        /// The window, an `HWND` of Windows.
        window: *mut c_void,
    },
}

/// An acquired display. It is released when this is dropped, before its instance.
pub(super) struct TakenDisplay {
    pub(super) physical: vk::PhysicalDevice,
    pub(super) display: vk::DisplayKHR,
    pub(super) info: vk::DisplaySurfaceCreateInfoKHR<'static>,
    pub(super) calls: khr::display::Instance,
    pub(super) release: Option<ext::direct_mode_display::Instance>,
    /// The card through which the display was acquired. It stays open while the display is used.
    #[allow(dead_code)]
    pub(super) card: Option<File>,
}

impl Drop for TakenDisplay {
    fn drop(&mut self) {
        if let Some(release) = &self.release {
            // SAFETY: surfaces on it are destroyed before, and a display that was not taken is not changed.
            let _ = unsafe { (release.fp().release_display_ext)(self.physical, self.display) };
        }
    }
}

pub(super) enum Target {
    Window(WindowHandle),
    #[cfg_attr(not(feature = "direct-display"), expect(dead_code, reason = "only direct.rs makes it"))]
    Direct(TakenDisplay),
}

impl Target {
    /// The extension of the instance that makes surfaces of the target.
    fn extension(&self) -> &'static CStr {
        match self {
            Self::Window(WindowHandle::Xcb { .. }) => khr::xcb_surface::NAME,
            Self::Window(WindowHandle::Xlib { .. }) => khr::xlib_surface::NAME,
            Self::Window(WindowHandle::Wayland { .. }) => khr::wayland_surface::NAME,
            Self::Window(WindowHandle::Win32 { .. }) => khr::win32_surface::NAME,
            Self::Direct(_) => khr::display::NAME,
        }
    }

    /// # Safety
    /// The instance has the extension of this kind of target, and a window's handles are valid.
    unsafe fn surface(&self, instance: &Instance) -> Result<vk::SurfaceKHR, vk::Result> {
        let (entry, raw) = (&instance.entry, &instance.raw);
        // SAFETY: the caller guarantees this. Plane, mode and display of a direct one were chosen together.
        unsafe {
            match self {
                Self::Direct(display) => display.calls.create_display_plane_surface(&display.info, None),
                Self::Window(WindowHandle::Xcb { connection, window }) => {
                    let info = vk::XcbSurfaceCreateInfoKHR::default().connection(connection.cast()).window(*window);
                    khr::xcb_surface::Instance::new(entry, raw).create_xcb_surface(&info, None)
                }
                Self::Window(WindowHandle::Xlib { display, window }) => {
                    let info = vk::XlibSurfaceCreateInfoKHR::default().dpy(display.cast()).window(*window as _);
                    khr::xlib_surface::Instance::new(entry, raw).create_xlib_surface(&info, None)
                }
                Self::Window(WindowHandle::Wayland { display, surface }) => {
                    let info =
                        vk::WaylandSurfaceCreateInfoKHR::default().display(display.cast()).surface(surface.cast());
                    khr::wayland_surface::Instance::new(entry, raw).create_wayland_surface(&info, None)
                }
                Self::Window(WindowHandle::Win32 { instance, window }) => {
                    let info = vk::Win32SurfaceCreateInfoKHR::default().hinstance(*instance as _).hwnd(*window as _);
                    khr::win32_surface::Instance::new(entry, raw).create_win32_surface(&info, None)
                }
            }
        }
    }
}

/// A surface. It is dropped after the swapchain on it and before the display is released.
pub(super) struct Surface {
    pub(super) raw: vk::SurfaceKHR,
    calls: khr::surface::Instance,
    target: Target,
    instance: Arc<Instance>,
}

impl Surface {
    /// Makes a surface on a target.
    ///
    /// # Errors
    /// [`EngineError::Unsuitable`] if the instance was not opened to present, or [`EngineError::Vulkan`].
    ///
    /// # Safety
    /// A window's handles are valid, and stay valid as long as the surface lives.
    pub(super) unsafe fn new(instance: &Arc<Instance>, target: Target) -> Result<Self, EngineError> {
        let extension = target.extension();
        if !instance.has(extension) {
            let reason =
                format!("{} is off: the device was not opened to present pictures", extension.to_string_lossy());
            return Err(EngineError::Unsuitable { device: "Vulkan".into(), reason });
        }
        let calls = khr::surface::Instance::new(&instance.entry, &instance.raw);
        // SAFETY: the instance has the extension, and the caller vouches for the handles.
        let raw = unsafe { target.surface(instance) }
            .map_err(|e| EngineError::vulkan("the display", "surface", "making a surface", e))?;
        Ok(Self { raw, calls, target, instance: Arc::clone(instance) })
    }

    /// True if a queue of this family can present on the surface.
    pub(super) fn shows(&self, physical: vk::PhysicalDevice, family: u32) -> bool {
        let only = self.display().map(|(only, _)| only);
        // SAFETY: the device is of the surface's instance, and has the family.
        let shows = || unsafe { self.calls.get_physical_device_surface_support(physical, family, self.raw) };
        only.is_none_or(|only| only == physical) && shows().unwrap_or(false)
    }

    /// The display of the surface and the only device that drives it. It is none on a desktop.
    pub(super) fn display(&self) -> Option<(vk::PhysicalDevice, vk::DisplayKHR)> {
        match &self.target {
            Target::Window(_) => None,
            Target::Direct(display) => Some((display.physical, display.display)),
        }
    }

    /// The current capabilities of the surface.
    pub(super) fn capabilities(&self, physical: vk::PhysicalDevice) -> Result<vk::SurfaceCapabilitiesKHR, vk::Result> {
        // SAFETY: the device is of the surface's instance.
        unsafe { self.calls.get_physical_device_surface_capabilities(physical, self.raw) }
    }

    /// The support of the surface for times of light, as far as the device enables the extensions.
    pub(super) fn times(&self, device: &Device) -> SurfaceTimes {
        let mut id2 = SurfacePresentId2::default();
        let mut wait2 = SurfacePresentWait2::default();
        let mut timing = SurfacePresentTiming::default();
        let mut can = vk::SurfaceCapabilities2KHR::default();
        if !device.has(PRESENT_ID2) {
            return SurfaceTimes::default();
        }
        can = can.push_next(&mut id2);
        if device.has(PRESENT_WAIT2) {
            can = can.push_next(&mut wait2);
        }
        if device.has(PRESENT_TIMING) {
            can = can.push_next(&mut timing);
        }
        let calls = khr::get_surface_capabilities2::Instance::new(&self.instance.entry, &self.instance.raw);
        let info = vk::PhysicalDeviceSurfaceInfo2KHR::default().surface(self.raw);
        // SAFETY: The device is of the surface's instance, which has the extension, because the device's extensions
        // need it.
        let asked = unsafe { calls.get_physical_device_surface_capabilities2(device.physical, &info, &mut can) };
        if asked.is_err() || id2.supported == vk::FALSE {
            return SurfaceTimes::default();
        }
        let stages = if timing.supported == vk::TRUE { timing.stages } else { 0 };
        let stage = [FIRST_PIXEL_VISIBLE, FIRST_PIXEL_OUT].into_iter().find(|stage| stages & stage != 0);
        SurfaceTimes { wait2: wait2.supported == vk::TRUE, stage }
    }

    /// The format whose levels are the bytes. Drivers list sRGB formats first, which would change the levels.
    pub(super) fn plain_format(
        &self,
        physical: vk::PhysicalDevice,
    ) -> Result<Option<vk::SurfaceFormatKHR>, vk::Result> {
        // SAFETY: the device is of the surface's instance.
        let formats = unsafe { self.calls.get_physical_device_surface_formats(physical, self.raw) }?;
        let plain = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM];
        let is =
            |f: &vk::SurfaceFormatKHR| plain.contains(&f.format) && f.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR;
        Ok(formats.into_iter().find(is))
    }

    /// The present modes, which define how pictures follow each other.
    pub(super) fn present_modes(&self, physical: vk::PhysicalDevice) -> Result<Vec<vk::PresentModeKHR>, vk::Result> {
        // SAFETY: the device is of the surface's instance.
        unsafe { self.calls.get_physical_device_surface_present_modes(physical, self.raw) }
    }

    /// Makes the surface again on the same target, if that is still there.
    ///
    /// # Safety
    /// No object that was made of the old surface exists any more.
    pub(super) unsafe fn recreate(&mut self) -> Result<(), vk::Result> {
        // SAFETY: the caller guarantees this, and the target is unchanged.
        unsafe {
            self.calls.destroy_surface(self.raw, None);
            self.raw = vk::SurfaceKHR::null();
            self.raw = self.target.surface(&self.instance)?;
        }
        Ok(())
    }

    /// The message for users that the surface is lost.
    pub(super) fn gone(&self) -> &'static str {
        match self.target {
            Target::Window(_) => "the window's surface is gone: it was closed, or the display was unplugged",
            Target::Direct(_) => "the display is gone: it was unplugged, or another program took it",
        }
    }

    /// Leaves the surface to the end of the process, because a swapchain on it stays.
    pub(super) fn leave(&mut self) {
        self.raw = vk::SurfaceKHR::null();
    }
}

impl Drop for Surface {
    fn drop(&mut self) {
        // SAFETY: swapchains on it are gone, and a null handle is ignored.
        unsafe { self.calls.destroy_surface(self.raw, None) };
    }
}
