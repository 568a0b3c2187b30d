//! Finds, acquires and releases displays that no desktop drives (`VK_KHR_display`).
//!
//! No other program is between their video frames and the SLM.
//!
//! Drivers hardly name these displays. On Linux the kernel's number of a connector leads to a display
//! (`VK_EXT_acquire_drm_display`). To acquire one requires the card itself, which no other program may drive at that
//! time. Therefore a desktop must release the connector, or not run. If a driver has no such extension, the displays
//! that it lists can be used without acquisition.

#![allow(unsafe_code)]

use super::connectors::{Connector, connectors};
use super::link::{Link, console};
use super::modes::{DirectDisplay, DirectMode, choose};
use super::surface::{TakenDisplay, Target};
use super::swapchain::{Policy, Swapchain};
use super::system::card_number;
use super::{DisplayPresenter, PresentError, Rate, RealClock};
use ash::{ext, khr, vk};
use eyebox_compute::gpu::{EngineError, Gpu, Instance, has};
use std::fs::{File, OpenOptions};
use std::path::Path;
use std::sync::Arc;

/// The folder in which the kernel lists connectors.
const CLASSES: &str = "/sys/class/drm";

fn refused(reason: impl ToString) -> PresentError {
    PresentError::display("direct display", reason.to_string())
}

struct Handles {
    physical: vk::PhysicalDevice,
    display: vk::DisplayKHR,
    modes: Vec<vk::DisplayModeKHR>,
    /// The card through which the display is acquired.
    card: Option<File>,
}

/// The displays that no desktop drives, as every driver lists them.
///
/// # Errors
/// [`PresentError::Display`] if no driver supports such displays.
pub fn direct_displays() -> Result<Vec<DirectDisplay>, PresentError> {
    let instance = Instance::open(false, true).map_err(refused)?;
    Displays::of(&Arc::new(instance)).map(|all| all.found).map_err(refused)
}

/// Checks the link to a display without a desktop, for a mode of these rows and columns.
pub fn direct_link(display: &DirectDisplay, size: [usize; 2]) -> Link {
    console::link(Path::new(CLASSES), &display.name, size)
}

impl DisplayPresenter {
    /// Takes the display that `wanted` names by its index, its connector or its monitor, in a mode of exactly this
    /// size. Without a name, it takes the first display with such a mode. The presenter uses this device, or the device
    /// of its instance that drives the display (see [`gpu`](Self::gpu)).
    ///
    /// # Errors
    /// [`PresentError::Display`] with a sentence, if there is none, it has no such mode, or another program drives it.
    pub fn direct(
        gpu: &Gpu,
        wanted: Option<&str>,
        size: [usize; 2],
        rate: Option<Rate>,
        clock: RealClock,
    ) -> Result<Self, PresentError> {
        let all = Displays::of(&gpu.device.instance).map_err(refused)?;
        let (index, mode) =
            choose(&all.found, wanted, size, rate).map_err(|r| PresentError::display("direct display", r))?;
        let found = all.found[index].clone();
        let rate = Rate::from_hz(f64::from(found.modes[mode].millihertz) / 1000.0).ok();
        let taken = all.acquire(index, mode).map_err(refused)?;
        let link = console::link(Path::new(CLASSES), &found.name, size);
        // SAFETY: no window is concerned.
        let swapchain = unsafe { Swapchain::on(gpu, Target::Direct(taken), Policy::Exact(size)) }.map_err(refused)?;
        Ok(Self::on_display(swapchain, format!("display {found}"), rate, clock, Some(link)))
    }
}

struct Displays {
    found: Vec<DirectDisplay>,
    handles: Vec<Handles>,
    calls: khr::display::Instance,
    acquire: Option<ext::acquire_drm_display::Instance>,
    release: Option<ext::direct_mode_display::Instance>,
    instance: Arc<Instance>,
}

impl Displays {
    fn of(instance: &Arc<Instance>) -> Result<Self, EngineError> {
        if !instance.has(khr::display::NAME) {
            return Err(EngineError::NoDevice { reason: "no driver has VK_KHR_display".into() });
        }
        let (entry, raw) = (&instance.entry, &instance.raw);
        let calls = khr::display::Instance::new(entry, raw);
        let release = instance.has(ext::direct_mode_display::NAME);
        let release = release.then(|| ext::direct_mode_display::Instance::new(entry, raw));
        let acquire = release.is_some() && instance.has(ext::acquire_drm_display::NAME);
        let acquire = acquire.then(|| ext::acquire_drm_display::Instance::new(entry, raw));
        let (found, handles, instance) = (Vec::new(), Vec::new(), Arc::clone(instance));
        let mut all = Self { found, handles, calls, acquire, release, instance };
        let plugged = connectors(Path::new(CLASSES), Path::new("/dev/dri"));
        // SAFETY: the instance is valid.
        let devices = unsafe { all.instance.raw.enumerate_physical_devices() }.unwrap_or_default();
        devices.into_iter().for_each(|device| all.ask(device, &plugged));
        Ok(all)
    }

    fn ask(&mut self, physical: vk::PhysicalDevice, plugged: &[Connector]) {
        // SAFETY: the device is of this instance, which has the extension, and a driver's name ends in zero.
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
            // SAFETY: the card is open, and a driver that does not drive it answers with an error.
            let display = unsafe { acquire.get_drm_display(physical, card_number(&card), id) };
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
        let index = self.found.len();
        self.found.push(DirectDisplay { index, name, monitor, device, size, modes });
        let modes = listed.iter().map(|m| m.display_mode).collect();
        self.handles.push(Handles { physical, display, modes, card });
    }

    /// Acquires one of the found displays, in one of its modes.
    fn acquire(mut self, index: usize, mode: usize) -> Result<TakenDisplay, EngineError> {
        let found = self.found.swap_remove(index);
        let handles = self.handles.swap_remove(index);
        let refused = |reason: String| EngineError::Unsuitable { device: format!("display '{}'", found.name), reason };
        let Handles { physical, display, modes, card } = handles;
        if let (Some(acquire), Some(card)) = (&self.acquire, &card) {
            // SAFETY: the card is open and stays open as long as the display is used.
            unsafe { acquire.acquire_drm_display(physical, card_number(card), display) }.map_err(|e| {
                refused(format!(
                    "it could not be acquired ({e:?}): another program, such as a desktop, drives its card, or this \
                     one has no permission. Leave the desktop, or release the connector from it"
                ))
            })?;
        }
        let mut taken = TakenDisplay {
            physical,
            display,
            info: vk::DisplaySurfaceCreateInfoKHR::default(),
            calls: self.calls.clone(),
            release: self.release.take(),
            card,
        };
        let [height, width] = found.modes[mode].size.map(|n| n as u32);
        let plane = self.plane(physical, display, modes[mode], vk::Extent2D { width, height });
        taken.info = plane
            .ok_or_else(|| refused("no plane shows opaque pictures of the mode's size: choose another mode".into()))?;
        Ok(taken)
    }

    /// A plane that shows opaque pictures of this size without a change.
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
            // SAFETY: as above, and the plane is one of the device's.
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
