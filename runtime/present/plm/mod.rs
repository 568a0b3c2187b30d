//! Sets up and starts a phase light modulator (PLM) with Texas Instruments' controller DLPC900, over USB.
//!
//! A [`Controller`] talks over a [`Link`], which is the USB connection of this machine ([`open_usb`]) or a
//! [`Simulated`] controller. [`open`] chooses between them for the `[device]` of a display file. The steps are
//! [`Controller::prepare`], [`Controller::wait_for_source`], [`Controller::begin`], [`Controller::poll`] about once per
//! second, and [`Controller::sleep`].
//!
//! `report` packs commands into reports, `values` reads and writes their data, `table` computes the 24 patterns of a
//! video frame, and `setup` has the order of the steps. TI's guide DLPU018J defines the commands and their bytes.
//! TI's own program has the commands that the guide lacks. The driver is not yet tested on hardware.

mod command;
mod controller;
mod error;
mod link;
mod report;
mod setup;
mod simulated;
mod simulated_state;
mod table;
#[cfg(test)]
mod tests;
mod usb;
mod values;

pub use command::Command;
pub use controller::{Controller, Flips, Identity, State};
pub use error::PlmError;
pub use link::{Link, REPORT};
pub use setup::{Condition, SOURCE_TIME};
pub use simulated::Simulated;
pub use simulated_state::{Faults, LitPlane};
pub use table::{PLANES, exposure_us, plane_of_bit, usual_leds};
pub use usb::open_usb;
pub use values::{HardwareFault, HardwareStatus, Leds, MainStatus, Version, Versions};

use eyebox_optics::Device;

/// Opens the controller of a display, or a simulated one if its file requests it.
///
/// # Errors
/// [`PlmError::NoController`], [`PlmError::Link`] and [`PlmError::Unsupported`].
pub fn open(device: &Device) -> Result<Controller, PlmError> {
    Controller::new(if device.simulated { Box::new(Simulated::on(device.link)) } else { open_usb(device.unit)? })
}
