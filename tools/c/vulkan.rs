//! A Vulkan device that the caller opened, and keeps.

use crate::arrays::hand_over;
use crate::failure::{Failure, answer, starts_threads};
use crate::{EyeboxEngine, EyeboxStatus};
use eyebox::engine::Backend;
use eyebox::engine::EngineError;
use eyebox::gpu::Gpu;
use eyebox::low_level::gpu::RawDevice;
use eyebox::low_level::gpu::ash::vk::Handle;
use eyebox::low_level::gpu::ash::{self, vk};
use std::ffi::c_void;
use std::mem::MaybeUninit;

/// What a caller does with its queue, with the pointer that was given to `eyebox_engine_with_queue`. It must not throw, nor call eyebox
/// with that engine or anything that computes on it.
pub type EyeboxUse = Option<extern "C" fn(user: *mut c_void)>;

/// A handle of Vulkan's that is a pointer, which must not be null.
fn handle<T: Handle>(at: *mut c_void, what: &'static str) -> Result<T, Failure> {
    if at.is_null() {
        return Err(Failure::Null(what));
    }
    Ok(T::from_raw(at as u64))
}

/// An engine on the caller's own Vulkan device. `instance`, `physical_device`, `device` and `queue` are VkInstance, VkPhysicalDevice,
/// VkDevice and VkQueue; the queue is one of `queue_family`, which computes (VK_QUEUE_COMPUTE_BIT). The instance and the device are
/// of Vulkan 1.2 or newer (VkApplicationInfo::apiVersion), and the device was made with the feature timelineSemaphore
/// (VkPhysicalDeviceVulkan12Features); no extension is needed. What Vulkan tells is looked at: limits, the version, whether the
/// family computes, and whether small transforms come out right. Which features are on it tells nobody: without that one the
/// calls are undefined. The device and its instance stay the caller's, and must stand until the engine, and all that was made
/// with it (refiners, sessions), are freed. Until then the caller makes use of the queue within `eyebox_engine_with_queue`
/// alone. A device that is lost is not opened anew: calls fail with EYEBOX_STATUS_ENGINE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_engine_vulkan_device(
    instance: *mut c_void,
    physical_device: *mut c_void,
    device: *mut c_void,
    queue_family: u32,
    queue: *mut c_void,
    engine: Option<&mut MaybeUninit<*mut EyeboxEngine>>,
) -> EyeboxStatus {
    answer(|| {
        starts_threads();
        hand_over(engine, || {
            let raw = RawDevice {
                instance: handle(instance, "instance")?,
                physical: handle(physical_device, "physical_device")?,
                device: handle(device, "device")?,
                queue: handle::<vk::Queue>(queue, "queue")?,
                // SAFETY: what is called Vulkan on this machine is trusted to be Vulkan: the caller's handles came of it.
                entry: unsafe { ash::Entry::load() }
                    .map_err(|e| EngineError::NoDevice { reason: format!("Vulkan's loader: {e}") })?,
                instance_extensions: Vec::new(),
                device_extensions: Vec::new(),
                family: queue_family,
            };
            // SAFETY: the header asks callers for handles that belong together and stand as long as the engine.
            let gpu = unsafe { Gpu::from_raw(raw, None) }?;
            EyeboxEngine::on(Backend::on_device(gpu)?)
        })
    })
}

/// Calls `with` (`user`) while nothing of eyebox makes use of the queue of an engine's device: for what the caller submits there itself.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_engine_with_queue(
    engine: Option<&EyeboxEngine>,
    with: EyeboxUse,
    user: *mut c_void,
) -> EyeboxStatus {
    answer(|| {
        let engine = engine.ok_or(Failure::Null("engine"))?;
        let with = with.ok_or(Failure::Null("with"))?;
        let on_the_cpu = || Failure::argument("engine", "one on the CPU", "one on a Vulkan device");
        engine.backend.gpu()?.ok_or_else(on_the_cpu)?.with_queue(|_| with(user));
        Ok(())
    })
}
