//! Opens the logical device and holds its shared queues, allocator, pipelines and counters.

use super::counters::Counts;
use super::devices::Candidate;
use super::error::EngineError;
use super::instance::Instance;
use super::modules::FloatModes;
use super::pipelines::{Pipeline, Pipelines, Wanted};
use super::presentation;
use super::report::{DeviceKind, DeviceReport, Options};
use super::tested::Record;
use crate::plan::Recording;
use ash::{khr, vk};
use eyebox_spirv::Module;
use gpu_allocator::AllocationSizes;
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use rayon::prelude::*;
use std::ffi::{CStr, CString};
use std::ops::Deref;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A queue, which one thread at a time uses.
pub struct Queue {
    pub family: u32,
    raw: Mutex<vk::Queue>,
}

impl Queue {
    pub(crate) fn new(family: u32, raw: vk::Queue) -> Self {
        Self { family, raw: Mutex::new(raw) }
    }

    /// Locks the queue for as long as the guard lives.
    pub fn lock(&self) -> MutexGuard<'_, vk::Queue> {
        self.raw.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The longest times of a submission, nanoseconds. After them the device counts as lost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Patience {
    /// Drivers reset hardware that takes longer. Software is slow, and nothing resets it.
    pub(crate) usual_ns: u64,
    /// The time if a pipeline runs for the first time. Software and devices of virtual machines may compile it only
    /// then, for minutes.
    pub(crate) first_use_ns: u64,
}

impl Patience {
    pub(crate) fn ns(self, is_first_use: bool) -> u64 {
        if is_first_use { self.first_use_ns.max(self.usual_ns) } else { self.usual_ns }
    }
}

/// Vulkan's device, destroyed with this value unless a program keeps it.
pub struct Handle {
    raw: ash::Device,
    owned: bool,
}

impl Handle {
    pub(crate) fn new(raw: ash::Device, owned: bool) -> Self {
        Self { raw, owned }
    }
}

impl Deref for Handle {
    type Target = ash::Device;

    fn deref(&self) -> &ash::Device {
        &self.raw
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        if self.owned {
            // SAFETY: everything on the device holds it, so all of that is gone, and its submissions are over. The
            // device was made here, and is destroyed once.
            unsafe {
                let _ = self.raw.device_wait_idle();
                self.raw.destroy_device(None);
            }
        }
    }
}

/// The shared device. Everything on it holds it, so that it is dropped last.
pub struct Device {
    // Fields are dropped in this order, first objects on the device, then the device, then its instance.
    pipelines: Mutex<Pipelines>,
    allocator: Mutex<Allocator>,
    /// Vulkan's handle of the device.
    pub raw: Handle,
    /// Vulkan's handle of the physical device.
    pub physical: vk::PhysicalDevice,
    /// The queue for kernels.
    pub(crate) compute: Queue,
    /// The queue for pictures, if it is another one.
    other: Option<Queue>,
    /// The families of both queues, or one if they are equal.
    families: Vec<u32>,
    pub(crate) synchronization2: Option<khr::synchronization2::Device>,
    /// The properties of the device.
    pub report: DeviceReport,
    counts: Mutex<Counts>,
    /// The kind of device that lists are recorded for.
    pub planned_as: DeviceKind,
    /// The largest range that the driver accepts. Without execution, lists are recorded as if larger ones were
    /// possible.
    pub(crate) storage_range: u64,
    /// True if everything is recorded and nothing runs.
    pub(crate) record_only: bool,
    /// The recording, while someone needs it.
    pub(crate) recording: Mutex<Option<Recording>>,
    /// True if the device passed its test. `record` stores that.
    pub(crate) is_tested: Mutex<bool>,
    pub(crate) record: Option<Record>,
    lost: AtomicBool,
    /// True if the device does not answer, and may still work on its submissions.
    stuck: AtomicBool,
    /// The number of recorders with a submission in flight whose pipelines run for the first time.
    pub(crate) first_uses: AtomicUsize,
    extensions: Vec<CString>,
    /// The instance of the device.
    pub instance: Arc<Instance>,
}

impl Device {
    /// Opens the chosen device.
    pub(crate) fn new(
        instance: &Arc<Instance>,
        chosen: Candidate,
        options: &Options,
    ) -> Result<Arc<Self>, EngineError> {
        let (name, physical) = (chosen.report.name.clone(), chosen.raw);
        let mut extensions: Vec<&CStr> = Vec::new();
        if chosen.synchronization2 {
            extensions.push(khr::synchronization2::NAME);
        }
        if chosen.portability_subset {
            extensions.push(khr::portability_subset::NAME);
        }
        #[cfg(target_os = "linux")]
        if super::sharing::shares(instance, physical) {
            extensions.push(khr::external_memory_fd::NAME);
        }
        let mut timeline = vk::PhysicalDeviceTimelineSemaphoreFeatures::default().timeline_semaphore(true);
        let mut synchronization = vk::PhysicalDeviceSynchronization2Features::default().synchronization2(true);
        let mut features = presentation::Features::default();
        let presents = chosen.presents.first().copied();
        if presents.is_some() {
            extensions.extend(presentation::extensions(instance, physical));
        }
        // These are one queue of each family, or two of the same.
        let priorities = [1.0; 2];
        let (family, present) = (chosen.family, presents.unwrap_or((chosen.family, 0)));
        let queue = |family, count| {
            vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&priorities[..count])
        };
        let queues = match present {
            (other, _) if other != family => vec![queue(family, 1), queue(other, 1)],
            (_, index) => vec![queue(family, index as usize + 1)],
        };
        let names: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
        let mut info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_extension_names(&names)
            .push_next(&mut timeline);
        if chosen.synchronization2 {
            info = info.push_next(&mut synchronization);
        }
        info = features.enable(info, &extensions);
        // SAFETY: the device is of this instance, and has the requested queue families, extensions and features.
        let raw = unsafe { instance.raw.create_device(physical, &info, None) }
            .map_err(|e| EngineError::vulkan(&name, "vkCreateDevice", "setting up", e))?;
        let raw = Handle::new(raw, true);
        // SAFETY: the queues were requested.
        let [compute, other] = unsafe {
            [(family, 0), present].map(|(family, index)| Queue::new(family, raw.get_device_queue(family, index)))
        };
        let other = Some(other).filter(|_| present != (family, 0));
        let extensions = extensions.into_iter().map(CStr::to_owned).collect();
        Self::of(instance, raw, physical, (compute, other), extensions, chosen.report, options)
    }

    /// Makes the shared parts of a device that was opened here or elsewhere. Its queues are for kernels, and for
    /// pictures if that is another one.
    pub(crate) fn of(
        instance: &Arc<Instance>,
        raw: Handle,
        physical: vk::PhysicalDevice,
        (compute, other): (Queue, Option<Queue>),
        extensions: Vec<CString>,
        mut report: DeviceReport,
        Options { cache, record_only, plan_as, .. }: &Options,
    ) -> Result<Arc<Self>, EngineError> {
        let (cache, record_only) = (cache.as_deref(), *record_only);
        let mut families = vec![compute.family];
        families.extend(other.as_ref().map(|q| q.family).filter(|f| *f != compute.family));
        // SAFETY: the device is of this instance.
        let properties = unsafe { instance.raw.get_physical_device_properties(physical) };
        let mut floats = vk::PhysicalDeviceFloatControlsProperties::default();
        let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut floats);
        // SAFETY: as above. The device is of Vulkan 1.2, which knows the structure.
        unsafe { instance.raw.get_physical_device_properties2(physical, &mut all) };
        let synchronization2 = extensions
            .iter()
            .any(|e| e.as_c_str() == khr::synchronization2::NAME)
            .then(|| khr::synchronization2::Device::new(&instance.raw, &raw));
        let planned_as = plan_as.unwrap_or(report.kind);
        let storage_range = report.limits.storage_range;
        if record_only && planned_as != DeviceKind::Cpu {
            // Every GPU has ranges of 4 GiB, and 48 KiB shared by a workgroup.
            report.limits.storage_range = storage_range.max(u64::from(u32::MAX));
            report.limits.shared_memory = report.limits.shared_memory.max(48 << 10);
        }
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.raw.clone(),
            device: raw.clone(),
            physical_device: physical,
            debug_settings: Default::default(),
            buffer_device_address: false,
            // Large buffers have dedicated memory, and these blocks hold the small ones.
            allocation_sizes: AllocationSizes::new(16 << 20, 8 << 20),
        });
        let allocator = allocator.map_err(|e| EngineError::Vulkan {
            device: report.name.clone(),
            call: "allocator",
            result: e.to_string(),
        })?;
        let pipelines = Pipelines::new(&raw, &report.name, &properties, cache, FloatModes::of(&floats), record_only)?;
        Ok(Arc::new(Self {
            pipelines: Mutex::new(pipelines),
            allocator: Mutex::new(allocator),
            raw,
            physical,
            compute,
            other,
            families,
            synchronization2,
            report,
            counts: Mutex::default(),
            planned_as,
            storage_range,
            record_only,
            recording: Mutex::default(),
            is_tested: Mutex::new(false),
            record: Record::new(cache, &properties),
            lost: AtomicBool::new(false),
            stuck: AtomicBool::new(false),
            first_uses: AtomicUsize::new(0),
            extensions,
            instance: Arc::clone(instance),
        }))
    }

    /// Returns the queue for pictures. Kernels run on it too if there is no other queue.
    pub fn present(&self) -> &Queue {
        self.other.as_ref().unwrap_or(&self.compute)
    }

    /// Returns true if pictures and kernels share one queue.
    pub fn shares_queue(&self) -> bool {
        self.other.is_none()
    }

    /// Returns the families of its queues. There are two if pictures are presented on another family.
    pub(crate) fn families(&self) -> &[u32] {
        &self.families
    }

    /// Returns true if an extension is enabled.
    pub fn has(&self, extension: &CStr) -> bool {
        self.extensions.iter().any(|e| e.as_c_str() == extension)
    }

    /// Locks the memory allocator.
    pub(crate) fn allocator(&self) -> MutexGuard<'_, Allocator> {
        self.allocator.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Locks the pipelines of the device.
    pub(crate) fn pipelines(&self) -> MutexGuard<'_, Pipelines> {
        self.pipelines.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the pipeline of a module, see [`Pipelines::get`].
    pub(crate) fn pipeline(
        &self,
        module: &'static Module,
        bindings: u32,
        constants: &[u32],
    ) -> Result<Pipeline, EngineError> {
        self.pipelines().get(module, bindings, constants, || self.count(|counts| counts.pipelines += 1))
    }

    /// Makes pipelines on all cores, and writes the cache to disk.
    pub(crate) fn compile(&self, wanted: Vec<Wanted>) -> Result<(), EngineError> {
        let (missing, maker) = {
            let mut pipelines = self.pipelines();
            (pipelines.missing(wanted)?, pipelines.maker.clone())
        };
        // This runs without the lock, because a waiting thread takes other work, which may need the lock.
        let make = |(wanted, pipeline): (Wanted, Pipeline)| {
            let raw = maker.make(wanted.module, pipeline.layout, &wanted.constants)?;
            Ok((wanted, Pipeline { raw, ..pipeline }))
        };
        let made: Vec<Result<(Wanted, Pipeline), EngineError>> = missing.into_par_iter().map(make).collect();
        let mut pipelines = self.pipelines();
        let mut all = Ok(());
        for one in made {
            match one {
                Ok((wanted, pipeline)) => {
                    self.count(|counts| counts.pipelines += 1);
                    pipelines.insert(wanted, pipeline);
                }
                Err(e) => all = Err(e),
            }
        }
        pipelines.save();
        all
    }

    /// Returns true if the device is assumed to pack halves.
    #[cfg(any(test, feature = "test-hooks"))]
    pub fn packs_halves(&self) -> bool {
        self.pipelines().packs_halves()
    }

    /// Returns the pipelines that were made.
    #[cfg(any(test, feature = "test-hooks"))]
    pub fn pipelines_made(&self) -> Vec<super::statistics::Key> {
        self.pipelines().keys()
    }

    /// Returns the number of live allocations.
    #[cfg(test)]
    pub(crate) fn allocations(&self) -> usize {
        self.allocator().generate_report().allocations.len()
    }

    /// Adds to the counts of work.
    pub(crate) fn count(&self, more: impl FnOnce(&mut Counts)) {
        more(&mut self.counts.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Returns the work since the device was opened.
    pub(crate) fn counts(&self) -> Counts {
        *self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds to the recording, if nothing runs and someone needs the recording.
    pub(crate) fn record(&self, say: impl FnOnce(&mut Recording)) {
        if self.record_only
            && let Some(recording) = self.recording.lock().unwrap_or_else(PoisonError::into_inner).as_mut()
        {
            say(recording);
        }
    }

    /// Returns true if it stopped answering. Nothing runs on it any more.
    pub(crate) fn is_lost(&self) -> bool {
        self.lost.load(Ordering::Relaxed)
    }

    /// Returns true if it was given up while it may still have been working. Its objects must not be destroyed.
    pub fn is_stuck(&self) -> bool {
        self.stuck.load(Ordering::Relaxed)
    }

    /// Gives the device up, because it did not answer in time. It and everything on it stay until the process ends.
    pub fn give_up(self: &Arc<Self>, call: &'static str, during: &str) -> EngineError {
        if !self.stuck.swap(true, Ordering::Relaxed) {
            std::mem::forget(Arc::clone(self));
        }
        self.error(call, during, vk::Result::ERROR_DEVICE_LOST)
    }

    /// Returns the longest time to wait for a queue, nanoseconds.
    pub fn patience_ns(&self) -> u64 {
        self.patience().ns(self.first_uses.load(Ordering::Relaxed) > 0)
    }

    /// Returns the longest times of submissions.
    pub(crate) fn patience(&self) -> Patience {
        const SECOND: u64 = 1_000_000_000;
        let usual_ns = if self.report.kind == DeviceKind::Cpu { 600 * SECOND } else { 10 * SECOND };
        Patience { usual_ns, first_use_ns: 600 * SECOND }
    }

    /// Turns an error code of Vulkan into an error. `call` names the call, `during` the kernel, the transfer or the
    /// buffer.
    pub fn error(&self, call: &'static str, during: &str, result: vk::Result) -> EngineError {
        if result == vk::Result::ERROR_DEVICE_LOST {
            self.lost.store(true, Ordering::Relaxed);
        }
        EngineError::vulkan(&self.report.name, call, during, result)
    }
}
