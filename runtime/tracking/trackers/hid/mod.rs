//! HID eye trackers: usage page 0x12, driven from the report descriptor (HUTRR74).
//!
//! Along the way of a report: [`descriptor`] reads what the device says of itself, [`layout`] finds the fields that
//! matter by their usages, or [`device_file`] tells where they are; [`report`] takes the bits out of the bytes;
//! [`device`] finds the device, starts it, and finds it again after it was pulled out. What touches the machine is
//! behind [`Bus`](device::Bus) and [`Port`](device::Port), so that all of it is tested without hardware; the
//! machine's own are [`system_bus`]'s.

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

/// What can be wrong with a HID device.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum HidError {
    /// A report descriptor that cannot be read.
    #[error("the report descriptor, at byte {at}: {reason}")]
    Descriptor {
        /// Offset of the item.
        at: usize,
        /// What is wrong.
        reason: Reason,
    },
    /// A device that is something else.
    #[error("{name} is not an eye tracker: {reason}")]
    NotAnEyeTracker {
        /// Its name.
        name: String,
        /// Why.
        reason: Reason,
    },
    /// This system has no HID that eyebox can use.
    #[error("{0}")]
    System(String),
    /// The device answered with an error, or is gone.
    #[error("{0}")]
    Port(String),
}
