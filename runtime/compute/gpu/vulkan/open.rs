//! Opens a device, or takes over one from the program.

use super::counters::Counts;
use super::device::{Device, Handle, Queue};
use super::devices::{Candidate, candidates, choose, inspect};
use super::error::EngineError;
use super::instance::{Instance, Messages};
use super::report::{DeviceKind, DeviceReport, Options};
use crate::plan::Recording;
use ash::vk;
use std::ffi::CString;
use std::path::Path;
use std::sync::{Arc, PoisonError};

/// A handle of an open Vulkan device. Clones share the device.
#[derive(Clone)]
pub struct Gpu {
    /// The device, shared by everything on it.
    pub device: Arc<Device>,
    options: Options,
}

/// A device that a program opened itself, for [`Gpu::from_raw`].
pub struct RawDevice {
    /// The loader from which the instance was made.
    pub entry: ash::Entry,
    /// The instance, of Vulkan 1.2 or newer.
    pub instance: vk::Instance,
    /// Enabled extensions of the instance.
    pub instance_extensions: Vec<CString>,
    /// The physical device of `device`.
    pub physical: vk::PhysicalDevice,
    /// The device, with the feature `timelineSemaphore` enabled.
    pub device: vk::Device,
    /// Enabled extensions of the device.
    pub device_extensions: Vec<CString>,
    /// The family of the queue. It computes, and draws if pictures are presented.
    pub family: u32,
    /// The queue of that family.
    pub queue: vk::Queue,
}

impl Gpu {
    /// Opens the device that the options name, or the best one.
    ///
    /// # Errors
    /// [`EngineError::NoDevice`] without a loader, a driver or a device of that name. [`EngineError::Unsuitable`] if
    /// the device cannot run the kernels.
    pub fn open(options: &Options) -> Result<Self, EngineError> {
        let instance = Arc::new(Instance::open(options.validation, options.present)?);
        let all = candidates(&instance, options.present)?;
        let chosen = choose(all, options.device.as_deref(), options.allow_cpu)?;
        Self::on(&instance, chosen, options)
    }

    pub(super) fn on(instance: &Arc<Instance>, chosen: Candidate, options: &Options) -> Result<Self, EngineError> {
        let device = Device::new(instance, chosen, options)?;
        let DeviceReport { name, driver, api, .. } = &device.report;
        tracing::debug!("{name}: opened, driver {driver}, Vulkan {api}");
        Ok(Self { device, options: options.clone() })
    }

    /// Takes over a device that the program opened and keeps. Neither it nor its instance is destroyed here. `cache`
    /// is the folder of compiled pipelines, by default the user's.
    ///
    /// # Errors
    /// [`EngineError::Unsuitable`] if it cannot run the kernels.
    ///
    /// # Safety
    /// The handles are valid and belong together. They stay so until the last clone of this, and everything made from
    /// it, is dropped. The listed extensions are the enabled ones. With `VK_KHR_synchronization2`,
    /// `VK_KHR_present_id`, `VK_KHR_present_wait`, their second versions and `VK_EXT_present_timing`, their features are
    /// enabled too. The queue is of that family, and
    /// the program uses it only within [`with_queue`](Self::with_queue).
    pub unsafe fn from_raw(raw: RawDevice, cache: Option<&Path>) -> Result<Self, EngineError> {
        let RawDevice { entry, instance, instance_extensions, physical, device, device_extensions, family, queue } =
            raw;
        // SAFETY: the caller vouches for the handles.
        let instance = unsafe { Instance::from_raw(entry, instance, instance_extensions) };
        let Candidate { report, family: computes, .. } = inspect(&instance, 0, physical, Some(family));
        let reason = match &report.usable {
            Err(reason) => Some(reason.clone()),
            Ok(()) if computes != family => Some(format!("its queue family {family} does not compute")),
            Ok(()) => None,
        };
        if let Some(reason) = reason {
            return Err(EngineError::Unsuitable { device: report.name, reason });
        }
        // SAFETY: as above.
        let raw = unsafe { ash::Device::load(instance.raw.fp_v1_0(), device) };
        let options =
            Options { cache: cache.map(Path::to_owned), present: true, allow_cpu: true, ..Options::default() };
        let (raw, queues) = (Handle::new(raw, false), (Queue::new(family, queue), None));
        let device = Device::of(&Arc::new(instance), raw, physical, queues, device_extensions, report, &options)?;
        Ok(Self { device, options })
    }

    /// Returns this device if `shows` accepts it for a surface and a queue family. Otherwise this opens the same device
    /// with a queue family that it accepts, or the best other device.
    pub fn that_shows(&self, shows: impl Fn(vk::PhysicalDevice, u32) -> bool) -> Result<Self, EngineError> {
        let device = &self.device;
        if device.has(ash::khr::swapchain::NAME) && shows(device.physical, device.present().family) {
            return Ok(self.clone());
        }
        let all = candidates(&device.instance, true)?.into_iter().filter_map(|c| c.that_shows(&shows));
        // The same device with a queue of another family is better than another device.
        let best = all.min_by_key(|c| (c.raw != device.physical, c.report.kind)).ok_or_else(|| {
            EngineError::NoDevice { reason: "no Vulkan device can show pictures in a window of this system".into() }
        })?;
        Self::on(&device.instance, best, &self.options)
    }

    /// Returns the report of the device.
    pub fn report(&self) -> &DeviceReport {
        &self.device.report
    }

    /// Returns true if it stopped answering. Everything made from it fails, and another device must be opened.
    pub fn is_lost(&self) -> bool {
        self.device.is_lost()
    }

    /// Returns true if views of content are drawn on the device. A software device leaves them to the host, whose kernels
    /// take a twentieth of the time.
    pub fn draws_views(&self) -> bool {
        self.device.planned_as != DeviceKind::Cpu
    }

    /// Returns true if both are one device.
    pub fn is(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.device, &other.device)
    }

    /// Returns the validation layer's messages, from the opening of the device to its closing, if the options enabled
    /// it. Keep the list to read the last messages.
    pub fn messages(&self) -> Messages {
        Arc::clone(&self.device.instance.messages)
    }

    /// Returns the work on the device since it was opened.
    pub fn counts(&self) -> Counts {
        self.device.counts()
    }

    /// Calls `with` and returns its recorded work, on a device that only records ([`Options::record_only`]). On other
    /// devices the recording is empty.
    pub fn recorded<R>(&self, with: impl FnOnce() -> R) -> (R, Recording) {
        let recording = || self.device.recording.lock().unwrap_or_else(PoisonError::into_inner);
        *recording() = Some(Recording::default());
        let result = with();
        (result, recording().take().unwrap_or_default())
    }

    /// Calls `with` with the queue of the kernels, which nobody else uses until it returns.
    pub fn with_queue<R>(&self, with: impl FnOnce(vk::Queue) -> R) -> R {
        with(*self.device.compute.lock())
    }
}
