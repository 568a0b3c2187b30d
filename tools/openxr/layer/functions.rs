//! The functions that the layer gives to the loader.

use super::instance::INSTANCES;
use super::{ending, extensions, frame, session, swapchain};
use openxr_sys::{self as xr, Handle};
use std::ffi::{CStr, c_char};

/// Returns a function of the layer, or of the next layer.
pub unsafe extern "system" fn get_instance_proc_addr(
    instance: xr::Instance,
    name: *const c_char,
    function: *mut Option<xr::pfn::VoidFunction>,
) -> xr::Result {
    if name.is_null() || function.is_null() {
        return xr::Result::ERROR_VALIDATION_FAILURE;
    }
    // SAFETY: the caller passes a string of C.
    let text = unsafe { CStr::from_ptr(name) };
    if let Some(own) = own(text) {
        // SAFETY: the caller passes a place for the function.
        unsafe { *function = Some(own) };
        return xr::Result::SUCCESS;
    }
    let Some(known) = INSTANCES.get(instance.into_raw()) else { return xr::Result::ERROR_HANDLE_INVALID };
    // SAFETY: the arguments are the caller's.
    let found = unsafe { (known.next.get_instance_proc_addr)(instance, name, function) };
    if let (xr::Result::SUCCESS, Some(own)) = (found, of_extension(text)) {
        // SAFETY: as above.
        unsafe { *function = Some(own) };
    }
    found
}

macro_rules! plain {
    ($function:expr, $kind:ident) => {{
        let function: xr::pfn::$kind = $function;
        // SAFETY: all functions have the same representation, and the caller converts it back by the name.
        unsafe { std::mem::transmute::<xr::pfn::$kind, xr::pfn::VoidFunction>(function) }
    }};
}

/// Returns the layer's own function of an extension, which replaces a function of the runtime.
fn of_extension(name: &CStr) -> Option<xr::pfn::VoidFunction> {
    Some(match name.to_bytes() {
        b"xrGetVulkanInstanceExtensionsKHR" => {
            plain!(extensions::get_vulkan_instance_extensions, GetVulkanInstanceExtensionsKHR)
        }
        b"xrGetVulkanDeviceExtensionsKHR" => {
            plain!(extensions::get_vulkan_device_extensions, GetVulkanDeviceExtensionsKHR)
        }
        b"xrCreateVulkanInstanceKHR" => plain!(extensions::create_vulkan_instance, CreateVulkanInstanceKHR),
        b"xrCreateVulkanDeviceKHR" => plain!(extensions::create_vulkan_device, CreateVulkanDeviceKHR),
        _ => return None,
    })
}

/// Returns the layer's own function of a name.
fn own(name: &CStr) -> Option<xr::pfn::VoidFunction> {
    Some(match name.to_bytes() {
        b"xrGetInstanceProcAddr" => plain!(get_instance_proc_addr, GetInstanceProcAddr),
        b"xrDestroyInstance" => plain!(destroy_instance, DestroyInstance),
        b"xrCreateSession" => plain!(session::create_session, CreateSession),
        b"xrDestroySession" => plain!(ending::destroy_session, DestroySession),
        b"xrBeginSession" => plain!(session::begin_session, BeginSession),
        b"xrLocateViews" => plain!(session::locate_views, LocateViews),
        b"xrCreateSwapchain" => plain!(swapchain::create_swapchain, CreateSwapchain),
        b"xrDestroySwapchain" => plain!(swapchain::destroy_swapchain, DestroySwapchain),
        b"xrAcquireSwapchainImage" => plain!(swapchain::acquire_swapchain_image, AcquireSwapchainImage),
        b"xrReleaseSwapchainImage" => plain!(swapchain::release_swapchain_image, ReleaseSwapchainImage),
        b"xrEndFrame" => plain!(frame::end_frame, EndFrame),
        _ => return None,
    })
}

unsafe extern "system" fn destroy_instance(instance: xr::Instance) -> xr::Result {
    let Some(known) = INSTANCES.take(instance.into_raw()) else { return xr::Result::ERROR_HANDLE_INVALID };
    // The sessions of an instance end with it.
    session::SESSIONS.handles(|session| session.instance.handle == instance).into_iter().for_each(ending::forget);
    // SAFETY: the argument is the caller's.
    unsafe { (known.next.destroy_instance)(instance) }
}
