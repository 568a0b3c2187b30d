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
        let mut found: Vec<_> =
            api.device_list().filter(|d| (d.vendor_id(), d.product_id()) == (VENDOR, PRODUCT)).collect();
        let lowest = found.iter().map(|device| device.interface_number()).min();
        found.retain(|device| Some(device.interface_number()) == lowest);
        found.sort_by_key(|device| device.path());
        let found = found.get(unit).ok_or(PlmError::NoController)?;
        let refused = |e| failed(format!("{}: {e} ({REFUSED})", found.path().to_string_lossy()));
        let device = api.open_path(found.path()).map_err(refused)?;
        Ok(Box::new(Usb { device: Some(device), begun: Instant::now() }))
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
}
