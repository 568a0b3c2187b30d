//! What is remembered of a device that was tried: beside its pipelines, for this driver and these kernels.

use super::{cache, report::Tested};
use ash::vk;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// What was tried, and how it went.
#[derive(Serialize, Deserialize)]
struct TestRecord {
    device: String,
    driver: u32,
    kernels: u32,
    tested: Tested,
}

/// Where it is kept, for one device, and what has to be the same.
pub(crate) struct Record {
    file: PathBuf,
    device: String,
    driver: u32,
}

impl Record {
    /// In `folder`, or where the user keeps such things.
    pub(crate) fn new(folder: Option<&Path>, properties: &vk::PhysicalDeviceProperties) -> Option<Self> {
        let device: String =
            properties.device_name_as_c_str().map_or_else(|_| String::new(), |n| n.to_string_lossy().into_owned());
        let file = cache::file(folder, properties, "tested", "json")?;
        Some(Self { file, device, driver: properties.driver_version })
    }

    /// What came of it, if this device was tried with this driver and these kernels.
    pub(crate) fn read(&self) -> Option<Tested> {
        let bytes = crate::files::read::bytes(&self.file, crate::files::read::TEXT).ok()?;
        let kept: TestRecord = serde_json::from_slice(&bytes).ok()?;
        let is_this = kept.device == self.device && kept.driver == self.driver && kept.kernels == kernels();
        is_this.then_some(kept.tested)
    }

    /// Keeps it; a folder that cannot be written to is no harm: the device is tried again.
    pub(crate) fn write(&self, tested: Tested) {
        let kept = TestRecord { device: self.device.clone(), driver: self.driver, kernels: kernels(), tested };
        let _ = serde_json::to_vec(&kept).is_ok_and(|text| cache::put(&self.file, &text));
    }
}

/// The kernels of this build, as a number.
fn kernels() -> u32 {
    eyebox_spirv::ALL.iter().fold(0, |sum, module| crc32c::crc32c_append(sum, bytemuck::cast_slice(module.words())))
}
