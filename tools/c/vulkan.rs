//! Engines on a Vulkan device that the caller opened and keeps.

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

/// A function of the caller that uses the queue. `user` is the pointer that `eyebox_engine_with_queue` received. The
/// function must not throw. It must not call eyebox with the same engine, or with a refiner or session that computes on
/// it.
pub type EyeboxUse = Option<extern "C" fn(user: *mut c_void)>;

/// Converts a pointer to a handle of Vulkan, and refuses null.
fn handle<T: Handle>(at: *mut c_void, what: &'static str) -> Result<T, Failure> {
    if at.is_null() {
        return Err(Failure::Null(what));
    }
    Ok(T::from_raw(at as u64))
}

/// Makes an engine on the caller's own Vulkan device. The types of the handles `instance`, `physical_device`, `device`
/// and `queue` are VkInstance, VkPhysicalDevice, VkDevice and VkQueue. The queue belongs to `queue_family`, which must
/// support VK_QUEUE_COMPUTE_BIT. The instance and the device must have Vulkan 1.2 or newer
/// (VkApplicationInfo::apiVersion). The device must be made with the feature timelineSemaphore
/// (VkPhysicalDeviceVulkan12Features), and needs no extension.
///
/// eyebox checks the limits, the version, the queue family, and the results of small transforms. It cannot check the
/// enabled features, because Vulkan does not report them. Without timelineSemaphore the calls are undefined.
///
/// The caller keeps the device and its instance. Both must exist until the engine, and all refiners and sessions that
/// were made with it, are freed. Until then the caller may use the queue only within `eyebox_engine_with_queue`. Free
/// the engine with `eyebox_engine_free`.
///
/// Fails with EYEBOX_STATUS_ENGINE if the device is not suitable. eyebox does not reopen a lost device, and later calls
/// fail with EYEBOX_STATUS_ENGINE.
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
                // SAFETY: The library named Vulkan on this machine is trusted, because the caller's handles come from
                // it.
                entry: unsafe { ash::Entry::load() }
                    .map_err(|e| EngineError::NoDevice { reason: format!("Vulkan's loader: {e}") })?,
                instance_extensions: Vec::new(),
                device_extensions: Vec::new(),
                family: queue_family,
            };
            // SAFETY: The header requires handles that belong together and exist as long as the engine.
            let gpu = unsafe { Gpu::from_raw(raw, None) }?;
            EyeboxEngine::on(Backend::on_device(gpu)?)
        })
    })
}

/// Calls `with(user)` once, while eyebox does not use the queue of the engine's device. In `with` the caller may submit
/// its own work to the queue. It runs on the calling thread, before this function returns. Fails with
/// EYEBOX_STATUS_ARGUMENT if the engine computes on the CPU.
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
