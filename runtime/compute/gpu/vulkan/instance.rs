//! Loads the Vulkan instance at run time, and collects the validation layer's messages.

use super::error::EngineError;
use super::extensions::{extension_names, has};
use super::validation::{self, Validation};
use ash::{ext, khr, vk};
use std::ffi::{CStr, CString, c_char, c_void};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Extensions for windows on desktops, and for displays without a desktop.
const SURFACES: [&CStr; 10] = [
    khr::surface::NAME,
    khr::get_surface_capabilities2::NAME,
    khr::xcb_surface::NAME,
    khr::xlib_surface::NAME,
    khr::wayland_surface::NAME,
    khr::win32_surface::NAME,
    khr::display::NAME,
    ext::direct_mode_display::NAME,
    ext::acquire_drm_display::NAME,
    ext::display_surface_counter::NAME,
];
/// The oldest Vulkan version that the kernels are compiled for.
pub(crate) const BASELINE: u32 = vk::API_VERSION_1_2;

/// The validation layer's messages, in order.
pub type Messages = Arc<Mutex<Vec<String>>>;

/// An instance and its messenger. Everything made from it must be gone before it is dropped.
pub struct Instance {
    /// Vulkan's handle of the instance.
    pub raw: ash::Instance,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    pub(crate) messages: Messages,
    extensions: Vec<CString>,
    /// True if the instance is destroyed with this value.
    owned: bool,
    /// The library, which must outlive everything that was loaded from it.
    pub entry: ash::Entry,
}

impl Instance {
    /// Loads Vulkan. `validation` adds core and synchronization validation, and `present` adds all available
    /// extensions of `SURFACES`.
    pub fn open(validation: bool, present: bool) -> Result<Self, EngineError> {
        let none = |reason: String| EngineError::NoDevice { reason };
        // SAFETY: the loader is trusted to be a Vulkan loader, and it stays loaded as long as the entry lives.
        let entry =
            unsafe { ash::Entry::load() }.map_err(|e| none(format!("the Vulkan loader could not be loaded ({e})")))?;
        // SAFETY: the entry is valid, and the call has no arguments.
        let version = unsafe { entry.try_enumerate_instance_version() }.ok().flatten().unwrap_or(vk::API_VERSION_1_0);
        if version < BASELINE {
            return Err(none(format!("the Vulkan loader supports {}, but 1.2 is needed", version_text(version))));
        }
        let there = extension_names(&entry, None);
        let shows = present && has(&there, khr::surface::NAME);
        // Without a compositor, this extension makes layers look for one and complain about it on standard error.
        let composited = ["WAYLAND_DISPLAY", "WAYLAND_SOCKET"].iter().any(|name| std::env::var_os(name).is_some());
        let useful = |name: &CStr| composited || name != khr::wayland_surface::NAME;
        let needed: Vec<_> = SURFACES.into_iter().filter(|name| shows && useful(name) && has(&there, name)).collect();
        let mut wanted: Vec<_> = needed.iter().map(|name| name.as_ptr()).collect();
        let mut layers = Vec::new();
        let mut flags = vk::InstanceCreateFlags::empty();
        if has(&there, khr::portability_enumeration::NAME) {
            wanted.push(khr::portability_enumeration::NAME.as_ptr());
            flags |= vk::InstanceCreateFlags::ENUMERATE_PORTABILITY_KHR;
        }
        let checks = if validation { Some(Validation::find(&entry, &there)?) } else { None };
        if let Some(checks) = checks {
            layers.push(checks.layer().as_ptr());
            wanted.extend([ext::debug_utils::NAME.as_ptr(), checks.extension().as_ptr()]);
        }
        let messages = Messages::default();
        let application =
            vk::ApplicationInfo::default().application_name(c"eyebox").engine_name(c"eyebox").api_version(BASELINE);
        let settings = validation::settings();
        let mut settings = vk::LayerSettingsCreateInfoEXT::default().settings(&settings);
        let mut features = validation::features();
        let mut listen = messenger_info(&messages);
        let mut info = vk::InstanceCreateInfo::default()
            .flags(flags)
            .application_info(&application)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&wanted);
        info = match checks {
            Some(Validation::Settings) => info.push_next(&mut settings).push_next(&mut listen),
            Some(Validation::Features) => info.push_next(&mut features).push_next(&mut listen),
            None => info,
        };
        keep_drivers(&entry);
        // SAFETY: all pointers in `info` live until the call returns, and the messages outlive the instance.
        let raw = unsafe { entry.create_instance(&info, None) }.map_err(|e| match e {
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => none("the loader works, but no driver is installed".into()),
            e => none(format!("no Vulkan instance could be made ({e:?})")),
        })?;
        let extensions = needed.iter().map(|&name| name.to_owned()).collect();
        let mut instance = Self { raw, messenger: None, messages, extensions, owned: true, entry };
        if validation {
            let utils = ext::debug_utils::Instance::new(&instance.entry, &instance.raw);
            let info = messenger_info(&instance.messages);
            // SAFETY: the instance is valid and has the extension, and the messages live in the same struct.
            let messenger = unsafe { utils.create_debug_utils_messenger(&info, None) }
                .map_err(|e| none(format!("no messenger could be made ({e:?})")))?;
            instance.messenger = Some((utils, messenger));
        }
        Ok(instance)
    }

    /// Wraps an instance that a program made and keeps.
    ///
    /// # Safety
    /// It was made from this entry, has these extensions, and outlives everything made here.
    pub(crate) unsafe fn from_raw(entry: ash::Entry, raw: vk::Instance, extensions: Vec<CString>) -> Self {
        // SAFETY: the caller guarantees it.
        let raw = unsafe { ash::Instance::load(entry.static_fn(), raw) };
        Self { raw, messenger: None, messages: Messages::default(), extensions, owned: false, entry }
    }

    /// Returns true if an extension is enabled.
    pub fn has(&self, extension: &CStr) -> bool {
        self.extensions.iter().any(|e| e.as_c_str() == extension)
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: everything made from the instance is gone (the device holds it and is dropped before). It is
        // destroyed once.
        unsafe {
            if let Some((utils, messenger)) = &self.messenger {
                utils.destroy_debug_utils_messenger(*messenger, None);
            }
            if self.owned {
                self.raw.destroy_instance(None);
            }
        }
    }
}

/// Keeps the drivers loaded from a process's second instance on, by an instance that is never destroyed. The loader
/// unloads a driver with the last instance. NVIDIA's driver (580.159.04 on an H200) could not be loaded any more
/// after four rounds, and no device was found. A likely cause is thread-local storage that glibc does not get back.
fn keep_drivers(entry: &ash::Entry) {
    static OPENED: AtomicUsize = AtomicUsize::new(0);
    if OPENED.fetch_add(1, Ordering::Relaxed) != 1 {
        return;
    }
    // SAFETY: the information lives until the call returns. If the call fails, nothing was made.
    if let Ok(_kept) = unsafe { entry.create_instance(&vk::InstanceCreateInfo::default(), None) } {
        std::mem::forget(entry.clone());
    }
}

/// Formats a version, such as `1.3.230`.
pub(crate) fn version_text(version: u32) -> String {
    let (major, minor) = (vk::api_version_major(version), vk::api_version_minor(version));
    format!("{major}.{minor}.{}", vk::api_version_patch(version))
}

fn messenger_info(messages: &Messages) -> vk::DebugUtilsMessengerCreateInfoEXT<'static> {
    use vk::{DebugUtilsMessageSeverityFlagsEXT as Severity, DebugUtilsMessageTypeFlagsEXT as Kind};
    vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(Severity::WARNING | Severity::ERROR)
        .message_type(Kind::VALIDATION | Kind::PERFORMANCE)
        .pfn_user_callback(Some(collect))
        .user_data(Arc::as_ptr(messages).cast_mut().cast())
}

unsafe extern "system" fn collect(
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    messages: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: `messages` is the mutex that `messenger_info` received, which outlives the instance. The layer passes
    // valid callback data and texts that end in zero.
    let (messages, [id, text]) = unsafe {
        let data = data.as_ref();
        let text = |text: *const c_char| {
            if text.is_null() { String::new() } else { CStr::from_ptr(text).to_string_lossy().into_owned() }
        };
        let texts = [data.map(|d| d.p_message_id_name), data.map(|d| d.p_message)];
        (&*messages.cast::<Mutex<Vec<String>>>().cast_const(), texts.map(|t| t.map_or_else(String::new, text)))
    };
    // Newer layers leave the identifier out of the text.
    let text = if text.contains(&id) { text } else { format!("{id}: {text}") };
    messages.lock().unwrap_or_else(PoisonError::into_inner).push(format!("{severity:?}: {text}"));
    vk::FALSE
}
