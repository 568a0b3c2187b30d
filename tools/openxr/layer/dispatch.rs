//! The functions below the layer, and tables of handles.

use openxr_sys as xr;
use std::collections::BTreeMap;
use std::ffi::CStr;
use std::sync::{Arc, PoisonError, RwLock};

/// Finds a function of an instance by its name.
fn find(get: xr::pfn::GetInstanceProcAddr, instance: xr::Instance, name: &CStr) -> Option<xr::pfn::VoidFunction> {
    let mut function = None;
    // SAFETY: the instance is valid, and the call writes only to `function`.
    let result = unsafe { get(instance, name.as_ptr(), &mut function) };
    function.filter(|_| result == xr::Result::SUCCESS)
}

/// Declares the functions of the next layer or of the runtime, by their names and types.
macro_rules! functions {
    ($($field:ident: $kind:ident = $name:literal,)* ; $($optional:ident: $its:ident = $of:literal,)*) => {
        /// The functions below the layer.
        #[derive(Clone, Copy)]
        pub struct Next {
            pub get_instance_proc_addr: xr::pfn::GetInstanceProcAddr,
            $(pub $field: xr::pfn::$kind,)*
            $(pub $optional: Option<xr::pfn::$its>,)*
        }

        impl Next {
            /// Finds the functions of an instance. Returns none if a function of every instance is missing.
            pub fn load(get: xr::pfn::GetInstanceProcAddr, instance: xr::Instance) -> Option<Self> {
                Some(Self {
                    get_instance_proc_addr: get,
                    // SAFETY: the name belongs to a function of this type.
                    $($field: unsafe {
                        std::mem::transmute::<xr::pfn::VoidFunction, xr::pfn::$kind>(find(get, instance, $name)?)
                    },)*
                    // SAFETY: the name belongs to a function of this type.
                    $($optional: find(get, instance, $of).map(|found| unsafe {
                        std::mem::transmute::<xr::pfn::VoidFunction, xr::pfn::$its>(found)
                    }),)*
                })
            }
        }
    };
}

functions! {
    destroy_instance: DestroyInstance = c"xrDestroyInstance",
    create_session: CreateSession = c"xrCreateSession",
    destroy_session: DestroySession = c"xrDestroySession",
    begin_session: BeginSession = c"xrBeginSession",
    create_swapchain: CreateSwapchain = c"xrCreateSwapchain",
    destroy_swapchain: DestroySwapchain = c"xrDestroySwapchain",
    enumerate_swapchain_images: EnumerateSwapchainImages = c"xrEnumerateSwapchainImages",
    acquire_swapchain_image: AcquireSwapchainImage = c"xrAcquireSwapchainImage",
    release_swapchain_image: ReleaseSwapchainImage = c"xrReleaseSwapchainImage",
    end_frame: EndFrame = c"xrEndFrame",
    locate_views: LocateViews = c"xrLocateViews",
    locate_space: LocateSpace = c"xrLocateSpace",
    ;
    convert_time: ConvertTimeToTimespecTimeKHR = c"xrConvertTimeToTimespecTimeKHR",
    vulkan_instance_extensions: GetVulkanInstanceExtensionsKHR = c"xrGetVulkanInstanceExtensionsKHR",
    vulkan_device_extensions: GetVulkanDeviceExtensionsKHR = c"xrGetVulkanDeviceExtensionsKHR",
    create_vulkan_instance: CreateVulkanInstanceKHR = c"xrCreateVulkanInstanceKHR",
    create_vulkan_device: CreateVulkanDeviceKHR = c"xrCreateVulkanDeviceKHR",
}

/// Objects of the layer by the handles of OpenXR.
pub struct Table<T>(RwLock<BTreeMap<u64, Arc<T>>>);

impl<T> Table<T> {
    /// Makes an empty table.
    pub const fn new() -> Self {
        Self(RwLock::new(BTreeMap::new()))
    }

    /// Returns the object of a handle.
    pub fn get(&self, handle: u64) -> Option<Arc<T>> {
        self.0.read().unwrap_or_else(PoisonError::into_inner).get(&handle).cloned()
    }

    /// Returns any of the objects.
    pub fn any(&self) -> Option<Arc<T>> {
        self.0.read().unwrap_or_else(PoisonError::into_inner).values().next().cloned()
    }

    /// Stores the object of a handle.
    pub fn put(&self, handle: u64, object: T) {
        self.0.write().unwrap_or_else(PoisonError::into_inner).insert(handle, Arc::new(object));
    }

    /// Removes the object of a handle.
    pub fn take(&self, handle: u64) -> Option<Arc<T>> {
        self.0.write().unwrap_or_else(PoisonError::into_inner).remove(&handle)
    }

    /// Returns the handles of the objects that fulfill a condition.
    pub fn handles(&self, has: impl Fn(&T) -> bool) -> Vec<u64> {
        let all = self.0.read().unwrap_or_else(PoisonError::into_inner);
        all.iter().filter(|(_, object)| has(object)).map(|(handle, _)| *handle).collect()
    }
}
