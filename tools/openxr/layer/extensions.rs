//! Adds the extensions of Vulkan that an application's device needs, so that its copies stay on the device.
//!
//! The application requests the extensions that its runtime needs (`XR_KHR_vulkan_enable`), or the runtime makes its
//! instance and its device (`XR_KHR_vulkan_enable2`). If the layer's extensions are not possible, all calls pass on
//! unchanged, and frames pass through the host.

use super::instance::{INSTANCES, Instance};
use crate::vulkan::own::{device_extensions, instance_extensions};
use ash::vk;
use openxr_sys::{self as xr, Handle};
use std::ffi::{CStr, c_char};
use std::panic::catch_unwind;

/// Lists extensions with a space between two of them.
type List = xr::pfn::GetVulkanInstanceExtensionsKHR;

pub unsafe extern "system" fn get_vulkan_instance_extensions(
    instance: xr::Instance,
    system: xr::SystemId,
    capacity: u32,
    count: *mut u32,
    text: *mut c_char,
) -> xr::Result {
    // SAFETY: the arguments are the caller's.
    unsafe {
        list(instance, |known| known.next.vulkan_instance_extensions, own_instance(), (system, capacity, count, text))
    }
}

pub unsafe extern "system" fn get_vulkan_device_extensions(
    instance: xr::Instance,
    system: xr::SystemId,
    capacity: u32,
    count: *mut u32,
    text: *mut c_char,
) -> xr::Result {
    // SAFETY: the arguments are the caller's.
    unsafe {
        list(instance, |known| known.next.vulkan_device_extensions, own_device(), (system, capacity, count, text))
    }
}

fn own_instance() -> &'static [&'static CStr] {
    catch_unwind(instance_extensions).unwrap_or(&[])
}

fn own_device() -> &'static [&'static CStr] {
    catch_unwind(device_extensions).unwrap_or(&[])
}

/// Answers with the list of the runtime and the layer's own extensions.
///
/// # Safety
/// The arguments must be valid for the functions of OpenXR, which both have the same type.
unsafe fn list(
    instance: xr::Instance,
    function: impl Fn(&Instance) -> Option<List>,
    added: &[&CStr],
    (system, capacity, count, text): (xr::SystemId, u32, *mut u32, *mut c_char),
) -> xr::Result {
    let Some(known) = INSTANCES.get(instance.into_raw()) else { return xr::Result::ERROR_HANDLE_INVALID };
    let Some(next) = function(&known) else { return xr::Result::ERROR_FUNCTION_UNSUPPORTED };
    // SAFETY: the arguments are the caller's.
    let unchanged = || unsafe { next(instance, system, capacity, count, text) };
    let mut needed = 0;
    // SAFETY: a capacity of 0 only returns the number.
    let counted = unsafe { next(instance, system, 0, &mut needed, std::ptr::null_mut()) };
    if counted.into_raw() < 0 || count.is_null() || (capacity > 0 && text.is_null()) {
        return unchanged();
    }
    let mut all = vec![0u8; needed as usize];
    if needed > 0 {
        // SAFETY: the list has as many bytes as stated.
        let listed = unsafe { next(instance, system, needed, &mut needed, all.as_mut_ptr().cast()) };
        if listed.into_raw() < 0 {
            return unchanged();
        }
    }
    let joined = joined(&all, added);
    let length = joined.len() as u32;
    // SAFETY: the caller passes a place for the number.
    unsafe { *count = length };
    if capacity == 0 {
        return xr::Result::SUCCESS;
    }
    if capacity < length {
        return xr::Result::ERROR_SIZE_INSUFFICIENT;
    }
    // SAFETY: the caller's text has as many bytes as it states, and these are not more.
    unsafe { std::ptr::copy_nonoverlapping(joined.as_ptr(), text.cast(), joined.len()) };
    xr::Result::SUCCESS
}

/// Returns a list with more names at its end, each once, and a zero.
fn joined(list: &[u8], added: &[&CStr]) -> Vec<u8> {
    let list = list.split(|byte| *byte == 0).next().unwrap_or_default();
    let mut names: Vec<&[u8]> = list.split(|byte| *byte == b' ').filter(|name| !name.is_empty()).collect();
    for name in added {
        if !names.contains(&name.to_bytes()) {
            names.push(name.to_bytes());
        }
    }
    let mut all = names.join(&b' ');
    all.push(0);
    all
}

/// Returns the names of a structure with more names at its end, or none if nothing is added.
///
/// # Safety
/// `count` strings must be at `first`, unless `count` is 0.
unsafe fn more(first: *const *const c_char, count: u32, added: &[&'static CStr]) -> Option<Vec<*const c_char>> {
    // SAFETY: as stated above.
    let mut names = if count == 0 || first.is_null() {
        Vec::new()
    } else {
        // SAFETY: as stated above.
        unsafe { std::slice::from_raw_parts(first, count as usize) }.to_vec()
    };
    let before = names.len();
    for name in added {
        // SAFETY: the names are strings of C.
        if !names.iter().any(|known| unsafe { CStr::from_ptr(*known) } == *name) {
            names.push(name.as_ptr());
        }
    }
    (names.len() > before).then_some(names)
}

/// Declares a function that makes an instance or a device with the layer's extensions, or as the application requests it
/// if that fails.
macro_rules! creating {
    ($(#[$about:meta])* $name:ident, $info:ident, $vulkan:ident, $made:ident, $own:ident) => {
        $(#[$about])*
        pub unsafe extern "system" fn $name(
            instance: xr::Instance,
            info: *const xr::$info,
            made: *mut xr::platform::$made,
            result: *mut xr::platform::VkResult,
        ) -> xr::Result {
            let Some(known) = INSTANCES.get(instance.into_raw()) else { return xr::Result::ERROR_HANDLE_INVALID };
            let Some(next) = known.next.$name else { return xr::Result::ERROR_FUNCTION_UNSUPPORTED };
            // SAFETY: the caller passes valid structures or null.
            let wanted = unsafe { info.as_ref() }.and_then(|info| {
                // SAFETY: as above. The structure is Vulkan's.
                let vulkan = unsafe { info.vulkan_create_info.cast::<vk::$vulkan<'_>>().as_ref() }?;
                // SAFETY: as above.
                let names = unsafe { more(vulkan.pp_enabled_extension_names, vulkan.enabled_extension_count, $own()) }?;
                Some((*info, *vulkan, names))
            });
            if let (Some((mut info, mut vulkan, names)), false) = (wanted, result.is_null()) {
                (vulkan.pp_enabled_extension_names, vulkan.enabled_extension_count) =
                    (names.as_ptr(), names.len() as u32);
                info.vulkan_create_info = (&raw const vulkan).cast();
                // SAFETY: the structures differ from the caller's by names, which live until the call returns.
                let done = unsafe { next(instance, &info, made, result) };
                // SAFETY: the call wrote the result of Vulkan.
                if done.into_raw() >= 0 && unsafe { *result } >= 0 {
                    return done;
                }
            }
            // SAFETY: the arguments are the caller's.
            unsafe { next(instance, info, made, result) }
        }
    };
}

creating!(
    /// Makes an instance with the layer's extensions.
    create_vulkan_instance,
    VulkanInstanceCreateInfoKHR,
    InstanceCreateInfo,
    VkInstance,
    own_instance
);

creating!(
    /// Makes a device with the layer's extensions.
    create_vulkan_device,
    VulkanDeviceCreateInfoKHR,
    DeviceCreateInfo,
    VkDevice,
    own_device
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_added_once() {
        let added = [c"VK_B", c"VK_C"];
        assert_eq!(joined(b"\0", &added), b"VK_B VK_C\0");
        assert_eq!(joined(b"", &added), b"VK_B VK_C\0");
        assert_eq!(joined(b"VK_A  VK_C VK_BB\0rest", &added), b"VK_A VK_C VK_BB VK_B\0");
        assert_eq!(joined(b"VK_A VK_A\0", &[]), b"VK_A VK_A\0");
    }

    #[test]
    fn a_list_of_pointers_keeps_the_names_of_the_application() {
        let theirs = [c"VK_A".as_ptr(), c"VK_B".as_ptr()];
        // SAFETY: the pointers are in the list.
        let all = unsafe { more(theirs.as_ptr(), 2, &[c"VK_B", c"VK_C"]) }.expect("a name more");
        // SAFETY: the pointers are strings of C.
        let names: Vec<&CStr> = all.iter().map(|name| unsafe { CStr::from_ptr(*name) }).collect();
        assert_eq!(names, [c"VK_A", c"VK_B", c"VK_C"]);
        // SAFETY: as above.
        assert!(unsafe { more(theirs.as_ptr(), 2, &[c"VK_A"]) }.is_none());
        // SAFETY: there are no names.
        assert!(unsafe { more(std::ptr::null(), 0, &[]) }.is_none());
    }
}
