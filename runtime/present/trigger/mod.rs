//! Gives pulses with the light of sets, and takes pulses that advance content.
//!
//! A [`TriggerOutput`] gives one pulse per call and never waits for a reader. A [`TriggerInput`] waits for pulses and
//! states when each arrived. The lines are serial ports, GPIO lines of Linux, and UDP.

mod error;
mod gpio;
mod line;
mod serial;
#[cfg(test)]
mod tests;
mod udp;

pub use error::TriggerError;
pub use line::{Given, Pulse, TriggerInput, TriggerOutput};
pub use serial::{SerialLine, SerialOutput, SerialPulses};

use eyebox_optics::{TriggerIn, TriggerOut, TriggerPort};

/// Opens the line of a `[trigger_out]`.
///
/// # Errors
/// [`TriggerError::Setting`], [`TriggerError::Open`], and [`TriggerError::Unsupported`] for a line that this build or
/// this system has not.
pub fn open_output(trigger: &TriggerOut) -> Result<Box<dyn TriggerOutput>, TriggerError> {
    trigger.check().map_err(TriggerError::Setting)?;
    match trigger.port().map_err(TriggerError::Setting)? {
        TriggerPort::Serial { path, baud } => serial::open_output(&path, baud, trigger),
        TriggerPort::Gpio { chip, line } => gpio::open_output(&chip, line, trigger),
        TriggerPort::Udp { address } => udp::open_output(&address, trigger),
    }
}

/// Opens the line of a `[trigger_in]`.
///
/// # Errors
/// The same errors as [`open_output`] returns.
pub fn open_input(trigger: &TriggerIn) -> Result<Box<dyn TriggerInput>, TriggerError> {
    trigger.check().map_err(TriggerError::Setting)?;
    match trigger.port().map_err(TriggerError::Setting)? {
        TriggerPort::Serial { path, baud } => serial::open_input(&path, baud, trigger),
        TriggerPort::Gpio { chip, line } => gpio::open_input(&chip, line, trigger),
        TriggerPort::Udp { address } => udp::open_input(&address, trigger),
    }
}
