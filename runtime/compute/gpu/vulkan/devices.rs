//! Lists the devices, checks if they can run the kernels, and chooses one.

use super::error::EngineError;
use super::extensions::has;
use super::instance::{BASELINE, Instance, version_text};
use super::report::{DeviceKind, DeviceReport, Limits};
use super::tested::Record;
use ash::{khr, vk};

/// A device with the data to open it.
pub(crate) struct Candidate {
    pub(crate) raw: vk::PhysicalDevice,
    pub(crate) report: DeviceReport,
    pub(crate) family: u32,
    /// Queue families and queue indices for pictures, best first, if presentation was wanted and is possible. Only a
    /// surface decides which of them it accepts.
    pub(crate) presents: Vec<(u32, u32)>,
    pub(crate) synchronization2: bool,
    pub(crate) portability_subset: bool,
}

/// Lists all devices that the loader finds, usable or not.
///
/// # Errors
/// [`EngineError::NoDevice`] without a loader, or with one that is too old.
pub fn devices() -> Result<Vec<DeviceReport>, EngineError> {
    let instance = Instance::open(false, false)?;
    Ok(candidates(&instance, false)?.into_iter().map(|c| c.report).collect())
}

/// Lists the devices. With `present` they also present pictures, if they can.
pub(crate) fn candidates(instance: &Instance, present: bool) -> Result<Vec<Candidate>, EngineError> {
    // SAFETY: the instance is valid.
    let all = unsafe { instance.raw.enumerate_physical_devices() }
        .map_err(|e| EngineError::NoDevice { reason: format!("devices could not be listed ({e:?})") })?;
    let shows = |c: Candidate| Candidate { presents: if present { c.presents } else { Vec::new() }, ..c };
    Ok(all.into_iter().enumerate().map(|(index, raw)| shows(inspect(instance, index, raw, None))).collect())
}

/// Inspects a device. `only` is its sole queue family, if the device is already open.
pub(crate) fn inspect(instance: &Instance, index: usize, raw: vk::PhysicalDevice, only: Option<u32>) -> Candidate {
    let vulkan = &instance.raw;
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
    let mut maintenance = vk::PhysicalDeviceMaintenance3Properties::default();
    let mut features12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut features2 = vk::PhysicalDeviceSynchronization2Features::default();
    // SAFETY: `raw` is a device of this instance.
    let (basic, queues, memory, extensions) = unsafe {
        (
            vulkan.get_physical_device_properties(raw),
            vulkan.get_physical_device_queue_family_properties(raw),
            vulkan.get_physical_device_memory_properties(raw),
            vulkan.enumerate_device_extension_properties(raw).unwrap_or_default(),
        )
    };
    let modern = basic.api_version >= BASELINE;
    let synchronization2 = modern && has(&extensions, khr::synchronization2::NAME);
    if modern {
        let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut features12);
        if synchronization2 {
            features = features.push_next(&mut features2);
        }
        let mut properties = vk::PhysicalDeviceProperties2::default()
            .push_next(&mut driver)
            .push_next(&mut subgroup)
            .push_next(&mut maintenance);
        // SAFETY: the chains hold structures that a device of 1.2, with that extension, knows.
        unsafe {
            vulkan.get_physical_device_features2(raw, &mut features);
            vulkan.get_physical_device_properties2(raw, &mut properties);
        }
    }
    // A queue without graphics does not compete with a desktop's drawing.
    let computes = |q: &vk::QueueFamilyProperties| q.queue_flags.contains(vk::QueueFlags::COMPUTE) && q.queue_count > 0;
    let draws = |q: &vk::QueueFamilyProperties| q.queue_flags.contains(vk::QueueFlags::GRAPHICS);
    let best = queues
        .iter()
        .position(|q| computes(q) && !draws(q) && q.timestamp_valid_bits > 0)
        .or_else(|| queues.iter().position(computes));
    let family = only.map(|f| f as usize).filter(|f| queues.get(*f).is_some_and(computes)).or(best);
    let presents = if has(&extensions, khr::swapchain::NAME) { presenting(&queues, family) } else { Vec::new() };
    let local = vk::MemoryPropertyFlags::DEVICE_LOCAL;
    let types = &memory.memory_types[..memory.memory_type_count as usize];
    let has_type = |heap: u32| types.iter().any(|t| t.heap_index == heap && t.property_flags.contains(local));
    let limits = Limits {
        storage_range: u64::from(basic.limits.max_storage_buffer_range),
        offset_alignment: basic.limits.min_storage_buffer_offset_alignment.max(4),
        shared_memory: basic.limits.max_compute_shared_memory_size,
        // Kernels arrange their threads along either axis.
        invocations: (basic.limits.max_compute_work_group_size[..2].iter())
            .fold(basic.limits.max_compute_work_group_invocations, |least, &size| least.min(size)),
        groups: basic.limits.max_compute_work_group_count,
        buffers: basic.limits.max_per_stage_descriptor_storage_buffers,
        subgroup: subgroup.subgroup_size,
        allocation: if modern { maintenance.max_memory_allocation_size } else { 0 },
        memory: memory.memory_heaps[..memory.memory_heap_count as usize]
            .iter()
            .enumerate()
            .filter(|(i, h)| h.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL) && has_type(*i as u32))
            .map(|(_, h)| h.size)
            .max()
            .unwrap_or(0),
        timestamp_period: match family {
            Some(f) if queues[f].timestamp_valid_bits > 0 => basic.limits.timestamp_period,
            _ => 0.0,
        },
    };
    let usable = if !modern {
        Err(format!("it supports Vulkan {}, but 1.2 is needed", version_text(basic.api_version)))
    } else if family.is_none() {
        Err("it has no queue that computes".into())
    } else if features12.timeline_semaphore == vk::FALSE {
        Err("it has no timeline semaphores".into())
    } else {
        check(&limits)
    };
    let text = |s: Result<&std::ffi::CStr, _>| s.map_or_else(|_| String::new(), |s| s.to_string_lossy().into_owned());
    let report = DeviceReport {
        index,
        name: text(basic.device_name_as_c_str()),
        kind: match basic.device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
            vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
            vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
            vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
            _ => DeviceKind::Other,
        },
        driver: format!("{} {}", text(driver.driver_name_as_c_str()), text(driver.driver_info_as_c_str())),
        api: version_text(basic.api_version),
        limits,
        usable,
        tested: Record::new(None, &basic).and_then(|record| record.read()),
    };
    Candidate {
        raw,
        report,
        family: family.unwrap_or(0) as u32,
        presents,
        synchronization2: features2.synchronization2 == vk::TRUE,
        portability_subset: has(&extensions, khr::portability_subset::NAME),
    }
}

/// Returns the families and indices of queues that can copy pictures, best first. `computes` is the family of the
/// kernels. Families that draw come first, because most surfaces accept them. In the family of the kernels, a second
/// queue is better, because a picture then does not wait for a kernel.
fn presenting(queues: &[vk::QueueFamilyProperties], computes: Option<usize>) -> Vec<(u32, u32)> {
    let copies = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE | vk::QueueFlags::TRANSFER;
    let mut families: Vec<usize> =
        (0..queues.len()).filter(|&f| queues[f].queue_count > 0 && queues[f].queue_flags.intersects(copies)).collect();
    families.sort_by_key(|&f| !queues[f].queue_flags.contains(vk::QueueFlags::GRAPHICS));
    let index = |f: usize| u32::from(Some(f) == computes && queues[f].queue_count > 1);
    families.into_iter().map(|f| (f as u32, index(f))).collect()
}

impl Candidate {
    /// Returns this device with only the best queue that `shows` accepts, or none if it accepts none.
    pub(crate) fn that_shows(mut self, shows: impl Fn(vk::PhysicalDevice, u32) -> bool) -> Option<Self> {
        self.presents.retain(|(family, _)| shows(self.raw, *family));
        self.presents.truncate(1);
        (!self.presents.is_empty() && self.report.usable.is_ok()).then_some(self)
    }
}

/// Most storage buffers that a kernel binds.
const BUFFERS: u64 = 7;

/// Checks the needs of the kernels beyond the minimum of every Vulkan device.
fn check(limits: &Limits) -> Result<(), String> {
    let at_least = |what: &str, has: u64, needed: u64| {
        if has >= needed { Ok(()) } else { Err(format!("{what} is {has}, but {needed} is needed")) }
    };
    at_least("the storage buffer range", limits.storage_range, 1 << 27)?;
    at_least("the workgroup's shared memory", limits.shared_memory.into(), 16 << 10)?;
    at_least("the number of invocations in a workgroup", limits.invocations.into(), 128)?;
    at_least("the number of storage buffers of a kernel", limits.buffers.into(), BUFFERS)?;
    if limits.memory > 0 { Ok(()) } else { Err("it has no memory that is DEVICE_LOCAL".into()) }
}

/// Returns the device that `wanted` names (its number, or a part of its name), or the best one.
pub(crate) fn choose(mut all: Vec<Candidate>, wanted: Option<&str>, allow_cpu: bool) -> Result<Candidate, EngineError> {
    if all.is_empty() {
        return Err(EngineError::NoDevice { reason: "the loader works, but no driver offers a device".into() });
    }
    let reports: Vec<&DeviceReport> = all.iter().map(|c| &c.report).collect();
    let at = pick(&reports, wanted, allow_cpu)?;
    Ok(all.swap_remove(at))
}

/// Returns the index of the best device, discrete before integrated before virtual, software only on request.
fn pick(all: &[&DeviceReport], wanted: Option<&str>, allow_cpu: bool) -> Result<usize, EngineError> {
    let refuse =
        |r: &DeviceReport, reason: &str| EngineError::Unsuitable { device: r.name.clone(), reason: reason.to_owned() };
    if let Some(wanted) = wanted {
        let lower = wanted.to_lowercase();
        let found = match wanted.parse::<usize>() {
            Ok(index) => all.iter().position(|r| r.index == index),
            Err(_) => all.iter().position(|r| r.name.to_lowercase().contains(&lower)),
        };
        let names = || all.iter().map(|r| format!("{}: {}", r.index, r.name)).collect::<Vec<_>>().join(", ");
        let at = found.ok_or_else(|| EngineError::NoDevice {
            reason: format!("no device has the name {wanted:?}. The devices are {}", names()),
        })?;
        return all[at].usable.clone().map(|()| at).map_err(|reason| refuse(all[at], &reason));
    }
    let usable = |r: &DeviceReport| r.usable.is_ok() && (allow_cpu || r.kind != DeviceKind::Cpu);
    let best = all.iter().enumerate().filter(|(_, r)| usable(r)).min_by_key(|(_, r)| r.kind);
    best.map(|(at, _)| at).ok_or_else(|| {
        let why = |r: &&DeviceReport| match &r.usable {
            Err(reason) => format!("{}: {reason}", r.name),
            Ok(()) => format!("{}: {}, which is taken only if it is named", r.name, r.kind),
        };
        EngineError::NoDevice { reason: all.iter().map(why).collect::<Vec<_>>().join("; ") }
    })
}

#[cfg(test)]
mod tests {
    use super::super::modules::instructions;
    use super::*;

    #[test]
    fn no_kernel_is_bound_to_more_buffers_than_are_asked_for() {
        // The numbers are of `OpDecorate` with a `Binding`.
        let bindings = |(_, code, words): (usize, u32, &[u32])| (code == 71 && words[2] == 33).then(|| words[3] + 1);
        let of = |module: &eyebox_spirv::Module| instructions(module.words()).filter_map(bindings).max().unwrap_or(0);
        assert_eq!(eyebox_spirv::ALL.iter().map(|module| u64::from(of(module))).max(), Some(BUFFERS));
    }

    fn report(index: usize, name: &str, kind: DeviceKind, usable: Result<(), String>) -> DeviceReport {
        let limits = Limits {
            storage_range: 1 << 27,
            offset_alignment: 16,
            shared_memory: 32 << 10,
            invocations: 1024,
            groups: [65535; 3],
            buffers: 16,
            subgroup: 8,
            allocation: 1 << 31,
            memory: 1 << 31,
            timestamp_period: 1.0,
        };
        DeviceReport {
            index,
            name: name.into(),
            kind,
            driver: String::new(),
            api: "1.2.0".into(),
            limits,
            usable,
            tested: None,
        }
    }

    #[test]
    fn a_real_gpu_comes_first_and_software_only_when_asked_for() {
        let software = report(0, "llvmpipe", DeviceKind::Cpu, Ok(()));
        let small = report(1, "Onboard", DeviceKind::Integrated, Ok(()));
        let big = report(2, "Big", DeviceKind::Discrete, Ok(()));
        let broken = report(3, "Broken", DeviceKind::Discrete, Err("too small".into()));
        let all = [&software, &small, &big, &broken];
        assert_eq!(pick(&all, None, true).unwrap(), 2);
        assert_eq!(pick(&all[..2], None, true).unwrap(), 1);
        assert_eq!(pick(&all[..1], None, true).unwrap(), 0);
        assert_eq!(pick(&all, Some("PIPE"), false).unwrap(), 0);
        assert_eq!(pick(&all, Some("1"), false).unwrap(), 1);
        let refused = pick(&all[..1], None, false).unwrap_err();
        assert!(matches!(&refused, EngineError::NoDevice { reason } if reason.contains("llvmpipe")), "{refused}");
        let small = pick(&all, Some("Broken"), false).unwrap_err();
        assert!(
            matches!(&small, EngineError::Unsuitable { device, reason } if device == "Broken" && reason == "too small"),
            "{small}"
        );
        let unknown = pick(&all, Some("nothing"), false).unwrap_err();
        assert!(matches!(&unknown, EngineError::NoDevice { reason } if reason.contains("Onboard")), "{unknown}");
    }

    fn family(flags: vk::QueueFlags, count: u32) -> vk::QueueFamilyProperties {
        vk::QueueFamilyProperties { queue_flags: flags, queue_count: count, ..Default::default() }
    }

    #[test]
    fn pictures_go_to_a_queue_that_the_surface_accepts() {
        let (draws, computes, copies) = (vk::QueueFlags::GRAPHICS, vk::QueueFlags::COMPUTE, vk::QueueFlags::TRANSFER);
        let decodes = vk::QueueFlags::VIDEO_DECODE_KHR;
        let queues = [family(computes, 2), family(decodes, 1), family(copies, 1), family(draws | computes, 16)];
        assert_eq!(presenting(&queues, Some(0)), [(3, 0), (0, 1), (2, 0)]);
        // A single queue is for both.
        assert_eq!(presenting(&queues[3..], Some(0)), [(0, 1)]);
        assert_eq!(presenting(&[family(draws | computes, 1)], Some(0)), [(0, 0)]);
        let candidate = |usable: Result<(), String>| Candidate {
            raw: vk::PhysicalDevice::null(),
            report: report(0, "", DeviceKind::Integrated, usable),
            family: 0,
            presents: presenting(&queues, Some(0)),
            synchronization2: false,
            portability_subset: false,
        };
        // The first family draws, but only the others reach this surface.
        let accepted =
            |accepts: &[u32]| candidate(Ok(())).that_shows(|_, family| accepts.contains(&family)).map(|c| c.presents);
        assert_eq!(accepted(&[0, 2]), Some(vec![(0, 1)]));
        assert_eq!(accepted(&[2, 3]), Some(vec![(3, 0)]));
        assert_eq!(accepted(&[1]), None);
        assert!(candidate(Err("too small".into())).that_shows(|_, _| true).is_none());
    }

    #[test]
    fn a_limit_that_is_too_small_is_named() {
        let mut limits = report(0, "", DeviceKind::Cpu, Ok(())).limits;
        assert_eq!(check(&limits), Ok(()));
        limits.shared_memory = 8 << 10;
        let small = check(&limits).unwrap_err();
        assert!(small.contains("8192") && small.contains("16384"), "{small}");
        let without = Limits { memory: 0, shared_memory: 16 << 10, ..limits };
        assert!(check(&without).unwrap_err().contains("DEVICE_LOCAL"));
    }
}
