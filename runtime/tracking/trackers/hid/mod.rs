//! Reads HID eye trackers of usage page 0x12 by their report descriptor (HUTRR74).
//!
//! The module [`descriptor`] reads the descriptor of the device. The module [`layout`] finds the relevant fields by
//! their usages, or [`device_file`] states their places. The module [`report`] extracts the bits from the bytes.
//! [`device`] finds the device, starts it, and finds it again after it was unplugged. All access to the machine is
//! behind [`Bus`](device::Bus) and [`Port`](device::Port), so that everything is tested without hardware.
//! [`system_bus`] gives the machine's own bus.

pub mod descriptor;
pub mod device;
pub mod device_file;
pub mod layout;
pub mod report;

mod describe;
mod names;
mod system;
#[cfg(test)]
mod tests;

pub use describe::{Description, FieldText, ReportText};
pub use descriptor::Descriptor;
pub use device::{HidSource, Listed, list};
pub use device_file::DeviceFile;
pub use layout::Layout;
pub use report::Decoder;
pub use system::system_bus;

use eyebox_base::error::Reason;

/// An error of a HID device.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum HidError {
    /// The report descriptor cannot be read.
    #[error("the report descriptor at byte {at}: {reason}")]
    Descriptor {
        /// Offset of the item, bytes.
        at: usize,
        /// The problem of the item.
        reason: Reason,
    },
    /// The device is not an eye tracker.
    #[error("{name} is not an eye tracker: {reason}")]
    NotAnEyeTracker {
        /// Name of the device.
        name: String,
        /// The reason, with the device's actual kind.
        reason: Reason,
    },
    /// This system has no HID that eyebox can use.
    #[error("{0}")]
    System(String),
    /// The device answered with an error, or is gone.
    #[error("{0}")]
    Port(String),
}
