//! Displays that no desktop drives (`VK_KHR_display`): found, acquired, and given back.
//!
//! Drivers hardly name them. On Linux a connector's name becomes a display through the kernel's number of it
//! (`VK_EXT_acquire_drm_display`), and acquiring one needs the card itself, which nobody else may drive at that time: a
//! desktop must leave the connector alone, or not run. Where a driver has no such extension, the displays that it lists
//! itself can be used without asking.

use super::super::EngineError;
use super::connectors::{Connector, connectors};
use super::screen::Screen;
use super::target::Target;
use crate::gpu::{Instance, has};
use ash::{ext, khr, vk};
use std::fs::{File, OpenOptions};
use std::path::Path;

/// A mode of a display.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DirectMode {
    /// Rows, columns.
    pub size: [usize; 2],
    /// Video frames in 1000 seconds.
    pub millihertz: u32,
}

/// A display as a driver lists it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundDisplay {
    /// The connector's, or what the driver calls it.
    pub name: String,
    /// What the monitor calls itself, where it is known.
    pub monitor: Option<String>,
    /// The driver's device.
    pub device: String,
    /// Rows, columns that it has.
    pub size: [usize; 2],
    /// Its modes, in the driver's order.
    pub modes: Vec<DirectMode>,
}

#[cfg(unix)]
fn number(card: &File) -> i32 {
    std::os::fd::AsRawFd::as_raw_fd(card)
}

#[cfg(not(unix))]
fn number(_: &File) -> i32 {
    -1
}

struct Handles {
    physical: vk::PhysicalDevice,
    display: vk::DisplayKHR,
    modes: Vec<vk::DisplayModeKHR>,
    /// The card through which it is acquired.
    card: Option<File>,
}

/// All of them, with the instance that knows them.
pub struct DirectDisplays {
    found: Vec<FoundDisplay>,
    handles: Vec<Handles>,
    calls: khr::display::Instance,
    acquire: Option<ext::acquire_drm_display::Instance>,
    release: Option<ext::direct_mode_display::Instance>,
    // Goes last.
    instance: Instance,
}

impl DirectDisplays {
    /// Asks every driver.
    ///
    /// # Errors
    /// [`EngineError::NoDevice`] where no driver knows of such displays.
    pub fn open(validation: bool) -> Result<Self, EngineError> {
        let all = [
            khr::surface::NAME,
            khr::display::NAME,
            ext::direct_mode_display::NAME,
            ext::acquire_drm_display::NAME,
            // What the fence at the first pixel needs.
            ext::display_surface_counter::NAME,
        ];
        // The last ones where they are there.
        let opened = [5, 3, 2].into_iter().map(|n| (n, Instance::with(validation, &all[..n])));
        let mut last = None;
        for (count, instance) in opened {
            match instance {
                Ok(instance) => return Ok(Self::on(instance, count)),
                Err(e) => last = Some(e),
            }
        }
        Err(last.unwrap_or_else(|| EngineError::NoDevice { reason: "no driver has VK_KHR_display".into() }))
    }

    fn on(instance: Instance, count: usize) -> Self {
        let (entry, raw) = (&instance.entry, &instance.raw);
        let calls = khr::display::Instance::new(entry, raw);
        let release = (count >= 3).then(|| ext::direct_mode_display::Instance::new(entry, raw));
        let acquire = (count >= 5).then(|| ext::acquire_drm_display::Instance::new(entry, raw));
        let mut all = Self { found: Vec::new(), handles: Vec::new(), calls, acquire, release, instance };
        let plugged = connectors(Path::new("/sys/class/drm"), Path::new("/dev/dri"));
        // SAFETY: the instance is valid.
        let devices = unsafe { all.instance.raw.enumerate_physical_devices() }.unwrap_or_default();
        devices.into_iter().for_each(|device| all.ask(device, &plugged));
        all
    }

    fn ask(&mut self, physical: vk::PhysicalDevice, plugged: &[Connector]) {
        // SAFETY: the device is of this instance, which has the extension; a driver's name ends in zero.
        let (properties, extensions, listed) = unsafe {
            let listed = self.calls.get_physical_device_display_properties(physical).unwrap_or_default();
            let name = |l: &vk::DisplayPropertiesKHR<'_>| {
                l.display_name_as_c_str().map_or_else(|| "display".into(), |n| n.to_string_lossy().into_owned())
            };
            (
                self.instance.raw.get_physical_device_properties(physical),
                self.instance.raw.enumerate_device_extension_properties(physical).unwrap_or_default(),
                listed.iter().map(|l| (l.display, l.physical_resolution, name(l))).collect::<Vec<_>>(),
            )
        };
        if !has(&extensions, khr::swapchain::NAME) {
            return;
        }
        let device = properties.device_name_as_c_str().map_or_else(|_| String::new(), |n| n.to_string_lossy().into());
        let mut seen = Vec::new();
        for connector in plugged {
            let (Some(acquire), Some(id)) = (&self.acquire, connector.id) else { continue };
            let Ok(card) = OpenOptions::new().read(true).write(true).open(&connector.card) else { continue };
            // SAFETY: the card is open; a driver that does not drive it answers with an error.
            let display = unsafe { acquire.get_drm_display(physical, number(&card), id) };
            let Some(display) = display.ok().filter(|d| *d != vk::DisplayKHR::null()) else { continue };
            seen.push(display);
            let found = (connector.name.clone(), connector.monitor.clone(), device.clone());
            let size = listed.iter().find(|l| l.0 == display).map(|l| l.1);
            self.add(found, physical, display, size, Some(card));
        }
        for (display, size, name) in listed {
            if !seen.contains(&display) {
                self.add((name, None, device.clone()), physical, display, Some(size), None);
            }
        }
    }

    fn add(
        &mut self,
        (name, monitor, device): (String, Option<String>, String),
        physical: vk::PhysicalDevice,
        display: vk::DisplayKHR,
        size: Option<vk::Extent2D>,
        card: Option<File>,
    ) {
        // SAFETY: the display is the device's.
        let listed = unsafe { self.calls.get_display_mode_properties(physical, display) }.unwrap_or_default();
        let sized = |e: vk::Extent2D| [e.height as usize, e.width as usize];
        let modes: Vec<DirectMode> = listed
            .iter()
            .map(|m| DirectMode { size: sized(m.parameters.visible_region), millihertz: m.parameters.refresh_rate })
            .collect();
        let size = size.map(sized).or_else(|| modes.iter().map(|m| m.size).max()).unwrap_or_default();
        self.found.push(FoundDisplay { name, monitor, device, size, modes });
        let modes = listed.iter().map(|m| m.display_mode).collect();
        self.handles.push(Handles { physical, display, modes, card });
    }

    /// What was found.
    pub fn found(&self) -> &[FoundDisplay] {
        &self.found
    }

    /// Takes one of what was found, in one of its modes, and shows on it.
    ///
    /// # Errors
    /// [`EngineError::Unsuitable`] where another program drives it, and where it cannot show bytes as they are;
    /// [`EngineError::Vulkan`].
    pub fn screen(mut self, index: usize, mode: usize) -> Result<Screen, EngineError> {
        let gone = || EngineError::NoDevice { reason: format!("there is no display {index} with a mode {mode}") };
        let found = self.found.get(index).cloned().ok_or_else(gone)?;
        let handles = self.handles.swap_remove(index);
        let (handle, chosen) = handles.modes.get(mode).zip(found.modes.get(mode)).ok_or_else(gone)?;
        let refused = |reason: String| EngineError::Unsuitable { device: format!("display '{}'", found.name), reason };
        let Handles { physical, display, ref card, .. } = handles;
        if let (Some(acquire), Some(card)) = (&self.acquire, card) {
            // SAFETY: the card is open and stays open as long as the display is used.
            unsafe { acquire.acquire_drm_display(physical, number(card), display) }.map_err(|e| {
                refused(format!(
                    "it could not be taken ({e:?}): another program drives its card, such as a desktop, or this one may \
                     not; leave the desktop, or take the connector from it"
                ))
            })?;
        }
        let mut direct = Direct {
            physical,
            display,
            info: vk::DisplaySurfaceCreateInfoKHR::default(),
            calls: self.calls.clone(),
            release: self.release.take(),
            _card: handles.card,
        };
        let [height, width] = chosen.size.map(|n| n as u32);
        direct.info = self.plane(physical, display, *handle, vk::Extent2D { width, height }).ok_or_else(|| {
            refused("none of its planes shows opaque pictures of the mode's size: choose another mode".into())
        })?;
        let size = chosen.size;
        // SAFETY: the instance has the extension of this target.
        unsafe { Screen::on(self.instance, Target::Direct(direct), size) }
    }

    /// A plane that shows opaque pictures of this size, as they are.
    fn plane(
        &self,
        physical: vk::PhysicalDevice,
        display: vk::DisplayKHR,
        mode: vk::DisplayModeKHR,
        extent: vk::Extent2D,
    ) -> Option<vk::DisplaySurfaceCreateInfoKHR<'static>> {
        // SAFETY: device, display and mode belong together.
        let planes = unsafe { self.calls.get_physical_device_display_plane_properties(physical) }.unwrap_or_default();
        planes.iter().enumerate().find_map(|(index, plane)| {
            let index = index as u32;
            // SAFETY: as above; the plane is one of the device's.
            let (shows, can) = unsafe {
                (
                    self.calls.get_display_plane_supported_displays(physical, index).unwrap_or_default(),
                    self.calls.get_display_plane_capabilities(physical, mode, index).ok()?,
                )
            };
            let free = plane.current_display == vk::DisplayKHR::null() || plane.current_display == display;
            let (least, most) = (can.min_dst_extent, can.max_dst_extent);
            let fits = (least.width..=most.width).contains(&extent.width)
                && (least.height..=most.height).contains(&extent.height);
            let alpha = vk::DisplayPlaneAlphaFlagsKHR::OPAQUE;
            (free && fits && shows.contains(&display) && can.supported_alpha.contains(alpha)).then(|| {
                vk::DisplaySurfaceCreateInfoKHR::default()
                    .display_mode(mode)
                    .plane_index(index)
                    .plane_stack_index(plane.current_stack_index)
                    .transform(vk::SurfaceTransformFlagsKHR::IDENTITY)
                    .global_alpha(1.0)
                    .alpha_mode(alpha)
                    .image_extent(extent)
            })
        })
    }
}

/// A display that was taken; given back when it is dropped, before its instance.
pub(super) struct Direct {
    pub(super) physical: vk::PhysicalDevice,
    pub(super) display: vk::DisplayKHR,
    info: vk::DisplaySurfaceCreateInfoKHR<'static>,
    calls: khr::display::Instance,
    release: Option<ext::direct_mode_display::Instance>,
    _card: Option<File>,
}

impl Direct {
    /// # Safety
    /// The instance lives.
    pub(super) unsafe fn surface(&self) -> Result<vk::SurfaceKHR, vk::Result> {
        // SAFETY: the caller says so; plane, mode and display were chosen together.
        unsafe { self.calls.create_display_plane_surface(&self.info, None) }
    }
}

impl Drop for Direct {
    fn drop(&mut self) {
        if let Some(release) = &self.release {
            // SAFETY: surfaces on it are destroyed before; one that was not taken is not changed.
            let _ = unsafe { (release.fp().release_display_ext)(self.physical, self.display) };
        }
    }
}
