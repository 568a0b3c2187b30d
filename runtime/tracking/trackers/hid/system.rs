//! Accesses the machine's HID devices through hidapi (hidraw on Linux, the HID class driver on Windows).

use super::HidError;
use super::device::Bus;

/// The HID bus of this machine.
///
/// # Errors
/// [`HidError::System`] if hidapi does not start, on systems other than Linux and Windows, and in a build without the
/// feature `trackers`.
pub fn system_bus() -> Result<Box<dyn Bus>, HidError> {
    #[cfg(all(any(target_os = "linux", windows), feature = "trackers"))]
    return hid::open();
    #[cfg(not(all(any(target_os = "linux", windows), feature = "trackers")))]
    Err(HidError::System(match cfg!(any(target_os = "linux", windows)) {
        true => "this program was built without the feature `trackers`. Use udp:// or a recording".into(),
        false => "HID trackers are supported on Linux and Windows. On this system use udp:// or pupil://".into(),
    }))
}

#[cfg(all(any(target_os = "linux", windows), feature = "trackers"))]
mod hid {
    use super::super::descriptor::{LONGEST_DESCRIPTOR, LONGEST_REPORT};
    use super::super::device::{Bus, Info, Port};
    use super::HidError;
    use std::{ffi::CString, time::Duration};

    /// The remedy for a user who may not read a device.
    const REFUSED: &str = match cfg!(windows) {
        true => "another program may hold it",
        false => "a udev rule with TAG+=\"uaccess\" lets users read it",
    };

    pub fn open() -> Result<Box<dyn Bus>, HidError> {
        let api = hidapi::HidApi::new().map_err(|e| HidError::System(format!("HID devices: {e}")))?;
        Ok(Box::new(HidapiBus(api)))
    }

    struct HidapiBus(hidapi::HidApi);

    struct HidapiPort(hidapi::HidDevice);

    fn gone(error: hidapi::HidError) -> HidError {
        HidError::Port(error.to_string())
    }

    impl Bus for HidapiBus {
        fn list(&mut self) -> Result<Vec<Info>, HidError> {
            self.0.refresh_devices().map_err(|e| HidError::System(format!("HID devices: {e}")))?;
            let mut found: Vec<Info> = Vec::new();
            for device in self.0.device_list() {
                let path = device.path().to_string_lossy().into_owned();
                // hidapi lists a device once per application collection.
                if found.iter().any(|f| f.path == path) {
                    continue;
                }
                let (vendor, product) = (device.vendor_id(), device.product_id());
                let name = device
                    .product_string()
                    .filter(|n| !n.is_empty())
                    .map_or_else(|| format!("{vendor:04x}:{product:04x}"), str::to_owned);
                found.push(Info { path, vendor, product, name });
            }
            Ok(found)
        }

        fn open(&mut self, info: &Info) -> Result<Box<dyn Port>, HidError> {
            let path =
                CString::new(info.path.as_str()).map_err(|_| HidError::Port("its path has a zero byte".into()))?;
            let device =
                self.0.open_path(&path).map_err(|e| HidError::Port(format!("{}: {e} ({REFUSED})", info.path)))?;
            Ok(Box::new(HidapiPort(device)))
        }
    }

    impl Port for HidapiPort {
        fn descriptor(&mut self) -> Result<Vec<u8>, HidError> {
            let mut bytes = vec![0; LONGEST_DESCRIPTOR + 1];
            let length = self.0.get_report_descriptor(&mut bytes).map_err(gone)?;
            bytes.truncate(length);
            Ok(bytes)
        }

        fn read(&mut self, report: &mut [u8], timeout: Duration) -> Result<usize, HidError> {
            let timeout = i32::try_from(timeout.as_millis()).unwrap_or(i32::MAX);
            self.0.read_timeout(report, timeout).map_err(gone)
        }

        fn get_feature(&mut self, report: &mut [u8]) -> Result<usize, HidError> {
            let mut whole = report.to_vec();
            if cfg!(windows) {
                // Windows refuses buffers that are shorter than the device's longest feature report.
                whole.resize(report.len().max(1 + LONGEST_REPORT), 0);
            }
            let length = self.0.get_feature_report(&mut whole).map_err(gone)?.min(report.len());
            report.copy_from_slice(&whole[..report.len()]);
            Ok(length)
        }

        fn set_feature(&mut self, report: &[u8]) -> Result<(), HidError> {
            self.0.send_feature_report(report).map_err(gone)
        }
    }
}
