//! The machine's own HID devices: hidraw through hidapi, on Linux.

use super::HidError;
use super::device::Bus;

/// The bus of this machine.
///
/// # Errors
/// [`HidError::System`] where hidapi does not start, and on systems other than Linux.
#[cfg(all(target_os = "linux", feature = "trackers"))]
pub fn system_bus() -> Result<Box<dyn Bus>, HidError> {
    let api = hidapi::HidApi::new().map_err(|e| HidError::System(format!("HID devices: {e}")))?;
    Ok(Box::new(linux::HidapiBus(api)))
}

/// The bus of this machine.
///
/// # Errors
/// [`HidError::System`]: only Linux has one, and only a build with the feature `trackers` reads it.
#[cfg(not(all(target_os = "linux", feature = "trackers")))]
pub fn system_bus() -> Result<Box<dyn Bus>, HidError> {
    Err(HidError::System(match cfg!(target_os = "linux") {
        true => "this program was built without the feature `trackers`: use udp:// or a recording".into(),
        false => "HID trackers are read through Linux's hidraw: on this system use udp:// or pupil://".into(),
    }))
}

#[cfg(all(target_os = "linux", feature = "trackers"))]
mod linux {
    use super::super::descriptor::LONGEST_DESCRIPTOR;
    use super::super::device::{Bus, Info, Port};
    use super::HidError;
    use std::{ffi::CString, time::Duration};

    pub struct HidapiBus(pub hidapi::HidApi);

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
            let device = self.0.open_path(&path).map_err(|e| {
                HidError::Port(format!("{}: {e} (a udev rule with TAG+=\"uaccess\" lets users read it)", info.path))
            })?;
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
            self.0.get_feature_report(report).map_err(gone)
        }

        fn set_feature(&mut self, report: &[u8]) -> Result<(), HidError> {
            self.0.send_feature_report(report).map_err(gone)
        }
    }
}
