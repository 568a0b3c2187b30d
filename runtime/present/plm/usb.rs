//! Opens the controller of this machine through hidapi (hidraw on Linux, the HID class driver on Windows).

use super::error::PlmError;
use super::link::Link;

/// Opens the controller with this number, in the order of the paths of the system and from 0. A controller has up to
/// two interfaces, and the lowest one takes the commands.
///
/// # Errors
/// [`PlmError::NoController`], [`PlmError::Link`], and [`PlmError::Unsupported`] on systems other than Linux and Windows
/// and in a build without the feature `plm`.
pub fn open_usb(unit: u8) -> Result<Box<dyn Link>, PlmError> {
    #[cfg(all(any(target_os = "linux", windows), feature = "plm"))]
    return hid::open(usize::from(unit));
    #[cfg(not(all(any(target_os = "linux", windows), feature = "plm")))]
    let _ = unit;
    #[cfg(not(all(any(target_os = "linux", windows), feature = "plm")))]
    Err(PlmError::Unsupported {
        reason: match cfg!(any(target_os = "linux", windows)) {
            true => "this program was built without the feature `plm`".into(),
            false => "a DLPC900 is supported on Linux and Windows".into(),
        },
    })
}

#[cfg(all(any(target_os = "linux", windows), feature = "plm"))]
mod hid {
    use super::super::error::PlmError;
    use super::super::link::{Link, REPORT};
    use std::ffi::CStr;
    use std::time::{Duration, Instant};

    const VENDOR: u16 = 0x0451;
    const PRODUCT: u16 = 0xC900;

    /// The remedy for a user who may not open a device.
    const REFUSED: &str = match cfg!(windows) {
        true => "another program may hold it",
        false => "a udev rule with TAG+=\"uaccess\" lets users open it",
    };

    fn failed(error: impl std::fmt::Display) -> PlmError {
        PlmError::Link { reason: error.to_string() }
    }

    pub fn open(unit: usize) -> Result<Box<dyn Link>, PlmError> {
        let api = hidapi::HidApi::new().map_err(failed)?;
        let controllers = api.device_list().filter(|d| (d.vendor_id(), d.product_id()) == (VENDOR, PRODUCT));
        let path = of_unit(controllers.map(|d| (d.path(), d.interface_number())), unit)?;
        let refused = |e| failed(format!("{}: {e} ({REFUSED})", path.to_string_lossy()));
        let device = api.open_path(path).map_err(refused)?;
        Ok(Box::new(Usb { device: Some(device), begun: Instant::now() }))
    }

    /// Returns the path of the controller with this number, among the paths and numbers of all interfaces.
    fn of_unit<'a>(interfaces: impl Iterator<Item = (&'a CStr, i32)>, unit: usize) -> Result<&'a CStr, PlmError> {
        let mut found: Vec<_> = interfaces.collect();
        let lowest = found.iter().map(|(_, interface)| *interface).min();
        found.retain(|(_, interface)| Some(*interface) == lowest);
        found.sort_unstable();
        found.get(unit).map(|(path, _)| *path).ok_or(PlmError::NoController)
    }

    struct Usb {
        device: Option<hidapi::HidDevice>,
        begun: Instant,
    }

    impl Usb {
        fn device(&self) -> Result<&hidapi::HidDevice, PlmError> {
            self.device.as_ref().ok_or_else(|| failed("it is closed"))
        }
    }

    impl Link for Usb {
        fn write(&mut self, report: &[u8; REPORT]) -> Result<(), PlmError> {
            // Reports of this device have no number, and hidapi expects a 0 for it.
            let mut numbered = [0; REPORT + 1];
            numbered[1..].copy_from_slice(report);
            let written = self.device()?.write(&numbered).map_err(failed)?;
            if written < REPORT { Err(failed(format!("{written} of {REPORT} bytes were sent"))) } else { Ok(()) }
        }

        fn read(&mut self, report: &mut [u8; REPORT], timeout: Duration) -> Result<usize, PlmError> {
            // A part of a millisecond counts as one, so that a wait is never shorter.
            let timeout = i32::try_from(timeout.as_nanos().div_ceil(1_000_000)).unwrap_or(i32::MAX);
            self.device()?.read_timeout(report, timeout).map_err(failed)
        }

        fn close(&mut self) {
            self.device = None;
        }

        fn now(&self) -> Duration {
            self.begun.elapsed()
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        /// Two controllers, each with an interface for commands and another one, in the order in which they were found.
        #[test]
        fn a_unit_is_a_controller_and_not_an_interface() {
            let found = [(c"usb-3:1", 1), (c"usb-3:0", 0), (c"usb-1:0", 0), (c"usb-1:1", 1)];
            let path = |unit| of_unit(found.into_iter(), unit);
            assert_eq!(path(0).unwrap(), c"usb-1:0");
            assert_eq!(path(1).unwrap(), c"usb-3:0");
            assert!(matches!(path(2), Err(PlmError::NoController)));
            assert!(matches!(of_unit(std::iter::empty(), 0), Err(PlmError::NoController)));
            // Systems that do not number interfaces report -1 for each.
            assert_eq!(of_unit([(c"b", -1), (c"a", -1)].into_iter(), 1).unwrap(), c"b");
        }
    }
}
