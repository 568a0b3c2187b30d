//! The entry point of the layer, and the creation of an instance.

use super::dispatch::Next;
use super::functions;
use super::instance::{self, Instance};
use openxr_sys::{self as xr, Handle};
use std::ffi::{CStr, c_char};

/// The version of the interface between loaders and layers.
const INTERFACE: u32 = 1;
/// The extension whose structures contain depth.
const DEPTH: &CStr = c"XR_KHR_composition_layer_depth";
/// The extension that converts times to `CLOCK_MONOTONIC`.
const TIME: &CStr = c"XR_KHR_convert_timespec_time";

/// Answers the loader, which calls this function by its name.
///
/// # Safety
/// OpenXR's loader must pass the pointers.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn xrNegotiateLoaderApiLayerInterface(
    loader: *const xr::NegotiateLoaderInfo,
    _name: *const c_char,
    request: *mut xr::NegotiateApiLayerRequest,
) -> xr::Result {
    // SAFETY: the loader passes valid structures or null.
    let (Some(loader), Some(request)) = (unsafe { loader.as_ref() }, unsafe { request.as_mut() }) else {
        return xr::Result::ERROR_INITIALIZATION_FAILED;
    };
    let known = loader.struct_type == xr::NegotiateLoaderInfo::TYPE
        && loader.struct_version == xr::NegotiateLoaderInfo::VERSION
        && loader.struct_size == size_of::<xr::NegotiateLoaderInfo>()
        && request.struct_type == xr::NegotiateApiLayerRequest::TYPE
        && request.struct_version == xr::NegotiateApiLayerRequest::VERSION
        && request.struct_size == size_of::<xr::NegotiateApiLayerRequest>()
        && (loader.min_interface_version..=loader.max_interface_version).contains(&INTERFACE);
    if !known {
        return xr::Result::ERROR_INITIALIZATION_FAILED;
    }
    request.layer_interface_version = INTERFACE;
    // The loader refuses a layer that is newer than itself.
    request.layer_api_version = loader.max_api_version.min(xr::CURRENT_API_VERSION);
    request.get_instance_proc_addr = Some(functions::get_instance_proc_addr);
    request.create_api_layer_instance = Some(create_api_layer_instance);
    xr::Result::SUCCESS
}

/// Creates the instance below the layer, and stores its functions.
unsafe extern "system" fn create_api_layer_instance(
    info: *const xr::InstanceCreateInfo,
    layer: *const xr::ApiLayerCreateInfo,
    created: *mut xr::Instance,
) -> xr::Result {
    // SAFETY: the loader passes valid structures or null.
    let (Some(info), Some(layer)) = (unsafe { info.as_ref() }, unsafe { layer.as_ref() }) else {
        return xr::Result::ERROR_INITIALIZATION_FAILED;
    };
    // SAFETY: the loader passes the list of the next layers.
    let Some(next) = (unsafe { layer.next_info.as_ref() }) else { return xr::Result::ERROR_INITIALIZATION_FAILED };
    let (Some(get), Some(create)) = (next.next_get_instance_proc_addr, next.next_create_api_layer_instance) else {
        return xr::Result::ERROR_INITIALIZATION_FAILED;
    };
    let below = runtime(next).map(extensions).unwrap_or_default();
    let has = |name: &CStr| below.iter().any(|known| known == name.to_bytes());
    // SAFETY: the application passes as many names as it states.
    let wanted = unsafe { names(info.enabled_extension_names, info.enabled_extension_count) };
    let is = |pointer: &*const c_char, name: &CStr| {
        // SAFETY: the names are strings of C.
        unsafe { CStr::from_ptr(*pointer) == name }
    };
    let depth_is_cut = wanted.iter().any(|name| is(name, DEPTH)) && !has(DEPTH);
    let mut kept: Vec<*const c_char> =
        wanted.iter().copied().filter(|name| !(depth_is_cut && is(name, DEPTH))).collect();
    if has(TIME) && !kept.iter().any(|name| is(name, TIME)) {
        kept.push(TIME.as_ptr());
    }
    let mut info = *info;
    (info.enabled_extension_names, info.enabled_extension_count) = (kept.as_ptr(), kept.len() as u32);
    let mut passed = *layer;
    passed.next_info = next.next;
    // SAFETY: the function is the next layer's, or the loader's. It expects these structures.
    let result = unsafe { create(&info, &passed, created) };
    if result != xr::Result::SUCCESS {
        return result;
    }
    // SAFETY: the call succeeded, so the handle is there.
    let handle = unsafe { *created };
    match Next::load(get, handle) {
        Some(next) => {
            instance::INSTANCES.put(handle.into_raw(), Instance::new(handle, next, depth_is_cut));
            result
        }
        None => xr::Result::ERROR_INITIALIZATION_FAILED,
    }
}

/// Takes a list of strings.
///
/// # Safety
/// `count` pointers must be at `first`, unless `count` is 0.
unsafe fn names<'a>(first: *const *const c_char, count: u32) -> &'a [*const c_char] {
    // SAFETY: as stated above.
    if count == 0 || first.is_null() { &[] } else { unsafe { std::slice::from_raw_parts(first, count as usize) } }
}

/// Returns the function at the end of the list of layers, which finds functions of the runtime. Layers in between may
/// not find functions before there is an instance.
fn runtime(mut last: &xr::ApiLayerNextInfo) -> Option<xr::pfn::GetInstanceProcAddr> {
    // SAFETY: the loader passes a list that ends with null.
    while let Some(next) = unsafe { last.next.as_ref() } {
        last = next;
    }
    last.next_get_instance_proc_addr
}

/// Returns the names of the extensions of the runtime. The list is empty if it does not state them before there is an
/// instance.
fn extensions(get: xr::pfn::GetInstanceProcAddr) -> Vec<Vec<u8>> {
    let mut function = None;
    let name = c"xrEnumerateInstanceExtensionProperties";
    // SAFETY: the function permits a null instance for this name, and writes only to `function`.
    let found = unsafe { get(xr::Instance::NULL, name.as_ptr(), &mut function) };
    let (xr::Result::SUCCESS, Some(function)) = (found, function) else { return Vec::new() };
    // SAFETY: the name belongs to a function of this type.
    let enumerate: xr::pfn::EnumerateInstanceExtensionProperties = unsafe { std::mem::transmute(function) };
    let mut count = 0;
    // SAFETY: a capacity of 0 only returns the number.
    let counted = unsafe { enumerate(std::ptr::null(), 0, &mut count, std::ptr::null_mut()) };
    if counted != xr::Result::SUCCESS {
        return Vec::new();
    }
    let empty = xr::ExtensionProperties {
        ty: xr::ExtensionProperties::TYPE,
        next: std::ptr::null_mut(),
        extension_name: [0; xr::MAX_EXTENSION_NAME_SIZE],
        extension_version: 0,
    };
    let mut all = vec![empty; count as usize];
    // SAFETY: the list has as many elements as stated.
    let listed = unsafe { enumerate(std::ptr::null(), count, &mut count, all.as_mut_ptr()) };
    if listed != xr::Result::SUCCESS {
        return Vec::new();
    }
    all.truncate(count as usize);
    let name = |one: &xr::ExtensionProperties| {
        one.extension_name.iter().take_while(|c| **c != 0).map(|c| *c as u8).collect::<Vec<u8>>()
    };
    all.iter().map(name).collect()
}
