//! Requests validation from the Khronos validation layer, with its synchronization validation.
//!
//! Layers of Vulkan 1.4 leave the accesses of shaders out of synchronization validation unless the setting
//! `syncval_shader_accesses_heuristic` includes them. Only `VK_EXT_layer_settings` passes settings to the layer. Older
//! layers include these accesses by default and have only `VK_EXT_validation_features`.

use super::error::EngineError;
use super::extensions::{extension_names, has};
use ash::{ext, vk};
use std::ffi::CStr;

const LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Settings of layers that have `VK_EXT_layer_settings`. All of them are switched on.
const SETTINGS: [&CStr; 2] = [c"validate_sync", c"syncval_shader_accesses_heuristic"];

/// The interface of the installed layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Validation {
    /// Settings by name, with the extension `VK_EXT_layer_settings`.
    Settings,
    /// Features by number, with the extension `VK_EXT_validation_features`.
    Features,
}

impl Validation {
    /// Finds the layer, with its best interface.
    pub(super) fn find(entry: &ash::Entry, loader: &[vk::ExtensionProperties]) -> Result<Self, EngineError> {
        let missing = |what: &str| EngineError::Unsuitable {
            device: "the Vulkan loader".into(),
            reason: format!("validation was requested, but {what} is not installed. `tools/setup.sh` installs it"),
        };
        // SAFETY: The entry is valid.
        let known = unsafe { entry.enumerate_instance_layer_properties() }.unwrap_or_default();
        if !known.iter().any(|l| l.layer_name_as_c_str() == Ok(LAYER)) {
            return Err(missing("the layer VK_LAYER_KHRONOS_validation"));
        }
        let offered = extension_names(entry, Some(LAYER));
        let reports = has(loader, ext::debug_utils::NAME) || has(&offered, ext::debug_utils::NAME);
        let best = Self::best(|name| has(&offered, name)).filter(|_| reports);
        best.ok_or_else(|| missing("a validation layer with VK_EXT_validation_features and VK_EXT_debug_utils"))
    }

    fn best(offers: impl Fn(&CStr) -> bool) -> Option<Self> {
        [Self::Settings, Self::Features].into_iter().find(|one| offers(one.extension()))
    }

    pub(super) fn layer(self) -> &'static CStr {
        LAYER
    }

    /// The extension of the interface, which the instance enables.
    pub(super) fn extension(self) -> &'static CStr {
        match self {
            Self::Settings => ext::layer_settings::NAME,
            Self::Features => ext::validation_features::NAME,
        }
    }
}

/// Returns the settings of a layer with `VK_EXT_layer_settings`.
pub(super) fn settings() -> [vk::LayerSettingEXT<'static>; SETTINGS.len()] {
    static ON: vk::Bool32 = vk::TRUE;
    // The method `values` counts bytes, but the layer counts values of the type.
    let (value_count, p_values) = (1, std::ptr::from_ref(&ON).cast());
    SETTINGS.map(|name| vk::LayerSettingEXT {
        value_count,
        p_values,
        ..vk::LayerSettingEXT::default().layer_name(LAYER).setting_name(name).ty(vk::LayerSettingTypeEXT::BOOL32)
    })
}

/// Returns the features of a layer with `VK_EXT_validation_features`.
pub(super) fn features() -> vk::ValidationFeaturesEXT<'static> {
    vk::ValidationFeaturesEXT::default()
        .enabled_validation_features(&[vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_used_when_the_layer_has_them() {
        let (new, old) = (ext::layer_settings::NAME, ext::validation_features::NAME);
        let best = |offered: &[&CStr]| Validation::best(|name| offered.contains(&name));
        assert_eq!(best(&[old, new]), Some(Validation::Settings));
        assert_eq!(best(&[old]), Some(Validation::Features));
        assert_eq!(best(&[]), None);
    }
}
