//! Chooses the extensions of a device for presentation and for its times.
//!
//! ash 0.38 has no `VK_KHR_present_id2`, `VK_KHR_present_wait2` and `VK_EXT_present_timing`, so their bindings are here.
//! Names and values come from the Vulkan headers 1.4.363.

use super::extensions::has;
use super::instance::Instance;
use ash::{ext, google, khr, vk};
use std::ffi::{CStr, c_void};

/// The name of `VK_KHR_present_id2`.
pub const PRESENT_ID2: &CStr = c"VK_KHR_present_id2";
/// The name of `VK_KHR_present_wait2`.
pub const PRESENT_WAIT2: &CStr = c"VK_KHR_present_wait2";
/// The name of `VK_EXT_present_timing`.
pub const PRESENT_TIMING: &CStr = c"VK_EXT_present_timing";
/// `VK_EXT_present_timing` requires this extension.
const CALIBRATED_TIMESTAMPS: &CStr = c"VK_KHR_calibrated_timestamps";

/// The flag `VK_SWAPCHAIN_CREATE_PRESENT_ID_2_BIT_KHR` of swapchains.
pub const WITH_PRESENT_ID2: vk::SwapchainCreateFlagsKHR = vk::SwapchainCreateFlagsKHR::from_raw(0x40);
/// The flag `VK_SWAPCHAIN_CREATE_PRESENT_WAIT_2_BIT_KHR` of swapchains.
pub const WITH_PRESENT_WAIT2: vk::SwapchainCreateFlagsKHR = vk::SwapchainCreateFlagsKHR::from_raw(0x80);
/// The flag `VK_SWAPCHAIN_CREATE_PRESENT_TIMING_BIT_EXT` of swapchains.
pub const WITH_PRESENT_TIMING: vk::SwapchainCreateFlagsKHR = vk::SwapchainCreateFlagsKHR::from_raw(0x200);

/// `VK_PRESENT_STAGE_IMAGE_FIRST_PIXEL_OUT_BIT_EXT`, the time at which the first pixel leaves the device.
pub const FIRST_PIXEL_OUT: u32 = 4;
/// `VK_PRESENT_STAGE_IMAGE_FIRST_PIXEL_VISIBLE_BIT_EXT`, the time at which the first pixel is visible.
pub const FIRST_PIXEL_VISIBLE: u32 = 8;

/// A structure of Vulkan with these fields after its type and its chain. The default has zeros.
macro_rules! structure {
    ($vulkan:literal, $name:ident = $number:literal { $($field:ident: $kind:ty),* }) => {
        #[doc = concat!("The structure `", $vulkan, "` of Vulkan.")]
        #[repr(C)]
        #[derive(Debug, Clone, Copy)]
        #[allow(missing_docs, reason = "Vulkan defines the names")]
        pub struct $name {
            pub s_type: vk::StructureType,
            pub p_next: *mut c_void,
            $(pub $field: $kind),*
        }

        impl Default for $name {
            fn default() -> Self {
                // SAFETY: All fields are numbers, handles or pointers, for which zeros are valid.
                let zeros: Self = unsafe { std::mem::zeroed() };
                Self { s_type: vk::StructureType::from_raw($number), ..zeros }
            }
        }
    };
}

structure!(
    "VkPhysicalDevicePresentId2FeaturesKHR",
    PresentId2Features = 1_000_479_002 { present_id2: vk::Bool32 }
);
structure!(
    "VkPhysicalDevicePresentWait2FeaturesKHR",
    PresentWait2Features = 1_000_480_001 { present_wait2: vk::Bool32 }
);
structure!(
    "VkPhysicalDevicePresentTimingFeaturesEXT",
    PresentTimingFeatures = 1_000_208_000 {
        present_timing: vk::Bool32,
        present_at_absolute_time: vk::Bool32,
        present_at_relative_time: vk::Bool32
    }
);
structure!(
    "VkSurfaceCapabilitiesPresentId2KHR",
    SurfacePresentId2 = 1_000_479_000 { supported: vk::Bool32 }
);
structure!(
    "VkSurfaceCapabilitiesPresentWait2KHR",
    SurfacePresentWait2 = 1_000_480_000 { supported: vk::Bool32 }
);
structure!(
    "VkPresentTimingSurfaceCapabilitiesEXT",
    SurfacePresentTiming = 1_000_208_008 {
        supported: vk::Bool32,
        at_absolute_time: vk::Bool32,
        at_relative_time: vk::Bool32,
        stages: u32
    }
);
structure!(
    "VkPresentId2KHR",
    PresentId2 = 1_000_479_001 { swapchain_count: u32, present_ids: *const u64 }
);
structure!(
    "VkPresentWait2InfoKHR",
    PresentWait2Info = 1_000_480_002 { present_id: u64, timeout: u64 }
);
structure!(
    "VkPresentTimingInfoEXT",
    PresentTimingInfo = 1_000_208_004 {
        flags: u32,
        target_time: u64,
        time_domain_id: u64,
        stages: u32,
        target_stage: u32
    }
);
structure!(
    "VkPresentTimingsInfoEXT",
    PresentTimingsInfo = 1_000_208_003 { swapchain_count: u32, infos: *const PresentTimingInfo }
);
structure!(
    "VkSwapchainTimeDomainPropertiesEXT",
    TimeDomains = 1_000_208_002 { count: u32, domains: *mut vk::TimeDomainKHR, ids: *mut u64 }
);
structure!(
    "VkPastPresentationTimingInfoEXT",
    PastTimingInfo = 1_000_208_005 { flags: u32, swapchain: vk::SwapchainKHR }
);
structure!(
    "VkPastPresentationTimingEXT",
    PastTiming = 1_000_208_007 {
        present_id: u64,
        target_time: u64,
        stage_count: u32,
        stages: *mut StageTime,
        time_domain: vk::TimeDomainKHR,
        time_domain_id: u64,
        is_complete: vk::Bool32
    }
);
structure!(
    "VkPastPresentationTimingPropertiesEXT",
    PastTimings = 1_000_208_006 { properties_counter: u64, domains_counter: u64, count: u32, timings: *mut PastTiming }
);

/// The structure `VkPresentStageTimeEXT` of Vulkan.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub struct StageTime {
    /// The stage, such as [`FIRST_PIXEL_OUT`].
    pub stage: u32,
    /// The time in the time domain of the presentation, 0 if it is unknown.
    pub time: u64,
}

/// The type of the function `vkWaitForPresent2KHR`.
pub type WaitForPresent2 =
    unsafe extern "system" fn(vk::Device, vk::SwapchainKHR, *const PresentWait2Info) -> vk::Result;
/// The type of the function `vkSetSwapchainPresentTimingQueueSizeEXT`.
pub type SetTimingQueueSize = unsafe extern "system" fn(vk::Device, vk::SwapchainKHR, u32) -> vk::Result;
/// The type of the function `vkGetSwapchainTimeDomainPropertiesEXT`.
pub type GetTimeDomains =
    unsafe extern "system" fn(vk::Device, vk::SwapchainKHR, *mut TimeDomains, *mut u64) -> vk::Result;
/// The type of the function `vkGetPastPresentationTimingEXT`.
pub type GetPastTimings = unsafe extern "system" fn(vk::Device, *const PastTimingInfo, *mut PastTimings) -> vk::Result;

// SAFETY: Each begins with its type and its chain, and the specification lists it for this chain.
unsafe impl vk::ExtendsPhysicalDeviceFeatures2 for PresentId2Features {}
// SAFETY: As above.
unsafe impl vk::ExtendsPhysicalDeviceFeatures2 for PresentWait2Features {}
// SAFETY: As above.
unsafe impl vk::ExtendsPhysicalDeviceFeatures2 for PresentTimingFeatures {}
// SAFETY: As above.
unsafe impl vk::ExtendsDeviceCreateInfo for PresentId2Features {}
// SAFETY: As above.
unsafe impl vk::ExtendsDeviceCreateInfo for PresentWait2Features {}
// SAFETY: As above.
unsafe impl vk::ExtendsDeviceCreateInfo for PresentTimingFeatures {}
// SAFETY: As above.
unsafe impl vk::ExtendsSurfaceCapabilities2KHR for SurfacePresentId2 {}
// SAFETY: As above.
unsafe impl vk::ExtendsSurfaceCapabilities2KHR for SurfacePresentWait2 {}
// SAFETY: As above.
unsafe impl vk::ExtendsSurfaceCapabilities2KHR for SurfacePresentTiming {}
// SAFETY: As above.
unsafe impl vk::ExtendsPresentInfoKHR for PresentId2 {}
// SAFETY: As above.
unsafe impl vk::ExtendsPresentInfoKHR for PresentTimingsInfo {}

/// The features of the extensions for presentation.
#[derive(Default)]
pub(crate) struct Features<'a> {
    id: vk::PhysicalDevicePresentIdFeaturesKHR<'a>,
    wait: vk::PhysicalDevicePresentWaitFeaturesKHR<'a>,
    id2: PresentId2Features,
    wait2: PresentWait2Features,
    timing: PresentTimingFeatures,
}

/// Returns the extensions of a device for presentation, as far as it has them with their features.
pub(crate) fn extensions(instance: &Instance, physical: vk::PhysicalDevice) -> Vec<&'static CStr> {
    // SAFETY: The device is of this instance.
    let offered = unsafe { instance.raw.enumerate_device_extension_properties(physical) }.unwrap_or_default();
    let offers = |name: &CStr| has(&offered, name);
    let mut features = Features::default();
    let mut all = vk::PhysicalDeviceFeatures2::default();
    if offers(khr::present_id::NAME) {
        all = all.push_next(&mut features.id);
    }
    if offers(khr::present_wait::NAME) {
        all = all.push_next(&mut features.wait);
    }
    if offers(PRESENT_ID2) {
        all = all.push_next(&mut features.id2);
    }
    if offers(PRESENT_WAIT2) {
        all = all.push_next(&mut features.wait2);
    }
    if offers(PRESENT_TIMING) {
        all = all.push_next(&mut features.timing);
    }
    // SAFETY: The device is of this instance, of Vulkan 1.2, and has the extensions of the structures.
    unsafe { instance.raw.get_physical_device_features2(physical, &mut all) };
    let is_on = [features.id.present_id, features.wait.present_wait].map(|on| on == vk::TRUE);
    let of_surfaces = instance.has(khr::get_surface_capabilities2::NAME);
    let id2 = of_surfaces && features.id2.present_id2 == vk::TRUE;
    let mut wanted = vec![khr::swapchain::NAME];
    let mut want = |condition: bool, names: &[&'static CStr]| {
        if condition && names.iter().all(|name| offers(name)) {
            wanted.extend(names);
        }
    };
    want(true, &[google::display_timing::NAME]);
    want(is_on == [true; 2], &[khr::present_id::NAME, khr::present_wait::NAME]);
    want(id2, &[PRESENT_ID2]);
    want(id2 && features.wait2.present_wait2 == vk::TRUE, &[PRESENT_WAIT2]);
    want(id2 && features.timing.present_timing == vk::TRUE, &[PRESENT_TIMING, CALIBRATED_TIMESTAMPS]);
    want(instance.has(ext::display_surface_counter::NAME), &[ext::display_control::NAME]);
    // Only drivers of Windows have it.
    want(of_surfaces, &[ext::full_screen_exclusive::NAME]);
    wanted
}

impl<'a> Features<'a> {
    /// Adds the features of the extensions that a new device enables.
    pub(crate) fn enable<'s>(
        &'s mut self,
        mut info: vk::DeviceCreateInfo<'s>,
        enabled: &[&CStr],
    ) -> vk::DeviceCreateInfo<'s>
    where
        'a: 's,
    {
        if enabled.contains(&khr::present_wait::NAME) {
            (self.id.present_id, self.wait.present_wait) = (vk::TRUE, vk::TRUE);
            info = info.push_next(&mut self.id).push_next(&mut self.wait);
        }
        if enabled.contains(&PRESENT_ID2) {
            self.id2.present_id2 = vk::TRUE;
            info = info.push_next(&mut self.id2);
        }
        if enabled.contains(&PRESENT_WAIT2) {
            self.wait2.present_wait2 = vk::TRUE;
            info = info.push_next(&mut self.wait2);
        }
        if enabled.contains(&PRESENT_TIMING) {
            self.timing.present_timing = vk::TRUE;
            info = info.push_next(&mut self.timing);
        }
        info
    }
}

/// The functions of `VK_EXT_present_timing`.
#[derive(Clone, Copy)]
#[allow(missing_docs, reason = "Vulkan defines the names")]
pub struct TimingCalls {
    pub set_queue_size: SetTimingQueueSize,
    pub domains: GetTimeDomains,
    pub past: GetPastTimings,
}

impl TimingCalls {
    /// Loads the functions from a device with `VK_EXT_present_timing`, or returns `None` if one is missing.
    pub fn load(instance: &ash::Instance, device: &ash::Device) -> Option<Self> {
        // SAFETY: The functions of these names have these types.
        unsafe {
            Some(Self {
                set_queue_size: load(instance, device, c"vkSetSwapchainPresentTimingQueueSizeEXT")?,
                domains: load(instance, device, c"vkGetSwapchainTimeDomainPropertiesEXT")?,
                past: load(instance, device, c"vkGetPastPresentationTimingEXT")?,
            })
        }
    }
}

/// Loads the function of `VK_KHR_present_wait2` from a device, or returns `None` if it is missing.
pub fn wait_for_present2(instance: &ash::Instance, device: &ash::Device) -> Option<WaitForPresent2> {
    // SAFETY: The function of this name has this type.
    unsafe { load(instance, device, c"vkWaitForPresent2KHR") }
}

/// # Safety
/// `F` is the type of a pointer to the function of this name.
unsafe fn load<F: Copy>(instance: &ash::Instance, device: &ash::Device, name: &CStr) -> Option<F> {
    // SAFETY: The device is of the instance, and the name ends in zero.
    let found = unsafe { instance.get_device_proc_addr(device.handle(), name.as_ptr()) }?;
    assert_eq!(size_of::<F>(), size_of_val(&found));
    // SAFETY: The caller guarantees the type, and both are pointers to functions.
    Some(unsafe { std::mem::transmute_copy::<unsafe extern "system" fn(), F>(&found) })
}
