//! Stores the test result of a device next to its pipelines, for this driver and these kernels.

use super::{cache, report::Tested};
use ash::vk;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The stored result, with the device, driver and kernels that were tested.
#[derive(Serialize, Deserialize)]
struct TestRecord {
    device: String,
    driver: u32,
    kernels: u32,
    tested: Tested,
}

/// The file for one device, with the values that must match.
pub(crate) struct Record {
    file: PathBuf,
    device: String,
    driver: u32,
}

impl Record {
    /// Returns the record in `folder`, or in the user's cache folder.
    pub(crate) fn new(folder: Option<&Path>, properties: &vk::PhysicalDeviceProperties) -> Option<Self> {
        let device: String =
            properties.device_name_as_c_str().map_or_else(|_| String::new(), |n| n.to_string_lossy().into_owned());
        let file = cache::file(folder, properties, "tested", "json")?;
        Some(Self { file, device, driver: properties.driver_version })
    }

    /// Returns the result, if this device was tested with this driver and these kernels.
    pub(crate) fn read(&self) -> Option<Tested> {
        let bytes = crate::files::read::bytes(&self.file, crate::files::read::TEXT).ok()?;
        let kept: TestRecord = serde_json::from_slice(&bytes).ok()?;
        let is_this = kept.device == self.device && kept.driver == self.driver && kept.kernels == kernels();
        is_this.then_some(kept.tested)
    }

    /// Stores the result. If the folder cannot be written, the device is only tested again.
    pub(crate) fn write(&self, tested: Tested) {
        let kept = TestRecord { device: self.device.clone(), driver: self.driver, kernels: kernels(), tested };
        let _ = serde_json::to_vec(&kept).is_ok_and(|text| cache::put(&self.file, &text));
    }
}

/// Returns a checksum of the kernels of this build.
fn kernels() -> u32 {
    eyebox_spirv::ALL.iter().fold(0, |sum, module| crc32c::crc32c_append(sum, bytemuck::cast_slice(module.words())))
}
