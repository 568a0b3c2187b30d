//! Stores the pipeline cache on disk, so that a driver does not compile again at the next start.
//!
//! It is a convenience. A file that cannot be read, is broken, or is from another driver is ignored, and a folder
//! that cannot be written leaves nothing behind. The driver checks the header as well. Since some drivers crashed on
//! a cut file, the length and a checksum precede its data.

use ash::vk;
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"eyebox\x01\0";
/// Larger files are from another program.
const LARGEST: u64 = 256 << 20;

/// Returns this device's file of a kind, in `folder` or in the user's cache folder.
pub(crate) fn file(
    folder: Option<&Path>,
    properties: &vk::PhysicalDeviceProperties,
    kind: &str,
    ending: &str,
) -> Option<PathBuf> {
    let folder = folder.map(Path::to_owned).or_else(crate::files::cache_folder)?;
    let id: String = properties.pipeline_cache_uuid.iter().map(|b| format!("{b:02x}")).collect();
    Some(folder.join(format!("{kind}-{:x}-{id}.{ending}", properties.driver_version)))
}

/// Writes a whole file and its folder, and returns true if that succeeded.
pub(crate) fn put(path: &Path, bytes: &[u8]) -> bool {
    let made = path.parent().is_some_and(|folder| std::fs::create_dir_all(folder).is_ok());
    made && crate::files::write_file(path, |out| out.write_all(bytes)).is_ok()
}

/// Returns the driver's data, if the file is complete and was written for this device.
pub(crate) fn read(path: &Path, properties: &vk::PhysicalDeviceProperties) -> Option<Vec<u8>> {
    if std::fs::metadata(path).ok()?.len() > LARGEST {
        return None;
    }
    let file = crate::files::read::bytes(path, crate::files::read::RESULTS).ok()?;
    let data = unpack(&file)?;
    is_for(data, properties).then(|| data.to_vec())
}

/// Writes the data next to the file and then replaces it. Returns true if that succeeded. Data that could not be read
/// back is not written: Mesa 26's software device gives 20 bytes, which name no device.
pub(crate) fn write(path: &Path, data: &[u8], properties: &vk::PhysicalDeviceProperties) -> bool {
    is_for(data, properties) && put(path, &pack(data))
}

fn pack(data: &[u8]) -> Vec<u8> {
    let mut file = MAGIC.to_vec();
    file.extend((data.len() as u64).to_le_bytes());
    file.extend(crc32c::crc32c(data).to_le_bytes());
    file.extend(data);
    file
}

fn unpack(file: &[u8]) -> Option<&[u8]> {
    let rest = file.strip_prefix(MAGIC)?;
    let (length, rest) = rest.split_first_chunk::<8>()?;
    let (sum, data) = rest.split_first_chunk::<4>()?;
    let whole = u64::from_le_bytes(*length) == data.len() as u64 && u32::from_le_bytes(*sum) == crc32c::crc32c(data);
    whole.then_some(data)
}

/// Returns true if the driver's header (Vulkan 1.2, VkPipelineCacheHeaderVersionOne) names this device.
fn is_for(data: &[u8], properties: &vk::PhysicalDeviceProperties) -> bool {
    let word = |i: usize| data.get(4 * i..4 * i + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    word(0).is_some_and(|n| n >= 32)
        && word(1) == Some(1)
        && word(2) == Some(properties.vendor_id)
        && word(3) == Some(properties.device_id)
        && data.get(16..32) == Some(properties.pipeline_cache_uuid.as_slice())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device() -> vk::PhysicalDeviceProperties {
        vk::PhysicalDeviceProperties { vendor_id: 7, device_id: 9, pipeline_cache_uuid: [3; 16], ..Default::default() }
    }

    fn data() -> Vec<u8> {
        let mut data: Vec<u8> = [32u32, 1, 7, 9].iter().flat_map(|w| w.to_le_bytes()).collect();
        data.extend([3; 16]);
        data.extend(b"compiled");
        data
    }

    #[test]
    fn comes_back_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deeper").join("cache.bin");
        assert_eq!(read(&path, &device()), None);
        assert!(!write(&path, &data()[..20], &device()) && !path.exists());
        assert!(write(&path, &data(), &device()));
        assert_eq!(read(&path, &device()), Some(data()));
        assert_eq!(read(&path, &vk::PhysicalDeviceProperties { device_id: 8, ..device() }), None);
        let whole = std::fs::read(&path).unwrap();
        for cut in 0..whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            assert_eq!(read(&path, &device()), None, "cut at {cut}");
        }
        for at in 0..whole.len() {
            let mut flipped = whole.clone();
            flipped[at] ^= 0x10;
            std::fs::write(&path, &flipped).unwrap();
            assert_eq!(read(&path, &device()), None, "flipped at {at}");
        }
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_tolerated() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "").unwrap();
        assert!(!write(&file.join("cache.bin"), &data(), &device()));
    }
}
