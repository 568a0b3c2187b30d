//! Lists the extensions of the loader and of layers.

use ash::vk;
use std::ffi::CStr;

/// Returns the extensions of the loader, or of one layer.
pub(super) fn extension_names(entry: &ash::Entry, layer: Option<&CStr>) -> Vec<vk::ExtensionProperties> {
    // SAFETY: the entry is valid. A missing layer gives an error, here an empty list.
    unsafe { entry.enumerate_instance_extension_properties(layer) }.unwrap_or_default()
}

/// Returns true if an extension is among these.
pub fn has(extensions: &[vk::ExtensionProperties], name: &CStr) -> bool {
    extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name))
}
